"""What an enclave may do with its own permissions document alone: what it does as long as nobody attacks.

Peers take it, and its own implementation does not refuse it.
"""

from __future__ import annotations

from keystore_audit.model.formal.abilities import Abilities
from keystore_audit.model.formal.attacker import RealmView
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.system import System


class OwnRights:
    """How the peers of one realm see enclaves that present their own documents. `refuses`: as of a `RealmAtom`."""

    def __init__(self, system: System, view: RealmView, refuses: frozenset[int] = frozenset()) -> None:
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
        own = atom.permissions
        anything = atom.opaque or (own is not None and self._system.documents[own].opaque)
        documents = frozenset() if own is None else self._view.accepted & {own}
        written, read = self._view.rights_with(enclave, documents, anything=anything)
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
