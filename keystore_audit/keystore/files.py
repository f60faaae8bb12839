"""What is in the directory of a keystore: files with their bytes, or with the reason why there are none."""

from __future__ import annotations

from enum import Enum
from typing import Final

from msgspec import Struct
from msgspec.structs import replace


class Status(str, Enum):
    """What was found under a name."""

    PRESENT = "present"
    MISSING = "missing"
    DANGLING = "dangling"
    LOOP = "loop"
    OUTSIDE = "outside"
    DIRECTORY = "directory"
    SPECIAL = "special"
    TOO_LARGE = "too-large"
    UNREADABLE = "unreadable"

    @property
    def unknown(self) -> bool:
        """Whether a robot might read something here that we did not read."""
        return self in (Status.OUTSIDE, Status.SPECIAL, Status.TOO_LARGE, Status.UNREADABLE)


UNREAD_BUT_THERE: Final = frozenset({Status.PRESENT, Status.UNREADABLE, Status.TOO_LARGE})
"""An unreadable key is in the tree all the same; one outside, by a link, is not."""


class File(Struct, frozen=True, kw_only=True):
    """What is at `path`: a path relative to the keystore, POSIX, percent-encoded (`text.percent_path`).

    `resolved` is the relative path of the regular file whose bytes these are, links resolved (None unless
    PRESENT). `detail` says in words why the status is not PRESENT. `mode` holds the permission bits of the resolved
    file or of a directory that was listed, `group` the number of its group. `link` is the target text where the entry
    itself is a symbolic link, percent-encoded too.
    `content` is None where the bytes were withheld: private keys, `.p11` files (they may hold a PIN). Of a file that is
    TOO_LARGE to be read `sha256` is known where all of it was hashed (`traces.search`).
    """

    path: str
    resolved: str | None
    status: Status
    detail: str = ""
    content: bytes | None = None
    sha256: str | None = None
    mode: int | None = None
    group: int | None = None
    shared_group: bool = False
    """Whether its group may hold others than its owner: a group of one user alone has that user's number."""
    link: str | None = None
    leaves: tuple[str, str] | None = None
    """The link on the way to it that goes by where the keystore lies, itself or another, and what that says."""
    holds_private_key: bool = False
    """Whether a private key may stand in it (`traces.Traces`, as the next three)."""
    holds_certificates: bool = False
    """Whether certificates may stand in it."""
    may_be_message: bool = False
    """Whether a signed message may stand in it."""
    concealed: str = ""
    """How it carries the mark of one that OpenSSL does not read there, in words; "" if it does not."""
    opaque: str = ""
    """Why what is in it was not read, though its bytes were, in words; "" if it was."""

    def __repr__(self) -> str:
        """Without the content, which may hold a private key."""
        return f"File({self.place!r}, {self.status.value})"

    @property
    def place(self) -> str:
        """The path to print: the resolved one where there is one."""
        return self.resolved if self.resolved is not None else self.path

    def holding(self, content: bytes | None) -> File:
        """The same file with other content, or none."""
        return self if content is self.content else replace(self, content=content)


class EntryKind(str, Enum):
    """What a directory entry is by itself, links not followed."""

    FILE = "file"
    DIRECTORY = "directory"
    LINK = "link"
    SPECIAL = "special"


class Entry(Struct, frozen=True, kw_only=True):
    """An entry of a directory; `target` is what a link says, byte for byte."""

    name: bytes
    kind: EntryKind
    target: bytes | None = None


class Listing(Struct, frozen=True, kw_only=True):
    """A directory and its entries by name; no entries unless the status of `directory` is DIRECTORY."""

    directory: File
    entries: tuple[Entry, ...]
