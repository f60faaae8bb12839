"""Two processes in two enclaves, on both vendors: whom they accept, and whose samples arrive, is what was measured."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.oracles.vendors.pairs import Pairs, pairs
from tests.oracles.vendors.pairs_measured import CASES, measured, outcomes
from tests.oracles.xml.parsers import require_measured_versions


@pytest.fixture(scope="module")
def vendors(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Pairs]]:
    """Both vendors' programs, where they are those of the table."""
    require_measured_versions(oracle)
    with pairs(oracle, tmp_path_factory.mktemp("programs")) as both:
        yield both


def test_every_pair_was_measured_once() -> None:
    titles = [case.title for case in CASES]
    assert len(titles) >= 60
    assert len(set(titles)) == len(titles)
    assert list(measured()) == titles


@pytest.mark.parametrize("vendor", ["cyclone", "fastdds"])
def test_pairs_do_what_was_measured(vendor: str, vendors: dict[str, Pairs], tmp_path: Path) -> None:
    expected = [measured()[case.title][vendor] for case in CASES]
    seen = outcomes(vendors[vendor], CASES, tmp_path, expected)
    others = {
        case.title: f"measured {was}, now {now}"
        for case, was, now in zip(CASES, expected, seen, strict=True)
        if was != now
    }
    assert not others


def test_samples_arrive_only_where_both_may_and_somewhere_each_way() -> None:
    letters = {name: "".join(row[name] for row in measured().values()) for name in ("cyclone", "fastdds")}
    for vendor, seen in letters.items():
        assert {"+", ".", "-", "~"} <= set(seen), f"the pairs of {vendor} do not tell its answers apart"
