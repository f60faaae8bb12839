"""A case that is asked of real sessions and routers, and of us."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime

from msgspec import Struct

from tests.oracles.zenoh.deployment import Configuration

K = "0/chatter/T/H"


class Case(Struct, frozen=True):
    """`who` does something on `key`, and `whom` is at `at`. `as_if`: whose certificate `who` has if no file counts.

    `to`: the only one that an attacker really connects to. `sessions`: what really starts. `files`: those of them that
    restrain; others are an attacker's. `ours`: what we say, where that is not what was measured: unknown.
    `after`: when it is done (aware UTC), where that is not at once. `wire`: a port, and another to which all that comes
    there is handed on: the question is what can be read there. `override`: values by their paths in place of those of
    every session's file, as an environment may set them.
    """

    name: str
    measured: str
    sessions: Mapping[str, Configuration]
    files: tuple[str, ...]
    who: str
    whom: str
    does: str = "put"
    key: str = K
    at: str = K
    as_if: str | None = None
    ours: str | None = None
    to: str | None = None
    after: datetime | None = None
    wire: tuple[int, int] | None = None
    override: Mapping[str, str] = {}
