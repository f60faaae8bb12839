"""Domain ids: what a document's ids and ranges cover, and the classes that no document tells apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from keystore_audit.keystore.governance import DomainRange

HIGHEST_DOMAIN = 232
"""RTPS 2.5, 9.6.2.3: with the default port numbers no UDP port is left above domain 232."""

Interval = tuple[int, int]


def covered(ranges: Iterable[DomainRange]) -> tuple[Interval, ...]:
    """The closed intervals of 0..232 that `<domains>` covers under `spec`, sorted and merged.

    An `<id_range>` without `<max>` has no upper bound, one without `<min>` starts at 0
    (DDS-Security 1.1, 9.4.1.2.4 and Annex A: either bound may be absent).
    """
    intervals = sorted(
        (max(0, item.low or 0), min(HIGHEST_DOMAIN, HIGHEST_DOMAIN if item.high is None else item.high))
        for item in ranges
    )
    merged: list[Interval] = []
    for low, high in intervals:
        if low > high:
            continue
        if merged and low <= merged[-1][1] + 1:
            merged[-1] = (merged[-1][0], max(merged[-1][1], high))
        else:
            merged.append((low, high))
    return tuple(merged)


def contains(intervals: Iterable[Interval], domain: int) -> bool:
    """Whether `domain` lies in one of the closed intervals."""
    return any(low <= domain <= high for low, high in intervals)


def elementary(covers: Iterable[Sequence[Interval]]) -> tuple[Interval, ...]:
    """The coarsest closed intervals that partition 0..232 and on which every cover is constant."""
    starts = {0}
    for cover in covers:
        for low, high in cover:
            starts.add(low)
            if high < HIGHEST_DOMAIN:
                starts.add(high + 1)
    ordered = sorted(starts)
    return tuple(
        (start, (ordered[index + 1] if index + 1 < len(ordered) else HIGHEST_DOMAIN + 1) - 1)
        for index, start in enumerate(ordered)
    )


def describe(intervals: Iterable[Interval]) -> str:
    """`0`, `0-5, 7`: for people."""
    return ", ".join(str(low) if low == high else f"{low}-{high}" for low, high in intervals) or "none"
