"""Channels are exact: whatever name, partition and domain is tried, its channel says what every rule says of it."""

from __future__ import annotations

import itertools
import random

import pytest

from keystore_audit.errors import BudgetExceeded
from keystore_audit.keystore.document import DomainRange, Text
from keystore_audit.keystore.typed import Criterion, Grant, Operation, Rule
from keystore_audit.model import channels as made
from keystore_audit.model import columns
from keystore_audit.model.channels import ANY_TOPIC, build_channels
from keystore_audit.model.domains import contains, covered, domain_classes
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.semantics import Area, Region, read_rules
from keystore_audit.profiles import VARIANTS, Access, Matcher
from tests.amount import tried

TOPICS = ["a", "b", "ab", "a*", "*b", "?", "[ab]c", "*", "ba", "b?a"]
PARTITIONS = ["a", "*", "b*", ""]
NAMES = ["".join(letters) for n in (1, 2, 3) for letters in itertools.product("abc", repeat=n)]


def text(value: str) -> Text:
    return Text(text=value, line=1)


def grant(*rules: Rule) -> Grant:
    return Grant(
        name="g",
        subject_name=text("CN=/talker"),
        not_before=text("2020-01-01T00:00:00"),
        not_after=text("2030-01-01T00:00:00"),
        rules=rules,
        default_allow=False,
        default_line=1,
        line=1,
    )


def random_rule(source: random.Random) -> Rule:
    def criterion() -> Criterion:
        partitions = source.sample(PARTITIONS, source.randrange(3))
        return Criterion(
            operation=source.choice(list(Operation)),
            topics=tuple(text(t) for t in source.sample(TOPICS, source.randrange(1, 4))),
            partitions=tuple(text(p) for p in partitions) if source.random() < 0.5 else None,
            data_tags=False,
            line=1,
        )

    return Rule(
        allow=source.random() < 0.5,
        domains=(DomainRange(low=source.randrange(4), high=source.randrange(4), line=1),),
        criteria=tuple(criterion() for _ in range(source.randrange(1, 4))),
        line=1,
    )


def named(rules: list[Rule], access: Access) -> list[tuple[Matcher, Region]]:
    """The regions of all rules as an implementation reads them."""
    return [
        (access.matcher, rule.region(operation))
        for rule in read_rules(grant(*rules), access)
        for operation in Operation
    ]


def holds(matcher: Matcher, region: Region, topic: str, partition: str) -> bool:
    return any(
        any(parse(text, matcher).matches(topic) for text in area.topics)
        and (area.partitions is None or any(parse(text, matcher).matches(partition) for text in area.partitions))
        for area in region
    )


@pytest.mark.parametrize("seed", range(tried(60)))
def test_every_name_has_a_channel_that_says_what_the_rules_say(seed: int) -> None:
    source = random.Random(seed)
    accesses = [profile.access for profile in source.sample(list(VARIANTS.values()), 2)]
    topics = [Area((text,), None) for text in source.sample(TOPICS, source.randrange(1, 4))]
    rules = [random_rule(source) for _ in range(source.randrange(4))]
    regions = [(access.matcher, (area,)) for access in accesses for area in topics]
    regions += [each for access in accesses for each in named(rules, access)]
    governed = covered([DomainRange(low=0, high=1, line=1)])
    domains = domain_classes([governed, *(covered(rule.domains) for rule in rules)])
    channels = build_channels(domains, [contains(governed, d.intervals[0][0]) for d in domains], regions)
    domain = next(n for n, d in enumerate(domains) if contains(d.intervals, 0))
    known = {
        tuple(number in channels.regions[each] for each in regions): channel
        for number, channel in enumerate(channels.channels)
        if channel.domain == domain
    }
    met = set()
    for topic in NAMES:
        for partition in ("", "a", "b", "bc", "zz"):
            said = tuple(holds(matcher, region, topic, partition) for matcher, region in regions)
            assert said in known, (topic, partition)
            met.add(said)
    for said, channel in known.items():
        again = tuple(holds(matcher, region, channel.topic, channel.partition) for matcher, region in regions)
        assert again == said, (channel.topic, channel.partition)
    assert len(known) == sum(1 for c in channels.channels if c.domain == domain)
    assert met <= set(known)


@pytest.mark.parametrize("seed", range(tried(20)))
def test_points_say_of_themselves_what_the_rules_say(seed: int) -> None:
    source = random.Random(seed)
    access = source.choice(list(VARIANTS.values())).access
    regions = named([random_rule(source) for _ in range(3)], access)
    domains = domain_classes([((0, 0), (2, 2)), ((2, 5),)])
    points = [(topic, partition) for topic in ("a", "ba", "abc") for partition in ("", "a", "zz")]
    channels = build_channels(
        domains, [contains(d.intervals, 0) or contains(d.intervals, 2) for d in domains], regions, points
    )
    for id_ in (0, 2):
        for number, (topic, partition) in enumerate(points):
            channel = channels.of_point(id_, number)
            assert (channels.channels[channel].topic, channels.channels[channel].partition) == (topic, partition)
            for matcher, region in regions:
                assert (channel in channels.regions[matcher, region]) is holds(matcher, region, topic, partition)
    assert {channels.channels[channels.of_point(7, number)].topic for number in range(9)} == {ANY_TOPIC}


def in_partitions(count: int, partition: str) -> list[tuple[Matcher, Region]]:
    """A topic each, in a partition that may be its own."""
    return [(Matcher.POSIX, (Area((f"rt/t{n}",), (partition.format(n),)),)) for n in range(count)]


@pytest.mark.parametrize(("limit", "words"), [("MAX_PAIRS", "pairs of topics"), ("MAX_MEETINGS", "that meet")])
def test_more_than_can_be_told_apart_is_not_told_apart(limit: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    domains = domain_classes([((0, 0),)])
    regions = [*in_partitions(3, "p{}*"), (Matcher.POSIX, (Area(("rt/t0",), ("*",)),))]
    assert build_channels(domains, [True], regions, opening=frozenset(regions)).meets
    monkeypatch.setattr(columns, limit, 1)
    with pytest.raises(BudgetExceeded, match=words):
        build_channels(domains, [True], regions, opening=None)


@pytest.mark.parametrize(("limit", "words"), [("MAX_FURTHER", "further classes"), ("MAX_RULED", "topic rules")])
def test_channels_of_further_domains_have_a_limit(limit: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    one, two = domain_classes([((0, 0),)]), domain_classes([((0, 0),), ((3, 3),)])
    monkeypatch.setattr(made, limit, 7)
    regions = in_partitions(3, "")  # with what nothing matches four classes
    assert build_channels(one, [True, False], regions, ruling=2).channels
    with pytest.raises(BudgetExceeded, match=words):
        build_channels(two, [True, True, True], regions, ruling=2)
