"""The rules of grants as steps over channels: the first step that is about a channel decides.

One evaluation (`allowed`, `deciding`) and one comparison (`compare`) for everybody who asks what ordered rules say.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Generic, TypeVar

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.keystore.governance import ProtectionKind, TopicRule
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.channels import Channels
from keystore_audit.model.domains import Interval
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.permission import allowing
from keystore_audit.model.formal.system import DomainRuleAtom, GrantAtom, RuleAtom, TopicRuleAtom
from keystore_audit.model.semantics import ReadDomainRule, ReadGrant, ReadRule, Region
from keystore_audit.profiles import Access, Matcher

By = TypeVar("By")


class Step(Struct, Generic[By], frozen=True):
    """Decides about `channels` (a bit set), unless an earlier step did. `by`: what says so."""

    channels: int
    allow: bool
    by: By


class Difference(Struct, Generic[By], frozen=True):
    """Channels that two lists decide differently about, and the step of each that does."""

    channels: int
    left: Step[By]
    right: Step[By]


def allowed(steps: Iterable[Step[By]]) -> int:
    """The channels that the steps allow."""
    return allowing((step.channels, step.allow) for step in steps)


def deciding(steps: Iterable[Step[By]], channel: int) -> Step[By]:
    """The step that decides about a channel; of lists that end with one about all of them."""
    return next(step for step in steps if step.channels >> channel & 1)


def compare(left: Iterable[Step[By]], right: Sequence[Step[By]], channels: int) -> Iterator[Difference[By]]:
    """Of the channels, those that the lists decide differently about, by the two steps that do."""
    theirs, undecided = [], channels
    for step in right:
        theirs.append(step.channels & undecided)
        undecided &= ~step.channels
    undecided, first = channels, 0
    for one in left:
        mine = one.channels & undecided
        undecided &= ~mine
        while first < len(theirs) and not theirs[first]:  # both mostly decide in one order, of thousands
            first += 1
        for number in range(first, len(theirs) if mine else 0):
            both = mine & theirs[number]
            if both:
                mine &= ~both
                theirs[number] &= ~both
                if one.allow is not right[number].allow:
                    yield Difference(both, one, right[number])
                if not mine:
                    break


class RuleLists:
    """Makes the steps of grants over some channels (`all`); what expressions and domains come to is worked out once."""

    def __init__(self, channels: Channels) -> None:
        self.all = (1 << len(channels.channels)) - 1
        self._channels = channels
        self._regions: dict[tuple[Matcher, Region], int] = {}
        self._covers: dict[tuple[Interval, ...], int] = {}

    def of(
        self,
        grant: ReadGrant,
        operation: Operation,
        matcher: Matcher,
        *,
        of_peers: bool = False,
        in_every_domain: bool = False,
    ) -> Iterator[Step[ReadRule | None]]:
        """What the grant decides about the operation, in order; last (`by` None) the default, about everything.

        `of_peers`: rules that decide about peers alone are among them. `in_every_domain`: rules apply outside of the
        domains that they name as well.
        """
        for rule in grant.rules:
            if of_peers or not rule.of_peers:
                channels = self.region(matcher, rule.region(operation))
                if not in_every_domain:
                    channels &= self.domains(rule.domains)
                if channels:
                    yield Step(channels, rule.allow, rule)
        yield Step(self.all, grant.default_allow, None)

    def region(self, matcher: Matcher, region: Region) -> int:
        """The channels of a region that took part when the channels were made."""
        if not region:
            return 0
        known = self._regions.get((matcher, region))
        if known is None:
            known = self._regions[matcher, region] = bits(self._channels.regions[matcher, region])
        return known

    def domains(self, cover: tuple[Interval, ...]) -> int:
        """The channels of the domains."""
        known = self._covers.get(cover)
        if known is None:
            known = self._covers[cover] = self._channels.within(cover)
        return known


# The rules of documents as atoms of a system: what an implementation reads in them, over channels.


Read = Sequence[tuple[str, ReadDocument]]
"""Documents with their places, in the order of the system's."""

Atoms = tuple[tuple[DomainRuleAtom, ...], tuple[TopicRuleAtom, ...], tuple[GrantAtom, ...], tuple[RuleAtom, ...]]


class RuleAtoms:
    """Makes the atoms of one keystore's rules. `instants`: those of its systems, sorted."""

    def __init__(self, channels: Channels, instants: Sequence[datetime]) -> None:
        self._channels = channels
        self._index = {instant: number for number, instant in enumerate(instants)}

    def of(self, documents: Read, names: Mapping[str, frozenset[int]], access: Access) -> Atoms:
        """The atoms of `documents` as read under `access`; `names`: whom each subject_name of a grant names."""
        domain_rules, topic_rules = self._governance(documents, access)
        return domain_rules, topic_rules, *self._permissions(documents, names, access, topic_rules, domain_rules)

    def _governance(
        self, documents: Read, access: Access
    ) -> tuple[tuple[DomainRuleAtom, ...], tuple[TopicRuleAtom, ...]]:
        domain_rules: list[DomainRuleAtom] = []
        topic_rules: list[TopicRuleAtom] = []
        for number, (place, document) in enumerate(documents):
            first = len(domain_rules)
            parted = list(self._by_join_control(document.domain_rules or (), access))
            for read, domains, controls_join in parted:
                rule = read.rule
                domain_rules.append(
                    DomainRuleAtom(
                        document=number,
                        domains=domains,
                        allow_unauthenticated_participants=rule.allow_unauthenticated_participants,
                        enable_join_access_control=controls_join,
                        discovery_protection_kind=_kind(rule.discovery_protection_kind, access),
                        liveliness_protection_kind=_kind(rule.liveliness_protection_kind, access),
                        rtps_protection_kind=_kind(rule.rtps_protection_kind, access),
                        location=Location(path=place, line=rule.line),
                    )
                )
            loose = self._loose(document, access) if access.any_governance_rule else _NONE_LOOSE
            parts: dict[frozenset[int], list[_Part]] = {}
            for parent, topic, channels in self._topics(parted, access):
                if channels not in parts:
                    parts[channels] = list(_parts(channels, loose))
                topic_rules += [_topic_atom(topic, first + parent, place, part, access) for part in parts[channels]]
        return tuple(domain_rules), tuple(topic_rules)

    def _topics(self, parted: Sequence[_Parted], access: Access) -> Iterator[tuple[int, TopicRule, frozenset[int]]]:
        """The topic rules with their channels and the place in `parted` of the domain rule that they count under.

        Where any rule of the governance counts, the domain rule that decides goes on with later ones of its domains.
        """
        decided: frozenset[int] = frozenset()
        for parent, (read, domains, _controls_join) in enumerate(parted):
            for topic in read.topic_rules:
                yield parent, topic.rule, self._channels.regions[access.matcher, topic.region]
            fresh = domains - decided
            if not fresh or not access.any_governance_rule:
                continue
            decided |= fresh
            left = frozenset(number for number, each in enumerate(self._channels.channels) if each.domain in fresh)
            for later, others, _controls_join in parted[parent + 1 :]:
                shared = fresh & others
                for topic in later.topic_rules if shared else ():
                    hit = frozenset(self._within(self._channels.regions[access.matcher, topic.region] & left, shared))
                    if hit:
                        left -= hit
                        yield parent, topic.rule, hit

    def _by_join_control(self, rules: Sequence[ReadDomainRule], access: Access) -> Iterator[_Parted]:
        """Each domain rule with its domain classes, and whether who joins is controlled there.

        Where any rule may switch that off, a rule is parted: its domains in which another one has it off come apart.
        """
        off: frozenset[int] = frozenset()
        if access.any_governance_rule:
            loose = (read.domains for read in rules if not read.rule.enable_join_access_control)
            off = off.union(*map(self._channels.covered, loose))
        for read in rules:
            domains, controlled = self._channels.covered(read.domains), read.rule.enable_join_access_control
            elsewhere = domains & off if controlled else frozenset()
            if elsewhere:
                yield read, elsewhere, False
            if domains != elsewhere or not elsewhere:
                yield read, domains - elsewhere, controlled

    def _loose(self, document: ReadDocument, access: Access) -> _Loose:
        """The channels for which any matching topic rule of the document has read, or write, access control off."""
        read_off: set[int] = set()
        write_off: set[int] = set()
        for domain_rule in document.domain_rules or ():
            domains = self._channels.covered(domain_rule.domains)
            for topic in domain_rule.topic_rules:
                hit = self._within(self._channels.regions[access.matcher, topic.region], domains)
                if not topic.rule.enable_read_access_control:
                    read_off |= hit
                if not topic.rule.enable_write_access_control:
                    write_off |= hit
        return frozenset(read_off), frozenset(write_off)

    def _permissions(
        self,
        documents: Read,
        names: Mapping[str, frozenset[int]],
        access: Access,
        topic_rules: Sequence[TopicRuleAtom],
        domain_rules: Sequence[DomainRuleAtom],
    ) -> tuple[tuple[GrantAtom, ...], tuple[RuleAtom, ...]]:
        controlled: frozenset[int] = frozenset()
        if access.first_rule_decides_topic:
            controlled = self._controlled(topic_rules, domain_rules)
        grants: list[GrantAtom] = []
        rules: list[RuleAtom] = []
        for number, (place, document) in enumerate(documents):
            for read in document.grants or ():
                grant = len(grants)
                rules += self._topics_denied(read.rules, grant, place, access, controlled)
                rules += [self._rule_atom(rule, grant, place, access) for rule in read.rules]
                grants.append(
                    GrantAtom(
                        document=number,
                        names=names[read.grant.subject_name.text],
                        not_before=self._index[read.not_before],
                        not_after=self._index[read.not_after],
                        default_allow=read.default_allow,
                        location=Location(path=place, line=read.grant.line),
                        subject=read.grant.subject_name.text,
                    )
                )
        return tuple(grants), tuple(rules)

    def _rule_atom(self, rule: ReadRule, grant: int, place: str, access: Access) -> RuleAtom:
        return RuleAtom(
            grant=grant,
            allow=rule.allow,
            domains=self._channels.covered(rule.domains),
            publish=self._region(rule.publish, access),
            subscribe=self._region(rule.subscribe, access),
            relay=self._region(rule.relay, access),
            location=Location(path=place, line=rule.line),
            source=rule.rule,
        )

    def _topics_denied(
        self, rules: Sequence[ReadRule], grant: int, place: str, access: Access, controlled: frozenset[int]
    ) -> Iterator[RuleAtom]:
        """Deny rules for topics that there are not, since the first rule that lists them denies; they come first."""
        if not controlled or all(rule.allow for rule in rules):
            return
        listed: set[int] = set()
        for rule in rules:
            domains = self._channels.covered(rule.domains)
            hit = self._within(self._region(rule.listed, access), domains)
            denied = frozenset((hit & controlled) - listed)
            if denied and not rule.allow:
                yield RuleAtom(
                    grant=grant,
                    allow=False,
                    domains=domains,
                    publish=denied,
                    subscribe=denied,
                    relay=frozenset(),
                    location=Location(path=place, line=rule.line),
                    source=rule.rule,
                )
            listed |= hit

    def _controlled(
        self, topic_rules: Sequence[TopicRuleAtom], domain_rules: Sequence[DomainRuleAtom]
    ) -> frozenset[int]:
        """The channels for which every governance that covers them has read and write access control on."""
        on: set[int] = set()
        off: set[int] = set()
        decided: dict[int, set[int]] = {}
        ruled: dict[int, set[int]] = {}
        fresh = []
        for rule in domain_rules:
            before = ruled.setdefault(rule.document, set())
            fresh.append(rule.domains - before)
            before |= rule.domains
        for topic in topic_rules:
            done = decided.setdefault(topic.domain_rule, set())
            hit = self._within(topic.channels, fresh[topic.domain_rule]) - done
            done |= hit
            both = topic.enable_read_access_control and topic.enable_write_access_control
            (on if both else off).update(hit)
        return frozenset(on - off)

    def _region(self, region: Region, access: Access) -> frozenset[int]:
        return self._channels.regions[access.matcher, region]

    def _within(self, channels: frozenset[int], domains: frozenset[int]) -> set[int]:
        """Those of the channels that lie in one of the domain classes."""
        return {channel for channel in channels if self._channels.channels[channel].domain in domains}


_Parted = tuple[ReadDomainRule, frozenset[int], bool]
_Loose = tuple[frozenset[int], frozenset[int]]
_NONE_LOOSE: _Loose = (frozenset(), frozenset())
_Part = tuple[frozenset[int], bool, bool]
"""Channels, and whether another rule switches read, and write, access control off for them."""


def _parts(channels: frozenset[int], loose: _Loose) -> Iterator[_Part]:
    """The channels of a topic rule; where another one switches access control off (`loose`), apart."""
    read_off, write_off = loose
    for is_read_off in (False, True) if read_off else (False,):
        for is_write_off in (False, True) if write_off else (False,):
            part = channels
            if read_off:
                part = part & read_off if is_read_off else part - read_off
            if write_off:
                part = part & write_off if is_write_off else part - write_off
            if part or part == channels:
                yield part, is_read_off, is_write_off


def _kind(kind: ProtectionKind, access: Access) -> ProtectionKind:
    """What the implementation makes of it."""
    return kind if access.authenticates_origin else kind.without_origin


def _topic_atom(topic: TopicRule, parent: int, place: str, part: _Part, access: Access) -> TopicRuleAtom:
    channels, is_read_off, is_write_off = part
    return TopicRuleAtom(
        domain_rule=parent,
        channels=channels,
        enable_discovery_protection=topic.enable_discovery_protection,
        enable_liveliness_protection=topic.enable_liveliness_protection,
        enable_read_access_control=topic.enable_read_access_control and not is_read_off,
        enable_write_access_control=topic.enable_write_access_control and not is_write_off,
        metadata_protection_kind=_kind(topic.metadata_protection_kind, access),
        data_protection_kind=_kind(topic.data_protection_kind, access),
        location=Location(path=place, line=topic.line),
    )
