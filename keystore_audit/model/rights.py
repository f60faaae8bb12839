"""What an implementation reads in documents, over channels: as steps, and undecided, as atoms of a system."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import cache
from itertools import chain, compress, product
from typing import Any, Final

from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.keystore.typed import DomainRule, Operation, ProtectionKind, TopicRule
from keystore_audit.model.access_view import ReadDocument
from keystore_audit.model.channels import Channels
from keystore_audit.model.domains import Interval
from keystore_audit.model.formal.bit_sets import bits, members, union
from keystore_audit.model.formal.rights import Safeguard, safeguards
from keystore_audit.model.formal.steps import Step, decided
from keystore_audit.model.formal.system import DomainRuleAtom, GrantAtom, RuleAtom, System, TopicRuleAtom
from keystore_audit.model.semantics import (
    CHECKED_TOGETHER,
    DIRECTIONS,
    OF_DOMAINS,
    OF_TOPICS,
    ReadDomainRule,
    ReadGrant,
    ReadRule,
    ReadTopicRule,
    Region,
    is_controlled,
)
from keystore_audit.profiles import Access, Matcher, TopicCheck

Part = tuple[ReadDomainRule, int]
"""A domain rule with the channels of its domains, or of some of them."""

TopicDecision = tuple[ReadDomainRule, TopicRule, int]
"""A topic rule and the domain rule that it stands in, with channels."""


class RuleLists:
    """Makes the steps of grants over some channels (`all`); expressions and domains are resolved once."""

    def __init__(self, channels: Channels) -> None:
        self.all = (1 << len(channels.channels)) - 1
        self._channels = channels
        self._within = cache(channels.within)

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

    def parts(self, rules: Iterable[ReadDomainRule]) -> list[Part]:
        """The domain rules of a governance with the channels of their domains."""
        return [(rule, self.domains(rule.domains)) for rule in rules]

    def topic_rules(
        self, parts: Sequence[Part], access: Access
    ) -> Iterator[tuple[int, ReadDomainRule, ReadTopicRule, int]]:
        """The topic rules of a governance, each with the channels of the domains in which it may decide.

        The number is that of the domain rule which decides there: where any rule counts, it goes on with later ones.
        """
        taken = 0
        for number, (first, inside) in enumerate(parts):
            fresh = inside & ~taken
            taken |= fresh
            yield from ((number, first, topic, fresh) for topic in first.topic_rules)
            for rule, within in parts[number + 1 :] if access.any_governance_rule and fresh else ():
                if here := within & fresh:
                    yield from ((number, rule, topic, here) for topic in rule.topic_rules)

    def topics(
        self, rules: Iterable[ReadDomainRule], access: Access, named: Callable[[ReadTopicRule], int] | None = None
    ) -> Iterator[TopicDecision]:
        """The topic rules of a governance, each with the channels that it decides about.

        `named`: further channels that the expression of a rule names, beside those that it matches.
        """
        listed = (
            Step((self.matched(topic, access) | (named(topic) if named else 0)) & here, True, (rule, topic.rule))
            for _number, rule, topic, here in self.topic_rules(self.parts(rules), access)
            if here
        )
        return ((*step.by, channels) for step, channels in decided(listed))

    def loose(self, rules: Iterable[ReadDomainRule], access: Access, operation: Operation) -> Iterator[TopicDecision]:
        """The topic rules that switch access control off for whatever they match: where any rule counts."""
        for rule in rules if access.any_governance_rule else ():
            for topic in rule.topic_rules:
                if not is_controlled(topic.rule, operation):
                    yield rule, topic.rule, self.matched(topic, access) & self.domains(rule.domains)

    def controlled(self, decisions: Iterable[TopicDecision]) -> int:
        """The channels for which each governance that decides about them has read and write access control on."""
        on, off = 0, 0
        for _rule, topic, channels in decisions:
            if topic.enable_read_access_control and topic.enable_write_access_control:
                on |= channels
            else:
                off |= channels
        return on & ~off

    def topics_denied(self, grant: ReadGrant, access: Access, controlled: int) -> list[tuple[ReadRule, int]]:
        """Those of the `controlled` topics that cannot exist, each with the first rule that denies it."""
        denied: list[tuple[ReadRule | None, int]] = [(None, controlled)]
        for together in CHECKED_TOGETHER[access.topic_check]:
            listed: list[Step[ReadRule | None]] = [
                Step(self.region(access.matcher, rule.listed(together)) & self.domains(rule.domains), rule.allow, rule)
                for rule in grant.rules
            ]
            listed.append(Step(self.all, grant.default_allow, None))
            refused = [(step.by, part) for step, part in decided(listed) if not step.allow]
            denied = [(by or also, here & part) for by, here in denied for also, part in refused if here & part]
        return [(by, channels) for by, channels in denied if by is not None]  # what no rule lists the default denies

    def matched(self, topic: ReadTopicRule, access: Access) -> int:
        """The channels that the expression of a topic rule matches, in any domain."""
        return self.region(access.matcher, topic.region)

    def region(self, matcher: Matcher, region: Region) -> int:
        """The channels of a region that took part when the channels were made."""
        return bits(self._channels.regions[matcher, region]) if region else 0

    def domains(self, cover: tuple[Interval, ...]) -> int:
        """The channels of the domains."""
        return self._within(cover)


# The rules of documents as atoms of a system: what an implementation reads in them, over channels.


Read = Sequence[tuple[str, ReadDocument]]
"""Documents with their places, in the order of the system's."""

Atoms = tuple[tuple[DomainRuleAtom, ...], tuple[TopicRuleAtom, ...], tuple[GrantAtom, ...], tuple[RuleAtom, ...]]


def one_after_another(parts: Sequence[tuple[int, Atoms]]) -> Atoms:
    """The atoms of several readings, each with the number of its first document."""
    if len(parts) == 1:
        return parts[0][1]
    domain_rules: list[DomainRuleAtom] = []
    topic_rules: list[TopicRuleAtom] = []
    grants: list[GrantAtom] = []
    rules: list[RuleAtom] = []
    for first, (governing, protecting, granting, ruling) in parts:
        above, before = len(domain_rules), len(grants)
        domain_rules += (replace(each, document=each.document + first) for each in governing)
        topic_rules += (replace(each, domain_rule=each.domain_rule + above) for each in protecting)
        grants += (replace(each, document=each.document + first) for each in granting)
        rules += (replace(each, grant=each.grant + before) for each in ruling)
    return tuple(domain_rules), tuple(topic_rules), tuple(grants), tuple(rules)


class RuleAtoms:
    """Makes the atoms of one keystore's rules. `instants`: those of its systems, sorted."""

    def __init__(self, channels: Channels, instants: Sequence[datetime]) -> None:
        self._channels = channels
        self._lists = RuleLists(channels)
        self._index = {instant: number for number, instant in enumerate(instants)}

    def of(self, documents: Read, names: Mapping[str, frozenset[int]], access: Access) -> Atoms:
        """The atoms of `documents` as read under `access`; `names`: whom each subject_name of a grant names."""
        return *self._governance(documents, access), *self._permissions(documents, names, access)

    def _governance(
        self, documents: Read, access: Access
    ) -> tuple[tuple[DomainRuleAtom, ...], tuple[TopicRuleAtom, ...]]:
        domain_rules: list[DomainRuleAtom] = []
        topic_rules: list[TopicRuleAtom] = []
        for number, (place, document) in enumerate(documents):
            rules, first = document.domain_rules or (), len(domain_rules)
            parts: list[Part] = []
            for read, domains, controls_join in self._by_join_control(rules, access):
                parts.append((read, union(map(self._channels.bits_in, domains))))
                said = _said(read.rule, OF_DOMAINS, access) | {"enable_join_access_control": controls_join}
                where = Location(path=place, line=read.rule.line)
                domain_rules.append(DomainRuleAtom(document=number, domains=domains, location=where, **said))
            # Where any rule counts, some channels of a topic rule have other access control than it says.
            off = [union(each[2] for each in self._lists.loose(rules, access, way)) for way in DIRECTIONS]
            for parent, read, topic, here in self._lists.topic_rules(parts, access):
                channels = self._channels.regions[access.matcher, topic.region]
                if read is not parts[parent][0]:
                    channels = frozenset(members(bits(channels) & here))
                said, where = _said(topic.rule, OF_TOPICS, access), Location(path=place, line=topic.rule.line)
                for part, switched_off in _by_access_control(channels, off):
                    flags = said | dict.fromkeys(switched_off, False)
                    topic_rules.append(
                        TopicRuleAtom(domain_rule=first + parent, channels=part, location=where, **flags)
                    )
        return tuple(domain_rules), tuple(topic_rules)

    def _by_join_control(
        self, rules: Sequence[ReadDomainRule], access: Access
    ) -> Iterator[tuple[ReadDomainRule, frozenset[int], bool]]:
        """Each domain rule with its domain classes, and whether joining is controlled there.

        Where any rule may switch that off, a rule is split: domains in which another rule has it off come apart.
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

    def _permissions(
        self, documents: Read, names: Mapping[str, frozenset[int]], access: Access
    ) -> tuple[tuple[GrantAtom, ...], tuple[RuleAtom, ...]]:
        controlled = 0
        if access.topic_check is not TopicCheck.NONE:
            governances = (self._lists.topics(document.domain_rules or (), access) for _place, document in documents)
            controlled = self._lists.controlled(chain.from_iterable(governances))
        grants: list[GrantAtom] = []
        rules: list[RuleAtom] = []
        for number, (place, document) in enumerate(documents):
            for read in document.grants or ():
                denied = self._lists.topics_denied(read, access, controlled)
                listed = [(rule, dict.fromkeys(DIRECTIONS, frozenset(members(channels)))) for rule, channels in denied]
                listed += [(rule, {way: self._region(rule, way, access) for way in Operation}) for rule in read.rules]
                rules += (
                    RuleAtom(
                        grant=len(grants),
                        allow=rule.allow,
                        domains=self._channels.covered(rule.domains),
                        publish=named[Operation.PUBLISH],
                        subscribe=named[Operation.SUBSCRIBE],
                        relay=named.get(Operation.RELAY, frozenset()),
                        location=Location(path=place, line=rule.line),
                        source=rule.rule,
                    )
                    for rule, named in listed
                )
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

    def _region(self, rule: ReadRule, operation: Operation, access: Access) -> frozenset[int]:
        return self._channels.regions[access.matcher, rule.region(operation)]


_CONTROLS: Final = ("enable_write_access_control", "enable_read_access_control")
"""What a topic rule says of each of the directions."""


def _by_access_control(channels: frozenset[int], off: Sequence[int]) -> Iterator[tuple[frozenset[int], Sequence[str]]]:
    """The channels of a topic rule; those for which another rule switches write or read access control off apart."""
    if not any(off):
        yield channels, ()
        return
    for chosen in product((False, True), repeat=len(_CONTROLS)):
        part = bits(channels)
        for is_off, those in zip(chosen, off, strict=True):
            part &= those if is_off else ~those
        if part:
            yield frozenset(members(part)), [*compress(_CONTROLS, chosen)]


def _said(rule: DomainRule | TopicRule, names: Iterable[str], access: Access) -> dict[str, Any]:
    """What the implementation reads in a governance rule."""
    said = {name: getattr(rule, name) for name in names}
    if access.authenticates_origin:
        return said
    kinds = (item for item in said.items() if isinstance(item[1], ProtectionKind))
    return said | {name: kind.without_origin for name, kind in kinds}


class Window:
    """The channels of one domain (0..232), name by name. `channels` were made for `names` points."""

    def __init__(self, channels: Channels, domain: int, names: int) -> None:
        self._domain = channels.domain_class(domain)
        self._here = channels.in_domain[self._domain]
        self.governed = len(self._here) == names
        self._names = names
        self.all = (1 << names) - 1

    def of(self, channels: int) -> int:
        """The names among the channels; an ungoverned domain has one channel for all names."""
        if self.governed:
            return channels >> self._here.start & self.all
        return self.all if channels >> self._here.start & 1 else 0

    def safeguards(self, system: System) -> tuple[tuple[Safeguard, ...], ...]:
        """What protects each name."""
        found = safeguards(system, self._here, self._domain)
        return found if self.governed else found * self._names
