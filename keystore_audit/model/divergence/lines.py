"""Which line of which document two readings take differently, for rights that they decide differently about.

Of ordered rules the first that matches decides. Where two readings decide differently, take the two rules that decide.
The earlier one matches in one reading alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from functools import cache
from typing import NamedTuple

from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import GovernanceFile, Operation, PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.divergence.substitution import Cause
from keystore_audit.model.formal.bit_sets import bits, members
from keystore_audit.model.formal.rights import EffectiveRights, Peers
from keystore_audit.model.formal.steps import Step, compare
from keystore_audit.model.formal.system import System
from keystore_audit.model.inventory import Typed, documents_of
from keystore_audit.model.participants.doubt import enclave_doubts
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.participants.views import Fleet, Kind
from keystore_audit.model.semantics import ReadGrant
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.model.validity import in_force, read_date
from keystore_audit.profiles import PartitionReading, Profile
from keystore_audit.truth import Bounds

# What an implementation allows, as values that can be compared: for certain, and perhaps.


def differing(values: Sequence[Bounds]) -> int:
    """What is certainly in one of the sets and certainly not in another."""
    somewhere, everywhere = 0, -1
    for value in values:
        somewhere |= value.must
        everywhere &= value.may
    return somewhere & ~everywhere


def attributed(stages: Sequence[Bounds], wanted: int) -> Iterator[tuple[int, bool, int]]:
    """To which stage each member of `wanted` is due that the first and the last stage decide differently.

    (stage, whether the first one allows, members): the earliest stage that decides as the last one does.
    """
    allowed = stages[0].must & ~stages[-1].may & wanted
    denied = stages[-1].must & ~stages[0].may & wanted
    for number, stage in enumerate(stages):
        if now := allowed & ~stage.may:
            allowed &= ~now
            yield number, True, now
        if now := denied & stage.must:
            denied &= ~now
            yield number, False, now


class LocalValues:
    """What implementations decide about their own participants, endpoints and topics.

    `domain`: the one in which enclaves are to start; None: some domain of 0..232.
    """

    def __init__(self, accesses: AccessViews, channels: Channels, at: datetime, domain: int | None) -> None:
        self._accesses = accesses
        self._channels = channels
        self._at = at
        self._anywhere = Usabilities(domain, accesses)
        self._members = [channels.bits_in(domain) for domain in range(len(channels.domains))]
        self._decided: dict[tuple[str, str, Operation], Bounds] = {}
        self.rights = LocalRights(accesses, channels, at)

    def starts(self, enclave: Enclave, profile: Profile) -> Bounds:
        """Whether a participant is created, as a set of one member."""
        usable = self._anywhere.of(enclave, self._at, profile).usable
        return Bounds(int(usable.must), int(usable.may))

    def decided(self, enclave: Enclave, operation: Operation, profile: Profile) -> Bounds:
        """The channels on which the operation is allowed to participants that are created there."""
        key = enclave.files.directory, profile.name, operation
        if key not in self._decided:
            row = self._accesses.row(profile.access)
            if enclave_doubts(enclave, profile.trust, row, self._accesses):
                self._decided[key] = Bounds(0, sum(self._members))
            else:
                allowed = self.rights.allowed(enclave, profile, operation)
                self._decided[key] = Bounds.exact(allowed & self._where_it_starts(enclave, profile, allowed))
        return self._decided[key]

    def starts_in(self, enclave: Enclave, profile: Profile, channels: int) -> int:
        """Those of the channels in whose domain a participant is created."""
        return channels & self._where_it_starts(enclave, profile, channels)

    def _where_it_starts(self, enclave: Enclave, profile: Profile, wanted: int) -> int:
        """The channels of domains in which a participant is created; only domains with `wanted` channels are asked."""
        found = 0
        for number, inside in enumerate(self._members):
            if inside & wanted:
                domain = self._channels.domains[number].intervals[0][0]
                if self._anywhere.in_domain(domain).of(enclave, self._at, profile).usable.may:
                    found |= inside
        return found


class PeerValues:
    """What peers accept from enclaves, each profile by its access row."""

    def __init__(self, builder: SystemBuilder, profiles: Iterable[Profile], accesses: AccessViews) -> None:
        facts: dict[str, System] = {}
        self._row: dict[str, str] = {}
        systems: list[System] = []
        by_row: dict[object, str] = {}
        for profile in profiles:
            row = accesses.row(profile.access)
            self._row[profile.name] = by_row.setdefault(row, profile.name)
            if by_row[row] != profile.name:
                continue
            fleet = Fleet((Kind(profile.trust, row),))
            may = replace(builder.build(fleet, may=True), profiles=(profile.name,))
            facts[profile.name] = may
            systems.append(may)
            if may.has_doubt:
                systems.append(replace(builder.build(fleet, may=False), profiles=(profile.name,)))
        self._effective = EffectiveRights(systems)
        self._view = cache(lambda name: _Peers(facts[name]))

    def accepted(self, path: str, operation: Operation, profile: Profile) -> Bounds:
        """The channels on which some peer accepts the operation from the enclave."""
        return self._effective.accepted(path, self._row[profile.name], operation)

    def view(self, profile: Profile) -> _Peers:
        """The facts behind it; what could not be read counts as anything."""
        return self._view(self._row[profile.name])


class Part(NamedTuple):
    """Channels with the line that is read differently, the line that decides instead, and the cause if that tells."""

    channels: int
    location: Location
    other: Location | None
    cause: Cause | None


_Both = tuple[Profile, Profile]
"""The profile before a peculiarity is removed, and after."""


class _Line(NamedTuple):
    """Where a step stands; `is_rule`: it is a rule, not a default or a missing rule; `allows`: a rule that allows."""

    location: Location | None
    is_rule: bool
    allows: bool = False


_Step = Step[_Line]


class DecidingLines:
    """The lines of one keystore at `at` (aware UTC)."""

    def __init__(self, keystore: Keystore, accesses: AccessViews, at: datetime, local: LocalValues) -> None:
        self._accesses = accesses
        self._at = at
        self._local = local
        self._files = {each.place: each.file for each in documents_of(keystore)}

    def start(self, enclave: Enclave, before: Profile, after: Profile) -> Location:
        """Why the enclave starts under one of the two alone."""
        if before.local.starts_ungoverned != after.local.starts_ungoverned:
            return _whole(enclave.governance) or Location(path=enclave.files.directory)
        for file in (enclave.governance, enclave.permissions):
            if file is not None:
                refusals = {self._accesses.read(file, profile.access).refusal for profile in (before, after)}
                if len(refusals) > 1 and None in refusals:
                    return self._refused(file, before, after)
        grants = [self._local.rights.grant(enclave, profile) for profile in (before, after)]
        if not _same(*grants):
            return self._own_date(enclave, before, after)
        if grants[0] is not None and enclave.permissions is not None:
            return Location(path=enclave.permissions.signed.file.place, line=grants[0].grant.line)
        return _whole(enclave.governance) or _whole(enclave.permissions) or Location(path=enclave.files.directory)

    def decided(
        self, enclave: Enclave, operation: Operation, before: Profile, after: Profile, channels: int
    ) -> Iterator[Part]:
        """Of channels that the two decide differently about for their own participants."""
        starts = [self._local.starts_in(enclave, profile, channels) for profile in (before, after)]
        differs = starts[0] ^ starts[1]
        if differs:
            yield Part(differs, self.start(enclave, before, after), None, None)
        rest = channels & ~differs
        if rest and not _same(*(self._local.rights.grant(enclave, profile) for profile in (before, after))):
            yield Part(rest, self._own_date(enclave, before, after), None, None)
        elif rest:
            ours, theirs = (_steps(self._local, enclave, profile, operation) for profile in (before, after))
            yield from self._parts(ours, theirs, rest, before)

    def accepted(
        self, peers: PeerValues, path: str, operation: Operation, before: Profile, after: Profile, channels: int
    ) -> Iterator[Part]:
        """Of channels on which peers accept the operation from the enclave under one of the two alone."""
        ours, theirs = map(peers.view, (before, after))
        number = ours.numbers.get(path)
        for trust_domain in range(min(len(ours.trust_domains), len(theirs.trust_domains)) if number is not None else 0):
            rights = [
                each.trust_domains[trust_domain].abilities(number or 0).by_right(operation) for each in (ours, theirs)
            ]
            here = (rights[0] ^ rights[1]) & channels
            for part in (
                self._in_trust_domain(ours, theirs, trust_domain, number or 0, operation, (before, after))
                if here
                else ()
            ):
                found = part.channels & here
                if found:
                    here &= ~found
                    channels &= ~found
                    yield part._replace(channels=found)

    def _in_trust_domain(
        self, ours: _Peers, theirs: _Peers, trust_domain: int, number: int, operation: Operation, both: _Both
    ) -> Iterator[Part]:
        """Every line that peers in a trust domain take differently, the governance's first, whatever they name."""
        for topics in (_topics, _open_topics):
            yield from self._parts(
                topics(ours, trust_domain, operation), topics(theirs, trust_domain, operation), -1, both[0]
            )
        identity = ours.system.enclaves[number].identity
        joins: list[Part] = []
        for document in sorted(ours.trust_domains[trust_domain].accepted | theirs.trust_domains[trust_domain].accepted):
            mine, other = (each.chosen(trust_domain, identity, document) for each in (ours, theirs))
            if mine is not None and other is not None and ours.order(mine) == theirs.order(other):
                yield from self._parts(_rules(ours, mine, operation), _rules(theirs, other, operation), -1, both[0])
                domains = ours.permissions.joins(mine) ^ theirs.permissions.joins(other)
                channels = ours.permissions.within(members(domains))
                joins.append(Part(channels, ours.system.grants[mine].location, None, None))
            elif mine is not None or other is not None:
                place = ours.system.documents[document].location.path
                subject = ours.system.certificates[identity].label if identity is not None else ""
                yield Part(-1, self._dated(place, subject, *both), None, None)
        yield from joins

    def _parts(self, ours: Iterable[_Step], theirs: Iterable[_Step], channels: int, before: Profile) -> Iterator[Part]:
        """Of the channels, those that the two lists decide differently about, by the two that decide."""
        for found in compare(ours, list(theirs), channels):
            first, second = _ordered(found.left.by, found.right.by)
            location = first.location or second.location
            if location is not None:
                cause = self._partition_cause(found.left, before)
                yield Part(found.channels, location, second.location if first.location else None, cause)

    def _partition_cause(self, step: _Step, before: Profile) -> Cause:
        """What of partitions is read differently, where that is the cause."""
        if before.access.partitions is PartitionReading.CRITERION_DEFAULT:
            return Cause.DENY_WITHOUT_PARTITION
        if before.access.partitions is PartitionReading.CRITERION_NAMED:
            return Cause.OTHER
        if step.allow:
            return Cause.CROSSED_PARTITIONS
        return Cause.FINAL_RULE if step.by.allows else Cause.DENY_IN_PARTITION

    def _refused(self, file: Typed, before: Profile, after: Profile) -> Location:
        """What makes one of the two refuse the document: a date, else the document."""
        place = file.signed.file.place
        for grant in file.grants if isinstance(file, PermissionsFile) else ():
            for date in (grant.not_before, grant.not_after):
                readings = [read_date(date.text, profile.access.dates, None) for profile in (before, after)]
                if (readings[0] is None) != (readings[1] is None):
                    return Location(path=place, line=date.line)
        return _whole(file) or Location(path=place)

    def _own_date(self, enclave: Enclave, before: Profile, after: Profile) -> Location:
        certificate = enclave.identity
        if enclave.permissions is None or certificate is None:
            return Location(path=enclave.files.directory)
        return self._dated(enclave.permissions.signed.file.place, certificate.subject, before, after)

    def _dated(self, place: str, subject: str, before: Profile, after: Profile) -> Location:
        """The date by which a grant for the subject counts for one of the two alone."""
        file = self._files.get(place)
        if file is None:
            return Location(path=place)
        read = [self._accesses.read(file, profile.access).grants or () for profile in (before, after)]
        named: Location | None = None
        for ours, theirs in zip(*read, strict=False):
            if ours.grant.subject_name.text != subject:
                continue
            named = named or Location(path=place, line=ours.grant.line)
            counts = [in_force(grant, self._at) for grant in (ours, theirs)]
            if counts[0] != counts[1]:
                out = theirs if counts[0] else ours
                date = out.grant.not_before if self._at < out.not_before else out.grant.not_after
                return Location(path=place, line=date.line)
        return named or self._refused(file, before, after)


class _Peers(Peers):
    def chosen(self, trust_domain: int, identity: int | None, document: int) -> int | None:
        """The grant of a document that the trust domain's peers take for the certificate's."""
        accepted = self.trust_domains[trust_domain].accepted & {document}
        return next(iter(self.permissions.chosen(identity, accepted)), None)

    def order(self, grant: int) -> int:
        """The place of a grant in its document."""
        document = self.system.grants[grant].document
        return sum(1 for other in self.system.grants[:grant] if other.document == document)


def _whole(file: Typed | None) -> Location | None:
    if file is None:
        return None
    typed = file.governance if isinstance(file, GovernanceFile) else file.permissions
    return Location(path=file.signed.file.place, line=typed.line if typed is not None else None)


def _ordered(one: _Line, two: _Line) -> tuple[_Line, _Line]:
    """The two, first the one that is read differently: a rule before a default, the earlier rule first."""
    if one.is_rule != two.is_rule:
        return (one, two) if one.is_rule else (two, one)
    if one.location is None or two.location is None or one.location.path != two.location.path:
        return one, two
    return (one, two) if (one.location.line or 0) <= (two.location.line or 0) else (two, one)


def _same(one: ReadGrant | None, other: ReadGrant | None) -> bool:
    """Whether both are a reading of one grant, or of none."""
    return (one.grant if one is not None else None) is (other.grant if other is not None else None)


def _steps(local: LocalValues, enclave: Enclave, profile: Profile, operation: Operation) -> Iterator[_Step]:
    steps = list(local.rights.steps(enclave, profile, operation))
    for step in steps:
        rule = step.by.rule
        line = _Line(step.by.location, step is not steps[-1], rule is not None and rule.rule.allow)
        yield Step(step.channels, step.allow, line)


def _topics(peers: _Peers, trust_domain: int, _operation: Operation) -> Iterator[_Step]:
    """Which topics exist by the governance."""
    for rule in peers.system.topic_rules:
        parent = peers.system.domain_rules[rule.domain_rule]
        if parent.document == peers.system.trust_domains[trust_domain].governance:
            named = bits(rule.channels) & peers.permissions.within(parent.domains)
            yield Step(named & peers.trust_domains[trust_domain].protection.governed, True, _Line(rule.location, True))
    yield Step(-1, False, _Line(None, False))


def _open_topics(peers: _Peers, trust_domain: int, operation: Operation) -> Iterator[_Step]:
    """The topics that are open to everybody: permissions do not count there."""
    protection = peers.trust_domains[trust_domain].protection
    controlled = protection.write_controlled if operation is Operation.PUBLISH else protection.read_controlled
    free = 0 if operation is Operation.RELAY else protection.governed & ~controlled
    for step in _topics(peers, trust_domain, operation):
        yield Step(step.channels & free, True, step.by)
        yield Step(step.channels & ~free, False, step.by)


def _rules(peers: _Peers, grant: int, operation: Operation) -> Iterator[_Step]:
    """What the rules of a grant decide, and its default."""
    for step in peers.decisions.steps(grant, operation):
        by = peers.system.grants[grant] if step.by is None else step.by
        allows = step.by is not None and step.by.source is not None and step.by.source.allow
        yield Step(step.channels, step.allow, _Line(by.location, step.by is not None, allows))
