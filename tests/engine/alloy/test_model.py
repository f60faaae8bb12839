"""What the Alloy model says: theorems about any keystore, and what each single change to a healthy one breaks."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.export import commands, write_model
from keystore_audit.engine.alloy.facts import KEYSTORE, MAIN, MODULES, facts
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.properties import PROPERTIES
from tests.engine import systems
from tests.engine.alloy.mutations import MODEL_MUTANTS, MUTATIONS, Change, both, mutated, on
from tests.engine.alloy_batch import compare_batch, decide_batch, outcomes, shipped, unexpected
from tests.engine.systems import (
    CHATTER,
    LISTENER,
    LISTENER_PERMISSIONS,
    TALKER,
    healthy,
)

HERE = Path(__file__).parent

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]


def test_every_change_breaks_exactly_the_properties_that_it_should() -> None:
    systems = [mutated(change) for change, _broken in MUTATIONS.values()]
    expected = [{prop.id: prop.id not in broken for prop in PROPERTIES} for _change, broken in MUTATIONS.values()]
    found = dict(zip(MUTATIONS, compare_batch(systems, expected), strict=True))
    assert {name: wrong for name, wrong in found.items() if wrong} == {}


def test_every_change_of_the_model_changes_an_answer() -> None:
    """Each mutant is found out by Alloy's own answer about one of the systems."""
    survived = []
    for name, (row, old, new) in MODEL_MUTANTS.items():
        change, broken = MUTATIONS[row]
        modules = shipped()
        [changed] = (module for module in MODULES if old in modules[module])
        [answers] = decide_batch([mutated(change)], {changed: modules[changed].replace(old, new)})
        if {identifier for identifier, holds in answers.items() if not holds} == broken:
            survived.append(name)
    assert survived == []


def test_every_property_is_broken_by_some_change_of_something_that_was_read() -> None:
    read = (broken for name, (_change, broken) in MUTATIONS.items() if "opaque" not in name)
    assert set().union(*read) == {prop.id for prop in PROPERTIES}


def any_keystore() -> dict[str, str]:
    return shipped() | {path.name: path.read_text() for path in (HERE / "any_keystore").glob("*.als")}


@pytest.mark.slow
@pytest.mark.parametrize("theorems", ["theorems.als", "flow_theorems.als", "fallen_theorems.als"])
def test_theorems_hold_of_any_keystore_and_every_property_can_fail_and_hold(theorems: str, tmp_path: Path) -> None:
    assert unexpected(tmp_path, any_keystore(), theorems) == []


PERMISSION_MUTANTS = {
    "DatesChooseGrants": ("Grant - (skipped_out_of_date - in_force), c", "Grant, c"),
    "RulesStayInTheirDomains": ("{ r: Rule, c: r.criteria | c.in_domain in r.domains }", "criteria"),
    "DenyRulesLetNobodyJoin": ("d: (g.rule & allow_rule).domains", "d: g.rule.domains"),
    "LessAllowedIsNoMore": (
        "Channel - g.rule.matches",
        "Channel - (g.rule & (allow_rule + (Rule - Entry.precedes))).matches",  # deny rules but the first do not count
    ),
}
"""By theorem about permissions a change of the module that no other theorem of any file finds (old text, new text)."""


@pytest.mark.parametrize("broken", [None, *PERMISSION_MUTANTS])
def test_each_theorem_about_permissions_finds_a_mutant_that_no_other_does(broken: str | None, tmp_path: Path) -> None:
    modules = any_keystore()
    if broken is not None:
        old, new = PERMISSION_MUTANTS[broken]
        assert old in modules["permissions.als"]
        modules["permissions.als"] = modules["permissions.als"].replace(old, new)
    assert unexpected(tmp_path, modules, "permission_theorems.als") == ([] if broken is None else [broken])


def execute(analyzer: Engine, folder: Path, main: str, *options: str) -> subprocess.CompletedProcess[str]:
    options_of_java = ["-XX:+UseSerialGC", "-XX:TieredStopAtLevel=1"]  # the second compiler takes a third of the time
    command = [str(analyzer.java), f"-Djava.io.tmpdir={folder}", *options_of_java, "-jar", str(analyzer.jar)]
    command += ["exec", "-f", "-s", "sat4j", "-o", "out", *options, main]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=1200, env={"PATH": os.defpath})


@pytest.mark.parametrize("module", [*MODULES, *claims.MODULES, KEYSTORE, MAIN])
def test_each_module_opens_and_runs_by_itself(module: str, tmp_path: Path) -> None:
    """With the example of the source tree as facts, and a command of the test's."""
    modules = shipped()
    name = module.removesuffix(".als")
    modules["alone.als"] = f"module alone\nopen {name}\nrun nothing {{ no none }} for 0\n"
    assert outcomes(tmp_path, modules, "alone.als") == {"nothing": True}


def test_the_temporal_module_opens_and_runs_by_itself(tmp_path: Path) -> None:
    modules = shipped()
    modules["alone.als"] = "module alone\nopen propagation\nrun Rest { always rests } for 0 but 1..2 steps\n"
    assert outcomes(tmp_path, modules, "alone.als") == {"Rest": True}


def test_an_exported_model_runs_as_it_is(tmp_path: Path, analyzer: Engine) -> None:
    write_model([systems.stock()], tmp_path / "model")
    done = execute(analyzer, tmp_path / "model", MAIN, "-t", "none", "-d", "0")
    assert done.returncode == 0, done.stderr
    failed = [line.split()[2] for line in done.stderr.splitlines() if line.endswith(" SAT") and "check" in line]
    assert failed == ["OneCaForOneRole", "ReadersCannotForge"]


def test_families_without_an_object_say_so(tmp_path: Path) -> None:
    """No grant at all: nothing to enforce; nothing governed: nothing to protect either."""
    modules = shipped()
    modules[MAIN] = commands(PROPERTIES)

    def exercised(change: Change) -> list[bool]:
        found = outcomes(tmp_path, modules | {KEYSTORE: facts(mutated(change))})
        return [found[f"{family}IsExercised"] for family in ("Authentication", "Encryption", "AccessControl")]

    assert exercised(lambda _b: None) == [True, True, True]
    assert exercised(on("topic_rules", 0, channels=frozenset())) == [True, False, False]
    no_grants = both(
        lambda b: b.rules.clear(),
        on("topic_rules", 0, enable_read_access_control=False),
        on("domain_rules", 0, enable_join_access_control=False),
    )
    assert exercised(no_grants) == [True, True, False]
    anonymous = both(on("enclaves", TALKER, identity=None), on("enclaves", LISTENER, identity=None))
    assert exercised(anonymous) == [False, False, False]


def test_a_contradiction_in_the_model_is_seen(tmp_path: Path) -> None:
    modules = shipped()
    modules |= {MAIN: commands(PROPERTIES), KEYSTORE: facts(healthy()) + "\nfact { no Enclave }\n"}
    assert not any(outcomes(tmp_path, modules).values())


def test_the_talker_and_the_listener_keep_their_indices() -> None:
    """What the mutations above rely on."""
    system = healthy()
    assert (system.enclaves[TALKER].label, system.enclaves[LISTENER].label) == ("/talker", "/listener")
    assert system.enclaves[LISTENER].document == LISTENER_PERMISSIONS
    assert system.channels[CHATTER].topic == "rt/chatter"
