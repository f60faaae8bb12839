"""Changes of single enclaves before they are told: equal ones of several enclaves are one change, and so are dates
that moved the same way.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from typing import NamedTuple

from keystore_audit.findings import Location
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.model.comparison.change import Aspect, Direction, joint_direction
from keystore_audit.text import instant

Dates = tuple[datetime | None, datetime | None]
"""Beginning and end, aware UTC; None: there is none."""


def other_dates(old: Dates, new: Dates) -> tuple[str, tuple[Aspect, ...], Direction]:
    """What became of the dates, as "begins later and ends later", each that is another, and if it is for longer."""
    words = []
    aspects = []
    for verb, what, before, after in zip(("begins", "ends"), ("from", "until"), old, new, strict=True):
        if before != after:
            later = after is None or (before is not None and before < after)
            words.append(f"{verb} {'later' if later else 'earlier'}")
            direction = Direction.GAINED if later == (what == "until") else Direction.LOST
            aspects.append(Aspect(what=what, old=told(before), new=told(after), direction=direction))
    return " and ".join(words), tuple(aspects), joint_direction(aspects)


def spanned(several: Sequence[tuple[Aspect, ...]]) -> tuple[Aspect, ...]:
    """One aspect for equally many of several changes: where values differ, the first and the last."""
    return tuple(
        Aspect(
            what=alike[0].what,
            old=_span([each.old for each in alike]),
            new=_span([each.new for each in alike]),
            direction=alike[0].direction,
        )
        for alike in zip(*several, strict=True)
    )


def _span(values: Sequence[str | None]) -> str | None:
    known = sorted({value for value in values if value is not None})
    if len(known) < 2:
        return known[0] if known else None
    return f"{known[0]} to {known[-1]}"


def told(moment: datetime | None) -> str:
    """As reports write it."""
    return "never" if moment is None else instant(moment)


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


def listing(what: str, old: Iterable[str], new: Iterable[str], direction: Direction) -> Aspect:
    """What is on one side alone, each in order."""
    one, other = (", ".join(sorted(each)) or None for each in (old, new))
    return Aspect(what=what, old=one, new=other, direction=direction)


def place_of(certificate: Certificate | None) -> Location | None:
    """Where it is written."""
    return None if certificate is None else Location(path=certificate.path, line=certificate.line)


def dated(kind: str, what: str, old: Dates, new: Dates) -> Iterator[Fact]:
    """Other dates: more where something counts for longer than before."""
    if old != new:
        words, aspects, direction = other_dates(old, new)
        yield Fact(kind, direction, f"{what} {words}", aspects)
