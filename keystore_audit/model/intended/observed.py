"""The system as it is or will be, held against what its enclaves are granted.

What nodes need (`observed_needs`) is compared with what the enclaves' own implementations let them do. A node does not
start without a right that it needs. A right that is granted and never used is more than it needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from datetime import datetime

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.grouped import grouped
from keystore_audit.intent.intent import Intent, Origin, SetVariable, Unresolved, UsedName
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import LayoutKind
from keystore_audit.keystore.typed import Grant, Operation, PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import Point
from keystore_audit.model.intended.observed_needs import Need, in_layout, needs, nodes_of, usages, usual_channels
from keystore_audit.model.intended.observed_rights import Deciders, JointRuling, PointRights
from keystore_audit.model.matching.expression import has_wildcard
from keystore_audit.model.names import Use
from keystore_audit.model.semantics import DIRECTIONS
from keystore_audit.profiles import Profile
from keystore_audit.truth import Truth


class MissingGrant(Struct, frozen=True, kw_only=True):
    """A node needs what its enclave's own implementation denies.

    `domains`: where alone, in words, "" for all in which the enclave starts. `explain`: why, a sentence without its
    full stop; `decides`: the line that denies. `profiles`: canonical names of those that deny.
    """

    need: Need
    domains: str
    explain: Callable[[], str]
    decides: Location | None
    profiles: tuple[str, ...]


class DeniedName(Struct, frozen=True, kw_only=True):
    """A node uses a name with which its enclave may do nothing."""

    used: UsedName
    enclave: str
    profiles: tuple[str, ...]


class GrantedName(Struct, frozen=True, kw_only=True):
    """A name that a grant lists, and the line; in a partition, "" for the default one."""

    operation: Operation
    topic: str
    partition: str
    location: Location


class ExcessGrant(Struct, frozen=True, kw_only=True):
    """What an enclave is granted and no node of it was seen to use.

    `names`: those it lists. `wide`: one more that an expression or a default allows, if there is one; `endless`: of
    infinitely many. `used`, `allowed`: how many of the names known it uses and may use, usual ones left
    out. `profiles`: that allow any of it. `launched`: launch files alone tell of its nodes.
    """

    enclave: str
    names: tuple[GrantedName, ...]
    wide: GrantedName | None
    endless: bool
    used: int
    allowed: int
    profiles: tuple[str, ...]
    launched: bool


class UnknownEnclave(Struct, frozen=True, kw_only=True):
    """Nodes that are to run in an enclave that the keystore does not have; their names, and the places."""

    path: str
    nodes: tuple[str, ...]
    locations: tuple[Location, ...]


class Undecided(Struct, frozen=True, kw_only=True):
    """An enclave about which something is unknown: a sentence without its full stop."""

    enclave: str
    reason: str
    profiles: tuple[str, ...]


class Observation(Struct, frozen=True, kw_only=True):
    """What files say of the system, compared with one keystore. `paths`: of the files, as the user gave them.

    `unused`: enclaves without a node in the files, so that nothing of theirs was compared.
    """

    paths: tuple[str, ...]
    missing: tuple[MissingGrant, ...]
    denied: tuple[DeniedName, ...]
    excess: tuple[ExcessGrant, ...]
    unknown: tuple[UnknownEnclave, ...]
    unresolved: tuple[Unresolved, ...]
    undecided: tuple[Undecided, ...]
    unused: tuple[str, ...]
    variables: tuple[SetVariable, ...] = ()
    speaking: tuple[Unresolved, ...] = ()


def observe(
    intents: Sequence[Intent],
    keystore: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    domain: int | None = None,
) -> Observation:
    """Compares graphs and launch files with the keystore, as the profiles read it at `at` (aware UTC).

    `domain`: the one that the robots use; None: every one that a governance covers. Where anything in the files could
    not be worked out, nothing is called excess.
    """
    intents = in_layout(intents, keystore.layout.kind)
    unresolved = tuple(each for intent in intents for each in intent.unresolved)
    told = _Told(intents)
    deciders = Deciders(profiles, at, accesses, domain)
    compared = [
        _Comparison(enclave, told, deciders, complete=not unresolved)
        for enclave in keystore.enclaves
        if enclave.path in told.enclaves
    ]
    return Observation(
        paths=tuple(intent.path for intent in intents),
        missing=tuple(each for one in compared for each in one.missing()),
        denied=tuple(each for one in compared for each in one.denied()),
        excess=tuple(each for one in compared for each in one.excess()),
        unknown=tuple(_unknown(intents, keystore)),
        unresolved=unresolved,
        undecided=tuple(each for one in compared for each in one.undecided()),
        unused=tuple(enclave.path for enclave in keystore.enclaves if enclave.path not in told.enclaves),
        variables=tuple(each for intent in intents for each in intent.variables),
        speaking=tuple(each for intent in intents for each in intent.speaking),
    )


def _unknown(intents: Sequence[Intent], keystore: Keystore) -> Iterator[UnknownEnclave]:
    """Enclaves that the keystore lacks; none if the user gave the folder of one enclave: the others are elsewhere."""
    known = {enclave.path for enclave in keystore.enclaves}
    if keystore.layout.kind is LayoutKind.ENCLAVE:
        return
    for path, nodes in sorted(nodes_of(intents).items()):
        if path not in known:
            names = tuple(dict.fromkeys(node.name for node in nodes))
            yield UnknownEnclave(path=path, nodes=names, locations=tuple(node.location for node in nodes))


class _Told:
    """What the files say, by enclave."""

    def __init__(self, intents: Sequence[Intent]) -> None:
        self.needs = grouped(needs(intents), lambda need: need.enclave)
        self.names = grouped((used for intent in intents for used in intent.names), lambda used: used.enclave)
        self.nodes = {
            path: tuple(dict.fromkeys(node.name for node in nodes)) for path, nodes in nodes_of(intents).items()
        }
        graphs = [intent for intent in intents if intent.origin is Origin.GRAPH]
        self.graphed = frozenset(nodes_of(graphs))
        self.enclaves = frozenset((*self.needs, *self.names, *self.nodes))


class _Comparison:
    """The comparison for one enclave."""

    def __init__(self, enclave: Enclave, told: _Told, deciders: Deciders, *, complete: bool) -> None:
        self._enclave = enclave
        self._deciders = deciders
        self._needs = told.needs.get(enclave.path, [])
        self._names = told.names.get(enclave.path, [])
        self._nodes = told.nodes.get(enclave.path, ())
        self._launched = enclave.path not in told.graphed
        # A launch file without a remapping says nothing of the names that the nodes use.
        says_names = bool(self._names) or any(not need.usual for need in self._needs)
        self._complete = complete and bool(self._nodes) and (says_names or not self._launched)
        file = enclave.permissions
        listed = [(name.topic, name.partition) for name in _listed(file, file.grants)] if file is not None else []
        needed = {channel for need in self._needs for channel in need.channels}
        possible = {channel for used in self._names for each in usages(used.name) for channel in each}
        channels = (*sorted(needed), *sorted(possible), *usual_channels(self._nodes))
        points = [(topic, "") for _operation, topic in channels]
        self._rights = PointRights(enclave, (*points, *listed), deciders)
        self._undecided: dict[str, list[str]] = {}

    def missing(self) -> Iterator[MissingGrant]:
        """What it needs and is denied."""
        every = tuple(dict.fromkeys(channel for need in self._needs for channel in need.channels))
        kinds = [  # most enclaves have all that they need: then one question is enough
            (profile, names)
            for profile, names in self._deciders.kinds
            if self._rights.verdict(profile, every).ruling in (Truth.NO, Truth.UNKNOWN)
        ]
        for need in self._needs if kinds else ():
            denied: list[tuple[JointRuling, tuple[str, ...]]] = []
            for profile, names in kinds:
                verdict = self._rights.verdict(profile, need.channels)
                if verdict.ruling is Truth.NO:
                    denied.append((verdict, names))
                elif verdict.ruling is Truth.UNKNOWN:
                    self._note("whether a participant starts cannot be told", names)
            if denied:
                worst = min((verdict for verdict, _names in denied), key=lambda verdict: bool(verdict.domains))
                yield MissingGrant(
                    need=need,
                    domains=worst.domains,
                    explain=worst.explain,
                    decides=worst.location,
                    profiles=self._in_order(name for _verdict, names in denied for name in names),
                )

    def denied(self) -> Iterator[DeniedName]:
        """The names that it uses and may do nothing with: neither in one direction, nor as any kind of name."""
        for used in self._names:
            denying: list[str] = []
            for profile, names in self._deciders.kinds:
                rulings = {self._rights.verdict(profile, channels).ruling for channels in usages(used.name)}
                if rulings == {Truth.NO}:
                    denying += names
                elif rulings <= {Truth.NO, Truth.UNKNOWN}:
                    self._note(f"whether it may use {used.name} cannot be told", names)
            if denying:
                yield DeniedName(used=used, enclave=self._enclave.path, profiles=self._in_order(denying))

    def excess(self) -> Iterator[ExcessGrant]:
        """What it is granted and does not use, over all profiles."""
        if not self._complete:
            return
        used = {channel for need in self._needs for channel in need.channels}
        used |= {channel for name in self._names for each in usages(name.name) for channel in each}
        usual = set(usual_channels(self._nodes))
        told = used | usual
        names: dict[tuple[Operation, Point], GrantedName] = {}
        beyond: list[tuple[bool, GrantedName]] = []
        known: set[Use] = set()
        allowing: list[str] = []
        for profile, alike in self._deciders.kinds:
            found = self._granted(profile)
            known |= {(name.operation, name.topic) for name in found} - usual
            more = [name for name in found if name.partition or (name.operation, name.topic) not in told]
            names.update({(name.operation, (name.topic, name.partition)): name for name in more})
            wide = list(self._beyond(profile, alike, found, told))
            beyond += wide
            if more or wide:
                allowing += alike
        if allowing:
            endless, wide_name = max(beyond, key=lambda each: each[0], default=(False, None))
            yield ExcessGrant(
                enclave=self._enclave.path,
                names=tuple(names.values()),
                wide=wide_name,
                endless=endless,
                used=len(known & used),
                allowed=len(known),
                profiles=self._in_order(allowing),
                launched=self._launched,
            )

    def undecided(self) -> Iterator[Undecided]:
        """What became unknown on the way: ask last."""
        for reason, names in self._undecided.items():
            yield Undecided(enclave=self._enclave.path, reason=reason, profiles=self._in_order(names))

    def _granted(self, profile: Profile) -> list[GrantedName]:
        """The names that its grant lists and that it really allows."""
        file, grant = self._enclave.permissions, self._rights.grant(profile)
        if file is None or grant is None:
            return []
        return [
            name
            for name in _listed(file, (grant.grant,))
            if self._rights.allows(profile, name.operation, (name.topic, name.partition))
        ]

    def _beyond(
        self, profile: Profile, alike: tuple[str, ...], found: Sequence[GrantedName], used: Set[Use]
    ) -> Iterator[tuple[bool, GrantedName]]:
        """By direction, a name that expressions allow beside those `found` and `used`; whether of infinitely many."""
        grant = self._rights.grant(profile)
        if grant is None or not (grant.default_allow or _has_expressions(grant.grant)):
            return
        try:
            for operation in DIRECTIONS:
                known = {(name.topic, name.partition) for name in found if name.operation is operation}
                known |= {(topic, "") for kind, topic in used if kind is operation}
                beyond = self._rights.beyond(profile, operation, known)
                if beyond is not None:
                    topic, partition = beyond.point
                    name = GrantedName(operation=operation, topic=topic, partition=partition, location=beyond.location)
                    yield beyond.endless, name
        except BudgetExceeded as exceeded:
            self._note(exceeded.message.rstrip("."), alike)

    def _note(self, reason: str, names: Iterable[str]) -> None:
        self._undecided.setdefault(reason, []).extend(names)

    def _in_order(self, names: Iterable[str]) -> tuple[str, ...]:
        """The names in the order of the profiles, each once."""
        wanted = set(names)
        return tuple(name for _profile, alike in self._deciders.kinds for name in alike if name in wanted)


def _listed(file: PermissionsFile, grants: Iterable[Grant]) -> Iterator[GrantedName]:
    """The single names in allow rules of the grants."""
    for grant in grants:
        for criterion in grant.allowed:
            for topic in filter(_is_name, criterion.topics):
                for partition in _partitions(criterion.partitions):
                    yield GrantedName(
                        operation=criterion.operation,
                        topic=topic.text,
                        partition=partition,
                        location=Location(path=file.signed.file.place, line=topic.line),
                    )


def _partitions(partitions: Sequence[Text] | None) -> Sequence[str]:
    return ("",) if partitions is None else [each.text for each in partitions if not each.text or _is_name(each)]


def _is_name(text: Text) -> bool:
    """Whether every implementation takes the expression for that one name."""
    return bool(text.text) and not has_wildcard(text.text)


def _has_expressions(grant: Grant) -> bool:
    return any(
        not _is_name(text)
        for criterion in grant.allowed
        for text in (*criterion.topics, *(each for each in criterion.partitions or () if each.text))
    )
