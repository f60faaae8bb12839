"""Without an assumption both engines decide alike; and who needs which is what leaving it out shows."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.engine.alloy.export import commands
from keystore_audit.engine.alloy.facts import CONSISTENCY, MAIN, facts
from keystore_audit.engine.engines import Engines
from keystore_audit.engine.native import NativeEngine
from keystore_audit.engine.needs import Minimal, solved_again, with_needs
from keystore_audit.model.formal.system import System
from keystore_audit.properties import BY_ID, PROPERTIES, Status
from keystore_audit.properties.result import EngineRun, EngineStatus, ProfileResult, PropertyResult
from tests.amount import tried
from tests.engine.alloy_batch import compare_batch, outcomes, shipped
from tests.engine.systems import healthy, judging
from tests.engine.test_agreement import holding, some_system

SEEDS = range(tried(60))

INSTANT = EVERY - {Assumption.SESSIONS_END_WITH_GRANTS, Assumption.LOCKSTEP_ROUNDS}
"""What an answer at an instant may rest on."""


def less(seed: int) -> System:
    """A random system with some assumptions left out."""
    chance = random.Random(seed)
    left_out = chance.sample(sorted(EVERY), chance.randint(1, 2))
    system = some_system(seed)
    return judging(replace(system, assumed=EVERY.difference(left_out)), asks_announced_only=chance.random() < 0.5)


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


PROFILES = {True: "cyclonedds-11", False: "spec"}
"""One that goes by what peers announce, and one that does not."""


def needing(system: System, made: frozenset[Assumption]) -> tuple[dict[str, frozenset[Assumption]], list[Minimal]]:
    """By what holds in the system what it needs, and the sets."""
    [answers] = NativeEngine([system]).answers
    [profile] = system.profiles
    results = [
        PropertyResult(
            prop=prop, profiles={profile: ProfileResult(status=answers[name].status, engines={}, counterexample=None)}
        )
        for name, prop in BY_ID.items()
    ]
    told, minimal = with_needs(results, NativeEngine([system]), made)
    found = {each.prop.id: each.profiles[profile] for each in told if each.status is Status.HOLDS}
    assert all({*each.needs, *each.survives_without} == made_for(profile, made) for each in found.values())
    return {name: frozenset(each.needs) for name, each in found.items()}, list(minimal)


def made_for(profile: str, made: frozenset[Assumption]) -> frozenset[Assumption]:
    return made if profile == PROFILES[True] else made - {Assumption.TRUTHFUL_ANNOUNCEMENTS}


def as_read(system: System, *, announced: bool) -> System:
    system = replace(system, profiles=(PROFILES[announced],), may=True, assumed=EVERY)
    return judging(system, asks_announced_only=False)


def holds(system: System, assumed: frozenset[Assumption], name: str) -> bool:
    announced = system.profiles == (PROFILES[True],)
    less = judging(replace(system, assumed=assumed), asks_announced_only=announced)
    return NativeEngine([less]).answers[0][name].status is Status.HOLDS


def test_each_set_is_enough_and_nothing_in_it_can_be_left_out() -> None:
    sets = set()
    for seed in SEEDS:
        system = as_read(some_system(seed), announced=seed % 2 == 0)
        for name, needs in needing(system, INSTANT)[0].items():
            known = EVERY - INSTANT
            assert holds(system, known | needs, name), (seed, name)
            assert not any(holds(system, known | needs - {each}, name) for each in needs), (seed, name)
            sets.add(needs)
    assert len(sets) > 6


def test_what_is_known_is_no_assumption() -> None:
    """With authorities that are declared, nothing rests on their being as found; what nobody certified still counts."""
    system = as_read(healthy(), announced=False)
    found, _minimal = needing(system, INSTANT)
    declared, _minimal = needing(system, INSTANT - {Assumption.AUTHORITIES_AS_FOUND})
    assert Assumption.AUTHORITIES_AS_FOUND in found["nobody-writes-without-a-grant"]
    assert declared == {name: needs - {Assumption.AUTHORITIES_AS_FOUND} for name, needs in found.items()}


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_alloy_finds_each_set_enough() -> None:
    systems = [as_read(some_system(seed), announced=seed % 2 == 0) for seed in range(tried(12))]
    minimal = [each for system in systems for each in needing(system, INSTANT)[1]]
    native = [holding(NativeEngine([each.system]).answers[0]) for each in minimal]
    differing = {n: found for n, found in enumerate(compare_batch([each.system for each in minimal], native)) if found}
    assert differing == {}
    assert all(held[name] for each, held in zip(minimal, native, strict=True) for name in each.names)


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
@pytest.mark.parametrize("choice", ["both", "auto"])
def test_a_set_that_alloy_does_not_find_enough_leaves_what_holds_unknown(choice: str) -> None:
    """Nothing is enough for rights, so that a set of nothing is refused by who was asked to solve it."""
    name = "nobody-writes-without-a-grant"
    system = as_read(healthy(), announced=False)
    held = ProfileResult(status=Status.HOLDS, engines={"native": Status.HOLDS}, counterexample=None)
    result = PropertyResult(prop=BY_ID[name], profiles={"spec": held})
    wrong = Minimal(replace(system, assumed=EVERY - INSTANT), frozenset({name}))
    run = EngineRun(name="alloy", version=None, status=EngineStatus.OK, reason="", required=True)
    told, runs = solved_again((result,), [wrong], (run,), Engines(choice=choice), None)
    assert (told[0].status, told[0].engines_agree) == (
        (Status.UNKNOWN, False) if choice == "both" else (Status.HOLDS, True)
    )
    assert [each.status for each in runs] == [EngineStatus.OK]
