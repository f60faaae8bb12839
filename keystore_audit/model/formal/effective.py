"""What peers accept from an enclave: the most that any peer in the keystore concedes (design section 3, effective).

Neither the enclave's own checks count, which a compromised enclave skips, nor the document that it holds: a peer takes
any validly signed document whose grant names the presenter.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.attacker import RealmView, enclaves_views
from keystore_audit.model.formal.bit_sets import Bounds, union
from keystore_audit.model.formal.permission import Decisions, Permissions
from keystore_audit.model.formal.system import EnclaveAtom, Reading, System


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

    @cached_property
    def realms(self) -> list[RealmView]:
        """How the peers of each realm that enclaves are of see every enclave."""
        return enclaves_views(self.system, self.permissions)

    def enclave(self, path: str) -> EnclaveAtom:
        """One that the system has."""
        return self.system.enclaves[self.numbers[path]]

    def accepted(self, path: str, operation: Operation) -> int:
        """The channels on which some realm accepts the operation; none of an enclave that is left out."""
        key = (path, operation)
        if key not in self._accepted:
            number = self.numbers.get(path)
            able = [realm.abilities(number) for realm in self.realms] if number is not None else []
            self._accepted[key] = union(each.by_right(operation) | each.unannounced for each in able)
        return self._accepted[key]


class EffectiveRights:
    """The rights of every enclave with every peer, by profile and in both readings."""

    def __init__(self, systems: Sequence[System]) -> None:
        self._peers: dict[tuple[str, Reading], Peers] = {}
        for system in systems:
            peers = Peers(system)
            for profile in system.profiles:
                self._peers[profile, system.reading] = peers

    def accepted(self, path: str, profile: str, operation: Operation) -> Bounds:
        """The channels on which some peer accepts the operation; what could not be read may accept anything."""
        may = self._peers[profile, Reading.MAY]
        must = self._peers.get((profile, Reading.MUST), may)
        return Bounds(must.accepted(path, operation), may.accepted(path, operation))
