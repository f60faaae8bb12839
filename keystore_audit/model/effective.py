"""What peers accept from an enclave: the most that any peer in the keystore concedes (design section 3, effective).

Neither the enclave's own checks count, which a compromised enclave skips, nor the document that it holds: a peer takes
any validly signed document whose grant names the presenter.
"""

from __future__ import annotations

from collections.abc import Sequence

from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.attacker import enclaves_views
from keystore_audit.model.permission import union
from keystore_audit.model.system import Reading, System


class EffectiveRights:
    """The rights of every enclave with every peer, by profile and in both readings."""

    def __init__(self, systems: Sequence[System]) -> None:
        self._peers: dict[tuple[str, Reading], _Peers] = {}
        for system in systems:
            peers = _Peers(system)
            for profile in system.profiles:
                self._peers[profile, system.reading] = peers

    def may(self, path: str, profile: str, operation: Operation) -> int:
        """The channels on which some peer may accept the operation, what could not be read counting as anything."""
        return self._peers[profile, Reading.MAY].accept(path, operation)

    def must(self, path: str, profile: str, operation: Operation) -> int:
        """The channels on which some peer accepts it for certain. Without doubt both are equal."""
        peers = self._peers.get((profile, Reading.MUST)) or self._peers[profile, Reading.MAY]
        return peers.accept(path, operation)


class _Peers:
    """The realms of the enclaves of one system, as enclaves meet them. An enclave is its path."""

    def __init__(self, system: System) -> None:
        self._numbers = {enclave.label: number for number, enclave in enumerate(system.enclaves)}
        self._realms = enclaves_views(system)
        self._known: dict[tuple[str, Operation], int] = {}

    def accept(self, path: str, operation: Operation) -> int:
        """The channels on which some realm accepts the operation; none of an enclave that is left out."""
        key = (path, operation)
        if key not in self._known:
            number = self._numbers.get(path)
            able = [realm.abilities(number) for realm in self._realms] if number is not None else []
            self._known[key] = union(each.by_right(operation) for each in able)
        return self._known[key]
