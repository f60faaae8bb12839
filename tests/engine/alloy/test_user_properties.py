"""Users' files through the real Analyzer: answers, names, faults; and our own properties asked the same way."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy.claims import check
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.process import Analyzer, Output
from keystore_audit.engine.alloy.user_file import CONSISTENT, UserFile, read_user_file
from keystore_audit.engine.alloy.user_properties import MAIN, _checked, ask, decide_files, job
from keystore_audit.engine.engines import Engines
from keystore_audit.engine.native import NativeEngine
from keystore_audit.errors import EngineOutOfScale, EngineTimeout, UsageError
from keystore_audit.given import GivenFile
from keystore_audit.intent.source import Source
from keystore_audit.model.formal.asked import PlaceAtom
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES, Status
from keystore_audit.properties.result import AlloyResult, EngineRun, EngineStatus
from tests.engine.alloy_batch import outcomes
from tests.engine.systems import CHATTER, LISTENER, TALKER, healthy, random_system, stock

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

ENOUGH = 120.0
"""Seconds for a small model on a busy machine."""

HEAD = "module asked\nopen keystore_audit\n"
NAMES = "//@ enclave Talker = /talker\n//@ topic Chatter = /chatter\n"

QUESTIONS = (
    HEAD
    + NAMES
    + """\
assert NobodyForges {
	all trust_domain: TrustDomain, enclave: Enclave, channel: Chatter |
		channel in enclave.(forges[trust_domain]) implies enclave in Talker
}
check NobodyForges for 0
check TalkerIsThere { one Talker and Talker in Enclave } for 0
run TalkerSpeaks { some trust_domain: TrustDomain | Chatter in Talker.(may_write[trust_domain]) } for 0
run ListenerSpeaks { some trust_domain: TrustDomain | some (Enclave - Talker).(may_write[trust_domain]) } for 0 expect 0
run Impossible { some Talker and no Enclave } for 0
check NobodyCanForge { all trust_domain: TrustDomain | no Enclave.(forges[trust_domain]) } for 0 expect 1
"""
)


def read(text: str) -> UserFile:
    return read_user_file(Source(file=GivenFile.of("asked.als", b""), real="/asked.als", text=text))


def placed(system: System, *, unread: bool = False) -> System:
    enclave = PlaceAtom(name="Talker", enclaves=frozenset({TALKER}), channels=None, unread=unread)
    return replace(system, places=(enclave, PlaceAtom(name="Chatter", enclaves=None, channels=frozenset({CHATTER}))))


def using(analyzer: Engine, timeout: float = ENOUGH) -> Analyzer:
    return Analyzer(java=analyzer.java, jar=analyzer.jar, timeout=timeout, memory_mb=1024)


@pytest.mark.usefixtures("resident_analyzer")
@pytest.mark.parametrize(("among", "vacuous"), [("Talker", False), ("Talker & opaque", True)])
def test_what_ranges_over_nothing_is_told(among: str, vacuous: bool, analyzer: Engine) -> None:
    asserted = f"assert Fine {{ all disj one_enclave, other: {among} + Enclave & Unmanaged | one_enclave != other }}\n"
    short = f"check Short {{\n\tall e: {among}, c: e.(may_write[TrustDomain]) {{ some e and some c }}\n}} for 0\n"
    file = read(HEAD + NAMES + asserted + "run Named { some Chatter } for 0\ncheck Fine for 0\n" + short)
    [[_named, fine, told]] = ask(file, [placed(healthy())], using(analyzer))
    assert {fine.status, told.status} == {Status.HOLDS}
    assert (fine.vacuous, told.vacuous) == (True, vacuous)  # there is one Talker, and never two


@pytest.mark.usefixtures("resident_analyzer")
def test_checks_and_runs_are_answered_and_told_in_names(analyzer: Engine) -> None:
    file = read(QUESTIONS)
    of_healthy, of_stock = ask(file, [placed(healthy()), placed(stock())], using(analyzer))
    names = [asked.name for asked in file.commands]
    held = [
        dict(zip(names, (one.status is Status.HOLDS for one in told), strict=True)) for told in (of_healthy, of_stock)
    ]
    assert held[0] == {
        "NobodyForges": True,
        "TalkerIsThere": True,
        "TalkerSpeaks": True,
        "ListenerSpeaks": True,
        "Impossible": False,
        "NobodyCanForge": False,
    }
    assert held[1]["NobodyForges"] is False
    example = of_stock[0].example
    assert example is not None
    assert "enclave: /listener" in example.text
    assert "channel: /chatter" in example.text
    assert [step.path for step in example.steps if step.enclave == "/listener"] == [
        stock().enclaves[LISTENER].location.path
    ]
    impossible = of_healthy[4].example
    assert impossible is not None
    assert impossible.text == "There is no instance of it."


def complaint(text: str, analyzer: Engine) -> str:
    with pytest.raises(UsageError) as caught:
        ask(read(text), [placed(healthy())], using(analyzer))
    return caught.value.message


@pytest.mark.usefixtures("resident_analyzer")
def test_what_alloy_refuses_is_said_where_it_is_in_the_users_file(analyzer: Engine) -> None:
    unknown = HEAD + NAMES + "check A {\n\tsome Talker.(may_writes[TrustDomain])\n} for 0\n"
    assert complaint(unknown, analyzer).startswith("asked.als:6:15: Alloy says: The name")
    missing = HEAD + "check A for 0\n"
    assert complaint(missing, analyzer).startswith("asked.als:3:1: Alloy says: The assertion")
    grammar = HEAD + "check A { some some } for 0\n"
    assert complaint(grammar, analyzer).startswith("asked.als:3:")
    unclosed = HEAD + "check A { some (TrustDomain } for 0\n"
    assert complaint(unclosed, analyzer).endswith(" possible tokens that can appear here: )"), "which, not only that"


@pytest.mark.usefixtures("resident_analyzer")
def test_a_warning_is_an_error(analyzer: Engine) -> None:
    """What is always empty is a property that holds of everything."""
    always_empty = HEAD + NAMES + "check A { no Talker & Chatter } for 0\n"
    message = complaint(always_empty, analyzer)
    assert message.startswith("asked.als:5:21: Alloy says: &")
    assert "irrelevant" in message
    unused = "check B { all e: Enclave | some TrustDomain } for 0\n"
    assert "unused" in complaint(HEAD + unused, analyzer)


@pytest.mark.usefixtures("resident_analyzer")
def test_a_contradiction_leaves_everything_undecided(analyzer: Engine) -> None:
    """The reader lets no fact in; if one came in by a way that nobody knows, everything would hold."""
    file = read(HEAD + "check A { no Enclave } for 0\n")
    smuggled = replace(file, text=file.text + "fact { no Enclave }\n")
    (told,) = ask(smuggled, [healthy()], using(analyzer))
    assert [(one.status, "contradicts" in one.reason) for one in told] == [(Status.UNKNOWN, True)]


def test_no_fact_can_take_anything_away(tmp_path: Path) -> None:
    """Facts that do not contradict say nothing new: the model's relations are constants."""
    system = placed(stock())
    run = job(read(QUESTIONS), system)
    plain = outcomes(tmp_path, dict(run.files), MAIN)
    harmless = "fact { some Enclave and Talker.identity in Certificate and no (iden & Enclave -> TrustDomain) }"
    assert outcomes(tmp_path, {**run.files, MAIN: f"{run.files[MAIN]}{harmless}\n"}, MAIN) == plain
    denied = "fact { all r: TrustDomain | no Enclave.(forges[r]) }"
    told = outcomes(tmp_path, {**run.files, MAIN: f"{run.files[MAIN]}{denied}\n"}, MAIN)
    assert told[CONSISTENT] is False


OURS = HEAD + "".join(check(prop.predicate) + "\n" for prop in PROPERTIES)


def test_our_own_properties_asked_as_users_ask_have_the_same_answers(tmp_path: Path) -> None:
    file = read(OURS)
    violated = 0
    for seed in range(0, 3000, 100):
        system = random_system(seed)
        run = job(file, system)
        found = outcomes(tmp_path, dict(run.files), run.main)
        native = NativeEngine([system]).answers[0]
        assert found.pop(CONSISTENT)
        assert found == {p.predicate: native[p.id].status is Status.VIOLATED for p in PROPERTIES}, seed
        violated += sum(found.values())
    assert violated > 50


def test_a_system_too_large_is_not_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("keystore_audit.engine.alloy.user_properties.MAX_ATOMS", 3)
    nowhere = Analyzer(java=Path("/nonexistent"), jar=Path("/nonexistent"), timeout=1, memory_mb=64)
    with pytest.raises(EngineOutOfScale, match="atoms"):
        ask(read(QUESTIONS), [healthy()], nowhere)


def test_out_of_time(analyzer: Engine) -> None:
    with pytest.raises(EngineTimeout):
        ask(read(QUESTIONS), [placed(healthy())], using(analyzer, 0.05))


# Results: unknown unless every reading says the same.

OK = EngineRun(name="alloy", version="6", status=EngineStatus.OK, reason="", required=True)


def decided(analyzer: Engine, systems: list[System], runs: list[EngineRun], timeout: float = ENOUGH) -> AlloyResult:
    file = read(HEAD + NAMES + "check Anonymous { no enclave: Enclave | no enclave.identity } for 0\n")
    engines = Engines(jar=analyzer.jar, offline=True, timeout=timeout)
    (result,) = decide_files([file], systems, ["a"], runs, engines, None)
    return result


@pytest.mark.usefixtures("resident_analyzer")
def test_both_readings_must_agree(analyzer: Engine) -> None:
    one = placed(replace(healthy(), profiles=("a",), may=False))
    nobody = replace(one.enclaves[LISTENER], identity=None)
    other = replace(one, may=True, enclaves=(one.enclaves[TALKER], nobody))
    assert decided(analyzer, [one], [OK]).status is Status.HOLDS
    assert decided(analyzer, [one, replace(one, may=True)], [OK]).status is Status.HOLDS
    differing = decided(analyzer, [one, other], [OK])
    assert (differing.status, differing.profiles["a"].engines) == (Status.UNKNOWN, {"alloy": Status.UNKNOWN})
    assert decided(analyzer, [other], [OK]).status is Status.VIOLATED


def test_names_that_are_not_known_leave_it_open(analyzer: Engine) -> None:
    result = decided(analyzer, [replace(placed(healthy(), unread=True), profiles=("a",))], [OK])
    assert (result.status, "name of one enclave is unknown" in result.reason) == (Status.UNKNOWN, True)


@pytest.mark.parametrize("status", [status for status in EngineStatus if status is not EngineStatus.OK])
def test_without_an_answer_about_our_own_properties_theirs_are_open(analyzer: Engine, status: EngineStatus) -> None:
    run = replace(OK, status=status, reason="It is ill.")
    result = decided(analyzer, [replace(placed(healthy()), profiles=("a",))], [run])
    assert (result.status, result.profiles["a"].engines) == (Status.UNKNOWN, {})
    assert result.reason == "Alloy gave no answer (It is ill)"


def test_no_time_and_no_systems_leave_it_open(analyzer: Engine) -> None:
    late = decided(analyzer, [replace(placed(healthy()), profiles=("a",))], [OK], timeout=0.05)
    assert (late.status, "0.05 seconds" in late.reason) == (Status.UNKNOWN, True)
    assert decided(analyzer, [], [OK]).status is Status.UNKNOWN
    assert decided(analyzer, [], []).status is Status.UNKNOWN


def test_complaints_about_our_own_modules_are_no_fault_of_the_users() -> None:
    file = read(QUESTIONS)
    output = Output(status=1, diagnostics="Syntax error in /x/claims.als at line 1 column 1:\nodd\n", messages="")
    assert _checked(file, output) == output
    warned = "00. check A 0 UNSAT\nWarning\n  0. line 3, column 4 (3,4), filename=/x/claims.als odd\n"
    assert _checked(file, replace(output, diagnostics=warned)).diagnostics == "00. check A 0 UNSAT\n"
