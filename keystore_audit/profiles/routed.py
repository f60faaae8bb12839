"""What releases of a routed middleware do otherwise, of which neither permissions nor governance bind the processes."""

from __future__ import annotations

from msgspec import Struct


class Release(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Some releases that decide alike; quirks.toml says what the columns mean."""

    name: str = ""
    title: str
    versions: str
    distributions: tuple[str, ...] = ()
    asked: tuple[str, ...]
    asks_one_subject: bool
    deletes_as_puts: bool
