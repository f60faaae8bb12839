"""The two engines give one answer: on random systems, by the thousand, through the real Analyzer."""

from __future__ import annotations

from dataclasses import replace

import pytest

from keystore_audit.engine.native import NativeEngine
from keystore_audit.model.claim import ClaimKind
from keystore_audit.model.system import System
from keystore_audit.properties import PROPERTIES, Answer, Status
from tests.engine import alloy_batch
from tests.engine.alloy.flow_builders import at, claim
from tests.engine.alloy_batch import compare_batch, decide_batch
from tests.engine.flows_by_hand import ByHand, violated
from tests.engine.systems import LISTENER, TALKER, healthy, lively, random_system, with_claims

SYSTEMS = 1000
"""As many as the project asks for; the seeds are fixed so that a failure can be seen again."""

CLAIMS = 2
"""About each system."""


def some_system(seed: int) -> System:
    """Every second system is one in which much is allowed, so that data flows."""
    system = random_system(seed)
    return with_claims(lively(system, seed) if seed % 2 else system, seed, CLAIMS)


def holding(answers: dict[str, Answer]) -> dict[str, bool]:
    return {prop.id: answers[prop.id].status is Status.HOLDS for prop in PROPERTIES}


@pytest.mark.slow
def test_native_and_alloy_agree_on_random_systems() -> None:
    """About every property; and about claims, where enumeration by hand says the same."""
    systems = [some_system(seed) for seed in range(SYSTEMS)]
    native = [NativeEngine([system]).answers[0] for system in systems]
    expected = [holding(answers) for answers in native]
    tally: dict[tuple[ClaimKind, bool], int] = {}
    differing: list[object] = []
    for seed, (system, ours, theirs) in enumerate(zip(systems, native, compare_batch(systems, expected), strict=True)):
        differing += [(seed, each) for each in theirs.differing]
        hand = ByHand(system)
        for asked in system.claims:
            wrong = violated(hand, asked)
            tally[asked.kind, wrong] = tally.get((asked.kind, wrong), 0) + 1
            right = Status.VIOLATED if wrong else Status.HOLDS
            if not (theirs.claims[asked.id] is ours[asked.id].status is right):
                differing.append((seed, asked.id, asked.kind, theirs.claims[asked.id], ours[asked.id].status, right))
    assert differing == []
    for prop in PROPERTIES:
        count = sum(not holds[prop.id] for holds in expected)
        assert 15 <= count <= SYSTEMS - 15, f"{prop.id} is violated in {count} of {SYSTEMS}: a lopsided test"
    for kind in ClaimKind:
        assert min(tally[kind, True], tally[kind, False]) >= 10, f"a lopsided test: {tally}"


def test_asking_whether_anything_differs_finds_what_asking_one_by_one_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    """The short cut of the test above, against a command for each property, with one expectation turned each time."""
    some = PROPERTIES[::3]
    systems = [some_system(seed) for seed in range(len(some))]
    alone = decide_batch(systems)
    known = {id(system): answers for system, answers in zip(systems, alone, strict=True)}
    monkeypatch.setattr(alloy_batch, "_decide", lambda _directory, _modules, system: known[id(system)])  # as just now
    turned = [answers | {prop.id: not answers[prop.id]} for prop, answers in zip(some, alone, strict=True)]
    assert [each.differing for each in compare_batch(systems, alone)] == [()] * len(systems)
    assert [each.differing for each in compare_batch(systems, turned)] == [(prop.id,) for prop in some]


def test_who_may_not_be_passed_is_no_place_of_the_only_pair_either() -> None:
    able = replace(claim(at(TALKER), at(LISTENER), kind=ClaimKind.ABLE), pairs=((at(TALKER), at(LISTENER)),))
    claims = [replace(able, through=frozenset(through)) for through in ((), (TALKER,))]
    systems = [replace(healthy(), claims=(each,)) for each in claims]
    native = [NativeEngine([system]).answers[0] for system in systems]
    found = compare_batch(systems, [holding(answers) for answers in native])
    for ours, theirs, expected in zip(native, found, (Status.HOLDS, Status.VIOLATED), strict=True):
        assert ours[able.id].status is theirs.claims[able.id] is expected
