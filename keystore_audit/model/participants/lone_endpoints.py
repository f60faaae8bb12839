"""Endpoints that an enclave's own implementation decides about otherwise than its peers. It creates some that peers
would refuse, and refuses some that peers would take.

An attacker gives its keys to anybody, and takes samples from anybody. So an honest enclave gets from an attacker what
its own implementation lets it read. An attacker, or anybody on the network, gets from an honest enclave what its own
implementation lets it write. What honest peers concede is no bound. Some implementations let an enclave do more. Fast
DDS applies rules of other domains to its own endpoints. Cyclone DDS lets a participant start wherever some topic has no
access control (docs/profiles.md).

While nobody attacks, data gets somewhere only if the implementations on the way create their own endpoints. Some refuse
what they would concede to a peer. To its own endpoints Fast DDS applies deny rules of other domains too, and a
`<relay>` gives them nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from functools import cache
from typing import Final, NamedTuple

from msgspec.structs import replace

from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import GovernanceFile, Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Channels, wildcard_names
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.bit_sets import members, union
from keystore_audit.model.formal.permission import Meetings
from keystore_audit.model.formal.system import Participant
from keystore_audit.model.inventory import governance_alike
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.semantics import ReadGrant
from keystore_audit.profiles import Access, Profile, TopicCheck


class Endpoints(NamedTuple):
    """Channels on which it decides about readers and writers of the enclave."""

    reads: frozenset[int]
    writes: frozenset[int]


NO_ENDPOINTS = Endpoints(frozenset(), frozenset())

WAYS: Final = (Operation.SUBSCRIBE, Operation.PUBLISH)
"""In the order of `Endpoints`."""

Timeline = tuple[tuple[int, Endpoints], ...]
"""Endpoints from moments on (`permission.Permissions`), ascending. None before the first, which is the audit's."""


def changes(found: Iterable[tuple[int, Endpoints]]) -> Timeline:
    """The timeline without later moments that change nothing; empty where it has nothing at any moment."""
    kept: list[tuple[int, Endpoints]] = []
    for moment, ends in found:
        if not kept or ends != kept[-1][1]:
            kept.append((moment, ends))
    return tuple(kept) if any(any(ends) for _moment, ends in kept) else ()


def then(timeline: Timeline, moment: int) -> Endpoints:
    """The endpoints at a moment."""
    *_, found = NO_ENDPOINTS, *(each for begin, each in timeline if begin <= moment)
    return found


def joined(several: Sequence[Timeline]) -> Timeline:
    """What a participant has that may have any of these."""
    found = []
    for moment in sorted({begin for each in several for begin, _ends in each}):
        reads, writes = zip(*(then(each, moment) for each in several), strict=True)
        found.append((moment, Endpoints(frozenset[int]().union(*reads), frozenset[int]().union(*writes))))
    return tuple(found)


def made_alone(atom: Participant, alone: Timeline, refused: Timeline = ()) -> Participant:
    """The enclave with these endpoints, made and refused by its own implementation."""
    several = []
    for moment in sorted({begin for begin, _ends in (*alone, *refused)}):
        made, lost = then(alone, moment), then(refused, moment)
        made_then = replace(atom, reads_alone=made.reads, writes_alone=made.writes)
        several.append((moment, replace(made_then, refused_reads=lost.reads, refused_writes=lost.writes)))
    return replace(several[0][1], later=tuple(several[1:])) if several else atom


def within(one: Timeline, other: Timeline) -> bool:
    """Whether the other has, at each moment, all that this one has."""
    moments = [begin for begin, _ends in (*one, *other)]
    pairs = ((then(one, moment), then(other, moment)) for moment in moments)
    return all(mine.reads <= its.reads and mine.writes <= its.writes for mine, its in pairs)


class Alone(NamedTuple):
    """What its own implementation lets an enclave do where it possibly starts, and where it certainly does. Also the
    endpoints that its implementation refuses and peers would take.
    """

    possible: Timeline = ()
    certain: Timeline = ()
    refused: Timeline = ()


NOTHING = Alone()
"""For an enclave whose implementation lets it do exactly what its peers concede."""


class LoneEndpoints:
    """The endpoints of one keystore's enclaves that are created, and those that are refused, from `at` on. `at` is one
    of the `instants` (aware UTC, sorted), among which are all dates of its certificates, lists and grants. They change
    at later moments, as another grant counts, or as an enclave begins or ceases to start. Also those that `holders`
    create.

    `meets`: by channel, those in which endpoints of its partition are met; empty where partitions are plain names.
    """

    def __init__(
        self,
        keystore: Keystore,
        accesses: AccessViews,
        channels: Channels,
        instants: Sequence[datetime],
        at: datetime,
        meets: Sequence[frozenset[int]],
        holders: Iterable[Enclave] = (),
    ) -> None:
        self._enclaves = (*keystore.enclaves, *holders)
        self._accesses = accesses
        self._channels = channels
        self._number = {instant: number for number, instant in enumerate(instants)}
        self._at = at
        self._meetings = Meetings(meets)
        self._odd_names = bool(wildcard_names(channels))
        self._usabilities = Usabilities(None, accesses)
        self._rights = cache(lambda at: LocalRights(accesses, channels, at))
        self._set = cache(lambda numbers: frozenset(members(numbers)))  # one object for as many as 300,000 channels
        self._differing: dict[tuple[Access, bool], set[int]] = {}
        self._ruled: dict[tuple[str, Access], frozenset[int]] = {}
        governances = (enclave.governance for enclave in keystore.enclaves if enclave.governance is not None)
        self._several = len(set(map(governance_alike, governances))) > 1
        self._count = len(keystore.enclaves)

    def of(self, profile: Profile) -> tuple[Alone, ...]:
        """By enclave, then by holder; empty where none may differ from what peers concede it."""
        row = self._accesses.row(profile.access)
        odd_names = self._odd_names and profile.local.reads_names_as_expressions
        if (row, odd_names) not in self._differing:
            self._differing[row, odd_names] = {
                number
                for number, enclave in enumerate(self._enclaves)
                if enclave.governance is not None
                and (odd_names or self._may_differ(enclave.governance, self._grants(enclave, row), row))
            }
        differing, found = self._differing[row, odd_names], [NOTHING] * len(self._enclaves)
        for number, enclave in enumerate(self._enclaves):
            if number in differing:
                found[number] = self._made(enclave, profile)
            grants = self._grants(enclave, profile.access) if number < self._count else ()
            if any(self._may_refuse(grant, profile) for grant in grants):
                found[number] = found[number]._replace(refused=self._refused(enclave, profile))
        return tuple(found) if any(any(each) for each in found) else ()

    def _grants(self, enclave: Enclave, access: Access) -> tuple[ReadGrant, ...]:
        """What its own document grants, whoever the grant names."""
        return () if enclave.permissions is None else self._accesses.read(enclave.permissions, access).grants or ()

    def _moments(self, enclave: Enclave, profile: Profile) -> Iterator[tuple[int, datetime, LocalRights]]:
        """The moments, instants at which they are, and what is decided then."""
        for date in sorted({self._at, *self._usabilities.dates(enclave, profile, self._at)}):
            for behind in (0, 1):
                at = date + behind * datetime.resolution
                yield 2 * self._number[date] + behind, at, self._rights(at)

    def _made(self, enclave: Enclave, profile: Profile) -> Alone:
        possible, certain = [], []
        for moment, at, local in self._moments(enclave, profile):
            ways = [self._meetings.met(local.allowed(enclave, profile, each)) for each in WAYS]
            may, must = self._where_usable(enclave, profile, at, union(ways))
            possible.append((moment, Endpoints(*(self._set(each & may) for each in ways))))
            certain.append((moment, Endpoints(*(self._set(each & must) for each in ways))))
        return Alone(changes(possible), changes(certain))

    def _refused(self, enclave: Enclave, profile: Profile) -> Timeline:
        return changes(
            (
                moment,
                Endpoints(
                    *(
                        self._set(
                            local.peer_authorised(enclave, profile, each) & ~local.allowed(enclave, profile, each)
                        )
                        for each in WAYS
                    )
                ),
            )
            for moment, _at, local in self._moments(enclave, profile)
        )

    def _where_usable(self, enclave: Enclave, profile: Profile, at: datetime, asked: int) -> tuple[int, int]:
        """Of the channels asked those of domains in which the enclave possibly, and in which it certainly starts."""
        possible, certain = 0, 0
        for number, domain in enumerate(self._channels.domains):
            here = asked & self._channels.bits_in(number)
            if here:
                usable = self._usabilities.in_domain(domain.intervals[0][0]).of(enclave, at, profile).usable
                possible |= here if usable.may else 0
                certain |= here if usable.must else 0
        return possible, certain

    def _may_differ(self, governance: GovernanceFile, grants: Iterable[ReadGrant], access: Access) -> bool:
        """Whether the enclave might do what peers would not concede it.

        It does not where each rule of its grants is about all governed domains, and about its own endpoints as about
        those of peers. Then peers let it join all domains, and rules apply there as they do here.
        It may where any rule of the governance counts, while the first alone says what is protected.
        """
        ruled = self._ruled_by(governance, access)
        return access.any_governance_rule or any(
            not (grant.default_allow or any(rule.allow for rule in grant.rules))
            or any(rule.of_peers or not ruled <= self._channels.covered(rule.domains) for rule in grant.rules)
            for grant in grants
        )

    def _ruled_by(self, governance: GovernanceFile, access: Access) -> frozenset[int]:
        """The domain classes that some rule of the governance is about."""
        key = (governance.signed.file.place, access)
        if key not in self._ruled:
            rules = self._accesses.deciding(governance, access)
            self._ruled[key] = frozenset[int]().union(*(self._channels.covered(rule.domains) for rule in rules))
        return self._ruled[key]

    def _may_refuse(self, grant: ReadGrant, profile: Profile) -> bool:
        """Whether its rules may decide otherwise about the enclave's own endpoints than about those of a peer."""
        if all(rule.allow and not rule.of_peers for rule in grant.rules):  # nearly always
            return False
        if any(rule.of_peers for rule in grant.rules):
            return True
        if not profile.local.binds_domains and len({rule.domains for rule in grant.rules}) > 1:
            return True
        return profile.access.topic_check is not TopicCheck.NONE and self._several  # each asks its own governance
