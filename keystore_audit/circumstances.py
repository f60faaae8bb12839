"""How a keystore is read that something is asked about: each question of the command line, and of programs."""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import datetime
from zoneinfo import ZoneInfo

from msgspec import Struct

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.keystore.foreign import NOTHING_DECLARED, DeclaredFiles
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.inventory import system_documents
from keystore_audit.profiles import Profile


class Circumstances(Struct, frozen=True, kw_only=True):
    """As these profiles do, at this instant (aware UTC), with what is declared and assumed.

    `zone`, `domain`: where the robots are and which domain they use, None if that is not known.
    """

    profiles: Sequence[Profile]
    at: datetime
    zone: ZoneInfo | None = None
    domain: int | None = None
    declared: DeclaredFiles = NOTHING_DECLARED
    assumed: frozenset[Assumption] = EVERY

    @property
    def names(self) -> tuple[str, ...]:
        """Of the profiles."""
        return tuple(profile.name for profile in self.profiles)

    def keystore(self, path: str | os.PathLike[str]) -> Keystore:
        """The keystore there. Raises errors.NothingToAudit."""
        return read_keystore(path, declared=self.declared)

    def accesses(self, keystore: Keystore) -> AccessViews:
        """What its documents say."""
        return AccessViews(system_documents(keystore), self.at, self.zone, self.assumed)
