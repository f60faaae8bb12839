"""Asking together what is expected to hold gives the answers of asking one by one, whatever is expected."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from keystore_audit import resources
from keystore_audit.engine.alloy.facts import facts
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.questions import ALL_ARE_SEPARATED, ALL_HOLD, NOTHING_IS_VACUOUS, Questions, Sheet
from keystore_audit.engine.alloy.runner import examine
from keystore_audit.engine.native import NativeEngine
from keystore_audit.errors import EngineFailed
from keystore_audit.model.system import System
from keystore_audit.properties import PROPERTIES, Status
from tests.engine.alloy_batch import outcomes
from tests.engine.systems import healthy, lively, random_system, stock, with_claims

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

SYSTEMS = 12
"""Random systems with claims; the seeds are fixed."""


def sheet(system: System) -> Sheet:
    return Sheet(system, PROPERTIES, (resources.alloy() / "properties.als").read_text())


def expected(system: System, chance: random.Random | None = None) -> dict[str, Status]:
    """What the native engine says; with `chance`, now and then the opposite."""
    wrong = {Status.HOLDS: Status.VIOLATED, Status.VIOLATED: Status.HOLDS}
    return {
        name: wrong[answer.status] if chance and chance.random() < 0.2 else answer.status
        for name, answer in NativeEngine([system]).answers[0].items()
    }


def test_together_and_one_by_one_have_the_same_outcomes(tmp_path: Path) -> None:
    modules = {path.name: path.read_text() for path in resources.alloy().glob("*.als")}
    again = settled = 0

    def ask(system: System, questions: Questions) -> dict[str, bool]:
        return outcomes(tmp_path, modules | {"keystore.als": facts(system), "audit.als": questions.text})

    for seed in range(SYSTEMS):
        system = with_claims(lively(random_system(seed), seed), seed)
        singly = ask(system, sheet(system).one_by_one())
        joint = sheet(system).together(expected(system, random.Random(seed) if seed % 2 else None))
        found = ask(system, joint)
        assert list(found) == [command.name for command in joint.commands]
        told, open_ = joint.answered(found)
        settled += sum(not set(each.members) & set(open_) for each in joint.joints)
        if open_:
            again += 1
            told |= ask(system, sheet(system).one_by_one(open_))
        assert told == singly, seed
    assert again >= 5
    assert settled >= SYSTEMS


def test_what_holds_as_expected_takes_one_command_for_all_of_it() -> None:
    system = healthy()
    assert sheet(system).together(expected(system)).commands == (NOTHING_IS_VACUOUS, ALL_HOLD)
    some = sheet(stock()).together(expected(stock()))
    alone = {prop.assertion for prop in PROPERTIES if prop.id in ("one-ca-for-one-role", "readers-cannot-forge")}
    assert {command.name for command in some.commands[2:]} == alone


def test_a_joint_command_that_is_not_answered_as_expected_settles_nothing() -> None:
    questions = sheet(healthy()).together(expected(healthy()))
    told, open_ = questions.answered({NOTHING_IS_VACUOUS.name: True, ALL_HOLD.name: True})
    assert set(open_) == set(questions.joints[1].members)
    assert not {command.name for command in open_} & set(told)
    told, open_ = questions.answered({NOTHING_IS_VACUOUS.name: False, ALL_HOLD.name: False})
    assert set(open_) == set(questions.joints[0].members)


def test_flows_that_do_not_happen_are_asked_together() -> None:
    for seed in range(8):
        system = with_claims(random_system(seed), seed, count=8)
        commands = sheet(system).together({claim.id: Status.HOLDS for claim in system.claims}).commands
        assert ALL_ARE_SEPARATED in commands


@pytest.mark.parametrize("says", [Status.HOLDS, Status.VIOLATED, Status.UNKNOWN])
def test_an_expectation_is_no_answer(says: Status, analyzer: Engine) -> None:
    wrong = {prop.id: says for prop in PROPERTIES}
    systems = [healthy(), stock()]
    found = examine(systems, java=analyzer.java, jar=analyzer.jar, timeout=240, expected=[wrong, wrong])
    for system, decision in zip(systems, found, strict=True):
        ours = NativeEngine([system]).answers[0]
        assert {name: a.status for name, a in decision.answers.items()} == {n: a.status for n, a in ours.items()}
        violated = [a for a in decision.answers.values() if a.status is Status.VIOLATED]
        assert all(answer.witnesses for answer in violated)
        assert decision.idle == frozenset()


def test_an_assertion_that_is_not_there_is_a_fault() -> None:
    with pytest.raises(EngineFailed, match="no assertion"):
        Sheet(healthy(), PROPERTIES, "module properties\n").together(expected(healthy()))
