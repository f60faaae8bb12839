"""The two engines give one answer: on random systems, by the hundred, through the real Analyzer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.engine.native import NativeEngine
from keystore_audit.model.formal.asked import ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES, Answer, Status
from tests.amount import tried
from tests.engine.alloy.flow_builders import at, claim
from tests.engine.alloy_batch import (
    as_expected,
    compare_batch,
    decide_batch,
    decide_claims,
    named_by_command,
    shipped,
    whole_world,
)
from tests.engine.flows_by_hand import ByHand, violated
from tests.engine.systems import LISTENER, TALKER, healthy, lively, random_system, with_claims

SYSTEMS = tried(500)
"""Every mistake of native_mutants.py shows in them. Their seeds are fixed."""

CLAIMS = 2
"""About each system."""


def some_system(seed: int) -> System:
    """Every second system is one in which much is allowed, so that data flows."""
    system = random_system(seed)
    return with_claims(lively(system, seed) if seed % 2 else system, seed, CLAIMS)


def holding(answers: dict[str, Answer]) -> dict[str, bool]:
    """Whether each property and claim holds."""
    return {identifier: answer.status is Status.HOLDS for identifier, answer in answers.items()}


def disagreements(seeds: Iterable[int]) -> tuple[list[object], Counter[tuple[object, bool]]]:
    """What the engines, or enumeration by hand, say otherwise; and how often each property and kind of claim is so.

    About every property; and about claims, where enumeration by hand has to say the same.
    """
    asked = {seed: some_system(seed) for seed in seeds}
    native = [holding(NativeEngine([system]).answers[0]) for system in asked.values()]
    tally: Counter[tuple[object, bool]] = Counter()
    differing: list[object] = []
    compared = zip(asked.items(), native, compare_batch(tuple(asked.values()), native), strict=True)
    for (seed, system), ours, theirs in compared:
        differing += [(seed, each) for each in theirs]
        tally.update((prop.id, ours[prop.id]) for prop in PROPERTIES)
        hand = ByHand(system)
        for each in system.claims:
            right = not violated(hand, each)
            tally[each.kind, right] += 1
            if ours[each.id] is not right:
                differing.append((seed, each, right))
    return differing, tally


@pytest.mark.slow
def test_native_and_alloy_agree_on_random_systems() -> None:
    differing, tally = disagreements(range(SYSTEMS))
    assert differing == []
    for each, least in (*((prop.id, tried(15)) for prop in PROPERTIES), *((kind, tried(10)) for kind in ClaimKind)):
        assert min(tally[each, True], tally[each, False]) >= least, f"a lopsided test: {tally}"


def test_asking_about_all_at_once_finds_each_answer_that_is_otherwise(tmp_path: Path) -> None:
    """The short cut of the test above, against a command for each: with one expectation turned each time."""
    told = set()
    for seed in (1, 4, 12, 15, 31, 64):  # in which each property, and a claim of each kind, holds and does not
        system = some_system(seed)
        alone = decide_batch([system])[0]
        alone |= {asked: status is Status.HOLDS for asked, status in decide_claims([system])[0].items()}
        world = whole_world(tmp_path, shipped(), system)
        assert as_expected(world, dict(named_by_command(system, alone).values()))
        kinds = {asked.id: asked.kind for asked in system.claims}
        for each, holds in alone.items():
            if (kinds.get(each, each), holds) not in told:
                told.add((kinds.get(each, each), holds))
                turned = named_by_command(system, alone | {each: not holds})
                assert not as_expected(world, dict(turned.values())), (seed, each)
    assert told == {(each, holds) for each in (*(p.id for p in PROPERTIES), *ClaimKind) for holds in (True, False)}
    assert list(compare_batch([system], [alone | {each: not holds}])) == [[each]]


def test_what_an_engine_shows_must_violate_what_it_says() -> None:
    """Natively, before anybody is shown it; a flow hop by hop."""
    wrong = replace(healthy(), claims=(claim(at(LISTENER), at(TALKER)),))
    right = replace(wrong, claims=(claim(at(TALKER), at(LISTENER)),))
    [answers] = NativeEngine([right]).answers
    assert NativeEngine([right]).checked([answers])[0] == answers
    [checked] = NativeEngine([wrong]).checked([answers])
    assert checked == answers | {"asked": Answer(status=Status.UNKNOWN)}
    for seed in (1, 4, 12, 15):
        system = some_system(seed)
        [answers] = NativeEngine([system]).answers
        for name, answer in answers.items():
            for each in answer.witnesses[:1]:
                if name not in {claim.id for claim in system.claims}:
                    other = replace(answer, witnesses=(dict.fromkeys(each, 9999),))
                    [checked] = NativeEngine([system]).checked([{name: other}])
                    assert checked[name].status is Status.UNKNOWN


def test_who_may_not_be_passed_is_no_place_of_the_only_pair_either() -> None:
    able = replace(claim(at(TALKER), at(LISTENER), kind=ClaimKind.ABLE), pairs=((at(TALKER), at(LISTENER)),))
    claims = [replace(able, through=frozenset(through)) for through in ((), (TALKER,))]
    systems = [replace(healthy(), claims=(each,)) for each in claims]
    native = [NativeEngine([system]).answers[0] for system in systems]
    assert [ours[able.id].status for ours in native] == [Status.HOLDS, Status.VIOLATED]
    assert list(compare_batch(systems, [holding(answers) for answers in native])) == [[], []]
