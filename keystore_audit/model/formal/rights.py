"""What peers accept from an enclave: the most that any peer in the keystore concedes (design section 3, effective).

The enclave's own checks do not count, since a compromised enclave skips them. Nor does the document that it holds: a
peer takes any validly signed document whose grant names the presenter.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.attacker import TrustDomainView, enclaves_views
from keystore_audit.model.formal.bit_sets import Abilities, bits, members, union
from keystore_audit.model.formal.permission import Decisions, Permissions, Protection
from keystore_audit.model.formal.system import Participant, System
from keystore_audit.model.names import topics_named
from keystore_audit.truth import Bounds


class Peers:
    """One system as its enclaves meet each other. An enclave is its path."""

    def __init__(self, system: System, decisions: Decisions | None = None) -> None:
        self.system = system
        self.decisions = decisions or Decisions(system)
        self.permissions = Permissions(system, None, self.decisions)
        self.numbers: dict[str, int] = {}
        for number, enclave in enumerate(system.enclaves):
            self.numbers.setdefault(enclave.label, number)
        self._accepted: dict[tuple[str, Operation], int] = {}
        self.judging = [*system.trust_domains_of_enclaves().values()]

    @cached_property
    def trust_domains(self) -> list[TrustDomainView]:
        """How the peers of each trust domain that enclaves are of see every enclave."""
        return enclaves_views(self.system, self.permissions)

    def enclave(self, path: str) -> Participant:
        """One that the system has."""
        return self.system.enclaves[self.numbers[path]]

    def accepted(self, path: str, operation: Operation) -> int:
        """The channels on which some trust domain accepts the operation; none of an enclave that is left out.

        In a mixed fleet the enclave's own trust domain counts only if others are in it. Who runs what is declared, and
        no peer judges as it does. Elsewhere it stands for the peers that a keystore of one enclave does not have.
        """
        key = (path, operation)
        if key not in self._accepted:
            number = self.numbers.get(path)
            alone = [number] if self.system.mixed else []
            views = zip(self.judging, self.trust_domains, strict=True)
            judging = [view for members, view in views if members != alone]
            able = [view.abilities(number) for view in judging] if number is not None else []
            self._accepted[key] = union(each.by_right(operation) | each.unannounced for each in able)
        return self._accepted[key]


class EffectiveRights:
    """The rights of every enclave with every peer, by profile and in both readings."""

    def __init__(self, systems: Sequence[System]) -> None:
        self._peers: dict[tuple[str, bool], Peers] = {}
        for system in systems:
            peers = Peers(system)
            for profile in system.profiles:
                self._peers[profile, system.may] = peers

    def accepted(self, path: str, profile: str, operation: Operation) -> Bounds:
        """The channels on which some peer accepts the operation; what could not be read may accept anything."""
        may = self._peers[profile, True]
        must = self._peers.get((profile, False), may)
        return Bounds(must.accepted(path, operation), may.accepted(path, operation))


# What an enclave may do with its own permissions document alone: what it does as long as nobody attacks.
#
# Peers take it, and its own implementation does not refuse it.


class OwnRights:
    """How peers in one trust domain see enclaves with their own documents. `refuses`: as of a `TrustDomainAtom`."""

    def __init__(self, system: System, view: TrustDomainView, refuses: frozenset[int] = frozenset()) -> None:
        self._system = system
        self._view = view
        self._refuses = refuses
        self._abilities: dict[int, Abilities] = {}

    def abilities(self, enclave: int) -> Abilities:
        """What the enclave may write and read; it overhears and forges nothing."""
        if enclave not in self._abilities:
            self._abilities[enclave] = self._able(enclave)
        return self._abilities[enclave]

    def _able(self, enclave: int) -> Abilities:
        atom = self._system.enclaves[enclave].at(self._view.moment)
        anything = atom.opaque or any(self._system.documents[own].opaque for own in atom.permissions)
        written, read = self._view.rights_with(enclave, self._view.accepted & atom.permissions, anything=anything)
        if atom.identity in self._refuses:
            written = read = 0
        written &= ~bits(atom.refused_writes)
        read &= ~bits(atom.refused_reads)
        return Abilities(
            may_write=written,
            may_read=read,
            may_relay=0,
            overhears=0,
            forges=0,
            writes_at_all=written,
            reads_at_all=read,
        )


# What somebody without any key can do in a trust domain, as sets of channels: where there is somebody to do it to.
#
# The definitions are in docs/model.md. Where there is nothing in the clear, nobody is asked what enclaves do.


def read(view: TrustDomainView) -> int:
    """Channels whose payload is readable."""
    return view.readable and view.readable & _written(view)


def learn_of(view: TrustDomainView) -> int:
    """Channels whose topic name is readable in discovery."""
    p = view.protection
    clear = p.governed & ~(p.rtps_encrypts | p.discovery_hidden)
    return clear and clear & (_written(view) | _read(view))


def inject_into(view: TrustDomainView) -> int:
    """Channels on which a reader takes samples."""
    return view.injectable and view.injectable & _read(view)


def replay(view: TrustDomainView) -> int:
    """Channels on which a reader takes old samples again."""
    clear = view.unauthenticated & ~view.protection.metadata_authenticates
    return clear and clear & _read(view)


def assert_liveliness_of(view: TrustDomainView) -> int:
    """Channels on which it can be said that a writer is alive."""
    clear = view.unauthenticated & ~view.protection.liveliness_authenticates
    return clear and clear & _read(view)


def _written(view: TrustDomainView) -> int:
    """Channels with a writer, though it may be one that honest readers refuse."""
    return union(able.writes_at_all for able in view.everybody())


def _read(view: TrustDomainView) -> int:
    """Channels with a reader, though it may be one that honest writers refuse."""
    return union(able.reads_at_all for able in view.everybody())


# What permissions that no enclave carries give to enclaves of the keystore, and what of it they alone give.


class Surplus(Struct, frozen=True, kw_only=True):
    """A right that only the unmanaged document gives the enclave, with its peers' consent.

    `topic`, `domains`: for people.
    """

    operation: Operation
    topic: str
    domains: str


class UnmanagedGrant(Struct, frozen=True, kw_only=True):
    """A grant in force of an unmanaged document that names an enclave of the keystore, and whose signer its peers take.

    `surplus` None: the documents of the enclaves give all of it as well. `profiles`: canonical names.
    """

    document: str
    enclave: str
    location: Location
    surplus: Surplus | None
    profiles: tuple[str, ...]


def unmanaged_grants(systems: Sequence[System], places: Collection[str]) -> tuple[UnmanagedGrant, ...]:
    """The grants of the documents at `places`, by document and enclave: those with a surplus under some profile, so."""
    found: dict[tuple[str, str], UnmanagedGrant] = {}
    for system in systems:
        if system.may:
            for each in _System(system, places).grants():
                known = found.get((each.document, each.enclave))
                found[each.document, each.enclave] = each if known is None else _joined(known, each)
    return tuple(found[key] for key in sorted(found))


def _joined(one: UnmanagedGrant, other: UnmanagedGrant) -> UnmanagedGrant:
    """The same grant under more profiles; a surplus counts for those alone that give it."""
    if (one.surplus is None) != (other.surplus is None):
        return other if one.surplus is None else one
    return replace(
        one,
        profiles=tuple(dict.fromkeys((*one.profiles, *other.profiles))),
    )


class _System:
    """One system, in which a trust domain is asked about the enclaves that unmanaged documents name."""

    def __init__(self, system: System, places: Collection[str]) -> None:
        self._system = system
        self._permissions = Permissions(system)
        numbered = enumerate(system.documents)
        self._unmanaged = frozenset(n for n, document in numbered if document.label in places and not document.opaque)

    def grants(self) -> Iterator[UnmanagedGrant]:
        """Each with the trust domain that takes it; one without a surplus may come before one with it."""
        named = [
            number
            for number, enclave in enumerate(self._system.enclaves)
            if not (enclave.opaque or enclave.unmanaged) and self._permissions.chosen(enclave.identity, self._unmanaged)
        ]
        for view in enclaves_views(self._system, self._permissions) if named else ():
            for enclave in named:
                if view.authenticated(enclave):
                    yield from self._taken(view, enclave)

    def _taken(self, view: TrustDomainView, enclave: int) -> Iterator[UnmanagedGrant]:
        """The grants of unmanaged documents that the trust domain takes from the enclave."""
        atom, permissions = self._system.enclaves[enclave], self._permissions
        others = permissions.chosen(atom.identity, view.accepted - self._unmanaged)
        for grant in permissions.chosen(atom.identity, view.accepted & self._unmanaged):
            document = self._system.documents[self._system.grants[grant].document]
            yield UnmanagedGrant(
                document=document.label,
                enclave=atom.label,
                location=self._system.grants[grant].location,
                surplus=self._surplus(view, grant, others),
                profiles=self._system.profiles,
            )

    def _surplus(self, view: TrustDomainView, grant: int, others: Collection[int]) -> Surplus | None:
        """A channel on which none of the other grants gives what this one does; one of ROS 2 first."""
        for operation in Operation:
            more = self._permissions.allowed(grant, operation) & view.protection.governed
            for other in others:
                more &= ~self._permissions.allowed(other, operation)
            channels = [self._system.channels[number] for number in members(more)]
            if channels:
                channel = min(channels, key=lambda channel: not channel.ros)
                domains = self._system.domains[channel.domain].label
                return Surplus(
                    operation=operation, topic=topics_named(channel.topic, endless=channel.infinite), domains=domains
                )
        return None


# What protects the samples of a topic, and whose rights are asked for: the governance in force, topic by topic.


LAYERS: Final[Mapping[str, tuple[str, str]]] = {
    "data": ("data_encrypts", "data_authenticates"),
    "metadata": ("metadata_encrypts", "metadata_authenticates"),
    "rtps": ("rtps_encrypts", "rtps_authenticates"),
}
"""The layers that a governance protects, as its elements call them, with the fields of `Protection`."""


class Safeguard(Struct, frozen=True, kw_only=True):
    """`encrypted`, `authenticated`: the layers (keys of `LAYERS`) that are. `read_controlled`, `write_controlled`:
    whether rights are asked for. Not `governed`: no topic rule covers the topic, so nobody can use it.
    `unauthenticated`: participants without any identity are let in.
    """

    governed: bool
    encrypted: tuple[str, ...] = ()
    authenticated: tuple[str, ...] = ()
    read_controlled: bool = True
    write_controlled: bool = True
    unauthenticated: bool = False


def safeguards(system: System, channels: range, domain: int) -> tuple[tuple[Safeguard, ...], ...]:
    """By channel, all of one domain class: what governances of trust domains say of it, each different one once.

    A trust domain whose governance could not be read, or is not in force in the domain, says nothing, unless none does.
    """
    views = enclaves_views(system)
    spoken = [view.protection for view in views if not view.open and view.protection.ruled >> domain & 1]
    distinct = list({_key(protection): protection for protection in spoken}.values())
    return tuple(
        tuple(dict.fromkeys(_safeguard(protection, channel, domain) for protection in distinct))
        or (Safeguard(governed=False),)
        for channel in channels
    )


def _key(protection: Protection) -> tuple[int, ...]:
    return tuple(getattr(protection, name) for name in Protection.__struct_fields__)


def _safeguard(protection: Protection, channel: int, domain: int) -> Safeguard:
    def holds(names: Iterable[int]) -> tuple[str, ...]:
        return tuple(layer for layer, field in zip(LAYERS, names, strict=True) if field >> channel & 1)

    if not protection.governed >> channel & 1:
        return Safeguard(governed=False)
    return Safeguard(
        governed=True,
        encrypted=holds(getattr(protection, encrypts) for encrypts, _signs in LAYERS.values()),
        authenticated=holds(getattr(protection, signs) for _encrypts, signs in LAYERS.values()),
        read_controlled=bool(protection.read_controlled >> channel & 1),
        write_controlled=bool(protection.write_controlled >> channel & 1),
        unauthenticated=bool(protection.unauthenticated >> domain & 1),
    )
