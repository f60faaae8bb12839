"""Reads an untrusted directory: regular files only, bounded, each once, and none outside it and what the user names."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from types import TracebackType
from typing import Any, Final
from urllib.parse import unquote_to_bytes

from msgspec.structs import replace

from keystore_audit.errors import NothingToAudit
from keystore_audit.keystore.descent import (
    MAX_DEPTH,
    Descent,
    Place,
    Refusal,
    described,
    display,
    names,
    read_at_most,
    reason,
    refusal,
    refuse_unless_file,
)
from keystore_audit.keystore.files import Entry, EntryKind, File, Listing, Status
from keystore_audit.keystore.traces import MAX_HASHED, look, search
from keystore_audit.resources import check_system, flags

MAX_FILE_BYTES: Final = 4 * 1024 * 1024
"""Largest file that is read: a permissions document of 20,000 topics has about 2 MB; no parser gets more."""

MAX_TOTAL_BYTES: Final = 256 * 1024 * 1024
"""Most that is read from one keystore: 10,000 enclaves of 20 kB, and it still fits into memory."""

MAX_ENTRIES: Final = 200_000
"""Most directory entries listed: 20,000 enclaves, each a directory and nine files, in about a second."""

_LIST_FLAGS: Final = flags("O_DIRECTORY", "O_NOFOLLOW", "O_CLOEXEC")
_READ_FLAGS: Final = flags("O_NONBLOCK", "O_NOFOLLOW", "O_CLOEXEC")

_EXPECTED: Final = "expected the directory of an SROS2 keystore, as `ros2 security create_keystore` makes it"


class Root:
    """An open keystore directory; a context manager, since it keeps descriptors.

    Paths are relative to it, as bytes or as `os.fsencode` takes them. Each inode is read once, so that everybody sees
    the same bytes even when the tree changes meanwhile. A sealed file gives what was hashed, or nothing.
    """

    def __init__(self, path: str, descent: Descent) -> None:
        """Take over an open `descent`; use `Root.open`."""
        self.path = path
        self.exhausted = False
        """Whether MAX_ENTRIES was reached: no further directory can be listed."""
        self._descent = descent
        self._reals: dict[bytes, Place] = {b"": ()}
        self._entered: set[bytes] = set()
        self._readings: dict[tuple[int, int], File] = {}
        self._met: dict[bytes, File] = {}
        self._contents: dict[str, bytes] = {}
        self._entries: dict[bytes, Entry] = {}
        self._listings: dict[bytes, Listing] = {}
        self._entries_left = MAX_ENTRIES
        self._bytes_left = MAX_TOTAL_BYTES
        self._hashed_left = MAX_HASHED

    @classmethod
    def open(cls, path: str | os.PathLike[str], others: Iterable[str] = ()) -> Root:
        """Open the directory at `path`, and the `others` that links may lead into: links in these paths themselves are
        followed, since the user chose them.

        Raises NothingToAudit if one is missing, no directory or unreadable.
        """
        name = os.fspath(path)
        descriptors: dict[str, int] = {}
        try:
            for each in (name, *others):
                if each not in descriptors:
                    descriptors[each] = _opened(each)
        except NothingToAudit:
            for descriptor in descriptors.values():
                os.close(descriptor)
            raise
        return cls(name, Descent(descriptors.pop(name), name, descriptors))

    def __enter__(self) -> Root:
        """Return the root itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Close every descriptor."""
        self._descent.close()

    def file(self, relative: bytes | str) -> File:
        """Read what is at `relative`. Never raises: a File that is not PRESENT says why."""
        key = os.fsencode(relative)
        found = self._met.get(key)
        if found is None or (found.status is Status.PRESENT and found.content is None):
            found = self._met[key] = self._file(key, needed=True)
            if found.content is not None and found.sha256 is not None:
                self._contents.setdefault(found.sha256, found.content)
        return found

    def sealed(self, relative: bytes | str) -> File:
        """Read and hash like `file`, but hand out no content: for what nobody parses, and for private keys."""
        key = os.fsencode(relative)
        if key not in self._met:
            self._met[key] = self._file(key, needed=False).holding(None)
        return self._met[key].holding(None)

    def unsealed(self, file: File) -> File:
        """Hand out the content of a sealed file: the bytes that were hashed, or none where others are there now."""
        content = self._contents.get(file.sha256 or "")
        if content is not None:
            return file.holding(content)
        again = self._file(unquote_to_bytes(file.path), needed=True)
        if again.sha256 == file.sha256:
            return again
        return replace(file, status=Status.UNREADABLE, detail="was replaced by something else while it was read")

    def fingerprint(self, relative: bytes) -> str:
        """Return the SHA-256 of the file at `relative` in hexadecimal, its status where it was not hashed."""
        file = self.sealed(relative)
        return file.sha256 or file.status.value

    def holding_private_keys(self) -> tuple[File, ...]:
        """The files read so far in which a private key is, each once, by place and without content."""
        found = {file.place: file.holding(None) for file in self._met.values() if file.holds_private_key}
        return tuple(found[place] for place in sorted(found))

    def messages(self) -> tuple[File, ...]:
        """The files read so far that may be S/MIME messages, by place, each content once, and with it."""
        return self._each_once(file for file in self._met.values() if file.may_be_message)

    def certificates(self) -> tuple[File, ...]:
        """The files read so far in which certificates may be, as `messages`."""
        return self._each_once(file for file in self._met.values() if file.holds_certificates)

    def _each_once(self, files: Iterable[File]) -> tuple[File, ...]:
        distinct: dict[str | None, File] = {}
        for file in sorted(files, key=lambda file: file.place):
            if file.status is Status.PRESENT:
                distinct.setdefault(file.sha256, file)
        return tuple(file.holding(self._contents.get(sha256 or "")) for sha256, file in distinct.items())

    def passed(self) -> frozenset[str]:
        """The paths of the directories so far in which stand links that other links led over."""
        return frozenset(display(b"/".join(place)) for place in self._descent.passed)

    def unread(self) -> tuple[File, ...]:
        """The entries met so far in which a robot might read something that we did not, by path."""
        found = {file.path: file for file in self._met.values() if file.status.unknown}
        return tuple(found[path] for path in sorted(found))

    def entries(self, relative: bytes | str) -> Listing:
        """List the directory at `relative` (`b""`: the root itself), links not followed. Never raises."""
        key = os.fsencode(relative)
        found = self._listings.get(key)
        if found is None:
            found = self._listings[key] = self._list(key)
            below = key + b"/" if key else b""
            self._entries.update((below + entry.name, entry) for entry in found.entries)
        return found

    def real(self, relative: bytes) -> Place:
        """Where the directory at `relative` is, over links that were entered."""
        found = self._reals.get(relative)
        if found is None:
            above, _slash, name = relative.rpartition(b"/")
            found = (*self._reals[above], name) if above in self._reals else names(relative)
            self._reals[relative] = found
        return found

    def directory_behind(self, relative: bytes) -> Place | None:
        """Where the link at `relative` leads, if that is a directory in one of the roots."""
        try:
            place, _found, target = self._find(relative)
            end, found, _left = self._descent.follow(place[:-1], target or b"")
        except (OSError, ValueError, Refusal):
            return None
        return end if stat.S_ISDIR(found.st_mode) else None

    def enter(self, relative: bytes, end: Place) -> None:
        """Let the link at `relative`, which leads to the directory at `end`, be a way to what is there."""
        self._reals[relative] = end
        self._entered.add(relative)

    def ways(self) -> dict[str, list[str]]:
        """Of directories to which entered links lead, the paths over these."""
        found: dict[str, list[str]] = {}
        for path, end in self._reals.items() if self._entered else ():
            place = b"/".join(end)
            if place != path:
                found.setdefault(display(place), []).append(display(path))
        return found

    def is_entered(self, relative: bytes) -> bool:
        """Whether a link is a way to what it leads to."""
        return relative in self._entered

    def _file(self, relative: bytes, *, needed: bool) -> File:
        """Read a file; its content may be None unless it is `needed`."""
        place: Place = ()
        link: str | None = None
        leaves: tuple[str, str] | None = None
        path = display(relative)
        missing = (Status.MISSING, "there is no such file")
        if relative not in self._entries and self._is_listed(relative.rpartition(b"/")[0]):
            return _refused(path, Refusal(*missing))
        try:
            place, found, target = self._find(relative)
            if target is not None:
                link = display(target)
                place, found, left = self._descent.follow(place[:-1], target)
                if left is not None:
                    leaves = (display(b"/".join(left[0])), display(left[1])) if left[0] else (path, link)
                refuse_unless_file(found, f"links to {link}: ")
            reading = self._read(place, found, needed=needed)
        except (OSError, ValueError) as error:
            reading = _refused(path, refusal(error, "cannot be read", missing=missing))
        except Refusal as refused:
            reading = _refused(path, refused)
        resolved = None
        if reading.status is Status.PRESENT:
            end = b"/".join(place)
            resolved = path if end == relative else display(end)
        return replace(reading, path=path, resolved=resolved, link=link, leaves=leaves)

    def _find(self, relative: bytes) -> tuple[Place, os.stat_result | None, bytes | None]:
        """Return the place of a file or link, a file's state unless its directory was listed, a link's target."""
        entry = self._entries.get(relative)
        directory, _slash, name = relative.rpartition(b"/")
        if entry is not None and entry.kind in (EntryKind.FILE, EntryKind.LINK):
            return (*self.real(directory), name), None, entry.target
        place = (*self._reals[directory], name) if name and directory in self._reals else names(relative)
        found = self._descent.entry(place)
        if stat.S_ISLNK(found.st_mode):
            return place, None, self._descent.target(place)
        refuse_unless_file(found)
        return place, found, None

    def _is_listed(self, directory: bytes) -> bool:
        listing = self._listings.get(directory)
        return listing is not None and listing.directory.status is Status.DIRECTORY

    def _read(self, place: Place, found: os.stat_result | None, *, needed: bool) -> File:
        """Return what the inode at `place` held when it was read first, without a path."""
        known = None if found is None else self._known(found, needed=needed)
        if known is not None:
            return known
        try:
            descriptor = self._descent.open(place, _READ_FLAGS)
        except (FileNotFoundError, NotADirectoryError):
            raise Refusal(Status.UNREADABLE, "was there, and gone when it was to be read") from None
        try:
            opened = os.fstat(descriptor)
            swapped = found is not None and (found.st_dev, found.st_ino) != (opened.st_dev, opened.st_ino)
            if not stat.S_ISREG(opened.st_mode) or swapped:
                raise Refusal(Status.UNREADABLE, "was replaced by something else when it was to be read")
            reading = self._known(opened, needed=needed)
            if reading is None:
                reading = self._content(descriptor, opened)
                self._readings[opened.st_dev, opened.st_ino] = reading.holding(None)
            return reading
        finally:
            os.close(descriptor)

    def _known(self, found: os.stat_result, *, needed: bool) -> File | None:
        known = self._readings.get((found.st_dev, found.st_ino))
        if known is None or known.status is not Status.PRESENT:
            return known
        content = self._contents.get(known.sha256 or "")
        return known.holding(content) if content is not None or not needed else None

    def _content(self, descriptor: int, found: os.stat_result) -> File:
        size, too_large, content = found.st_size, "", b""
        if size > MAX_FILE_BYTES:
            too_large = f"holds {size} bytes, more than the limit of {MAX_FILE_BYTES}; it was not read"
        elif size > self._bytes_left:
            too_large = f"was not read: with it, the keystore's files hold more than {MAX_TOTAL_BYTES} bytes"
        else:
            content = read_at_most(descriptor, MAX_FILE_BYTES + 1, size)
            self._bytes_left -= len(content)
            if len(content) > MAX_FILE_BYTES:
                too_large = f"holds more than the limit of {MAX_FILE_BYTES} bytes"
        if too_large:
            traces, hashed = search(descriptor, self._hashed_left)
            self._hashed_left -= min(hashed, self._hashed_left)
        else:
            traces = look(content)
            if any(traces[:3]) and traces.sha256 is not None:
                self._contents.setdefault(traces.sha256, content)
        return _there(
            found,
            status=Status.TOO_LARGE if too_large else Status.PRESENT,
            detail=too_large,
            content=None if too_large else content,
            **traces._asdict(),
        )

    def _list(self, relative: bytes) -> Listing:
        path = display(relative)
        try:
            found, entries = self._scan(self.real(relative))
        except (OSError, ValueError) as error:
            missing = (Status.MISSING, "there is no such directory")
            return Listing(directory=_refused(path, refusal(error, "cannot be listed", missing=missing)), entries=())
        except Refusal as refused:
            return Listing(directory=_refused(path, refused), entries=())
        return Listing(directory=_there(found, path=path, status=Status.DIRECTORY), entries=entries)

    def _scan(self, place: Place) -> tuple[os.stat_result, tuple[Entry, ...]]:
        found = self._descent.entry(place)
        if not stat.S_ISDIR(found.st_mode):
            raise Refusal(Status.UNREADABLE, "is no directory")
        if len(place) > MAX_DEPTH:
            raise Refusal(Status.UNREADABLE, f"lies deeper than the limit of {MAX_DEPTH} directories")
        descriptor = self._descent.open(place, _LIST_FLAGS)
        entries: list[Entry] = []
        try:
            with os.scandir(descriptor) as scanned:
                for entry in scanned:
                    if len(entries) >= self._entries_left:
                        self.exhausted = True
                        limit = f"with it, the keystore holds more than {MAX_ENTRIES} entries"
                        raise Refusal(Status.UNREADABLE, f"was not listed, nor what comes after it: {limit}")
                    entries.append(described(entry, descriptor))
        finally:
            os.close(descriptor)
        self._entries_left -= len(entries)
        entries.sort(key=lambda entry: entry.name)
        return found, tuple(entries)


def _opened(path: str) -> int:
    check_system()
    try:
        return os.open(path, flags("O_DIRECTORY", "O_CLOEXEC"))
    except FileNotFoundError:
        raise NothingToAudit(f"{path} does not exist: {_EXPECTED}.") from None
    except NotADirectoryError:
        raise NothingToAudit(f"{path} is not a directory: {_EXPECTED}.") from None
    except OSError as error:
        raise NothingToAudit(f"{path} cannot be read ({reason(error)}): {_EXPECTED}.") from None
    except ValueError:  # a NUL character
        raise NothingToAudit(f"{path!r} is not a path: {_EXPECTED}.") from None


def _there(found: os.stat_result, *, path: str = "", **more: Any) -> File:
    shared = found.st_gid != found.st_uid
    mode = stat.S_IMODE(found.st_mode)
    return File(path=path, resolved=None, mode=mode, group=found.st_gid, shared_group=shared, **more)


def _refused(path: str, refused: Refusal) -> File:
    return File(path=path, resolved=None, status=refused.status, detail=refused.detail)
