"""Reads the files of an untrusted directory: bounded, regular files only, never outside the root."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum


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
        """Whether a robot might read something here that we did not."""
        return self in (Status.OUTSIDE, Status.SPECIAL, Status.TOO_LARGE, Status.UNREADABLE)


@dataclass(frozen=True, slots=True, kw_only=True)
class File:
    """What is at `path`: a path relative to the keystore, POSIX, percent-encoded (`text.percent_path`).

    `resolved` is the relative path of the regular file whose bytes these are, links resolved (None unless
    PRESENT). `detail` says in words why the status is not PRESENT. `mode` holds the permission bits of the
    resolved file, `link` the target text where the entry itself is a symbolic link.
    """

    path: str
    resolved: str | None
    status: Status
    detail: str = ""
    content: bytes | None = field(default=None, repr=False)
    sha256: str | None = None
    mode: int | None = None
    link: str | None = None

    @property
    def place(self) -> str:
        """The path to print: the resolved one where there is one."""
        return self.resolved if self.resolved is not None else self.path
