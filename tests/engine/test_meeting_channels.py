"""Partitions that are patterns: what channels meet counts in both engines, in smaller systems, and as it is in DDS."""

from __future__ import annotations

import fnmatch
import itertools
import random
from datetime import datetime, timezone

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy.merging import merge
from keystore_audit.engine.case import Case
from keystore_audit.engine.native import NativeEngine
from keystore_audit.keystore.document import DomainRange, Text
from keystore_audit.keystore.typed import Criterion, Grant, Operation, Rule
from keystore_audit.model.channels import build_channels
from keystore_audit.model.domains import domain_classes
from keystore_audit.model.formal.permission import Decisions
from keystore_audit.model.formal.system import GrantAtom, RuleAtom, System
from keystore_audit.model.semantics import ReadRule, read_grant, read_rules
from keystore_audit.profiles import VARIANTS, Access
from keystore_audit.properties import Role, Status
from tests.amount import tried
from tests.engine.alloy.cloning import system_with_twins
from tests.engine.alloy_batch import compare_batch
from tests.engine.systems import CHATTER, LISTENER, TALKER, healthy_builder, lively, random_system, with_claims

SYSTEMS = tried(180, 90)
"""Random systems that are decided natively; the seeds are fixed."""

ASKED = tried(16, 4)
"""Of these, systems that the Analyzer is asked about."""


def meeting(system: System, seed: int) -> System:
    """The same system, in which channels of one domain and the same topic rules meet by chance."""
    chance = random.Random(f"meeting {seed}")
    around = [
        (atom.domain, *(number in rule.channels for rule in system.topic_rules))
        for number, atom in enumerate(system.channels)
    ]
    meets = tuple(
        frozenset(m for m in range(len(around)) if m != n and around[m] == around[n] and chance.random() < 0.4)
        for n in range(len(around))
    )
    return replace(system, meets=meets if any(meets) else ())


def doubled(system: System) -> System:
    """Each channel twice, as a topic more that is named wherever the first is, in places of claims too."""
    count = len(system.channels)

    def twice(some: frozenset[int]) -> frozenset[int]:
        return some | {number + count for number in some}

    return replace(
        system,
        channels=system.channels * 2,
        topic_rules=tuple(replace(rule, channels=twice(rule.channels)) for rule in system.topic_rules),
        rules=tuple(
            replace(rule, publish=twice(rule.publish), subscribe=twice(rule.subscribe), relay=twice(rule.relay))
            for rule in system.rules
        ),
        claims=tuple(
            replace(
                claim,
                source=replace(claim.source, channels=twice(claim.source.channels)),
                target=replace(claim.target, channels=twice(claim.target.channels)),
                left_out=twice(claim.left_out),
            )
            for claim in system.claims
        ),
        meets=(*system.meets, *(frozenset(number + count for number in others) for others in system.meets)),
    )


def some_system(seed: int) -> System:
    """By turns: one with twins, one with each channel twice, and one as it comes."""
    if seed % 3 == 0:
        return meeting(system_with_twins(seed), seed)
    drawn = meeting(with_claims(lively(random_system(seed), seed), seed), seed)
    return doubled(drawn) if seed % 3 == 1 else drawn


def statuses(system: System) -> dict[str, Status]:
    return {key: answer.status for key, answer in NativeEngine([system]).answers[0].items()}


def test_smaller_systems_have_the_same_answers_and_what_meets_matters() -> None:
    mattered = smaller = 0
    for seed in range(SYSTEMS):
        system = some_system(seed)
        found = statuses(system)
        few = merge(system).system
        assert statuses(few) == found, seed
        mattered += found != statuses(replace(system, meets=()))
        smaller += bool(few.meets) and len(few.channels) < len(system.channels)
    assert mattered >= tried(15)
    assert smaller >= tried(30)


@pytest.mark.alloy
def test_the_analyzer_says_the_same() -> None:
    """Of systems in which the channels that meet change an answer, whole and made smaller."""
    systems = [system for system in map(some_system, range(SYSTEMS)) if system.meets]
    systems = [system for system in systems if statuses(system) != statuses(replace(system, meets=()))][:ASKED]
    assert len(systems) == ASKED
    found = [statuses(system) for system in systems]
    ours = [{each: status is Status.HOLDS for each, status in statuses.items()} for statuses in found]
    for asked in (systems, [merge(system).system for system in systems]):
        assert list(compare_batch(asked, ours)) == [[]] * len(systems)


def test_a_right_by_a_pattern_is_told_with_its_line() -> None:
    """The listener may subscribe in another channel, which meets that of the talker."""
    b = healthy_builder()
    pattern = b.channel(0, "rt/chatter", "*")
    b.topic_rule(0, [pattern])
    b.rules[1] = replace(b.rules[1], subscribe=frozenset({pattern}))
    system = replace(b.system(), meets=(frozenset(), frozenset(), frozenset({CHATTER})))
    on_chatter = {Role.TRUST_DOMAIN: 0, Role.CHANNEL: CHATTER}
    (right,) = Case(system, on_chatter).rights(LISTENER, Operation.SUBSCRIBE)
    assert (right.location, right.by_pattern) == (b.rules[1].location, True)
    assert Case(replace(system, meets=()), on_chatter).rights(LISTENER, Operation.SUBSCRIBE) == []
    assert [right.by_pattern for right in Case(system, on_chatter).rights(TALKER, Operation.PUBLISH)] == [False]


PARTITIONS = ["a", "b", "*", "?", "a*", "?b", "[!a]", "a?", "*b*", ""]
NAMES = ["".join(letters) for n in range(4) for letters in itertools.product("abc", repeat=n)]
ENDPOINTS = [
    *NAMES,
    *("".join(each) for n in (1, 2, 3) for each in itertools.product("ab*?", repeat=n) if {*each} & {*"*?"}),
]
START, END = (datetime(year, 1, 1, tzinfo=timezone.utc) for year in (2020, 2030))


def text(value: str) -> Text:
    return Text(text=value, line=1)


def random_grant(chance: random.Random, operation: Operation) -> Grant:
    def criterion() -> Criterion:
        listed = tuple(map(text, chance.sample(PARTITIONS, chance.randint(1, 2))))
        topics = tuple(map(text, chance.sample(["x", "y", "*"], chance.randint(1, 2))))
        partitions = listed if chance.random() < 0.8 else None
        return Criterion(operation=operation, topics=topics, partitions=partitions, data_tags=False, line=1)

    rules = tuple(
        Rule(
            allow=chance.random() < 0.6,
            domains=(DomainRange(low=0, high=0, line=1),),
            criteria=(criterion(),),
            line=1,
        )
        for _ in range(chance.randint(1, 3))
    )
    dates = (text("2020-01-01T00:00:00"), text("2030-01-01T00:00:00"))
    return Grant(
        name="g",
        subject_name=text("CN=/talker"),
        not_before=dates[0],
        not_after=dates[1],
        rules=rules,
        default_allow=chance.random() < 0.15,
        default_line=1,
        line=1,
    )


def as_system(grants: list[list[ReadRule]], defaults: list[bool], access: Access) -> System:
    """What the grants decide, over channels that they tell apart."""
    b = healthy_builder()
    regions = [(access.matcher, rule.region(op)) for rules in grants for rule in rules for op in Operation]
    opening = {
        (access.matcher, rule.region(op)) for rules in grants for rule in rules if rule.allow for op in Operation
    }
    found = build_channels(
        domain_classes([((0, 0),)]), [True], regions, opening=None if any(defaults) else frozenset(opening)
    )
    place = b.grants[0].location
    rules = [
        RuleAtom(
            grant=number,
            allow=rule.allow,
            domains=frozenset({0}),
            publish=found.regions[access.matcher, rule.publish],
            subscribe=found.regions[access.matcher, rule.subscribe],
            relay=found.regions[access.matcher, rule.relay],
            location=place,
        )
        for number, each in enumerate(grants)
        for rule in each
    ]
    atoms = [
        GrantAtom(document=1, names=frozenset(), not_before=0, not_after=1, default_allow=default, location=place)
        for default in defaults
    ]
    kept = replace(b.system(), domains=found.domains, channels=found.channels, meets=found.meets)
    return replace(kept, grants=tuple(atoms), rules=tuple(rules))


def allowed(rules: list[ReadRule], default: bool, operation: Operation, topic: str, partition: str) -> bool:
    """By trying the rules in order, with matching that is not ours."""
    for rule in rules:
        for area in rule.region(operation):
            if any(fnmatch.fnmatchcase(topic, each) for each in area.topics) and (
                area.partitions is None or any(fnmatch.fnmatchcase(partition, each) for each in area.partitions)
            ):
                return rule.allow
    return default


def meet(one: str, other: str) -> bool:
    return one == other or fnmatch.fnmatchcase(one, other) or fnmatch.fnmatchcase(other, one)


@pytest.mark.parametrize("seed", range(tried(60)))
def test_writer_and_reader_meet_where_some_partitions_of_theirs_do(seed: int) -> None:
    """Against every endpoint in a short partition, plain or a pattern, under one implementation's reading."""
    chance = random.Random(seed)
    access = chance.choice([VARIANTS[name].access for name in ("spec", "fastdds-2.9", "cyclonedds-11")])
    drawn = [random_grant(chance, operation) for operation in (Operation.PUBLISH, Operation.SUBSCRIBE)]
    read = [read_grant(grant, read_rules(grant, access), START, END, access) for grant in drawn]
    rules, defaults = [list(each.rules) for each in read], [each.default_allow for each in read]
    system = as_system(rules, defaults, access)
    decisions = Decisions(system)
    written = decisions.met(decisions.allowed(0, Operation.PUBLISH))
    subscribed = decisions.met(decisions.allowed(1, Operation.SUBSCRIBE))
    truth = False
    for topic in ("x", "y", "z"):
        writers = [e for e in ENDPOINTS if allowed(rules[0], defaults[0], Operation.PUBLISH, topic, e)]
        readers = [e for e in ENDPOINTS if allowed(rules[1], defaults[1], Operation.SUBSCRIBE, topic, e)]
        truth = truth or any(meet(one, other) for one in writers for other in readers)
    assert bool(written & subscribed) is truth
