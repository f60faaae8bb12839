"""Without an assumption both engines decide alike; and who needs which is what leaving it out shows."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.assumptions import CONDITIONS, EVERY, Assumption
from keystore_audit.engine.alloy.export import commands
from keystore_audit.engine.alloy.facts import CONSISTENCY, MAIN, facts
from keystore_audit.engine.horizon import with_conditions
from keystore_audit.engine.native import NativeEngine
from keystore_audit.model.formal.system import System
from keystore_audit.properties import BY_ID, PROPERTIES, Status
from keystore_audit.properties.result import ProfileResult, PropertyResult
from tests.amount import tried
from tests.engine.alloy_batch import compare_batch, outcomes, shipped
from tests.engine.systems import healthy
from tests.engine.test_agreement import holding, some_system

SEEDS = range(tried(60))


def less(seed: int) -> System:
    """A random system with some assumptions left out."""
    chance = random.Random(seed)
    left_out = chance.sample(sorted(EVERY), chance.randint(1, 2))
    system = some_system(seed)
    return replace(system, assumed=EVERY.difference(left_out), asks_announced_only=chance.random() < 0.5)


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_the_engines_agree_without_an_assumption() -> None:
    systems = [less(seed) for seed in SEEDS]
    native = [holding(NativeEngine([system]).answers[0]) for system in systems]
    differing = {seed: found for seed, found in enumerate(compare_batch(systems, native)) if found}
    assert differing == {}
    made = [holding(NativeEngine([replace(system, assumed=EVERY)]).answers[0]) for system in systems]
    changed = sum(one != other for one, other in zip(native, made, strict=True))
    assert changed > len(SEEDS) // 2


def test_to_take_less_for_granted_lets_nothing_hold_that_did_not() -> None:
    for seed in SEEDS:
        system = less(seed)
        fewer, all_made = (NativeEngine([each]).answers[0] for each in (system, replace(system, assumed=EVERY)))
        for prop in PROPERTIES:
            assert fewer[prop.id].status is Status.VIOLATED or all_made[prop.id].status is Status.HOLDS, (seed, prop.id)


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
@pytest.mark.parametrize("contradiction", ["some none", "no assumed", "anybody != opaque & Enclave"])
def test_facts_that_contradict_what_is_assumed_have_no_instance(contradiction: str, tmp_path: Path) -> None:
    modules = {**shipped(), "keystore.als": facts(healthy()), MAIN: commands((), healthy())}
    assert outcomes(tmp_path / "sound", modules, MAIN)[CONSISTENCY]
    modules["vacuity.als"] += f"\nfact {{ {contradiction} }}\n"
    assert not outcomes(tmp_path / "contradictory", modules, MAIN)[CONSISTENCY]


@pytest.mark.parametrize("assumption", CONDITIONS)
def test_who_needs_an_assumption_is_told_and_nobody_else(assumption: Assumption) -> None:
    system = replace(healthy(), profiles=("cyclonedds-11", "spec"), may=True)
    holds = ProfileResult(status=Status.HOLDS, engines={}, counterexample=None)
    results = [PropertyResult(prop=prop, profiles=dict.fromkeys(system.profiles, holds)) for prop in BY_ID.values()]
    told = {result.prop.id: result for result in with_conditions(results, [system])}
    for profile in system.profiles:
        asks = profile == "cyclonedds-11"
        without = replace(system, assumed=EVERY - {assumption}, asks_announced_only=asks)
        [answers] = NativeEngine([without]).answers
        for name, answer in answers.items():
            needed = assumption in told[name].profiles[profile].needs
            assert needed == (answer.status is Status.VIOLATED), (profile, name)
    needing = {name for name, result in told.items() if assumption in result.needs}
    assert {"nobody-writes-without-a-grant"} <= needing < {*told}
