"""Every directory of a keystore, in order of path, and the digest of all that lies there. It enters such links to
directories as it is told to.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator
from sys import intern
from typing import Final

from keystore_audit.keystore.descent import Place, display
from keystore_audit.keystore.files import EntryKind, Listing, Status
from keystore_audit.keystore.root import Root
from keystore_audit.text import percent_path

VOLUME: Final = b"..data"
"""The link by which Kubernetes swaps the files of a mounted secret at once (pkg/volume/util/atomic_writer.go). It leads
to a folder beside it whose name begins with two dots, too.
"""


def walk(root: Root, enters: Callable[[bytes, Place], bool]) -> Iterator[tuple[bytes, Listing]]:
    """List every directory; end at the limit of entries.

    `enters`: whether to enter the link at a path, by where it leads. A directory is listed once on each way, so that
    ways end.
    """
    stack: list[tuple[bytes, tuple[Place, ...]]] = [(b"", ())]
    while stack:
        path, over = stack.pop()
        listing = root.entries(path)
        yield path, listing
        if root.exhausted and listing.directory.status is not Status.DIRECTORY:
            return
        way = (*over, root.real(path))
        for entry in reversed(listing.entries):
            inner = below(path, entry.name)
            if entry.kind is EntryKind.LINK:
                end = root.directory_behind(inner)
                if end is None or end in way or not enters(inner, end):
                    continue
                root.enter(inner, end)
            elif entry.kind is not EntryKind.DIRECTORY or root.real(inner) in way:
                continue
            stack.append((inner, way))


def below(path: bytes, name: bytes) -> bytes:
    """The path of a name in a directory."""
    return path + b"/" + name if path else name


def in_other_root(_path: bytes, end: Place) -> bool:
    """Whether a link leads into another root than the keystore's own, so that no other way leads there."""
    return end[:1] != () and end[0].startswith(b"/")


def is_volume(root: Root, path: bytes, end: Place) -> bool:
    """Whether the link is the one over which the files beside it lead to those of a mounted volume."""
    above, _slash, name = path.rpartition(b"/")
    if name != VOLUME or end[:-1] != root.real(above) or not end[-1].startswith(b".."):
        return False
    return any((entry.target or b"").startswith(VOLUME + b"/") for entry in root.entries(above).entries)


# --- what identifies a content

Record = tuple[bytes, bytes, bytes]
"""Path, type and value of an entry."""

_HASH_LENGTH: Final = hashlib.sha256().digest_size * 2
_FILE: Final = EntryKind.FILE.value.encode()
_DIRECTORY: Final = EntryKind.DIRECTORY.value.encode()


def digest(records: Iterable[Record]) -> str:
    """Hash the tree: for each entry, in order of path, path, type and value, each ended by NUL.

    The value is the SHA-256 of a file's content in hexadecimal, a link's target, and nothing for a directory. Where a
    file was not hashed, or a directory not listed, it is the status. No modes and times: a copy has the same digest.
    """
    hashed = hashlib.sha256()
    for record in records:
        for part in record:
            hashed.update(part + b"\0")
    return hashed.hexdigest()


def contents(records: Iterable[Record]) -> Iterator[tuple[str, str]]:
    """Files with the hash of what is in them."""
    for path, kind, value in records:
        if kind == _FILE and _is_hash(value):
            yield display(path), intern(value.decode())


def uncovered(records: Iterable[Record]) -> Iterator[str]:
    """Files that were not hashed and directories that were not listed: their values are statuses."""
    for path, kind, value in records:
        if (kind == _FILE and not _is_hash(value)) or (kind == _DIRECTORY and value):
            yield percent_path(path) or "."


def _is_hash(value: bytes) -> bool:
    """Whether it is a SHA-256 in hexadecimal; every status is shorter."""
    return len(value) == _HASH_LENGTH


def records(root: Root) -> Iterator[Record]:
    """Every entry below the root, and what links lead to in other roots; with it, every file has been read."""
    for place, listing in walk(root, in_other_root):
        status = listing.directory.status
        yield place, _DIRECTORY, b"" if status is Status.DIRECTORY else status.value.encode()
        for entry in listing.entries:
            path = below(place, entry.name)
            if entry.kind is EntryKind.LINK:
                yield path, entry.kind.value.encode(), entry.target or b""
                if root.sealed(path).place.startswith("/"):
                    yield path, _FILE, root.fingerprint(path).encode()
            elif entry.kind is not EntryKind.DIRECTORY:
                yield path, entry.kind.value.encode(), root.fingerprint(path).encode()
