"""`--alloy-property`: users' properties in Alloy gate the audit, and what Alloy did not decide is no pass."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from keystore_audit.engine.alloy.process import Jvm
from tests.cli.keystores import AT, answer
from tests.schemas import schema

SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"
BAD = "rules/KA741-asserted-alloy-property-violated/bad"
GOOD = "rules/KA741-asserted-alloy-property-violated/good"
ASKED = "alloy_properties/chatter.als"


Audit = Callable[..., tuple[int, str]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, resident_analyzer: None) -> Audit:  # noqa: ARG001
    """An audit with a file of properties: its exit code and its report."""
    monkeypatch.chdir(SAMPLES)
    monkeypatch.delenv("CI", raising=False)

    def audit(keystore: str, *arguments: str, file: str | Path = ASKED) -> tuple[int, str]:
        return answer(keystore, "--alloy-property", file, "--at", AT, *arguments)

    return audit


Reported = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def report(run: Audit) -> Reported:
    """The same, as JSON."""

    def audit(keystore: str, *arguments: str) -> tuple[int, dict[str, Any]]:
        code, text = run(keystore, "-f", "json", *arguments)
        found = json.loads(text)
        schema("report").validate(found)
        return code, found

    return audit


def asserted(found: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {each["id"]: each for each in found["properties"] if each["id"].startswith("chatter-")}


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_what_holds_passes_and_the_text_says_who_decided(run: Audit) -> None:
    code, text = run(GOOD, "-v")
    assert code == 0
    lines = [line for line in text.splitlines() if "chatter-only-the-talker-speaks" in line]
    assert {line.split()[0] for line in lines} == {"holds"}
    assert all("alloy" in line and "native" not in line for line in lines)


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_words_of_users_have_a_jvm_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(SAMPLES)
    monkeypatch.delenv("CI", raising=False)
    asked: list[tuple[Jvm, str]] = []
    ask = Jvm.ask
    monkeypatch.setattr(Jvm, "ask", lambda jvm, *words: asked.append((jvm, words[1])) or ask(jvm, *words))
    assert answer(GOOD, "--alloy-property", ASKED, "--at", AT, "--profile", "spec")[0] == 0
    assert len({jvm for jvm, _main in asked}) == len(set(asked)) == 2


def test_without_alloy_it_is_open(report: Reported) -> None:
    code, found = report(GOOD, "--engine", "native")
    assert (code, found["verdict"]) == (4, "incomplete")
    assert {each["status"] for each in asserted(found).values()} == {"unknown"}
    told = [each["message"] for each in found["findings"] if each["code"] == "KA906"]
    assert len(told) == 2
    assert all("--engine native" in message for message in told)
    assert all(message.count("Alloy alone decides this") == 1 for message in told)
    remedies = {each["fix"]["steps"][0]["text"] for each in found["findings"] if each["code"] == "KA906"}
    (advice,) = remedies
    assert "`--engine both`" in advice  # nothing is unread here


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("module m\nopen keystore_audit\ncheck A { some Enclav } for 0\n", "m.als:3:16: Alloy says: The name"),
        ("module m\nopen keystore_audit\ncheck A { some Enclave } for 3\n", "m.als:3: expected `check NAME for 0`"),
        ("module m\nopen keystore_audit\n//@ enclave X = /nobody\nrun A { some X } for 0\n", "m.als:3: '/nobody'"),
        ("module m\nopen keystore_audit\n//@ topic X = /not_there\nrun A { some X } for 0\n", "m.als:3: no permiss"),
        ("module m\nopen keystore_audit\nfact { no Enclave }\n", "m.als:3: 'fact'"),
    ],
)
def test_a_mistake_in_the_file_is_a_usage_error_with_its_place(
    text: str, said: str, run: Audit, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.als").write_text(text)
    assert run(GOOD, file=tmp_path / "m.als") == (2, "")
    complaint = capsys.readouterr().err
    assert said in complaint
    assert str(tmp_path) in complaint


def test_a_file_in_the_keystore_is_refused(run: Audit, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Whoever makes the keystore would say what is asked of it."""
    keystore = tmp_path / "keystore"
    keystore.mkdir()
    (keystore / "mine.als").write_text("module m\nopen keystore_audit\nrun A {} for 0\n")
    assert run(str(keystore), file=keystore / "mine.als")[0] == 2
    assert "lies in the keystore" in capsys.readouterr().err
    os.link(keystore / "mine.als", tmp_path / "outside.als")
    assert run(str(keystore), file=tmp_path / "outside.als")[0] == 2
    assert "would judge itself" in capsys.readouterr().err


def model(directory: Path, *files: Path | str) -> int:
    named = [word for file in files for word in ("--alloy-property", file)]
    return answer("model", SAMPLES / BAD, "-o", directory, "--profile", "spec", *named)[0]


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_the_model_for_the_window_has_the_file_and_its_names(tmp_path: Path) -> None:
    from tests.engine.alloy_batch import outcomes

    assert model(tmp_path / "m", SAMPLES / ASKED) == 0
    found = outcomes(tmp_path / "m", {}, "chatter_asked.als")
    assert found.pop("KeystoreAuditIsConsistent")
    assert found == {"OnlyTheTalkerSpeaks": True, "SomebodyListens": True}


def test_names_that_two_files_give_cannot_stand_in_one_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(SAMPLES)
    (tmp_path / "other.als").write_text(
        "module o\nopen keystore_audit\n//@ enclave Talker = /talker\nrun Some { some Talker } for 0\n"
    )
    assert model(tmp_path / "m", ASKED, tmp_path / "other.als") == 2
    complaint = capsys.readouterr().err
    assert "other.als:3: 'Talker' has a meaning at alloy_properties/chatter.als:5 already" in complaint
    assert not (tmp_path / "m").exists()


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
@pytest.mark.parametrize(
    ("sample", "why"),
    [
        ("flows/chatter_linked_away_enclave", "the name of one enclave is unknown"),
        ("flows/chatter_unreadable_enclave", "it depends on what is in enclaves/listener/permissions.p7s"),
    ],
)
def test_what_could_not_be_read_leaves_it_open(sample: str, why: str, report: Reported) -> None:
    code, found = report(sample)
    assert code == 4
    assert {each["status"] for each in asserted(found).values()} == {"unknown"}
    told = [
        each["message"] for each in found["findings"] if each["code"] == "KA906" and "Alloy alone" in each["message"]
    ]
    assert len(told) == 2
    assert all(why in message for message in told)
    advice = {each["fix"]["steps"][0]["text"] for each in found["findings"] if each["code"] == "KA906"}
    assert all("what the other findings call unread" in each for each in advice)


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_what_holds_of_nothing_is_told_in_every_format_and_never_attested(run: Audit, tmp_path: Path) -> None:
    """A check that ranges over nothing holds, and says nothing of the keystore."""
    for among, vacuous in (("Talker", False), ("Talker & opaque", True)):
        file = tmp_path / f"{vacuous}.als"
        short = f"check Short {{ all one_enclave: {among} | some one_enclave.(may_write[TrustDomain]) }} for 0"
        file.write_text(f"module short\nopen keystore_audit\n//@ enclave Talker = /talker\n{short}\n")
        kinds = {kind: run(GOOD, "-f", kind, file=file)[1] for kind in ("json", "sarif", "text", "markdown", "html")}
        told = [each for each in json.loads(kinds["json"])["properties"] if each["id"].endswith("-short")]
        assert [("vacuous" in each, each["status"]) for each in told] == [(vacuous, "holds")]
        [sarif] = json.loads(kinds["sarif"])["runs"]
        assert sarif["properties"]["vacuous"] == ([told[0]["id"]] if vacuous else [])
        assert {"vacuous" in kinds[kind] for kind in ("markdown", "html")} == {vacuous}
        assert ("with a reservation" in kinds["text"]) is vacuous
        passed = json.loads(run(GOOD, "-f", "statement", file=file)[1])["predicate"]["passedTests"]
        conditional = f"{told[0]['id']}-if-nothing-else-certified-and-truthful-announcements"
        assert (conditional in passed) is not vacuous


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
@pytest.mark.parametrize(("keystore", "who"), [("healthy", {"alloy", "native"}), ("expiring_grant", {"native"})])
def test_what_is_kept_over_several_instants_is_said_by_the_native_engine_alone(
    keystore: str,
    who: set[str],
    run: Audit,  # noqa: ARG001 - where samples are
) -> None:
    """Alloy decides each instant, and not what somebody keeps from one to the next."""
    given = ("--settings", "settings/vehicle.toml", "--profile", "cyclonedds-11", "--engine", "both", "-f", "json")
    _code, told = answer(f"flows/vehicle_{keystore}", *given, "--at", AT)
    found = {each["id"]: each for each in json.loads(told)["properties"]}["infotainment-never-reaches-motor"]
    assert found["status"] == "holds"
    assert [set(each["engines"]) for each in found["profiles"].values()] == [who]
