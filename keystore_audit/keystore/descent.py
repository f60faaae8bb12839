"""Finds names below one directory and never leaves it, whatever links say and whoever swaps them meanwhile.

Nothing is opened by a path that the kernel would resolve. Links are read and followed here, as names. Their targets are
reached from the root downwards, one component at a time, without following links. So a component swapped in between
gives a refusal, not a file outside. Outside the root, and others that a user names, nothing is even looked at, since a
hostile link could trigger an automount. So a link that leaves them may lead to anything.
"""

from __future__ import annotations

import errno
import os
import re
import stat
from collections import OrderedDict
from collections.abc import Mapping
from sys import intern
from typing import Final

from keystore_audit.keystore.files import Entry, EntryKind, Status
from keystore_audit.resources import flags
from keystore_audit.text import percent_path

MAX_DEPTH: Final = 128
"""Deepest directory entered: a ROS name of at most 255 characters has at most 127 parts."""

MAX_LINKS: Final = 40
"""Links followed for one name, as Linux does (path_resolution(7)): a robot gets ELOOP beyond it."""

MAX_STEPS: Final = 2_000_000
"""Names that links may lead over in one keystore: 10,000 enclaves need 150,000, each a microsecond. A link can have
2,000 names and lead to 40 others."""

_OPEN_DIRECTORIES: Final = 64
"""Directory descriptors kept open: those in use, far below the usual limits of 256 or 1,024 a process."""

# O_PATH needs only the right to pass through a directory, as a robot that opens a file in it does; macOS
# has none.
_PASS_FLAGS: Final[int] = flags("O_PATH", "O_DIRECTORY", "O_NOFOLLOW", "O_CLOEXEC")

_PLAIN: Final = re.compile(rb"[A-Za-z0-9_./-]+")
"""Paths that `percent_path` leaves as they are; nearly all."""

Place = tuple[bytes, ...]
"""Names from the root downwards. What lies in another root begins with the absolute path of that one, as one name."""

Left = tuple[Place, bytes]
"""A link by which a way depends on where the root lies, and its text; its place is () where the way begins with it."""


class Refusal(Exception):
    """Why a name was not read; caught where a File is made of it."""

    def __init__(self, status: Status, detail: str) -> None:
        """Keep the status and the sentence that a File will carry."""
        super().__init__(detail)
        self.status = status
        self.detail = detail


class Descent:
    """Descriptors of the directories below a root and others that links may lead into, and where links in them lead."""

    def __init__(self, descriptor: int, path: str, others: Mapping[str, int] | None = None) -> None:
        """Take over `descriptor` of the root at `path`, and those of the `others` by their paths."""
        self._descriptor = descriptor
        self._others: dict[bytes, int] = {}
        self._roots: list[tuple[Place, Place]] = []
        self._spellings: list[tuple[Place, Place]] = []
        for each, opened in ((path, None), *(others or {}).items()):
            real = os.fsencode(os.path.realpath(each))
            if opened is not None:
                self._others[real] = opened
            absolute = names(real)
            self._roots.append((absolute, () if opened is None else (real,)))
            self._spellings += [(absolute, absolute), (names(os.fsencode(os.path.abspath(each))), absolute)]
        self._directories: OrderedDict[Place, int] = OrderedDict()
        self._followed: dict[tuple[Place, bytes], tuple[Place, os.stat_result, Left | None]] = {}
        self._steps_left = MAX_STEPS
        self.passed: set[Place] = set()
        """The directories of links that other links led over."""

    def close(self) -> None:
        """Close every descriptor."""
        while self._directories:
            os.close(self._directories.popitem()[1])
        while self._others:
            os.close(self._others.popitem()[1])
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def open(self, place: Place, flags: int) -> int:
        """Open what stands at `place` itself; `flags` has to have O_NOFOLLOW. Raises OSError or Refusal."""
        if _is_root(place):
            return os.open(b".", flags, dir_fd=self._directory(place))
        return os.open(place[-1], flags, dir_fd=self._directory(place[:-1]))

    def target(self, place: Place) -> bytes:
        """Return what the link at `place` says; raises OSError or Refusal."""
        return os.readlink(place[-1], dir_fd=self._directory(place[:-1]))

    def entry(self, place: Place) -> os.stat_result:
        """Describe the entry at `place`, itself not followed.

        Raises Refusal where the way there leads out or over a link to a directory, and OSError.
        """
        if b".." in place:
            raise Refusal(Status.OUTSIDE, "leads out of the keystore; it was not read")
        try:
            return self._lstat(place)
        except OSError as error:
            if error.errno in (errno.ENOTDIR, errno.ELOOP, errno.EMLINK):
                self._refuse_directory_link(place)
            raise

    def follow(self, directory: Place, target: bytes) -> tuple[Place, os.stat_result, Left | None]:
        """Resolve a link in the real directory `directory`: the place where it ends, and what is there. Also how the
        way left the roots, by an absolute path or upwards, before it came back.

        The way is kept as absolute names, `here`. All names of a root are real directories, so `..` is exact on names
        there too. A way that leaves a root and comes back needs no look outside.
        Raises Refusal where it ends nowhere, outside or never.
        """
        # In a keystore they all lead up and to the same few files: a way is walked once from where it turns down.
        base, rest = directory, target
        while not _is_root(base) and rest.startswith(b"../") and rest[3:4] not in (b"", b"/"):
            base, rest = base[:-1], rest[3:]
        known = self._followed.get((base, rest))
        if known is not None:
            return known
        try:
            end, found, left = self._walk(base, rest)
            known = end, found if found is not None else self._lstat(end), left
        except (OSError, ValueError) as error:
            shown = percent_path(target)
            missing = (Status.DANGLING, f"links to {shown}, which does not exist")
            raise refusal(error, f"links to {shown}, which cannot be read", missing=missing) from None
        self._followed[base, rest] = known
        return known

    def _walk(self, directory: Place, target: bytes) -> tuple[Place, os.stat_result | None, Left | None]:
        here = self._absolute(directory)
        pending = self._steps(target, here)
        links = 1
        link: Left = (), target
        left = link if target.startswith(b"/") else None
        found: os.stat_result | None = None  # of `here`, where it was looked at
        while pending:
            name = pending.pop()
            self._steps_left -= 1
            if self._steps_left < 0:
                limit = f"the keystore's links lead over more than {MAX_STEPS} names"
                raise Refusal(Status.UNREADABLE, f"links to {percent_path(target)}, which was not followed: {limit}")
            if found is not None and not stat.S_ISDIR(found.st_mode):
                raise NotADirectoryError
            if name == b".":
                continue
            found = None
            if name == b"..":
                del here[-1:]  # above `/` there is `/`
                left = left or (link if self._place(here, target) is None else None)
                continue
            here.append(name)
            place = self._place(here, target)
            if place is None:
                continue
            found = self._lstat(place)
            if stat.S_ISLNK(found.st_mode):
                found = None
                links += 1
                if links > MAX_LINKS:
                    circle = f"a circle, or a chain of more than {MAX_LINKS} links"
                    raise Refusal(Status.LOOP, f"links to {percent_path(target)}: {circle}")
                self.passed.add(place[:-1])
                here.pop()
                link = place, self.target(place)
                left = left or (link if link[1].startswith(b"/") else None)
                pending.extend(self._steps(link[1], here))
        end = self._place(here, target)
        if end is None:
            raise _outside(target)
        return end, found, left

    def _absolute(self, place: Place) -> list[bytes]:
        if place and place[0].startswith(b"/"):
            return [*names(place[0]), *place[1:]]
        return [*self._roots[0][0], *place]

    def _place(self, here: list[bytes], target: bytes) -> Place | None:
        """The place with these absolute names, None above the roots. Raises Refusal elsewhere."""
        for real, first in self._roots:
            if tuple(here[: len(real)]) == real:
                return (*first, *here[len(real) :])
        above = tuple(here)
        if any(real[: len(above)] == above for real, _first in self._roots):
            return None
        raise _outside(target)

    def _steps(self, target: bytes, here: list[bytes]) -> list[bytes]:
        """Return the names that a link's target goes through, last first; an absolute target moves `here`."""
        steps = [name for name in target.split(b"/") if name]
        if target.endswith(b"/"):
            steps.append(b".")  # what it ends at has to be a directory
        if target.startswith(b"/"):
            here.clear()
            for spelling, real in self._spellings:
                if tuple(steps[: len(spelling)]) == spelling:
                    here.extend(real)
                    del steps[: len(spelling)]
                    break
        steps.reverse()
        return steps

    def _refuse_directory_link(self, place: Place) -> None:
        for depth in range(1, len(place)):
            if stat.S_ISLNK(self._lstat(place[:depth]).st_mode):
                link = display(b"/".join(place[:depth]))
                raise Refusal(Status.UNREADABLE, f"{link} is a link; links to directories are not followed")

    def _lstat(self, place: Place) -> os.stat_result:
        if _is_root(place):
            return os.fstat(self._directory(place))
        return os.stat(place[-1], dir_fd=self._directory(place[:-1]), follow_symlinks=False)

    def _directory(self, place: Place) -> int:
        """Return a descriptor of the real directory at `place`, valid until the next call."""
        if _is_root(place):
            return self._others[place[0]] if place else self._descriptor
        known = self._directories.get(place)
        if known is not None:
            self._directories.move_to_end(place)
            return known
        if len(place) > MAX_DEPTH:
            raise Refusal(Status.UNREADABLE, f"lies deeper than the limit of {MAX_DEPTH} directories")
        descriptor = os.open(place[-1], _PASS_FLAGS, dir_fd=self._directory(place[:-1]))
        self._directories[place] = descriptor
        if len(self._directories) > _OPEN_DIRECTORIES:
            os.close(self._directories.popitem(last=False)[1])
        return descriptor


def _is_root(place: Place) -> bool:
    return not place or place[-1].startswith(b"/")


def refusal(error: OSError | ValueError, failure: str, *, missing: tuple[Status, str]) -> Refusal:
    """Turn the system's error into a Refusal: `missing` where there is nothing, else UNREADABLE."""
    # ValueError: a NUL character, so no file has such a name.
    if isinstance(error, FileNotFoundError | NotADirectoryError | ValueError):
        return Refusal(*missing)
    return Refusal(Status.UNREADABLE, f"{failure}: {reason(error)}")


def _outside(target: bytes) -> Refusal:
    return Refusal(Status.OUTSIDE, f"links to {percent_path(target)}, outside the keystore; it was not read")


def reason(error: OSError) -> str:
    """Return the words of the operating system, without the path that `str(error)` has."""
    return os.strerror(error.errno) if error.errno is not None else "unknown error"


def names(path: bytes) -> Place:
    """Split a path; empty names and `.` say nothing."""
    return tuple(name for name in path.split(b"/") if name and name != b".")


def display(relative: bytes) -> str:
    """Return a path below the root in the form that `File.path` has; `.` for the root itself."""
    if _PLAIN.fullmatch(relative):
        return intern(relative.decode("ascii"))  # each path is asked for several times, and kept
    return percent_path(relative) or "."


def refuse_unless_file(found: os.stat_result, way: str = "") -> None:
    """Raise Refusal for what is no regular file; `way` says over which link it was reached."""
    if stat.S_ISDIR(found.st_mode):
        raise Refusal(Status.DIRECTORY, f"{way}a directory, where a file was expected")
    if not stat.S_ISREG(found.st_mode):
        raise Refusal(Status.SPECIAL, f"{way}{_special(found.st_mode)}, no regular file; it was not opened")


def _special(mode: int) -> str:
    if stat.S_ISFIFO(mode):
        return "a named pipe"
    if stat.S_ISSOCK(mode):
        return "a socket"
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        return "a device"
    return "neither a file nor a directory"


def read_at_most(descriptor: int, limit: int, size: int) -> bytes:
    """Read to the end, but at most `limit` bytes: `size`, what the file says of itself, need not be true."""
    content = os.read(descriptor, min(size + 1, limit))
    if len(content) == size > 0:
        return content  # the end came where it was said to be
    pieces = [content]
    left = limit - len(content)
    while pieces[-1] and left > 0:
        pieces.append(os.read(descriptor, min(left, 64 * 1024)))
        left -= len(pieces[-1])
    return b"".join(pieces)


def described(entry: os.DirEntry[str], directory: int) -> Entry:
    """An entry of the open directory, itself not followed."""
    name = os.fsencode(entry.name)
    if entry.is_symlink():
        return Entry(name=name, kind=EntryKind.LINK, target=os.readlink(name, dir_fd=directory))
    if entry.is_dir(follow_symlinks=False):
        return Entry(name=name, kind=EntryKind.DIRECTORY)
    if entry.is_file(follow_symlinks=False):
        return Entry(name=name, kind=EntryKind.FILE)
    return Entry(name=name, kind=EntryKind.SPECIAL)
