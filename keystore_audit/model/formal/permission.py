"""What signed permissions allow: grant choice, first match, default (DDS-Security 1.1, 9.4.1.3).

Sets of channels and of domains are bit sets: channel n is bit n. The definitions are in docs/model.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import groupby
from operator import attrgetter

from msgspec import Struct

from keystore_audit.grouped import gathered
from keystore_audit.keystore.typed import Operation, ProtectionKind
from keystore_audit.model.formal.bit_sets import bits, members, union
from keystore_audit.model.formal.steps import Step, allowed, decided, deciding
from keystore_audit.model.formal.system import DocumentAtom, DomainRuleAtom, RuleAtom, System, TopicRuleAtom


class Meetings:
    """Which channels are met in others, by `System.meets`."""

    def __init__(self, meets: Sequence[frozenset[int]]) -> None:
        self._meets = {number: bits(others) for number, others in enumerate(meets) if others}
        self._meeting = bits(self._meets)

    def met(self, channels: int) -> int:
        """These channels, and those in which endpoints of theirs are met whose partitions are patterns."""
        found = channels
        for channel in members(channels & self._meeting):
            found |= self._meets[channel]
        return found


class Decisions:
    """What each grant of a system allows whenever it is in force: the same for all systems with the same grants."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._known: dict[int, int] = {}
        self._allowed: dict[tuple[int, Operation], int] = {}
        self.met = Meetings(system.meets).met
        self.all_channels = (1 << len(system.channels)) - 1
        self.all_domains = (1 << len(system.domains)) - 1
        self.channels_in = [0] * len(system.domains)
        """By domain class: its channels, which mostly stand together."""
        start = 0
        for domain, together in groupby(map(attrgetter("domain"), system.channels)):
            stop = start + len([*together])
            self.channels_in[domain] |= (1 << stop) - (1 << start)
            start = stop
        self._within: dict[frozenset[int], int] = {}

    def shared(self, channels: int) -> int:
        """The set, one object for all that are equal: each has a bit for every channel, and there may be 20,000."""
        return self._known.setdefault(channels, channels)

    @cached_property
    def _rules(self) -> dict[int, list[RuleAtom]]:
        """By grant: its rules in order."""
        return gathered((rule.grant, rule) for rule in self._system.rules)

    def allowed(self, grant: int, operation: Operation) -> int:
        """Channels on which the first matching rule allows, or none matches and the default does."""
        found = self._allowed.get((grant, operation))
        if found is None:
            found = self._allowed[grant, operation] = self.shared(allowed(self.steps(grant, operation)))
        return found

    def steps(self, grant: int, operation: Operation) -> list[Step[RuleAtom | None]]:
        """What the grant decides about the operation, in order; last (`by` None) the default, about everything."""
        steps: list[Step[RuleAtom | None]] = [
            Step(self._matches(rule, operation), rule.allow, rule) for rule in self._rules.get(grant, ())
        ]
        steps.append(Step(self.all_channels, self._system.grants[grant].default_allow, None))
        return steps

    def _matches(self, rule: RuleAtom, operation: Operation) -> int:
        """Channels whose domain, topic and partition the rule matches."""
        named = rule.named(operation)
        if rule.domains not in self._within:
            self._within[rule.domains] = self.within(rule.domains)
        within = self._within[rule.domains]
        return bits(named) & within if named else 0

    def decider(self, grant: int, operation: Operation, channel: int) -> RuleAtom | None:
        """The first rule of the grant that matches the channel; None where the default decides."""
        return deciding(self.steps(grant, operation), channel).by

    def within(self, domains: Iterable[int]) -> int:
        """The channels of these domain classes."""
        return union(self.channels_in[domain] for domain in domains)

    def joins(self, grant: int) -> int:
        """Domains that the grant lets its holder join."""
        if self._system.grants[grant].default_allow:
            return self.all_domains
        return union(bits(rule.domains) for rule in self._rules.get(grant, ()) if rule.allow)


class Permissions:
    """The decisions of every grant of a system at one moment.

    `moment` is twice the index of an instant, plus one for the time between it and the next; None: the audit
    instant. `decisions`: those of the system, where they are known already.
    """

    def __init__(self, system: System, moment: int | None = None, decisions: Decisions | None = None) -> None:
        self._system = system
        self.moment = 2 * system.now if moment is None else moment
        known = Decisions(system) if decisions is None else decisions
        self.allowed, self.joins, self.met, self.within = known.allowed, known.joins, known.met, known.within
        self.decider, self.shared = known.decider, known.shared
        self.all_channels, self.all_domains, self.channels_in = known.all_channels, known.all_domains, known.channels_in

    def in_force(self, not_before: int, not_after: int) -> bool:
        """Whether the moment lies between these instants, both included."""
        return 2 * not_before <= self.moment <= 2 * not_after

    @cached_property
    def _chosen(self) -> dict[int, list[tuple[int, int]]]:
        """By certificate, pairs (document, grant).

        The grant is the first in force of the document that names the certificate. Where grants out of date are not
        skipped, it is the first that names it, and in force.
        """
        chosen: dict[int, list[tuple[int, int]]] = {}
        seen: set[tuple[int, int]] = set()
        for number, grant in enumerate(self._system.grants):
            in_force = self.in_force(grant.not_before, grant.not_after)
            if not in_force and self._system.reading_of(grant).skips_grants_out_of_date:
                continue
            for certificate in grant.names:
                if (grant.document, certificate) not in seen:
                    seen.add((grant.document, certificate))
                    if in_force:
                        chosen.setdefault(certificate, []).append((grant.document, number))
        return chosen

    @cached_property
    def _named(self) -> dict[int, dict[int, int]]:
        """By certificate and document: the first grant that names it, where that lets join whatever its dates."""
        named: dict[int, dict[int, int]] = {}
        for number, grant in enumerate(self._system.grants):
            for certificate in grant.names if self._system.reading_of(grant).joins_out_of_date else ():
                named.setdefault(certificate, {}).setdefault(grant.document, number)
        return named

    @cached_property
    def documents(self) -> Mapping[int, Mapping[int, DocumentAtom]]:
        """By reading its documents, by number."""
        numbered = enumerate(self._system.documents)
        return {reading: dict(each) for reading, each in gathered((d.reading, (n, d)) for n, d in numbered).items()}

    @cached_property
    def domain_rules(self) -> dict[int | None, list[tuple[int, DomainRuleAtom]]]:
        """By document: its domain rules, each with its number."""
        return gathered((rule.document, (number, rule)) for number, rule in enumerate(self._system.domain_rules))

    @cached_property
    def topic_rules(self) -> dict[int, list[TopicRuleAtom]]:
        """By domain rule: its topic rules."""
        return gathered((topic.domain_rule, topic) for topic in self._system.topic_rules)

    def admitting(self, certificate: int | None, documents: frozenset[int]) -> list[int]:
        """The grants of these documents by which the certificate joins: dates may bind endpoints alone."""
        chosen = self.chosen(certificate, documents)
        if certificate not in self._named:
            return chosen
        first = self._named[certificate].items()
        return sorted({*chosen, *(grant for document, grant in first if document in documents)})

    def chosen(self, certificate: int | None, documents: frozenset[int]) -> list[int]:
        """The grants that these documents hold for the certificate, one a document."""
        if certificate is None:
            return []
        return [grant for document, grant in self._chosen.get(certificate, ()) if document in documents]

    def granting(self, documents: frozenset[int], *, admitting: bool = False) -> list[int]:
        """The grants of these documents that count for whomever they name; or (`admitting`) by which one joins."""
        return [
            number
            for number, grant in enumerate(self._system.grants)
            if grant.document in documents
            and (
                self.in_force(grant.not_before, grant.not_after)
                or (admitting and self._system.reading_of(grant).joins_out_of_date)
            )
        ]


# What the governance of a trust domain protects, and against whom (DDS-Security 1.1, 9.4.1.2).
#
# All sets are bit sets over channels, except `unauthenticated`, `ruled` and `join_controlled`: over domains.


class Protection(Struct):
    """The flags and kinds that apply, by first match. A channel that is not `governed` is in no set."""

    ruled: int = 0
    unauthenticated: int = 0
    join_controlled: int = 0
    governed: int = 0
    read_controlled: int = 0
    write_controlled: int = 0
    discovery_hidden: int = 0
    liveliness_authenticates: int = 0
    rtps_encrypts: int = 0
    rtps_authenticates: int = 0
    metadata_encrypts: int = 0
    metadata_authenticates: int = 0
    metadata_authenticates_origin: int = 0
    data_encrypts: int = 0
    data_authenticates: int = 0


def protection(document: int | None, permissions: Permissions) -> Protection:
    """What the governance `document` says, None: nothing is governed."""
    result = Protection()
    rules = (
        Step(bits(rule.domains), True, (number, rule)) for number, rule in permissions.domain_rules.get(document, ())
    )
    for one, domains in decided(rules):
        number, rule = one.by
        result.ruled |= domains
        result.unauthenticated |= _if(rule.allow_unauthenticated_participants, domains)
        result.join_controlled |= _if(rule.enable_join_access_control, domains)
        here = permissions.within(members(domains)) if domains else 0
        for each, hit in decided(
            Step(bits(topic.channels) & here, True, topic) for topic in permissions.topic_rules.get(number, ())
        ):
            _apply_topic(result, hit, rule, each.by)
    return result


def open_protection(permissions: Permissions) -> Protection:
    """What an open trust domain protects: nothing, though everything is governed and everybody may come."""
    return Protection(
        ruled=permissions.all_domains,
        unauthenticated=permissions.all_domains,
        governed=permissions.all_channels,
    )


def _apply_topic(result: Protection, hit: int, rule: DomainRuleAtom, topic: TopicRuleAtom) -> None:
    """Adds what the topic rule and its domain rule say of the channels `hit`."""
    result.governed |= hit
    result.read_controlled |= _if(topic.enable_read_access_control, hit)
    result.write_controlled |= _if(topic.enable_write_access_control, hit)
    hidden = topic.enable_discovery_protection and rule.discovery_protection_kind.encrypts
    alive = topic.enable_liveliness_protection and rule.liveliness_protection_kind.authenticates
    result.discovery_hidden |= _if(hidden, hit)
    result.liveliness_authenticates |= _if(alive, hit)
    rtps, metadata, data = rule.rtps_protection_kind, topic.metadata_protection_kind, topic.data_protection_kind
    result.rtps_encrypts |= _if(rtps.encrypts, hit)
    result.rtps_authenticates |= _if(rtps.authenticates, hit)
    result.metadata_encrypts |= _if(metadata.encrypts, hit)
    result.metadata_authenticates |= _if(metadata.authenticates, hit)
    result.metadata_authenticates_origin |= _if(metadata.authenticates_origin, hit)
    result.data_encrypts |= _if(data.encrypts, hit)
    result.data_authenticates |= _if(data is not ProtectionKind.NONE, hit)


def _if(condition: bool, hit: int) -> int:
    return hit if condition else 0
