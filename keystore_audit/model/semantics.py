"""What governance and permissions say, as one implementation reads them: typed documents in, ordered rules out.

Implementations differ in what one document says (`profiles.access`). Here the differences become plain rules: of the
rules that this module gives, the first that matches decides, for every implementation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.keystore.document import DomainRange, Text
from keystore_audit.keystore.typed import (
    Criterion,
    DomainRule,
    Governance,
    Grant,
    Operation,
    ProtectionKind,
    Rule,
    TopicRule,
)
from keystore_audit.model.domains import Interval, covered
from keystore_audit.model.validity import in_force
from keystore_audit.profiles import Access, PartitionReading, RelayReading, TopicCheck


class Area(NamedTuple):
    """Names that one of `topics` matches, in partitions that one of `partitions` matches (None: in every one).

    `every`: an endpoint in several partitions is in the area if all of them are, as in allow rules. Else it is if any
    is, as in deny rules. A tuple, since a keystore has 100,000s of them.
    """

    topics: tuple[str, ...]
    partitions: tuple[str, ...] | None
    every: bool = True


Region = tuple[Area, ...]
"""The union of its areas."""

DIRECTIONS = (Operation.PUBLISH, Operation.SUBSCRIBE)
"""The operations of endpoints; nobody relays under ROS 2."""

CHECKED_TOGETHER: Final[Mapping[TopicCheck, Sequence[tuple[Operation, ...]]]] = {
    TopicCheck.NONE: (),
    TopicCheck.FIRST_RULE: (DIRECTIONS,),
    TopicCheck.EACH: tuple((each,) for each in DIRECTIONS),
}
"""The operations for which one rule decides whether a topic exists: it does not if all of these deny."""

OF_DOMAINS: Final = (
    "allow_unauthenticated_participants",
    "enable_join_access_control",
    "discovery_protection_kind",
    "liveliness_protection_kind",
    "rtps_protection_kind",
)
OF_TOPICS: Final = (
    "enable_discovery_protection",
    "enable_liveliness_protection",
    "enable_read_access_control",
    "enable_write_access_control",
    "metadata_protection_kind",
    "data_protection_kind",
)
"""What rules of a governance say."""

OPENING: Final = frozenset({"allow_unauthenticated_participants"})
"""The flags of these that let more happen where they are on."""

DEFAULT_PARTITION = ("",)
"""The expressions of a criterion without `<partitions>`: the empty name alone."""


class ReadTopicRule(Struct, frozen=True, kw_only=True):
    """A `<topic_rule>` with the topics that its expression matches, in every partition."""

    region: Region
    rule: TopicRule


class ReadDomainRule(Struct, frozen=True, kw_only=True):
    """A `<domain_rule>` with the domain ids that it covers."""

    domains: tuple[Interval, ...]
    topic_rules: tuple[ReadTopicRule, ...]
    rule: DomainRule


class ReadRule(Struct, frozen=True, kw_only=True):
    """A rule of a grant: what it decides for each operation, in its domains.

    `of_peers`: it decides about peers, not about an implementation's own endpoints.
    """

    allow: bool
    domains: tuple[Interval, ...]
    publish: Region
    subscribe: Region
    relay: Region
    of_peers: bool
    rule: Rule

    @property
    def line(self) -> int | None:
        """Where the rule stands."""
        return self.rule.line

    def region(self, operation: Operation) -> Region:
        """What it decides for the operation."""
        if operation is Operation.PUBLISH:
            return self.publish
        return self.subscribe if operation is Operation.SUBSCRIBE else self.relay

    def texts(self, *operations: Operation) -> Iterator[str]:
        """The topic expressions of what it decides for these operations, or for all."""
        return (text for each in operations or Operation for area in self.region(each) for text in area.topics)

    def listed(self, operations: Iterable[Operation]) -> Region:
        """The topics that it lists for these operations, in every partition."""
        return _everywhere(tuple(self.texts(*operations)))


class ReadGrant(Struct, frozen=True, kw_only=True):
    """A `<grant>` with its validity (aware UTC) and what holds where no rule of it matches."""

    not_before: datetime
    not_after: datetime
    default_allow: bool
    rules: tuple[ReadRule, ...]
    grant: Grant


def deciding_grant(named: Iterable[ReadGrant], at: datetime, access: Access) -> ReadGrant | None:
    """The grant that counts, of those that name somebody: the first in force, or the first if it is in force."""
    for grant in named:
        if in_force(grant, at):
            return grant
        if not access.skips_grants_out_of_date:
            break
    return None


NO_GRANT: Final = "no grant in force names {}"
FIRST_IS_OVER: Final = "of the grants that name {} the first alone counts, and it is not in force"


def without_grant(named: Iterable[ReadGrant], at: datetime) -> str:
    """Why none of the grants that name somebody, `{}`, counts: one of two reasons."""
    return FIRST_IS_OVER if any(in_force(grant, at) for grant in named) else NO_GRANT


def is_controlled(topic: TopicRule, operation: Operation) -> bool:
    """Whether peers ask for a grant for the operation."""
    return topic.enable_write_access_control if operation is Operation.PUBLISH else topic.enable_read_access_control


def strengths(kind: ProtectionKind) -> frozenset[str]:
    """What a kind of protection does."""
    has = {"signed": kind.authenticates, "secret": kind.encrypts, "origin": kind.authenticates_origin}
    return frozenset(name for name, holds in has.items() if holds)


def read_domain_rules(governance: Governance, access: Access) -> tuple[ReadDomainRule, ...]:
    """The domain rules in order: of those that cover a domain the first counts, of its topic rules the first match."""
    return tuple(
        ReadDomainRule(
            domains=_domains(rule.domains, access),
            topic_rules=tuple(
                ReadTopicRule(region=(Area((topic.expression.text,), None),), rule=topic) for topic in rule.topic_rules
            ),
            rule=rule,
        )
        for rule in governance.domain_rules
    )


def read_grant(
    grant: Grant, rules: tuple[ReadRule, ...], not_before: datetime, not_after: datetime, access: Access
) -> ReadGrant:
    """The grant with its rules (`read_rules`) in order: the first that matches decides, else the default."""
    return ReadGrant(
        not_before=not_before,
        not_after=not_after,
        default_allow=grant.default_allow and access.honours_default,
        rules=rules,
        grant=grant,
    )


def read_rules(grant: Grant, access: Access) -> tuple[ReadRule, ...]:
    """The rules of the grant in order. A peculiarity is read only where some rule gives an occasion for it."""
    partitions = access.partitions if names_partitions(grant) else PartitionReading.CRITERION
    relays = any(each.operation is Operation.RELAY for rule in grant.rules for each in rule.criteria)
    relay = access.relay if relays else RelayReading.RELAY
    return tuple(_rules(grant.rules, access, partitions, relay))


def names_partitions(grant: Grant) -> bool:
    """Whether its rules or its default may allow anything outside of the default partition, where all read alike."""
    return grant.default_allow or any(each.partitions is not None for rule in grant.rules for each in rule.criteria)


def _domains(ranges: Sequence[DomainRange], access: Access) -> tuple[Interval, ...]:
    bounded = all(each.low == each.high or (each.low is not None and each.high) for each in ranges)
    return covered(ranges) if bounded else covered(ranges, access.open_ranges)


def _rules(
    rules: Sequence[Rule], access: Access, partitions: PartitionReading, relay: RelayReading
) -> Iterator[ReadRule]:
    blocking = _blocking(rules, relay) if partitions is PartitionReading.RULE else ({},) * len(rules)
    for rule, blocked in zip(rules, blocking, strict=True):
        domains = _domains(rule.domains, access)
        regions = {operation: _region(rule, operation, partitions) for operation in Operation}
        if relay is not RelayReading.RELAY:
            regions[Operation.RELAY] = ()
        yield _read_rule(rule, domains, regions, allow=rule.allow)
        relayed = _topics(rule, Operation.RELAY) if relay is RelayReading.READ else ()
        if rule.allow and partitions is PartitionReading.RULE:
            if any(blocked.values()):
                yield _read_rule(rule, domains, blocked, allow=False)
            if relayed:
                read = {Operation.SUBSCRIBE: _everywhere(_topics(rule, Operation.SUBSCRIBE))}
                yield _read_rule(rule, domains, read, allow=False, of_peers=True)
        if relayed:
            read = {Operation.SUBSCRIBE: _region(rule, Operation.RELAY, partitions)}
            yield _read_rule(rule, domains, read, allow=rule.allow, of_peers=True)
            if rule.allow:
                read = {Operation.SUBSCRIBE: _everywhere(relayed)}
                yield _read_rule(rule, domains, read, allow=False, of_peers=True)


def _read_rule(
    rule: Rule,
    domains: tuple[Interval, ...],
    regions: Mapping[Operation, Region],
    *,
    allow: bool,
    of_peers: bool = False,
) -> ReadRule:
    return ReadRule(
        allow=allow,
        domains=domains,
        **{operation.value: regions.get(operation, ()) for operation in Operation},
        of_peers=of_peers,
        rule=rule,
    )


def _region(rule: Rule, operation: Operation, reading: PartitionReading) -> Region:
    """What the rule decides for the operation."""
    if reading is PartitionReading.RULE:
        return _by_rule(rule, operation)
    return _by_criterion(rule, operation, reading)


def _everywhere(topics: tuple[str, ...]) -> Region:
    return (Area(topics, None),) if topics else ()


def _by_criterion(rule: Rule, operation: Operation, reading: PartitionReading) -> Region:
    everywhere = not rule.allow and reading is not PartitionReading.CRITERION_DEFAULT
    found = []
    for criterion in rule.criteria:
        if criterion.operation is operation:
            partitions = _partitions(criterion, everywhere=everywhere)
            if partitions is not None and reading is PartitionReading.CRITERION_NAMED:
                partitions = _named(partitions, allow=rule.allow)
            found.append(Area(_texts(criterion.topics), partitions, rule.allow))
    return tuple(found)


def _named(partitions: tuple[str, ...], *, allow: bool) -> tuple[str, ...]:
    """With the default partition, or (for a denial) without it; an expression of stars alone matches it too.

    This is for endpoints without a name: with an empty name they may do less, nowhere more.
    """
    if allow:
        return tuple(dict.fromkeys((*partitions, *DEFAULT_PARTITION)))
    return tuple(text if text.strip("*") else f"?{text}" for text in partitions if text)


def _by_rule(rule: Rule, operation: Operation) -> Region:
    """Topics of all its criteria of the kind, in the partitions of all of them; a deny rule denies in every one."""
    topics = _topics(rule, operation)
    if not topics:
        return ()
    return (Area(topics, _listed(rule, operation) if rule.allow else None),)


def _blocking(rules: Sequence[Rule], relay: RelayReading) -> Sequence[Mapping[Operation, Region]]:
    """The region in which each allow rule keeps later ones from allowing: its topics, in all other partitions.

    Empty where no later rule allows in another partition, as in what `ros2 security` writes: no rule more then. Where
    `relay` admits readers, a later rule allows them by what it lists for relaying too.
    """
    later: dict[Operation, set[str]] = {operation: set() for operation in Operation}
    found: list[Mapping[Operation, Region]] = []
    for rule in reversed(rules):  # a document may hold 10,000 of them: what comes later is gathered once
        blocked: dict[Operation, Region] = {}
        for operation in Operation if rule.allow else ():
            topics, own = _topics(rule, operation), _listed(rule, operation)
            if topics and not later[operation].issubset(own):
                blocked[operation] = (Area(topics, None),)
        found.append(blocked)
        for operation in Operation if rule.allow else ():
            later[operation].update(_listed(rule, operation))
            if operation is Operation.RELAY and relay is RelayReading.READ:
                later[Operation.SUBSCRIBE].update(_listed(rule, operation))
    return found[::-1]


def _topics(rule: Rule, operation: Operation) -> tuple[str, ...]:
    return tuple(
        text.text for criterion in rule.criteria if criterion.operation is operation for text in criterion.topics
    )


def _listed(rule: Rule, operation: Operation) -> tuple[str, ...]:
    """The partition expressions of all criteria of the kind."""
    found: dict[str, None] = {}
    for criterion in rule.criteria:
        if criterion.operation is operation:
            found.update(dict.fromkeys(_partitions(criterion, everywhere=False) or ()))
    return tuple(found)


def _partitions(criterion: Criterion, *, everywhere: bool) -> tuple[str, ...] | None:
    if criterion.partitions is None:
        return None if everywhere else DEFAULT_PARTITION
    return _texts(criterion.partitions)


def _texts(texts: Iterable[Text]) -> tuple[str, ...]:
    return tuple(text.text for text in texts)
