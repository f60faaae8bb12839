"""What behaviours rest on: Alloy confirms it of keystores, and refuses each change of it."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timezone
from itertools import pairwise
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit import resources
from keystore_audit.engine.alloy import determinism
from keystore_audit.engine.alloy.facts import KEYSTORE, facts
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.process import Analyzer
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.formal.asked import DeterminismAtom, Meeting, Spread
from keystore_audit.model.formal.system import System
from keystore_audit.model.interpret import interpret
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import resolve
from keystore_audit.settings.settings import read_settings
from tests.engine.alloy_batch import outcomes, shipped

SAMPLES = Path(__file__).resolve().parents[3] / "sample_keystores"
AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)

TURTLESIM = """\
[[forward]]
enclave = "/multiplexer"
from = ["/high_priority", "/low_priority"]
to = "/move_turtle"
scheduler = "priority"
[[property]]
name = "high-keyboard"
deterministic = { low = "/move_turtle", high = "/keyboard" }
[[property]]
name = "high-topic"
deterministic = { low = ["/move_turtle", "/high_priority"], high = "topic:/low_priority", include_ambient = true }
"""
JOYSTICK = """\
[[property]]
name = "over-two-nodes"
deterministic = { low = "/move_turtle", high = "/joystick" }
[[forward]]
enclave = "/multiplexer"
from = "/low_priority"
to = "/move_turtle"
scheduler = "any"
"""
VEHICLE = """\
[[forward]]
enclave = "/brake"
from = "/motor_state"
to = ["/motor_limit", "/brake_state"]
scheduler = "any"
[[forward]]
enclave = "/motor"
from = "/motor_limit"
to = "/motor_state"
scheduler = "any"
[[property]]
name = "stays-apart"
deterministic = { low = ["/motor_limit", "/vehicle_state"], high = "/infotainment" }
"""
CASES = {
    "turtlesim_healthy": (TURTLESIM, "fastdds"),
    "turtlesim_shared_ca": (TURTLESIM, "cyclonedds-0.10"),
    "turtlesim_joystick": (JOYSTICK, "spec"),
    "vehicle_bridged_domain": (VEHICLE, "fastdds"),
    "vehicle_governance_flag": (VEHICLE, "spec"),
}


def system_of(name: str, tmp_path: Path) -> System:
    text, profile = CASES[name]
    file = tmp_path / "keystore-audit.toml"
    file.write_text(text)
    keystore = read_keystore(SAMPLES / "flows" / name)
    accesses = AccessViews(documents_of(keystore), AT, None)
    declared = read_settings(file, ()).declared
    usabilities = Usabilities(None, accesses)
    meaning = interpret(keystore, resolve((profile,)), AT, accesses, usabilities, declared=declared)
    (system,) = meaning.systems
    assert all(not claim.undecided and claim.meetings for claim in system.determinism)
    return system


def confirmed(system: System, directory: Path) -> bool:
    modules = shipped()
    modules |= {KEYSTORE: facts(system), determinism.WIRING: determinism.write_wiring(system)}
    return not outcomes(directory, modules, determinism.WIRING)[determinism.CONFIRMED]


@pytest.mark.parametrize("name", CASES)
def test_alloy_confirms_who_hands_samples_to_whom(name: str, tmp_path: Path) -> None:
    assert confirmed(system_of(name, tmp_path), tmp_path)


def changes(claim: DeterminismAtom, enclaves: frozenset[int]) -> Iterator[DeterminismAtom]:
    """The claim with one sender too many or too few; with one reached enclave, or forward, too few."""

    def meeting(number: int, changed: Meeting) -> DeterminismAtom:
        return replace(claim, meetings=(*claim.meetings[:number], changed, *claim.meetings[number + 1 :]))

    def spread(changed: Spread) -> DeterminismAtom:
        return replace(claim, spread=changed)

    for number, each in enumerate(claim.meetings):
        if each.senders:
            yield meeting(number, replace(each, senders=each.senders - {min(each.senders)}))
        if enclaves - each.senders:
            yield meeting(number, replace(each, senders=each.senders | {min(enclaves - each.senders)}))
    assert claim.spread is not None
    for number, passage in enumerate(claim.spread.passages):
        if passage.reached:
            passages = list(claim.spread.passages)
            passages[number] = replace(passage, reached=False)
            yield spread(replace(claim.spread, passages=tuple(passages)))


@pytest.mark.parametrize("name", ["turtlesim_healthy", "vehicle_bridged_domain"])
def test_each_change_is_refused(name: str, tmp_path: Path) -> None:
    system = system_of(name, tmp_path)
    enclaves = frozenset(range(len(system.enclaves)))
    asked = [changed for claim in system.determinism for changed in changes(claim, enclaves)]
    assert len(asked) >= 5
    for changed in asked:
        assert not confirmed(replace(system, determinism=(changed,)), tmp_path), changed


def test_who_is_reached_over_other_nodes_is_not_forgotten(tmp_path: Path) -> None:
    system = system_of("turtlesim_joystick", tmp_path)
    (claim,) = system.determinism
    assert claim.spread is not None
    inside = {system.enclaves[number].label for number in claim.spread.inside}
    assert inside == {"/joystick", "/keyboard"}
    fewer = frozenset(n for n in claim.spread.inside if system.enclaves[n].label == "/joystick")
    changed = replace(claim, spread=replace(claim.spread, inside=fewer))
    assert not confirmed(replace(system, determinism=(changed,)), tmp_path)


def test_what_is_not_confirmed_is_no_answer(analyzer: Engine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    system = system_of("turtlesim_healthy", tmp_path)
    given = Analyzer(java=analyzer.java, jar=analyzer.jar, timeout=120, memory_mb=512)
    changed = replace(system, determinism=(next(changes(system.determinism[0], frozenset())),))
    with pytest.raises(EngineFailed, match="does not confirm"):
        determinism.decide([changed], given)
    monkeypatch.setattr(determinism, "MAX_ATOMS", 10)
    with pytest.raises(EngineOutOfScale, match="up to 10"):
        determinism.decide([system], given)


def test_everything_that_is_declared_has_a_comment() -> None:
    for module in ("forwarding.als", determinism.MODULE):
        lines = (resources.alloy() / module).read_text().split("\n")
        for before, line in pairwise(lines):
            if line.startswith(("abstract sig", "one sig", "sig", "fun", "pred", "assert", "fact")):
                assert before.endswith("*/") or before.startswith("one sig"), f"{module}: {line}"
