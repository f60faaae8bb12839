"""What identifies a keystore's content: a digest of all that lies in its directory."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.keystore.files import EntryKind, Status
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.walk import below, in_other_root, walk
from keystore_audit.text import percent_path

Record = tuple[bytes, bytes, bytes]
"""Path, type and value of an entry."""

_HASH_LENGTH: Final = hashlib.sha256().digest_size * 2
_FILE: Final = EntryKind.FILE.value.encode()
_DIRECTORY: Final = EntryKind.DIRECTORY.value.encode()


def digest(records: Iterable[Record]) -> str:
    """Hash the tree: for each entry, in order of path, path, type and value, each ended by NUL.

    The value is the SHA-256 of a file's content in hexadecimal (its status where it was not hashed), a link's
    target, and nothing for a directory (its status where it was not listed). No modes and times: a copy has
    the same digest.
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
            yield percent_path(path), value.decode()


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
