"""Accepted findings as a user has them: which files are refused, and that no report hides what they accept."""

from __future__ import annotations

import hashlib
import html
import json
import os
from pathlib import Path
from typing import Any

import pytest
from junitparser import JUnitXml
from msgspec.structs import replace

from keystore_audit.formats import FORMATS
from keystore_audit.text import markdown
from tests.cli.keystores import answer
from tests.settings.files import file
from tests.test_samples import SAMPLES, as_built
from tools.samples.base import TWO
from tools.samples.documents import DomainRule, Governance, TopicRule
from tools.samples.made_at_test_time import RECIPES
from tools.samples.store import write

AT = "2026-11-21T12:00:00Z"
PRINT = "a" * 64
WHY = 'reason = "so"\nowner = "Ada"\nuntil = 2026-12-04\n'
PLACED = f'[[suppression]]\ncode = "KA205"\nwhere = "/talker"\n{WHY}'
ENTRY = f'[[accepted]]\ncode = "KA205"\nfingerprint = "{PRINT}"\nmeaning = "{PRINT}"\nseverity = "low"\n{WHY}'
TALKER = "rules/KA909-suppression-expired/bad"
"""Its findings: KA205 and KA636 (medium) and KA513 (low) of the talker."""


@pytest.fixture
def talker(tmp_path: Path) -> Path:
    keystore, _expected = as_built(SAMPLES / f"{TALKER}.toml", tmp_path / "keys")
    return keystore


def run(keystore: Path, *options: str | Path, kind: str = "json") -> tuple[int, Any]:
    code, text = answer("audit", keystore, "--engine", "native", "--at", AT, "-f", kind, *options)
    return code, json.loads(text) if kind == "json" else text


def fate(keystore: Path, *options: str | Path) -> dict[str, bool]:
    """Which rules found something, and whether all of it is accepted."""
    _code, report = run(keystore, *options)
    found: dict[str, bool] = {}
    for finding in report["findings"]:
        found[finding["code"]] = found.get(finding["code"], True) and finding["suppressed"] is not None
    return found


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PLACED.replace("2026-12-04", "2027-05-21"), ":6: 2027-05-21 is too far away: expected 2027-05-20 or"),
        (PLACED.replace("KA205", "KA250"), "KA250 is no rule's code. Did you mean KA"),
        (PLACED.replace("owner", "onwer"), "unknown key 'onwer'"),
    ],
)
def test_exit_2_with_the_place_and_no_report(
    tmp_path: Path, talker: Path, text: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = file(tmp_path, text)
    assert answer("audit", talker, "--at", AT, "--settings", path) == (2, "")
    said = capsys.readouterr().err
    assert f"keystore-audit: {path}:" in said
    assert words in said


def test_a_later_end_where_settings_say_so_weakens(tmp_path: Path, talker: Path) -> None:
    path = file(tmp_path, f"max_suppression_days = 200\n{PLACED.replace('2026-12-04', '2027-06-09')}")
    _code, report = run(talker, "--settings", path)
    assert f"max_suppression_days = 200 in {path}" in report["weakened"]
    assert f"1 finding accepted by {path}" in report["weakened"]
    baseline = file(tmp_path, ENTRY.replace("2026-12-04", "2027-06-09"), "b.toml")
    assert run(talker, "--settings", path, "--baseline", baseline)[0] == 0
    assert answer("audit", talker, "--at", AT, "--baseline", baseline) == (2, "")


def test_a_worse_one_is_not_accepted_where_nobody_says_how_bad_it_may_be(tmp_path: Path) -> None:
    """KA109, a note, is critical once the tree goes on a robot: who accepted the note did not accept that."""
    keystore, _expected = as_built(SAMPLES / "rules/KA109-ca-private-key-in-tree/bad.toml", tmp_path / "ca")
    anything = PLACED.replace("KA205", "KA109").replace("/talker", "*")
    note = file(tmp_path, anything)
    assert fate(keystore, "--settings", note)["KA109"] is True
    deployed = fate(keystore, "--settings", note, "--deployed")
    assert (deployed["KA109"], deployed["KA910"]) == (False, False)
    worse = file(tmp_path, f'{anything}severity = "critical"\n')
    assert fate(keystore, "--settings", worse, "--deployed")["KA109"] is True


def test_other_profiles_are_not_accepted(tmp_path: Path, talker: Path) -> None:
    path = file(tmp_path, f'{PLACED}profiles = ["spec"]\n')
    assert fate(talker, "--settings", path)["KA205"] is False
    assert fate(talker, "--settings", path, "--profile", "spec")["KA205"] is True


def replayed(topic: str, keystore: Path) -> Path:
    """Samples on the topic can be sent again by anybody: KA714, which KA407 and KA411 (medium) explain."""
    topics = (TopicRule(expression=topic, metadata="NONE"), TopicRule())
    governance = Governance(rules=(DomainRule(rtps="NONE", topics=topics),))
    write(replace(TWO, governance=governance).tree(), keystore)
    return keystore


@pytest.mark.parametrize("same", [False, True])
def test_a_property_is_accepted_with_what_it_is_about(tmp_path: Path, same: bool) -> None:
    before, after = replayed("rt/chatter", tmp_path / "before"), replayed("ros_discovery_info", tmp_path / "after")
    (found,) = (each for each in run(before)[1]["findings"] if each["code"] == "KA714")
    meaning = found["meaning"] if same else PRINT
    text = f'[[suppression]]\ncode = "KA714"\nfingerprint = "{found["fingerprint"]}"\nmeaning = "{meaning}"\n{WHY}'
    path = file(tmp_path, text)
    assert run(before, "--settings", path)[0] == (0 if same else 1)
    assert run(after, "--settings", path)[0] == 1


def test_one_settings_file_in_the_working_directory_but_not_in_ci_nor_with_deployed(
    tmp_path: Path, talker: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "cwd"
    folder.mkdir()
    file(folder, PLACED)
    monkeypatch.chdir(folder)
    monkeypatch.delenv("CI", raising=False)
    assert fate(talker)["KA205"] is True
    assert fate(talker, "--deployed")["KA205"] is False
    monkeypatch.setenv("CI", "true")
    assert fate(talker)["KA205"] is False


@pytest.mark.parametrize("kind", ["statement", "svr"])
def test_no_statement_is_made_with_settings_that_merely_lay_there(
    tmp_path: Path, talker: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "cwd"
    folder.mkdir()
    path = file(folder, PLACED)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    monkeypatch.chdir(folder)
    monkeypatch.delenv("CI", raising=False)
    _code, text = answer("audit", talker, "--engine", "native", "-f", kind)
    assert digest not in text
    said = "./keystore-audit.toml was not used, since a statement is written; name it with --settings"
    assert text.count("keystore-audit.toml") == text.count(said) == 1
    assert fate(talker, "-o", f"{kind}={tmp_path / 'out'}")["KA205"] is False
    assert fate(talker, "-o", f"junit={tmp_path / 'out'}")["KA205"] is True
    _code, text = answer("audit", talker, "--engine", "native", "-f", kind, "--settings", path.name)
    assert digest in text
    assert said not in text


@pytest.mark.parametrize("inside", [".", "enclaves"])
def test_a_keystore_that_is_the_working_directory_brings_no_settings(
    tmp_path: Path, inside: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Refused, not left aside: who put it there may believe that it counts."""
    RECIPES["KA230"][1](tmp_path / "keys")  # with keys of its own: those of samples are no good on a robot
    file(tmp_path / "keys" / inside, PLACED)
    monkeypatch.chdir(tmp_path / "keys" / inside)
    monkeypatch.delenv("CI", raising=False)
    keystore = Path("." if inside == "." else "..")
    assert answer("audit", keystore, "--at", AT, "--engine", "native")[0] == 2
    assert "would judge itself" in capsys.readouterr().err
    assert answer("audit", keystore, "--at", AT, "--engine", "native", "--deployed", "--ignore", "KA121")[0] == 0


class TestInsideTheKeystore:
    """A keystore that absolves itself: refused by its path, over links, and as the same file of another name."""

    @pytest.fixture(params=["--settings", "--baseline"])
    def option(self, request: pytest.FixtureRequest) -> str:
        return str(request.param)

    def text(self, option: str) -> str:
        return PLACED if option == "--settings" else ENTRY

    def refused(self, keystore: Path, option: str, path: Path, capsys: pytest.CaptureFixture[str]) -> bool:
        code, out = answer("audit", keystore, "--at", AT, option, path)
        assert (code, out) == (2, "")
        return "judge itself" in capsys.readouterr().err

    def test_named(self, talker: Path, option: str, capsys: pytest.CaptureFixture[str]) -> None:
        inside = file(talker / "enclaves", self.text(option), "x.toml")
        assert self.refused(talker, option, inside, capsys)
        assert self.refused(talker, option, talker / "public" / ".." / "enclaves" / "x.toml", capsys)

    def test_over_links(self, talker: Path, tmp_path: Path, option: str, capsys: pytest.CaptureFixture[str]) -> None:
        inside = file(talker, self.text(option), "x.toml")
        (tmp_path / "link.toml").symlink_to(inside)
        (tmp_path / "folder").symlink_to(talker)
        (tmp_path / "alias").symlink_to(talker)
        assert self.refused(talker, option, tmp_path / "link.toml", capsys)
        assert self.refused(talker, option, tmp_path / "folder" / "x.toml", capsys)
        assert self.refused(tmp_path / "alias", option, inside, capsys)

    def test_hard_links(self, talker: Path, tmp_path: Path, option: str, capsys: pytest.CaptureFixture[str]) -> None:
        inside = file(talker / "enclaves" / "talker", self.text(option), "x.toml")
        outside = tmp_path / "outside.toml"
        os.link(inside, outside)
        assert self.refused(talker, option, outside, capsys)
        assert self.refused(tmp_path / "keys", option, outside, capsys)
        elsewhere = tmp_path / "elsewhere.toml"
        inside.unlink()
        os.link(outside, elsewhere)  # two names, none of them in the keystore
        assert answer("audit", talker, "--at", AT, "--engine", "native", option, elsewhere)[0] == 0


# Every format


def written(keystore: Path, folder: Path, *options: str | Path) -> dict[str, str]:
    """The reports of one audit in every format."""
    folder.mkdir()
    outputs = [word for kind in FORMATS for word in ("-o", f"{kind}={folder / kind}")]
    answer("audit", keystore, "--engine", "native", "-q", *outputs, *options)
    return {kind: (folder / kind).read_text() for kind in FORMATS}


WEAKENING: dict[str, tuple[str, ...]] = {
    "--fail-on critical": ("--fail-on", "critical"),
    "--fail-on never": ("--fail-on", "never"),
    "--ignore KA203": ("--ignore", "KA203"),
    "--select KA2": ("--select", "KA2"),
    "--at 2026-11-21T12:00:00Z": ("--at", AT),
    "--expires-within 5": ("--expires-within", "5"),
    "max_suppression_days = 181 in ": ("--settings", "long.toml"),
    "1 finding accepted by ": ("--settings", "placed.toml", "--at", AT),
    "1 finding accepted by b": ("--baseline", "b.toml", "--at", AT),
}


def says(kind: str, text: str, reason: str) -> bool:
    """Whether a report says that its gate is weakened in this way, as its readers read it."""
    document = json.loads(text) if kind in ("json", "sarif", "statement", "svr") else None
    if kind == "json":
        return any(reason in each for each in document["weakened"])
    if kind == "sarif":
        (run,) = document["runs"]
        notes = [each["message"]["text"] for each in run["invocations"][0]["toolExecutionNotifications"]]
        return any(reason in each for each in run["properties"]["weakened"]) and any(reason in each for each in notes)
    if kind == "statement":
        return any(reason in each for each in document["predicate"]["keystoreAudit"]["weakened"])
    if kind == "svr":
        return any(reason in each for each in document["predicate"]["verifier"]["keystoreAudit"]["weakened"])
    if kind == "junit":
        values = [each.value for suite in JUnitXml.fromstring(text.encode()) for each in suite.properties()]
        return any(reason in value for value in values)
    flat = " ".join(text.split())
    return any(shown in flat for shown in (reason, markdown(reason), html.escape(reason)))


@pytest.mark.parametrize("reason", WEAKENING)
def test_each_weakening_is_said_in_every_format_and_no_statement_passes(
    reason: str, talker: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file(tmp_path, "max_suppression_days = 181\n", "long.toml")
    file(tmp_path, PLACED, "placed.toml")
    _code, report = run(talker)
    found = next(each for each in report["findings"] if each["code"] == "KA205")
    entry = ENTRY.replace(PRINT, found["fingerprint"], 1).replace(PRINT, found["meaning"])
    file(tmp_path, entry.replace("low", "medium"), "b.toml")
    texts = written(talker, tmp_path / "out", *WEAKENING[reason])
    assert [kind for kind, text in texts.items() if not says(kind, text, reason)] == []
    assert json.loads(texts["statement"])["predicate"]["result"] == "WARNED"
    assert json.loads(texts["svr"])["predicate"]["properties"] == []


def test_settings_that_were_passed_over_are_said_in_every_format(
    talker: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    said = "./keystore-audit.toml was not used, since "
    quiet = written(talker, tmp_path / "before")
    assert [kind for kind, text in quiet.items() if says(kind, text, said)] == []
    file(tmp_path, "")
    texts = written(talker, tmp_path / "out")
    assert [kind for kind, text in texts.items() if not says(kind, text, said)] == []
    assert json.loads(texts["statement"])["predicate"]["result"] == "WARNED"
    monkeypatch.setenv("CI", "true")
    head = run(talker, kind="text")[1].split("MEDIUM")[0]
    assert f"WARNING Weakened gate: {said}the variable CI is set;" in " ".join(head.split())


def test_a_gate_at_full_strength_says_nothing_of_the_kind(tmp_path: Path) -> None:
    keystore, _expected = as_built(SAMPLES / "healthy/turtlesim.toml", tmp_path / "keys")
    path = file(tmp_path, "")
    texts = written(keystore, tmp_path / "out", "--settings", path, "--expires-within", "40", "--fail-on", "info")
    assert json.loads(texts["json"])["weakened"] == []
    assert "eakened" not in texts["text"] + texts["markdown"]


def test_accepted_findings_are_seen_and_counted_in_every_format(talker: Path, tmp_path: Path) -> None:
    path = file(tmp_path, PLACED.replace('"so"', '"New <identity> in December"'))
    texts = written(talker, tmp_path / "out", "--settings", path, "--at", AT)
    (finding,) = (each for each in json.loads(texts["json"])["findings"] if each["suppressed"])
    assert finding["suppressed"] == {
        "reason": "New <identity> in December", "until": "2026-12-04", "owner": "Ada", "source": f"{path}:1",
    }  # fmt: skip
    assert json.loads(texts["json"])["summary"]["medium"] == 1  # KA636
    (result,) = (each for each in json.loads(texts["sarif"])["runs"][0]["results"] if each.get("suppressions"))
    assert result["ruleId"] == "KA205"
    assert "New <identity> in December (until 2026-12-04, Ada" in result["suppressions"][0]["justification"]
    suites = JUnitXml.fromstring(texts["junit"].encode())
    skipped = [str(one.message) for suite in suites for case in suite for one in case.result]
    assert "accepted until 2026-12-04: New <identity> in December" in skipped
    counted = [each.value for suite in suites for each in suite.properties() if each.name == "accepted findings"]
    assert counted == ["1"]
    assert "1 accepted" in texts["markdown"].split("\n")[2]
    assert markdown("New <identity> in December") in texts["markdown"]
    assert "KA205" in texts["markdown"]
    _code, text = run(talker, "--settings", path, kind="text")
    flat = " ".join(text.split())
    assert "Accepted 1 finding, not counted (-v)" in flat
    assert "1 accepted); exit code 0" in flat
    _code, text = run(talker, "--settings", path, "-v", kind="text")
    assert "accepted until 2026-12-04 by Ada" in " ".join(text.split())


def test_what_is_accepted_decides_nothing_and_counts_again_when_it_ends(talker: Path, tmp_path: Path) -> None:
    path = file(tmp_path, PLACED + PLACED.replace("KA205", "KA636"))
    assert run(talker, "--fail-on", "medium")[0] == 1
    code, report = run(talker, "--fail-on", "medium", "--settings", path)
    assert code == 0
    assert report["safe_until"] == "2026-12-05T00:00:00Z"
    late = ("--at", "2026-12-05T00:00:00Z", "--fail-on", "medium", "--settings", path)
    code, text = answer("audit", talker, "--engine", "native", "-f", "json", *late)
    found = {each["code"]: each["suppressed"] for each in json.loads(text)["findings"]}
    assert (code, found.get("KA909", "absent")) == (1, None)


def test_nothing_accepts_an_undecided_audit(tmp_path: Path) -> None:
    keystore, expected = as_built(SAMPLES / "unknown/unreadable_enclave.toml", tmp_path / "keys")
    _code, report = run(keystore)
    codes = sorted({each["code"] for each in report["findings"] if not each["code"].startswith("KA9")})
    path = file(tmp_path, "".join(
        PLACED.replace("KA205", code).replace("/talker", "*") + 'severity = "critical"\n' for code in codes
    ))  # fmt: skip
    code, after = run(keystore, "--settings", path, "--fail-on", "never")
    assert (code, after["verdict"], expected["exit_code"]) == (4, "incomplete", 4)
    open_rules = {each["rule"] for each in after["outcomes"] if each["outcome"] == "open"}
    assert open_rules
    assert not [each for each in after["findings"] if each["suppressed"] and each["code"].startswith("KA9")]


def test_what_is_asserted_under_the_same_name_is_another_thing_once_it_means_another(tmp_path: Path) -> None:
    """Accepted by fingerprint and meaning; then the assertion is changed, and keeps its name."""
    keystore, _expected = as_built(SAMPLES / "flows/vehicle_plain_grant.toml", tmp_path / "keys")

    def violated(text: str) -> dict[str, Any]:
        path = file(tmp_path, f'[[property]]\nname = "mine"\n{text}\n')
        (finding,) = (each for each in run(keystore, "--settings", path)[1]["findings"] if each["code"] == "KA740")
        return dict(finding)

    first = violated('no_flow = { from = "/infotainment", to = "/motor" }')
    reworded = violated('description = "Said otherwise."\nno_flow = { to = "/motor", from = ["/infotainment"] }')
    wider = violated('no_flow = { from = "/infotainment", to = "/motor", include_ambient = true }')
    assert (first["fingerprint"], first["meaning"]) == (reworded["fingerprint"], reworded["meaning"])
    assert first["message"] != reworded["message"]
    assert first["meaning"] != wider["meaning"]
