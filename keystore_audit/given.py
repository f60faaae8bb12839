"""Files beside the keystore that an audit is made with, by which a statement says what its verdict rests on."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

from keystore_audit.dataclass import dataclass
from keystore_audit.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenFile:
    """A file that was read. `path` as it was given or found, or below that; `sha256` of its bytes, in hexadecimal."""

    path: str
    sha256: str

    @classmethod
    def of(cls, path: str, content: bytes) -> GivenFile:
        """The file with this content."""
        return cls(path=path, sha256=hashlib.sha256(content).hexdigest())


def check_beside(path: Path, keystores: Iterable[str | Path]) -> None:
    """Raise errors.UsageError for a file in one of the keystores, whose maker would then say what is asked."""
    here = path.resolve()
    for keystore in keystores:
        if here.is_relative_to(Path(keystore).resolve()):
            raise UsageError(f"{path} lies in the keystore {keystore}, which would judge itself: keep it elsewhere.")
