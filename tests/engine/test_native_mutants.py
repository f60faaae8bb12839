"""A mistake in the native engine alone turns the agreement suite red: Alloy decides for itself, and is not told."""

from __future__ import annotations

import pytest

from keystore_audit.engine.native import NativeEngine
from keystore_audit.model.formal.system import System
from tests.engine.alloy.mutations import MUTATIONS as CHANGES
from tests.engine.alloy.mutations import mutated
from tests.engine.alloy_batch import decide_batch
from tests.engine.native_mutants import MUTANTS, mistaken
from tests.engine.test_agreement import holding, some_system

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

SEEDS = (2, 16, 23, 24, 134, 241, 255, 310, 333, 412, 427, 491)
"""Of the random systems of test_agreement.py: together they find every mistake out."""

SINGLE = [name for name in CHANGES if "assumed" in name or "announcements" in name or "certificate of" in name]
"""Of the single changes of a healthy system, those about what is assumed and who signs."""

Decided = list[tuple[System, dict[str, bool]]]


@pytest.fixture(scope="module")
def decided() -> Decided:
    """What the Analyzer says of each system."""
    systems = [*(some_system(seed) for seed in SEEDS), *(mutated(CHANGES[name][0]) for name in SINGLE)]
    return list(zip(systems, decide_batch(systems), strict=True))


def disagreements(decided: Decided) -> int:
    return sum(not theirs.items() <= holding(NativeEngine([system]).answers[0]).items() for system, theirs in decided)


@pytest.mark.parametrize("name", MUTANTS)
def test_a_mistake_in_python_alone_is_a_disagreement(name: str, decided: Decided) -> None:
    with mistaken(name):
        assert disagreements(decided) > 0
    assert disagreements(decided) == 0, "and without it there is none"
