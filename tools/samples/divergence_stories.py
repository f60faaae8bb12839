"""Pairs for KA6: one keystore, several meanings. Each is about the talker, under the default profiles."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import LISTENER_GRANT, ONE, QUIET, TALKER, TWO, governed, listener, with_grant, with_rules
from .documents import DISCOVERY, Criterion, Permissions, Rule, TopicRule
from .store import Store
from .story import Case, Story, pair

COMMAND = "rt/cmd_vel"
BOTH = (0, 5)
"""Domains of a robot and of its test bench."""


def stories() -> Iterator[Story]:
    """All pairs of KA6."""
    yield from _participants()
    yield from _partitions()
    yield from _rules()
    yield from _values()


def _in(store: Store, *domains: int, **fields: object) -> Store:
    """The keystore with its governance for these domains."""
    return governed(store, replace(QUIET, domains=domains, **fields))


def _for(domains: tuple[int, ...], *rules: Rule) -> tuple[Rule, ...]:
    return tuple(replace(rule, domains=domains) for rule in (*rules, DISCOVERY))


def _participants() -> Iterator[Story]:
    talking = Rule(publish=("rt/chatter",))
    yield from pair(
        "KA601",
        bad=Case(
            "The governance covers domains 0 and 5, the talker's rules only domain 0. Under Fast DDS the talker "
            "also publishes in domain 5.",
            _in(ONE, *BOTH),
        ),
        good=Case("The talker's rules are for both domains.", _in(with_grant(rules=_for(BOTH, talking)), *BOTH)),
    )
    open_topic = (TopicRule(expression="rt/clock", write_access_control=False), TopicRule())
    yield from pair(
        "KA602",
        bad=Case(
            "The governance covers domains 0 and 5 and lets everybody publish /clock; the talker's rules are for "
            "domain 0. Cyclone DDS still lets it join domain 5.",
            _in(ONE, *BOTH, topics=open_topic),
        ),
        good=Case(
            "The talker's rules are for both domains.",
            _in(with_grant(rules=_for(BOTH, talking)), *BOTH, topics=open_topic),
        ),
    )
    yield from pair(
        "KA603",
        bad=Case(
            "The robot is in domain 7, but the governance covers domain 0. Fast DDS starts, without protection and "
            "without a topic; the others refuse.",
            ONE,
        ),
        good=Case(
            "Governance and permissions are for domain 7 too.",
            _in(with_grant(rules=_for((0, 7), talking)), 0, 7),
        ),
        options=("--domain", "7"),
    )


def _partitions() -> Iterator[Story]:
    command = Rule(publish=(COMMAND,))
    here = Rule(publish=(Criterion(topics=(COMMAND,), partitions=("lab",)),))
    yield from pair(
        "KA604",
        bad=Case(
            "The talker may publish /cmd_vel except in the partition lab. Fast DDS denies it everywhere; so does "
            "Cyclone DDS, in its own way.",
            with_rules(replace(here, allow=False), command),
        ),
        good=Case("Only an allow rule, for the default partition.", with_rules(command)),
    )
    yield from pair(
        "KA605",
        bad=Case(
            "A deny rule takes /cmd_vel from the talker, a later one allows it in the partition lab. Cyclone DDS 11 "
            "denies it only in the default one. (The talker may read the topic, or Cyclone DDS had none.)",
            with_rules(replace(command, allow=False), here, Rule(subscribe=(COMMAND,))),
        ),
        good=Case("Neither rule: what is not allowed is denied.", ONE),
    )
    apart = (
        Criterion(topics=("rt/chatter",), partitions=("public",)),
        Criterion(topics=("rt/map",), partitions=("private",)),
    )
    yield from pair(
        "KA606",
        bad=Case(
            "One rule allows /chatter in the partition public and /map in private. Under Fast DDS the talker "
            "publishes /map in public.",
            with_rules(Rule(publish=apart)),
        ),
        good=Case("A rule for each partition.", with_rules(*(Rule(publish=(criterion,)) for criterion in apart))),
    )
    read = Criterion(topics=("rt/map",), partitions=("*",))
    secret = replace(read, partitions=("secret",))
    yield from pair(
        "KA637",
        bad=Case(
            "The talker may not read /map in the partition secret, but may in *. Its reader joins the partition * "
            "and meets the writers in secret.",
            with_rules(Rule(subscribe=(secret,), allow=False), Rule(subscribe=(read,))),
        ),
        good=Case(
            "The allowed partition is named.", with_rules(Rule(subscribe=(replace(read, partitions=("public",)),)))
        ),
    )
    yield from pair(
        "KA638",
        bad=Case(
            "The talker is meant to publish /map only with endpoints that have the data tag survey. Implementations "
            "ignore the tag: it may with all.",
            with_rules(Rule(publish=(Criterion(topics=("rt/map",), data_tag="survey"),))),
        ),
        good=Case("The rule has no tag.", with_rules(Rule(publish=("rt/map",)))),
    )
    two = tuple(Rule(publish=(Criterion(topics=("rt/map",), partitions=(name,)),)) for name in ("east", "west"))
    yield from pair(
        "KA607",
        bad=Case(
            "One rule allows /map in the partition east, the next in west. Fast DDS stops at the first, so nothing "
            "is published in west.",
            with_rules(*two),
        ),
        good=Case(
            "One rule lists both partitions.",
            with_rules(Rule(publish=(Criterion(topics=("rt/map",), partitions=("east", "west")),))),
        ),
    )


def _rules() -> Iterator[Story]:
    denied = replace(LISTENER_GRANT, rules=(Rule(publish=("rt/chatter",), allow=False), *LISTENER_GRANT.rules))
    yield from pair(
        "KA608",
        bad=Case(
            "A deny rule forbids the listener to publish /chatter. Cyclone DDS 0.10 denies it the whole topic: the "
            "listener hears nothing.",
            replace(TWO, enclaves=(TALKER, listener(permissions=Permissions(grants=(denied,))))),
        ),
        good=Case("No deny rule: what is not allowed is denied.", TWO),
    )
    yield from pair(
        "KA609",
        bad=Case(
            "The talker may relay /camera, which by the specification passes on what it cannot read. Fast DDS gives "
            "its reader the plain samples.",
            with_rules(Rule(publish=("rt/chatter",)), Rule(relay=("rt/camera",))),
        ),
        good=Case("Nothing is relayed.", ONE),
    )
    yield from pair(
        "KA610",
        bad=Case(
            "The talker may publish arm_[^s]. Fast DDS reads every arm but s. Cyclone DDS reads the arms ^ and s, "
            "which was to be left out.",
            with_rules(Rule(publish=("rt/arm_[^s]",))),
        ),
        good=Case("The arms are named.", with_rules(Rule(publish=("rt/arm_a", "rt/arm_b")))),
    )
    yield from pair(
        "KA611",
        bad=Case(
            "A deny rule for the arms a and b lacks its closing bracket: it denies one odd name, or none. Nothing "
            "else allows the arms today.",
            with_rules(Rule(publish=("rt/arm_[ab",), allow=False), Rule(publish=("rt/chatter",))),
        ),
        good=Case(
            "The bracket is closed.",
            with_rules(Rule(publish=("rt/arm_[ab]",), allow=False), Rule(publish=("rt/chatter",))),
        ),
    )


def _values() -> Iterator[Story]:
    yield from pair(
        "KA612",
        bad=Case(
            "The grant begins on New Year's Day in Tonga, 13 hours ahead. Cyclone DDS reads zones up to 12 hours: "
            "the talker's rights begin six weeks early.",
            with_grant(not_before="2027-01-01T00:00:00+13:00"),
        ),
        good=Case("The same instant in UTC.", with_grant(not_before="2026-12-31T11:00:00")),
    )
    yield from pair(
        "KA613",
        bad=Case(
            "The grant ends at midnight in Helsinki. Fast DDS ignores the zone, so on a robot set to UTC it ends "
            "two hours later.",
            with_grant(not_after="2100-01-01T00:00:00+02:00"),
        ),
        good=Case("It ends at the same instant, in UTC.", with_grant(not_after="2099-12-31T22:00:00")),
    )
    everywhere = Rule(publish=(COMMAND,), domains=BOTH)
    yield from pair(
        "KA614",
        bad=Case(
            "The talker may not publish /cmd_vel from domain 0 on. Fast DDS and Cyclone DDS read only domain 0: the "
            "next rule allows it in domain 5.",
            _in(
                with_grant(
                    rules=(
                        replace(everywhere, domains=((0, None),), allow=False),
                        everywhere,
                        *_for(BOTH, Rule(publish=("rt/chatter",))),
                    )
                ),
                *BOTH,
            ),
        ),
        good=Case(
            "Neither rule: what is not allowed is denied.",
            _in(with_grant(rules=_for(BOTH, Rule(publish=("rt/chatter",)))), *BOTH),
        ),
    )
    clock = TopicRule(expression="rt/clock", write_access_control=False)
    yield from pair(
        "KA615",
        bad=Case(
            "/clock is under access control, but topics that begin with c are not. On OpenDDS the second rule is "
            "enough, and the talker sets the clock.",
            _in(ONE, 0, topics=(TopicRule(expression="rt/clock"), replace(clock, expression="rt/c*"), TopicRule())),
        ),
        good=Case(
            "The rule without access control is the first that matches.", _in(ONE, 0, topics=(clock, TopicRule()))
        ),
        options=("--profile", "spec", "--profile", "opendds"),
    )
