"""Services and actions of which an enclave may use a part alone, so that they cannot work.

What counts is what the enclave's own implementation lets it do, over all ROS names: in classes (`model.ros.classes`).
Half of it has to come from an allow rule of the enclave's grant. What a governance leaves open to everybody, or a
default allows, does not show that the enclave was to have the service. ROS 2 endpoints are in the default partition.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from itertools import chain
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.grouped import grouped
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.bit_sets import members, union
from keystore_audit.model.formal.steps import allowed
from keystore_audit.model.names import ACTION_PART, ACTION_ROLES, ACTION_SERVICES, SERVICE_ROLES, Use, dds_expressions
from keystore_audit.model.question import Usability
from keystore_audit.model.ros.classes import OF_ACTIONS, Affix, RosChannels, ros_channels
from keystore_audit.model.ros.holders import DocumentLines, is_surely_whole
from keystore_audit.model.semantics import DIRECTIONS
from keystore_audit.profiles import Access, Matcher, Profile

_PARTS_OF_ACTIONS: Final = tuple(f"rq?*{ACTION_PART}{service}Request" for service in ACTION_SERVICES)
"""The requests that are parts of actions: as services they are not looked at."""

PUBLISH, SUBSCRIBE = Operation.PUBLISH, Operation.SUBSCRIBE
Role = tuple[tuple[Operation, Affix], ...]

ROLES: Final[Mapping[str, Role]] = {
    role: tuple(
        (operation, Affix(topic[:2], topic[2:]))
        for operation, topic in sorted(dds_expressions(role, ""), key=lambda use: use[0] is not PUBLISH)
    )
    for role in (*SERVICE_ROLES, *ACTION_ROLES)
}
"""What each role takes (`names.dds_expressions`); what is published comes first."""


class Half(Struct, frozen=True, kw_only=True):
    """An operation on a service or an action (`names.dds_channels`) of which the enclave may do a part.

    `name`: a ROS name; `several`: others are like it. `has`, `lacks`: what is allowed by a rule, and what is refused,
    on DDS topics. `location`: the line that allows the first of `has`. `profiles`: chosen ones for which it holds.
    """

    enclave: str
    role: str
    name: str
    several: bool
    has: tuple[Use, ...]
    lacks: tuple[Use, ...]
    location: Location
    profiles: tuple[str, ...]


class Halves(Struct, frozen=True, kw_only=True):
    """All halves of a keystore. `unknown`: by path, enclaves whose names are of too many classes, and why."""

    halves: tuple[Half, ...] = ()
    unknown: tuple[tuple[Enclave, str], ...] = ()


class _Reader(NamedTuple):
    """Profiles that read this keystore's documents, and ask of their own endpoints, alike; `profile` is one of them."""

    profile: Profile
    row: Access
    names: tuple[str, ...]


def halves(
    keystore: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    usability: Mapping[tuple[str, str], Usability],
) -> Halves:
    """Half services and actions of every enclave that starts, at `at` (aware UTC).

    `usability`: by (enclave directory, profile name).
    """
    return _Search(profiles, at, accesses, usability).of(keystore.enclaves)


class _Search:
    """Looks at enclaves one by one; those with equal documents share what was found."""

    def __init__(
        self,
        profiles: Sequence[Profile],
        at: datetime,
        accesses: AccessViews,
        usability: Mapping[tuple[str, str], Usability],
    ) -> None:
        self._at = at
        self._accesses = accesses
        self._usability = usability
        readers = grouped(profiles, lambda profile: (accesses.row(profile.access), profile.local))
        self._readers = [
            _Reader(alike[0], row, tuple(profile.name for profile in alike)) for (row, _), alike in readers.items()
        ]
        self._rewinds = all(reader.row.matcher is not Matcher.SINGLE_TRY for reader in self._readers)
        self._known: dict[object, tuple[_Found, ...]] = {}

    def of(self, enclaves: Iterable[Enclave]) -> Halves:
        """All halves of these enclaves."""
        found: list[Half] = []
        unknown: list[tuple[Enclave, str]] = []
        for enclave in enclaves:
            if all(is_surely_whole(grant, rewinds=self._rewinds) for grant in enclave.grants):
                continue
            readers = [reader for reader in self._readers if self._starts(enclave, reader)]
            try:
                shared = self._shared(enclave, readers) if readers else ()
            except BudgetExceeded as exceeded:
                unknown.append((enclave, exceeded.message))
                continue
            found += _named(enclave, shared)
        return Halves(halves=tuple(found), unknown=tuple(unknown))

    def _starts(self, enclave: Enclave, reader: _Reader) -> bool:
        usability = self._usability.get((enclave.files.directory, reader.names[0]))
        return usability is None or usability.usable.may

    def _shared(self, enclave: Enclave, readers: Sequence[_Reader]) -> tuple[_Found, ...]:
        """What was found for an enclave with the same rules below the same governance."""
        if enclave.permissions is None or enclave.governance is None:
            return ()
        rows = tuple(dict.fromkeys(reader.row for reader in readers))
        read = [self._accesses.read(enclave.permissions, row).grants or () for row in rows]
        key = (
            enclave.governance.signed.file.place,
            tuple(reader.names for reader in readers),
            tuple((grant.rules, grant.default_allow) for grants in read for grant in grants),
        )
        if any(len(grants) != 1 for grants in read):  # which of them counts depends on the enclave
            return tuple(_compared(enclave, readers, self._accesses, self._at))
        if key not in self._known:
            self._known[key] = tuple(_compared(enclave, readers, self._accesses, self._at))
        return self._known[key]


class _Found(NamedTuple):
    """A half, without its enclave."""

    role: str
    name: str
    several: bool
    has: Role
    lacks: Role
    names: tuple[str, ...]


def _named(enclave: Enclave, shared: Iterable[_Found]) -> Iterator[Half]:
    lines = DocumentLines(enclave)
    for found in shared:
        has, lacks = (
            tuple((operation, affix.topic(found.name)) for operation, affix in channels)
            for channels in (found.has, found.lacks)
        )
        yield Half(
            enclave=enclave.path,
            role=found.role,
            name=found.name,
            several=found.several,
            has=has,
            lacks=lacks,
            location=lines.of(*has[0]),
            profiles=found.names,
        )


def _compared(enclave: Enclave, readers: Sequence[_Reader], accesses: AccessViews, at: datetime) -> Iterator[_Found]:
    """The halves of an enclave under all readers, equal ones together."""
    read = accesses.by_row((reader.profile for reader in readers), (enclave.permissions, enclave.governance))
    for roles, marks in ((SERVICE_ROLES, _PARTS_OF_ACTIONS), (ACTION_ROLES, ())):
        affixes = tuple(dict.fromkeys(affix for role in roles for _operation, affix in ROLES[role]))
        channels = ros_channels(read, affixes, marks)
        local = LocalRights(accesses, channels.channels, at)
        rights = [(reader, _Rights(local, enclave, reader.profile)) for reader in readers]
        together: dict[tuple[str, Role, Role], list[tuple[int, _Reader]]] = {}
        for role in roles:
            telling = {each: _telling(role, each, channels) for each in ROLES[role]}
            for reader, its in rights:
                for has, lacks, halves_ in _halves_of(telling, its, channels):
                    together.setdefault((role, has, lacks), []).append((halves_, reader))
        for (role, has, lacks), found in together.items():
            for number in members(union(halves_ for halves_, _reader in found)):
                of = (reader.names for halves_, reader in found if halves_ >> number & 1)
                names = tuple(dict.fromkeys(chain.from_iterable(of)))
                yield _Found(role, channels.classes[number].name, not channels.is_literal(number), has, lacks, names)


class _Rights:
    """By operation: what the enclave's implementation allows, and what of it a rule of its grant allows."""

    def __init__(self, local: LocalRights, enclave: Enclave, profile: Profile) -> None:
        self.allowed: dict[Operation, int] = {}
        self.granted: dict[Operation, int] = {}
        for operation in DIRECTIONS:
            steps = list(local.steps(enclave, profile, operation))
            self.allowed[operation] = allowed(steps)
            steps.pop()  # the default
            self.granted[operation] = allowed(step for step in steps if step.by.by_permissions)


def _telling(role: str, channel: tuple[Operation, Affix], channels: RosChannels) -> int:
    """The classes for which a right on the channel shows that the role was meant.

    Only where an expression names services, or for an action, one: `*` is about everything, `rq/arm/*Request` about
    services, and `rt/arm/*` about topics. Who only reads the topics of an action watches.
    """
    operation, affix = channel
    if role in SERVICE_ROLES:
        return channels.naming(operation, affix, f"{affix.prefix}/")
    if affix not in OF_ACTIONS:
        return channels.naming(operation, affix, ACTION_PART)
    return channels.listed(operation, affix) if operation is PUBLISH else 0


def _halves_of(
    telling: Mapping[tuple[Operation, Affix], int], rights: _Rights, channels: RosChannels
) -> Iterator[tuple[Role, Role, int]]:
    """What the enclave may and may not do of a role, in some domain, and the classes for which it is so."""
    topics = {(operation, affix): channels.of_affix(affix) for operation, affix in telling}
    for start in channels.starts:
        has_any, lacks_any = 0, 0
        granted: dict[tuple[Operation, Affix], int] = {}
        allowed: dict[tuple[Operation, Affix], int] = {}
        for each in telling:
            granted[each] = channels.by_class(rights.granted[each[0]], start, topics[each])
            allowed[each] = channels.by_class(rights.allowed[each[0]], start, topics[each])
            has_any |= granted[each] & telling[each]
            lacks_any |= ~allowed[each]
        alike: list[tuple[Role, Role, int]] = [((), (), has_any & lacks_any & channels.unmarked)]
        for each in telling:
            alike = [
                ((*has, each) if may else has, lacks if able else (*lacks, each), among)
                for has, lacks, classes in alike
                for may, of_both in ((True, classes & granted[each]), (False, classes & ~granted[each]))
                for able, among in ((True, of_both & allowed[each]), (False, of_both & ~allowed[each]))
                if among
            ]
        yield from alike
