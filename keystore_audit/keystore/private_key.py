"""Private keys: their public half and facts about them. Nothing else ever leaves this module."""

from __future__ import annotations

from dataclasses import dataclass

from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.files import File


@dataclass(frozen=True, slots=True, kw_only=True)
class PrivateKey:
    """A private key file. `file.content` is None: the bytes stay here.

    `key` identifies the public half as `Certificate.key` does, None where it could not be read.
    """

    file: File
    key: str | None
    key_kind: str | None
    encrypted: bool
    defects: tuple[Defect, ...]
