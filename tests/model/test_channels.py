"""Channels are exact: whatever name, partition and domain is tried, its channel says what every rule says of it."""

from __future__ import annotations

import itertools
import random

import pytest

from keystore_audit.keystore.governance import DomainRange, ProtectionKind, Text, TopicRule
from keystore_audit.keystore.permissions import Criterion, Operation, Rule
from keystore_audit.model.channels import Channels, build_channels, covers_of, domain_classes
from keystore_audit.model.domains import contains, covered
from keystore_audit.model.expression import Matcher, parse

TOPICS = ["a", "b", "ab", "a*", "*b", "?", "[ab]c", "*", "ba", "b?a"]
PARTITIONS = ["a", "*", "b*", ""]
NAMES = ["".join(letters) for n in (1, 2, 3) for letters in itertools.product("abc", repeat=n)]


def text(value: str) -> Text:
    return Text(text=value, line=1)


def topic_rule(expression: str) -> TopicRule:
    return TopicRule(
        expression=text(expression),
        enable_discovery_protection=True,
        enable_liveliness_protection=True,
        enable_read_access_control=True,
        enable_write_access_control=True,
        metadata_protection_kind=ProtectionKind.NONE,
        data_protection_kind=ProtectionKind.NONE,
        line=1,
        lines={},
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


def matches(rule: Rule, operation: Operation, topic: str, partition: str) -> bool:
    """DDS-Security 1.1, 9.4.1.3.2.3: topic and partition within one criterion of the kind."""
    for criterion in rule.criteria:
        if criterion.operation is not operation:
            continue
        if not any(parse(t.text, Matcher.POSIX).matches(topic) for t in criterion.topics):
            continue
        if criterion.partitions is None:
            if partition == "" or not rule.allow:
                return True
        elif any(parse(p.text, Matcher.POSIX).matches(partition) for p in criterion.partitions):
            return True
    return False


def signature(channels: Channels, channel: int) -> tuple[bool, ...]:
    """What all rules say of a channel."""
    return tuple(channel in rule for rule in channels.topic_rules) + tuple(
        channel in found for rule in channels.rules for found in (rule.publish, rule.subscribe, rule.relay)
    )


@pytest.mark.parametrize("seed", range(60))
def test_every_name_has_a_channel_that_says_what_the_rules_say(seed: int) -> None:
    source = random.Random(seed)
    topic_rules = [topic_rule(t) for t in source.sample(TOPICS, source.randrange(1, 4))]
    rules = [random_rule(source) for _ in range(source.randrange(4))]
    governed = covered([DomainRange(low=0, high=1, line=1)])
    domains = domain_classes([governed, *covers_of(rules)])
    channels = build_channels(domains, [contains(governed, d.intervals[0][0]) for d in domains], topic_rules, rules)
    domain = next(n for n, d in enumerate(domains) if contains(d.intervals, 0))
    known = {signature(channels, n): channel for n, channel in enumerate(channels.channels) if channel.domain == domain}
    met = set()
    for topic in NAMES:
        for partition in ("", "a", "b", "bc", "zz"):
            said = tuple(parse(t.expression.text, Matcher.POSIX).matches(topic) for t in topic_rules)
            said += tuple(matches(r, operation, topic, partition) for r in rules for operation in Operation)
            assert said in known, (topic, partition)
            met.add(said)
    for said, channel in known.items():
        again = tuple(parse(t.expression.text, Matcher.POSIX).matches(channel.topic) for t in topic_rules)
        again += tuple(
            matches(r, operation, channel.topic, channel.partition) for r in rules for operation in Operation
        )
        assert again == said, (channel.topic, channel.partition)
    assert len(known) == sum(1 for c in channels.channels if c.domain == domain)
    assert met <= set(known)


def test_an_ungoverned_domain_has_one_channel_that_no_rule_matches() -> None:
    domains = domain_classes([((0, 0),)])
    channels = build_channels(domains, [True, False], [topic_rule("*")], [])
    assert [channel.domain for channel in channels.channels] == [0, 1]
    assert channels.topic_rules == (frozenset({0}),)
