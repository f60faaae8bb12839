"""What permissions that no enclave carries give to enclaves of the keystore, and what of it they alone give."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.attacker import RealmView, enclaves_views
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import Reading, System


class Surplus(Struct, frozen=True, kw_only=True):
    """A right on `topic` that only the stray document gives the enclave, with its peers' consent."""

    operation: Operation
    topic: str
    domains: str
    """The domains for people."""


class StrayGrant(Struct, frozen=True, kw_only=True):
    """A grant in force of a stray document that names an enclave of the keystore, and whose signer its peers take.

    `surplus` None: the documents of the enclaves give all of it as well. `profiles`: canonical names.
    """

    document: str
    enclave: str
    location: Location
    surplus: Surplus | None
    profiles: tuple[str, ...]


def stray_grants(systems: Sequence[System], places: Collection[str]) -> tuple[StrayGrant, ...]:
    """The grants of the documents at `places`, by document and enclave: those with a surplus under some profile, so."""
    found: dict[tuple[str, str], StrayGrant] = {}
    for system in systems:
        if system.reading is Reading.MAY:
            for each in _System(system, places).grants():
                known = found.get((each.document, each.enclave))
                found[each.document, each.enclave] = each if known is None else _joined(known, each)
    return tuple(found[key] for key in sorted(found))


def _joined(one: StrayGrant, other: StrayGrant) -> StrayGrant:
    """The same grant under more profiles; a surplus counts for those alone that give it."""
    if (one.surplus is None) != (other.surplus is None):
        return other if one.surplus is None else one
    return replace(
        one,
        profiles=tuple(dict.fromkeys((*one.profiles, *other.profiles))),
    )


class _System:
    """One system, in which a realm is asked about the enclaves that stray documents name."""

    def __init__(self, system: System, places: Collection[str]) -> None:
        self._system = system
        self._permissions = Permissions(system)
        numbered = enumerate(system.documents)
        self._strays = frozenset(n for n, document in numbered if document.label in places and not document.opaque)

    def grants(self) -> Iterator[StrayGrant]:
        """Each with the realm that takes it; one without a surplus may come before one with it."""
        named = [
            number
            for number, enclave in enumerate(self._system.enclaves)
            if not (enclave.opaque or enclave.at_large) and self._permissions.chosen(enclave.identity, self._strays)
        ]
        for view in enclaves_views(self._system, self._permissions) if named else ():
            for enclave in named:
                if view.authenticated(enclave):
                    yield from self._taken(view, enclave)

    def _taken(self, view: RealmView, enclave: int) -> Iterator[StrayGrant]:
        """The grants of stray documents that the realm takes from the enclave."""
        atom, permissions = self._system.enclaves[enclave], self._permissions
        others = permissions.chosen(atom.identity, view.accepted - self._strays)
        for grant in permissions.chosen(atom.identity, view.accepted & self._strays):
            document = self._system.documents[self._system.grants[grant].document]
            yield StrayGrant(
                document=document.label,
                enclave=atom.label,
                location=self._system.grants[grant].location,
                surplus=self._surplus(view, grant, others),
                profiles=self._system.profiles,
            )

    def _surplus(self, view: RealmView, grant: int, others: Collection[int]) -> Surplus | None:
        """A channel on which none of the other grants gives what this one does; one of ROS 2 first."""
        for operation in Operation:
            more = self._permissions.allowed(grant, operation) & view.protection.governed
            for other in others:
                more &= ~self._permissions.allowed(other, operation)
            channels = [self._system.channels[number] for number in members(more)]
            if channels:
                channel = min(channels, key=lambda channel: not channel.ros)
                domains = self._system.domains[channel.domain].label
                return Surplus(operation=operation, topic=channel.topic, domains=domains)
        return None
