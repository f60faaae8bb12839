"""Domain ids as intervals, against brute force over 0..232."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.keystore.document import MAX_DOMAIN, DomainRange
from keystore_audit.model.domains import contains, covered, domain_classes, elementary

BOUND = st.none() | st.integers(0, 300)
RANGES = st.lists(st.tuples(BOUND, BOUND), max_size=5)


def holds(domain: int, ranges: list[tuple[int | None, int | None]]) -> bool:
    return any((low or 0) <= domain <= (300 if high is None else high) for low, high in ranges)


def typed(ranges: list[tuple[int | None, int | None]]) -> list[DomainRange]:
    return [DomainRange(low=low, high=high, line=1) for low, high in ranges]


@given(RANGES)
def test_covered_holds_exactly_the_ids_of_the_ranges(ranges: list[tuple[int | None, int | None]]) -> None:
    cover = covered(typed(ranges))
    assert {d for d in range(MAX_DOMAIN + 1) if contains(cover, d)} == {
        d for d in range(MAX_DOMAIN + 1) if holds(d, ranges)
    }
    assert all(cover[n][1] + 1 < cover[n + 1][0] for n in range(len(cover) - 1))


@given(st.lists(RANGES, max_size=4))
def test_elementary_intervals_partition_the_ids_and_are_constant(
    lists: list[list[tuple[int | None, int | None]]],
) -> None:
    covers = [covered(typed(ranges)) for ranges in lists]
    intervals = elementary(covers)
    assert [d for low, high in intervals for d in range(low, high + 1)] == list(range(MAX_DOMAIN + 1))
    for low, high in intervals:
        for cover in covers:
            assert len({contains(cover, d) for d in range(low, high + 1)}) == 1


@given(st.lists(RANGES, max_size=4))
def test_domain_classes_are_the_coarsest(lists: list[list[tuple[int | None, int | None]]]) -> None:
    covers = [covered(typed(ranges)) for ranges in lists]
    signatures = {}
    for number, atom in enumerate(domain_classes(covers)):
        for low, high in atom.intervals:
            for domain in range(low, high + 1):
                signatures[domain] = (number, tuple(contains(cover, domain) for cover in covers))
    assert len(signatures) == MAX_DOMAIN + 1
    assert (
        len(set(signatures.values()))
        == len({s for _n, s in signatures.values()})
        == len({n for n, _s in signatures.values()})
    )
