"""Asking together what is expected to hold gives the answers of asking one by one, whatever is expected."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from keystore_audit import resources
from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.atoms import ROLE_LETTERS, name_atoms
from keystore_audit.engine.alloy.facts import CONSISTENCY, EXERCISED, facts
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.questions import AS_EXPECTED, Questions, Sheet, without_last
from keystore_audit.engine.alloy.runner import examine
from keystore_audit.engine.alloy.solution import Command
from keystore_audit.engine.native import NativeEngine
from keystore_audit.errors import EngineFailed
from keystore_audit.model.formal.claim import ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES, Status
from tests.engine.alloy_batch import outcomes, shipped
from tests.engine.systems import healthy, lively, random_system, stock, with_claims

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

RUNS = {CONSISTENCY, *EXERCISED.values()}

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
    modules = shipped()
    again = settled = 0

    def ask(system: System, questions: Questions) -> dict[str, bool]:
        return outcomes(tmp_path, modules | {"keystore.als": facts(system), "audit.als": questions.text})

    for seed in range(SYSTEMS):
        system = with_claims(lively(random_system(seed), seed), seed)
        singly = ask(system, sheet(system).one_by_one())
        says = expected(system, random.Random(seed) if seed % 2 else None)
        told: dict[str, bool] = {}
        questions: Questions | None = sheet(system).together(says)
        rounds = 0
        while questions is not None:
            found = ask(system, questions)
            assert list(found) == [command.name for command in questions.commands]
            answered, open_ = questions.answered(found)
            settled += sum(not set(each.members) & set(open_) for each in questions.joints)
            told |= answered
            questions = sheet(system).again(says, open_) if open_ else None
            rounds += 1
        again += rounds > 1
        assert rounds <= 3
        assert told == singly, seed
    assert again >= 5
    assert settled >= SYSTEMS // 2


def test_what_is_as_expected_takes_one_command_for_all_of_it() -> None:
    for system in (healthy(), stock()):
        assert sheet(system).together(expected(system)).commands == (AS_EXPECTED,)
    for seed in range(8):
        system = with_claims(random_system(seed), seed, count=8)
        assert sheet(system).together(expected(system)).commands == (AS_EXPECTED,)
    unknown = {prop.id: Status.UNKNOWN for prop in PROPERTIES}
    asked = sheet(healthy()).together(unknown).commands
    assert asked == (AS_EXPECTED, *(Command(kind="check", name=prop.assertion) for prop in PROPERTIES))


def test_a_joint_command_that_is_not_answered_as_expected_settles_nothing() -> None:
    says = expected(stock())
    questions = sheet(stock()).together(says)
    violated = {prop.assertion for prop in PROPERTIES if says[prop.id] is Status.VIOLATED}
    assert violated
    assert {prop.assertion for prop in PROPERTIES} > violated
    told, open_ = questions.answered({AS_EXPECTED.name: True})
    assert not open_
    assert {name for name, occurs in told.items() if occurs} == {*violated, *RUNS}
    told, open_ = questions.answered({AS_EXPECTED.name: False})
    assert not told
    assert {command.name for command in open_} == {*RUNS, *(prop.assertion for prop in PROPERTIES)}
    apart = sheet(stock()).again(says, open_)
    assert {command.name for command in apart.joints[0].members} == {prop.assertion for prop in PROPERTIES}
    assert {command.name for command in apart.commands} == {AS_EXPECTED.name, *RUNS}
    told, open_ = apart.answered({AS_EXPECTED.name: False} | dict.fromkeys(RUNS, True))
    assert set(told) == RUNS
    assert sheet(stock()).again(says, open_).commands == open_


def test_a_flow_that_is_expected_and_not_there_is_asked_about_alone() -> None:
    """Nobody can name its hops; a compartment is looked for then."""
    alone = 0
    for seed in range(8):
        system = with_claims(random_system(seed), seed, count=8)
        says = expected(system)
        for number, claim in enumerate(system.claims):
            there = says[claim.id] is (Status.VIOLATED if claim.kind is ClaimKind.NO_FLOW else Status.HOLDS)
            if claim.kind in claims.FLOWS and not there:
                wrong = Status.HOLDS if claim.kind is ClaimKind.ABLE else Status.VIOLATED
                command = claims.command_of(claim, number)
                assert sheet(system).together(says | {claim.id: wrong}).commands == (AS_EXPECTED, command)
                alone += 1
    assert alone >= 4


@pytest.mark.usefixtures("resident_analyzer")
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


def test_a_condition_without_its_last_variable_says_the_same(tmp_path: Path) -> None:
    modules = shipped()
    shorter = 0
    for seed in range(SYSTEMS):
        system = with_claims(lively(random_system(seed), seed), seed, count=6)
        opened = sheet(system).one_by_one().text.partition("run ")[0]
        conditions = [sheet(system).condition(prop) for prop in PROPERTIES]
        conditions += [
            claims.condition(claim, n) for n, claim in enumerate(system.claims) if claim.kind not in claims.FLOWS
        ]
        pairs = [(each, without_last(each)) for each in conditions]
        shorter += sum(one != other for one, other in pairs)
        asked = [f"check Same{n} {{ ({one}) iff ({other}) }} for 0" for n, (one, other) in enumerate(pairs)]
        found = outcomes(tmp_path, modules | {"keystore.als": facts(system), "audit.als": "\n".join([opened, *asked])})
        assert not any(found.values()), seed
    assert shorter >= 13 * SYSTEMS


def test_the_last_variable_may_share_its_type() -> None:
    assert without_last("all one, two: A | two not in E") == "all one: A | no (E) & (A)"
    assert without_last("all one: B, two, three: A[1] | three not in E") == "all one: B, two: A[1] | no (E) & (A[1])"


@pytest.mark.parametrize(
    "condition",
    [
        "all one: A, other: one.more | other not in other.more",
        "all one: A | one in more",
        "all one: A | one not in more",
        "some one: A, other: B | other not in one.more",
    ],
)
def test_other_conditions_are_left_as_they_are(condition: str) -> None:
    assert without_last(condition) == condition


@pytest.mark.usefixtures("resident_analyzer")
def test_witnesses_of_a_joint_command_are_violations(tmp_path: Path, analyzer: Engine) -> None:
    """Each makes its condition false, in systems of one realm and of several."""
    modules = shipped()
    systems = [with_claims(lively(random_system(seed), seed), seed) for seed in (0, 1, 2, 5, 8)]
    assert len({len(system.realms) for system in systems}) > 1
    told = examine(
        systems, java=analyzer.java, jar=analyzer.jar, timeout=240, expected=[expected(system) for system in systems]
    )
    shown = 0
    for system, decision in zip(systems, told, strict=True):
        atoms = name_atoms(system)
        sorts = {"R": atoms.realms, "D": atoms.domains, "E": atoms.enclaves, "P": atoms.documents}
        sorts |= {"T": atoms.channels, "C": atoms.certificates}
        conditions = {prop.id: sheet(system).condition(prop) for prop in PROPERTIES}
        conditions |= {claim.id: claims.condition(claim, n) for n, claim in enumerate(system.claims)}
        asked = []
        for name, answer in decision.answers.items():
            for witness in answer.witnesses:
                declared, body = conditions[name].removeprefix("all ").split("|", 1)
                names = {role.value: sorts[ROLE_LETTERS[role]].name(atom) for role, atom in witness.items()}
                if "publisher:" in declared:  # an enclave, a certificate, or nobody that has a key
                    names["publisher"] = names.pop("enclave", names.pop("certificate", "Outsider"))
                places = [f"{variable} = {atom}" for variable, atom in names.items()]
                asked.append(
                    f"run Shown{len(asked)} {{ some {declared} | {' and '.join(places)} and not ({body}) }} for 0"
                )
        if not asked:
            continue
        opened = sheet(system).one_by_one().text.partition("run ")[0]
        found = outcomes(tmp_path, modules | {"keystore.als": facts(system), "audit.als": "\n".join([opened, *asked])})
        assert len(found) == len(asked)
        assert all(found.values())
        shown += len(asked)
    assert shown >= 12
