"""The files that graphs and launch files are read from: regular and bounded; included ones below one directory."""

from __future__ import annotations

import os
import posixpath
from pathlib import Path
from typing import Final

from msgspec import Struct

from keystore_audit.errors import NothingToAudit, UsageError
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.root import Root
from keystore_audit.text import percent_path, shorten

MAX_QUOTED: Final = 80
"""Characters of a name from a file that a message quotes."""

MAX_DETAIL: Final = 480
"""Characters of what a parser says."""


class Source(Struct, frozen=True, kw_only=True):
    """The text of one file.

    `file`: its path as the user gave it, or below what the user gave, percent-encoded. `real`: where it is, absolute,
    links resolved.
    """

    file: GivenFile
    real: str
    text: str

    @property
    def path(self) -> str:
        """As the user gave it."""
        return self.file.path

    @property
    def directory(self) -> str:
        """The directory that it is in, absolute."""
        return os.path.dirname(self.real)

    def location(self, line: int | None) -> Location:
        """A place in it."""
        return Location(path=self.path, line=line)

    def malformed(self, line: int | None, detail: str) -> UsageError:
        """The error for something that cannot be read; `detail` becomes the rest of the sentence."""
        return malformed(self.location(line), detail)


class Unreadable(Exception):
    """An included file that is not read; the message is the reason, words to go into a sentence."""


def malformed(location: Location, detail: str) -> UsageError:
    """The error for something at the place that cannot be read; `detail` becomes the rest of the sentence."""
    return UsageError(f"{location}: {detail}.")


def shown(text: str) -> str:
    """Return `text` from a file as messages quote it: short, in quotes, on one line."""
    return repr(shorten(text, MAX_QUOTED))


def read_source(path: Path) -> Source:
    """Read the file that the user named, UTF-8, links followed.

    Raises UsageError if it is no regular file, larger than 4 MB, unreadable or not UTF-8.
    """
    given = os.fspath(path)
    named = percent_path(given)
    try:
        real = os.path.realpath(given)
        with Root.open(os.path.dirname(real)) as beside:
            file = beside.file(os.path.basename(real))
    except (NothingToAudit, ValueError):  # a NUL character in the path
        raise UsageError(f"{named}: there is no such file.") from None
    if file.status is not Status.PRESENT or file.content is None:
        raise UsageError(f"{named}: {reason(file)}.")
    return _source(named, real, file.content)


class Directory:
    """The directory of a file that the user named, below which others may be included."""

    def __init__(self, given: Path, source: Source, root: Root) -> None:
        """Take the open `root` of the directory that `source` is in, which the user named `given`."""
        self._given = os.path.dirname(given)
        self._real = source.directory
        self._root = root

    def included(self, path: str) -> Source:
        """Read the file at `path`, absolute or relative to this directory.

        Raises Unreadable if there is none below the directory, and UsageError if it is not UTF-8.
        """
        if "\0" in path:
            raise Unreadable("the path holds a NUL character")
        try:
            os.fsencode(path)
        except UnicodeEncodeError:  # as a text of Python may be
            raise Unreadable("the path holds half of a surrogate pair") from None
        below = os.path.relpath(os.path.join(self._real, path), self._real)
        if below.split(os.sep, 1)[0] == os.pardir:
            raise Unreadable(f"it is not below {percent_path(self._given or os.curdir)}, and was not read")
        file = self._root.file(below)
        if file.status is not Status.PRESENT or file.content is None:
            raise Unreadable(reason(file))
        named = percent_path(posixpath.join(self._given, below))
        return _source(named, os.path.join(self._real, below), file.content)


def reason(file: File) -> str:
    """Why there is no content, in words that do not speak of a keystore."""
    return {
        Status.MISSING: "there is no such file",
        Status.DANGLING: "it links to nothing",
        Status.LOOP: "its links lead in a circle",
        Status.OUTSIDE: "it leads out of the directory that may be read",
    }.get(file.status, file.detail or "it cannot be read")


def _source(named: str, real: str, content: bytes) -> Source:
    return Source(real=real, text=_decoded(named, content), file=GivenFile.of(named, content))


def _decoded(named: str, content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise UsageError(f"{named}:{line}: expected UTF-8, found the byte 0x{content[error.start]:02x}.") from None
