"""Domain ids: what a document's ids and ranges cover, and the classes that no document tells apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from keystore_audit.keystore.document import MAX_DOMAIN, DomainRange
from keystore_audit.model.formal.system import DomainAtom
from keystore_audit.profiles import OpenRange

Interval = tuple[int, int]


def covered(ranges: Iterable[DomainRange], reading: OpenRange = OpenRange.UNBOUNDED) -> tuple[Interval, ...]:
    """The closed intervals of 0..232 that `<domains>` covers, sorted and merged.

    Either bound of an `<id_range>` may be absent (DDS-Security 1.1, 9.4.1.2.4 and Annex A); what that means is
    `reading`.
    """
    return merged(filter(None, (_interval(item, reading) for item in ranges)))


def merged(intervals: Iterable[Interval]) -> tuple[Interval, ...]:
    """What the closed intervals cover, ascending and apart."""
    found: list[Interval] = []
    for low, high in sorted(intervals):
        if found and low <= found[-1][1] + 1:
            found[-1] = (found[-1][0], max(found[-1][1], high))
        else:
            found.append((low, high))
    return tuple(found)


def _interval(item: DomainRange, reading: OpenRange) -> Interval | None:
    low, high = item.low or 0, item.high
    if reading is not OpenRange.UNBOUNDED and item.low is not None and high is None:
        high = low
    if reading is OpenRange.LONE_BOUND_IS_THAT_ID and high == 0:
        high = low
    high = MAX_DOMAIN if high is None else min(MAX_DOMAIN, high)
    return (low, high) if low <= high else None


def contains(intervals: Iterable[Interval], domain: int) -> bool:
    """Whether `domain` lies in one of the closed intervals."""
    for low, high in intervals:  # noqa: SIM110 - asked a million times of hostile documents, and `any` is slow
        if low <= domain <= high:
            return True
    return False


def domain_bits(intervals: Iterable[Interval]) -> int:
    """The ids in the closed intervals as a bit set: to be asked about many of them."""
    found = 0
    for low, high in intervals:
        found |= (2 << high) - (1 << low)
    return found


def covered_classes(cover: Iterable[Interval], domains: Iterable[DomainAtom]) -> frozenset[int]:
    """The classes among `domains` that the cover is about, where it is one of those that made them."""
    ids = domain_bits(cover)
    return frozenset(number for number, each in enumerate(domains) if ids >> each.intervals[0][0] & 1)


def elementary(covers: Iterable[Sequence[Interval]]) -> tuple[Interval, ...]:
    """The coarsest closed intervals that partition 0..232 and on which every cover is constant."""
    starts = {0}
    for cover in set(map(tuple, covers)):
        for low, high in cover:
            starts.add(low)
            if high < MAX_DOMAIN:
                starts.add(high + 1)
    ordered = sorted(starts)
    return tuple(
        (start, (ordered[index + 1] if index + 1 < len(ordered) else MAX_DOMAIN + 1) - 1)
        for index, start in enumerate(ordered)
    )


def describe(intervals: Iterable[Interval]) -> str:
    """`0`, `0-5, 7`: for people."""
    return ", ".join(str(low) if low == high else f"{low}-{high}" for low, high in intervals) or "none"


def domain_classes(covers: Iterable[Sequence[Interval]]) -> tuple[DomainAtom, ...]:
    """Domain ids 0..232 in classes that no cover tells apart."""
    distinct = list(dict.fromkeys(tuple(cover) for cover in covers))
    classes: dict[tuple[int, ...], list[Interval]] = {}
    covers_bits = [domain_bits(cover) for cover in distinct]
    for low, high in elementary(distinct):
        signature = tuple([bits >> low & 1 for bits in covers_bits])
        classes.setdefault(signature, []).append((low, high))
    atoms = []
    for intervals in classes.values():
        several = len(intervals) > 1 or intervals[0][0] != intervals[0][1]
        label = f"{'domains' if several else 'domain'} {describe(intervals)}"
        atoms.append(DomainAtom(label=label, intervals=tuple(intervals)))
    return tuple(atoms)
