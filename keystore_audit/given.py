"""Files beside the keystore that an audit is made with, by which a statement says what its verdict rests on."""

from __future__ import annotations

import hashlib

from keystore_audit.dataclass import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenFile:
    """A file that was read. `path` as it was given or found, or below that; `sha256` of its bytes, in hexadecimal."""

    path: str
    sha256: str

    @classmethod
    def of(cls, path: str, content: bytes) -> GivenFile:
        """The file with this content."""
        return cls(path=path, sha256=hashlib.sha256(content).hexdigest())
