"""Asking together what is expected to be so gives the answers of asking one by one, whatever is expected."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from keystore_audit.engine.alloy.atoms import ROLE_SORTS, name_atoms
from keystore_audit.engine.alloy.claims import Question
from keystore_audit.engine.alloy.facts import CONSISTENCY, facts
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.runner import AS_EXPECTED, examine, expected_true, main_file, questions
from keystore_audit.engine.native import NativeEngine
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES, Status
from tests.amount import tried
from tests.engine.alloy_batch import outcomes, shipped
from tests.engine.systems import healthy, lively, random_system, stock, with_claims

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

SYSTEMS = tried(12, 8)
"""Random systems with claims; the seeds are fixed."""


def asked(system: System) -> list[Question]:
    return [*questions(system, PROPERTIES)]


def expected(system: System, chance: random.Random | None = None) -> dict[str, Status]:
    """What the native engine says; with `chance`, now and then the opposite."""
    wrong = {Status.HOLDS: Status.VIOLATED, Status.VIOLATED: Status.HOLDS}
    return {
        name: wrong[answer.status] if chance and chance.random() < 0.1 else answer.status
        for name, answer in NativeEngine([system]).answers[0].items()
    }


def test_together_and_one_by_one_have_the_same_outcomes(tmp_path: Path) -> None:
    """One command has an instance exactly where every condition is true that it asks for."""
    modules = shipped()
    right = wrong = 0
    for seed in range(SYSTEMS):
        system = with_claims(lively(random_system(seed), seed), seed)
        every = asked(system)
        together = expected_true(every, expected(system, random.Random(seed) if seed % 2 else None))
        text, commands = main_file(system, together, every)
        found = outcomes(tmp_path, modules | {"keystore.als": facts(system), "audit.als": text})
        assert list(found) == [command.name for command in commands]
        true = [found[each.command.name] is (each.command.kind == "run") for each in together]
        assert found[AS_EXPECTED.name] is all(true), seed
        right += all(true)
        wrong += not all(true)
    assert right >= SYSTEMS // 2
    assert wrong >= 2


def test_what_is_expected_to_be_so_takes_one_command_for_all_of_it() -> None:
    for system in (healthy(), stock(), *(with_claims(random_system(seed), seed, count=8) for seed in range(8))):
        every, says = asked(system), expected(system)
        together = expected_true(every, says)
        assert every[0] in together
        assert every[0].command.name == CONSISTENCY
        known = {each.id for each in together}
        alone = [each for each in every if each.id not in known]
        assert all(says[each.id] is not each.when_true for each in alone)
    unknown = dict.fromkeys(expected(healthy()), Status.UNKNOWN)
    assert expected_true(asked(healthy()), unknown) == asked(healthy())[:1]


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


@pytest.mark.usefixtures("resident_analyzer")
def test_witnesses_are_violations(tmp_path: Path, analyzer: Engine) -> None:
    """Each makes its condition false, in systems of one trust domain and of several."""
    modules = shipped()
    stated = dict(re.findall(r"^pred (\w+) \{\n\t(.*?)^\}", modules["properties.als"], re.MULTILINE | re.DOTALL))
    systems = [with_claims(lively(random_system(seed), seed), seed) for seed in (0, 1, 2, 5, 8)]
    assert len({len(system.trust_domains) for system in systems}) > 1
    told = examine(
        systems, java=analyzer.java, jar=analyzer.jar, timeout=240, expected=[expected(system) for system in systems]
    )
    shown = 0
    for system, decision in zip(systems, told, strict=True):
        atoms = name_atoms(system)
        conditions = {question.id: stated.get(question.condition, question.condition) for question in asked(system)}
        shows: list[str] = []
        for name, answer in decision.answers.items():
            for witness in answer.witnesses:
                declared, body = conditions[name].removeprefix("all ").split("|", 1)
                names = {role.value: atoms[ROLE_SORTS[role]].name(atom) for role, atom in witness.items()}
                if "publisher:" in declared:  # an enclave, a certificate, or nobody that has a key
                    names["publisher"] = names.pop("enclave", names.pop("certificate", "Outsider"))
                places = [f"{variable} = {atom}" for variable, atom in names.items()]
                shows.append(
                    f"run Shown{len(shows)} {{ some {declared} | {' and '.join(places)} and not ({body}) }} for 0"
                )
        if not shows:
            continue
        opened = main_file(system, (), asked(system))[0].partition("run ")[0]
        found = outcomes(tmp_path, modules | {"keystore.als": facts(system), "audit.als": "\n".join([opened, *shows])})
        assert len(found) == len(shows)
        assert all(found.values())
        shown += len(shows)
    assert shown >= 12
