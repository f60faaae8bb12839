"""Where the second reader's tests ask keystore_audit: the systems of a keystore, and what they stand on."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from msgspec import Struct

from keystore_audit.engine.alloy.facts import facts
from keystore_audit.errors import NothingToAudit
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.inventory import certificates_of, system_documents
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.profiles import resolve


class Asked(Struct, frozen=True):
    """A keystore as it is read, its systems with their texts for Alloy, and the SHA-256 of their certificates."""

    keystore: Keystore
    systems: tuple[Any, ...]
    texts: tuple[str, ...]
    certificates: tuple[str, ...]

    @property
    def foreign(self) -> frozenset[str]:
        """The foreign files that it names, links and directories apart."""
        named = (each.file for each in self.keystore.foreign)
        return frozenset(unquote(file.path) for file in named if file.link is None and file.status.value != "directory")


def ask(root: Path, at: datetime, profiles: Sequence[str]) -> Asked | None:
    """What both engines are given; None where there is nothing to audit."""
    try:
        keystore = read_keystore(root)
    except NothingToAudit:
        return None
    accesses = AccessViews(system_documents(keystore), at, None)
    systems = SystemBuilder(keystore, resolve(profiles), at, accesses).systems()
    certificates = tuple(certificate.sha256 for certificate in certificates_of(keystore, at))
    return Asked(keystore, systems, tuple(map(facts, systems)), certificates)
