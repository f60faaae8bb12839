"""Two processes in two enclaves, on both vendors: whom they accept, and whose samples arrive, is what was measured."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest

from keystore_audit.model.question import Answer
from keystore_audit.truth import Truth
from tests.oracles.vendors.ours import PROFILES, Asked
from tests.oracles.vendors.pairs import Pairs
from tests.oracles.vendors.pairs_case import KEYSTORE, Case
from tests.oracles.vendors.pairs_measured import CASES, measured, outcomes

pytestmark = pytest.mark.xdist_group("vendors-pairs")  # the programs are compiled once


def test_every_pair_was_measured_once() -> None:
    titles = [case.title for case in CASES]
    assert len(titles) >= 60
    assert len(set(titles)) == len(titles)
    assert list(measured()) == titles


@pytest.mark.parametrize("vendor", PROFILES)
def test_pairs_do_what_was_measured(vendor: str, vendors: dict[str, Pairs], tmp_path: Path) -> None:
    expected = [measured()[case.title][vendor] for case in CASES]
    seen = outcomes(vendors[vendor], CASES, tmp_path, expected)
    others = {
        case.title: f"measured {was}, now {now}"
        for case, was, now in zip(CASES, expected, seen, strict=True)
        if was != now
    }
    assert not others


def test_every_letter_is_among_the_answers_of_either_vendor() -> None:
    for vendor in PROFILES:
        seen = {letter for row in measured().values() for letter in row[vendor]}
        assert {"+", ".", "-", "~"} <= seen, f"the pairs of {vendor} do not tell its answers apart"


ABSTAINING = {"subject with blanks round it", "subject with newlines round it", "subject in both forms"}
"""Where we do not say what a document means: a subject that implementations read differently."""


def said(keystore: Path, case: Case, side: int, vendor: str) -> tuple[Answer, ...]:
    asked = Asked(keystore, "/second", case.domains[side], case.endpoints, datetime.now(timezone.utc))
    return asked.endpoints(vendor)


@pytest.mark.parametrize("vendor", PROFILES)
def test_we_call_effective_what_was_accepted(vendor: str, tmp_path: Path) -> None:
    exact = 0
    others = []
    for number, case in enumerate(case for case in CASES if case.second is not None):
        case.sides(tmp_path / str(number))
        letters = measured()[case.title][vendor]
        ours = said(tmp_path / str(number) / KEYSTORE, case, 0, vendor)
        is_exact = case.peers_agree
        for endpoint, letter, answer in zip(case.endpoints, letters, ours, strict=False):
            if case.title in ABSTAINING and answer.effective is Truth.UNKNOWN:
                continue
            exact += is_exact
            wanted = Truth.YES if letter in "+~" else Truth.NO if is_exact and letter == "." else None
            if wanted is not None and answer.effective is not wanted:
                others.append(f"{case.title}: {endpoint}: measured {letter}, effective is {answer.effective.value}")
    assert not others
    assert exact > 300


@pytest.mark.parametrize("vendor", PROFILES)
def test_we_decide_as_an_honest_side_does(vendor: str, tmp_path: Path) -> None:
    others = []
    honest = [case for case in CASES if case.second is not None and case.presented is None]
    for number, case in enumerate(honest):
        case.sides(tmp_path / str(number))
        letters = measured()[case.title][vendor]
        ours = said(tmp_path / str(number) / KEYSTORE, case, 1, vendor)
        # A side that did not start has no letter for each endpoint, and was never asked where the first one did not.
        each = letters if letters not in ("first", "second") else "-" * len(ours) if letters == "second" else ""
        for endpoint, letter, answer in zip(case.endpoints, each, ours, strict=False):
            wanted = Truth.NO if letter == "-" else Truth.YES
            if answer.decision is not wanted:
                others.append(f"{case.title}: {endpoint}: measured {letters}, decision is {answer.decision.value}")
    assert not others


def test_what_rests_on_the_handshake_is_unknown_to_fast_dds_alone(tmp_path: Path) -> None:
    (case,) = (case for case in CASES if case.title == "subject in both forms")
    case.sides(tmp_path)
    ours = {vendor: said(tmp_path / KEYSTORE, case, 0, vendor) for vendor in PROFILES}
    assert {vendor: {each.effective for each in answers} for vendor, answers in ours.items()} == {
        "cyclone": {Truth.YES, Truth.NO},
        "fastdds": {Truth.UNKNOWN},
    }
