"""Dates that are others than before, in words and as aspects of a change."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from keystore_audit.model.comparison.change import Aspect, Direction
from keystore_audit.text import instant

Dates = tuple[datetime | None, datetime | None]
"""Beginning and end, aware UTC; None: there is none."""


def other_dates(old: Dates, new: Dates) -> tuple[str, tuple[Aspect, ...]]:
    """What became of the dates, as "begins later and ends later", and each that is another."""
    words = []
    aspects = []
    for verb, what, before, after in zip(("begins", "ends"), ("from", "until"), old, new, strict=True):
        if before != after:
            later = after is None or (before is not None and before < after)
            words.append(f"{verb} {'later' if later else 'earlier'}")
            aspects.append(Aspect(what=what, old=told(before), new=told(after), direction=Direction.CHANGED))
    return " and ".join(words), tuple(aspects)


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
