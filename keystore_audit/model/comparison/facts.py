"""Changes of single enclaves before they are told: equal ones of several enclaves are one change."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from keystore_audit.findings import Location
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.model.comparison.change import Aspect, Direction
from keystore_audit.model.comparison.dates import Dates, other_dates


class Fact(NamedTuple):
    """A change of one enclave; equal ones are told once, and so are dates that moved the same way.

    `profiles`: under which it is one; none: under all that were asked for. `touched`: other enclaves that it bears on,
    as those whose key it is; `whole`: it may bear on any.
    """

    kind: str
    direction: Direction
    what: str
    aspects: tuple[Aspect, ...]
    profiles: tuple[str, ...] = ()
    touched: tuple[str, ...] = ()
    whole: bool = False


Placed = tuple[Fact, Location | None, Location | None]
"""With where it is written in the old and in the new keystore."""


def place_of(certificate: Certificate | None) -> Location | None:
    """Where it is written."""
    return None if certificate is None else Location(path=certificate.path, line=certificate.line)


def dated(kind: str, what: str, old: Dates, new: Dates) -> Iterator[Fact]:
    """Other dates: neither more nor less, since everything is decided at one instant."""
    if old != new:
        words, aspects = other_dates(old, new)
        yield Fact(kind, Direction.CHANGED, f"{what} {words}", aspects)
