"""Files beside the keystore that an audit is made with, by which a statement says what its verdict rests on."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from msgspec import Struct

from keystore_audit.errors import UsageError


class GivenFile(Struct, frozen=True, kw_only=True):
    """A file that was read. `path` as it was given or found, or below that; `sha256` of its bytes, in hexadecimal."""

    path: str
    sha256: str

    @classmethod
    def of(cls, path: str, content: bytes) -> GivenFile:
        """The file with this content."""
        return cls(path=path, sha256=hashlib.sha256(content).hexdigest())


def read_given(path: Path, most: int, expected: str) -> tuple[GivenFile, str]:
    """The file and its text. Raises errors.UsageError for one that is not `expected`: unreadable, larger, not UTF-8."""
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror or error}.") from error
    if len(content) > most:
        raise UsageError(f"{path} is larger than {most} bytes; expected {expected}.")
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise UsageError(f"{path}:{line}: this is not UTF-8; expected {expected}.") from error
    return GivenFile.of(str(path), content), text


def real_path(path: str | Path) -> Path:
    """The path with its links followed, as far as they lead somewhere."""
    return Path(os.path.realpath(path))  # Path.resolve raises RuntimeError where they lead in a circle


def check_beside(path: Path, keystores: Iterable[str | Path]) -> None:
    """Raise errors.UsageError for a file in one of the keystores, whose maker would then say what is asked."""
    here = real_path(path)
    for keystore in keystores:
        if here.is_relative_to(real_path(keystore)):
            raise UsageError(f"{path} lies in the keystore {keystore}, which would judge itself: keep it elsewhere.")
    linked = _linked(here, keystores)
    if linked is not None:
        raise UsageError(f"{path} is also the file {linked} of a keystore, which would judge itself: use a copy.")


def _linked(file: Path, keystores: Iterable[str | Path]) -> str | None:
    """Where a keystore has the same file under another name (a hard link); None: nowhere."""
    try:
        about = file.stat()
    except OSError:  # whoever reads it says so
        return None
    if about.st_nlink < 2:
        return None
    for keystore in keystores:
        for folder, _folders, names in os.walk(keystore):
            for name in names:
                path = os.path.join(folder, name)
                with suppress(OSError):
                    found = os.lstat(path)
                    if (found.st_dev, found.st_ino) == (about.st_dev, about.st_ino):
                        return path
    return None
