"""Pairs for rules that decide nothing, change nothing, hang on their order, or are about nothing."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import LISTENER_GRANT, QUIET, TWO, governed, listener, with_grant, with_listener, with_rules
from .documents import DISCOVERY, DomainRule, Permissions, Rule, TopicRule
from .store import Store
from .story import Case, Story, pair

BOTH = (0, 5)
"""Domains of a robot and of its test bench."""

WORDS = ("arm", "base", "camera", "door", "elbow", "finger", "gear", "hand", "imu")
"""With a * on both sides of each, every set of them is a class of names of its own."""


def stories() -> Iterator[Story]:
    """All pairs."""
    yield from _governance()
    yield from _void()
    yield from _superfluous()
    yield from _ordered()
    yield from _names()
    yield from _too_much()


def _governance() -> Iterator[Story]:
    weak, strong = TopicRule(metadata="SIGN"), TopicRule(expression="rt/chatter")
    yield from pair(
        "KA422",
        bad=Case(
            "The governance encrypts /chatter, in a rule after the one for every topic, which only signs: /chatter "
            "is signed.",
            governed(with_rules(Rule(publish=("rt/chatter",))), replace(QUIET, topics=(weak, strong))),
        ),
        good=Case(
            "The rule for /chatter comes first.",
            governed(with_rules(Rule(publish=("rt/chatter",))), replace(QUIET, topics=(strong, weak))),
        ),
    )
    domains = tuple(replace(rule, domains=BOTH) for rule in (Rule(publish=("rt/chatter",)), DISCOVERY))
    robot, bench = DomainRule(domains=BOTH), replace(QUIET, domains=(5,))
    yield from pair(
        "KA423",
        bad=Case(
            "The governance encrypts all messages of domain 5, in a rule after the one for both domains, which only "
            "signs them.",
            governed(with_grant(rules=domains), robot, bench),
        ),
        good=Case("The rule for domain 5 comes first.", governed(with_grant(rules=domains), bench, robot)),
    )


def _void() -> Iterator[Story]:
    everything, secret = Rule(publish=("rt/arm/*",)), Rule(publish=("rt/arm/secret",), allow=False)
    yield from pair(
        "KA617",
        bad=Case(
            "The grant allows all topics of the arm, then denies one of them. The first rule that matches decides, "
            "so the denial never does.",
            with_rules(everything, secret),
        ),
        good=Case("The deny rule comes first, as `ros2 security` writes it.", with_rules(secret, everything)),
    )
    secrets = Rule(publish=("rt/arm/secret", "rt/leg/secret"), allow=False)
    legs = Rule(publish=("rt/leg/*",))
    yield from pair(
        "KA618",
        bad=Case(
            "A deny rule names a topic of the arm and one of the leg, but an earlier rule allows all of the arm's.",
            with_rules(everything, secrets, legs),
        ),
        good=Case(
            "One topic of the arm is allowed, by name.", with_rules(Rule(publish=("rt/arm/pose",)), secrets, legs)
        ),
    )


def _superfluous() -> Iterator[Story]:
    talking, status = Rule(publish=("rt/chatter",)), Rule(publish=("rt/chatter", "rt/status"))
    yield from pair(
        "KA619",
        bad=Case(
            "Two rules allow /chatter. Whoever removes it from one of them believes the right gone.",
            with_rules(talking, status),
        ),
        good=Case("Each rule has its own topics.", with_rules(talking, Rule(publish=("rt/status",)))),
    )
    yield from pair(
        "KA622",
        bad=Case(
            "A rule denies what nothing allows, and what the default denies anyway.",
            with_rules(Rule(publish=("rt/secret",), allow=False), talking),
        ),
        good=Case("There is no such rule.", with_rules(talking)),
    )
    bench = replace(talking, domains=(5,))
    announced = replace(DISCOVERY, domains=BOTH)
    yield from pair(
        "KA623",
        bad=Case(
            "A copy of the rule is for the test bench's domain, which the governance does not cover.",
            with_grant(rules=(talking, bench, announced)),
        ),
        good=Case(
            "The governance covers both domains.",
            governed(with_grant(rules=(talking, bench, announced)), replace(QUIET, domains=BOTH)),
        ),
    )


def _ordered() -> Iterator[Story]:
    states = Rule(publish=("rt/*_state",))
    yield from pair(
        "KA620",
        bad=Case(
            "All topics of the arm are denied and all states allowed: the order of the rules decides about the "
            "arm's state.",
            with_rules(Rule(publish=("rt/arm_*",), allow=False), states),
        ),
        good=Case(
            "Only the arm's state is denied: an exception to what is allowed.",
            with_rules(Rule(publish=("rt/arm_state",), allow=False), states),
        ),
    )
    yield from pair(
        "KA621",
        bad=Case(
            "One topic of the arm is denied before all of them are allowed: the usual exception, which depends on "
            "the order.",
            with_rules(Rule(publish=("rt/arm/secret",), allow=False), Rule(publish=("rt/arm/*",))),
        ),
        good=Case("There is no exception.", with_rules(Rule(publish=("rt/arm/*",)))),
    )


def _names() -> Iterator[Story]:
    arms = Rule(publish=("rt/arm_*",))
    yield from pair(
        "KA624",
        bad=Case(
            "The range in brackets ends before it begins: no arm with a digit is denied.",
            with_rules(Rule(publish=("rt/arm_[9-0]",), allow=False), arms),
        ),
        good=Case("The range goes upwards.", with_rules(Rule(publish=("rt/arm_[0-9]",), allow=False), arms)),
    )
    yield from pair(
        "KA625",
        bad=Case(
            "The prefix rt/ is missing, so the talker may not publish /chatter.",
            with_rules(Rule(publish=("chatter",), subscribe=("rt/clock",))),
        ),
        good=Case("The name is the DDS name.", with_rules(Rule(publish=("rt/chatter",), subscribe=("rt/clock",)))),
    )
    misspelt = replace(LISTENER_GRANT, rules=(Rule(subscribe=("rt/chater",)), DISCOVERY))
    yield from pair(
        "KA626",
        bad=Case(
            "The listener may subscribe to a topic that nobody may publish: its name is misspelt, and nobody reads "
            "what the talker publishes.",
            with_listener(permissions=Permissions(grants=(misspelt,))),
        ),
        good=Case("Both name one topic.", replace(TWO, enclaves=(TWO.enclaves[0], listener()))),
    )


def _too_much() -> Iterator[Story]:
    def store(words: tuple[str, ...]) -> Store:
        texts = tuple(f"rt/*{word}*" for word in words)
        return with_rules(Rule(publish=texts[::2], allow=False), Rule(publish=texts[1::2]))

    yield from pair(
        "KA627",
        bad=Case(
            "Rules name topics by nine words that may stand anywhere in them: too many classes of names to compare.",
            store(WORDS),
        ),
        good=Case("Three words are few enough.", store(WORDS[:3])),
    )
