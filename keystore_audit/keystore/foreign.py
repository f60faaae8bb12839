"""Files that neither sros2 nor the DDS-Security plugins know by place and name, and what users say of them. Sources:
ros2/sros2 (keystore layouts of all distributions) and ros2/rmw_dds_common (security.cpp).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.descent import display
from keystore_audit.keystore.files import EntryKind, File
from keystore_audit.keystore.layout import ENCLAVE_NAMES, Layout, LayoutKind
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.walk import VOLUME, below, in_other_root, walk

_SHARED: Final = re.compile(
    r"(enclaves/)?governance\.(xml|p7s)|public/(identity_|permissions_)?ca\.cert\.pem"
    r"|private/(identity_|permissions_)?ca\.key\.pem"
)
_BEFORE_FOXY: Final = re.compile(
    r"(identity_|permissions_)?ca\.(cert|key)\.pem|ca_conf\.cnf|(index\.txt|serial)(\.attr|\.old)*|[0-9A-F]{4,40}\.pem"
    r"|(.*/)?ecdsaparam|.*/(req\.pem|request\.cnf)"
)
_FOLDERS: Final = frozenset({".", "public", "private", "enclaves"})


class DeclaredFiles(Struct, frozen=True, kw_only=True):
    """What users say of the files of a keystore.

    `foreign`: patterns of paths of which no finding is made. `accepted`: SHA-256, in hexadecimal, of files that were
    looked at by somebody. `key_group`: the number of the group that may read enclaves' keys. `aliases`: as in
    `layout.discover`. `roots`: further directories that links may lead into. `enclaves`: paths, each with the
    place where it is said what the enclave runs.
    """

    foreign: tuple[str, ...] = ()
    accepted: frozenset[str] = frozenset()
    key_group: int | None = None
    aliases: tuple[str, ...] = ()
    roots: tuple[str, ...] = ()
    enclaves: tuple[tuple[str, str], ...] = ()

    def names(self, path: str) -> bool:
        """Whether a pattern names the path: `*` is anything but `/`, `**` anything."""
        return any(_expression(pattern).fullmatch(path) for pattern in self.foreign)


NOTHING_DECLARED: Final = DeclaredFiles()


class Foreign(Struct, frozen=True, kw_only=True):
    """A foreign file, or a directory in which nothing was found. `top`: the topmost directory around it in which all is
    foreign; itself where there is none.
    """

    file: File
    top: str

    @property
    def unread(self) -> bool:
        """Whether it may hold something that was not read."""
        return self.file.status.unknown or self.file.opaque != ""


def find_foreign(root: Root, layout: Layout) -> Iterator[Foreign]:
    """The foreign files, by path. Every file has been read."""
    known = {path for file in _known(layout) for path in (file.path, file.place)}
    own = {enclave.directory for enclave in layout.enclaves}
    passed, ways = root.passed(), root.ways()
    found: dict[str, File] = {}
    folders = set(_FOLDERS)
    for place, listing in walk(root, in_other_root):
        directory = display(place)
        if not listing.entries and directory not in _FOLDERS:
            found[directory] = listing.directory
        called = (directory, *ways.get(directory, ()))
        for entry in listing.entries:
            if entry.kind is EntryKind.DIRECTORY:
                continue
            inner = below(place, entry.name)
            path = display(inner)
            if (
                path in known
                or (entry.name in ENCLAVE_NAMES and not own.isdisjoint(called))
                or any(_shared(_in(each, path), layout.kind) for each in called)
                or root.is_entered(inner)
                or (entry.name == VOLUME and directory in passed)
            ):
                folders.update(_above(path))
            else:
                found[path] = root.sealed(inner)
    for path in sorted(found):
        top = next((each for each in reversed([*_above(path)]) if each not in folders), path)
        yield Foreign(file=found[path], top=top)


def _in(directory: str, path: str) -> str:
    """The path of the same name in a directory."""
    name = path.rpartition("/")[2]
    return name if directory == "." else f"{directory}/{name}"


def _shared(path: str, kind: LayoutKind) -> bool:
    """Whether it is one of the files that sros2 makes beside enclaves, or that openssl left for it."""
    return bool(_SHARED.fullmatch(path) or (kind is not LayoutKind.SROS2 and _BEFORE_FOXY.fullmatch(path)))


def _known(layout: Layout) -> Iterator[File]:
    """What enclaves read, what lies beside it, and where links of theirs lead."""
    shared = (*layout.authority_keys, *layout.authorities, layout.governance, layout.unsigned_governance)
    yield from (file for file in shared if file is not None and _shared(file.path, layout.kind))
    for enclave in layout.enclaves:
        yield from enclave.every


@lru_cache
def _expression(pattern: str) -> re.Pattern[str]:
    words = {"**": ".*", "*": "[^/]*", "?": "[^/]"}
    return re.compile(
        "".join(words.get(part, re.escape(part)) for part in re.split(r"(\*\*|\*|\?)", pattern)), re.DOTALL
    )


def _above(path: str) -> Iterator[str]:
    """The directories around it, the innermost first, but for the root."""
    while path := path.rpartition("/")[0]:
        yield path
