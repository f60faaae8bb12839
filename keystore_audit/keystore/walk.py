"""Every directory of a keystore, in order of path, over such links to directories as are to be entered."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from keystore_audit.keystore.descent import Place
from keystore_audit.keystore.files import EntryKind, Listing, Status
from keystore_audit.keystore.root import Root

VOLUME: Final = b"..data"
"""The link by which Kubernetes swaps the files of a mounted secret at once, to a folder beside it whose name begins
with two dots, too (pkg/volume/util/atomic_writer.go).
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
