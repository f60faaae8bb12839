"""The command over many keystores: reports of each, one summary, and what becomes of those that fail or vanish."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import time
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import psutil
import pytest
from msgspec.structs import replace

from keystore_audit.findings import Severity
from keystore_audit.report.content import Verdict
from keystore_audit.report.summary import Row, Summary, render_text, without_report
from tests.cli.keystores import AT, answer, keystore, rule
from tests.schemas import schema

NATIVE = ("--engine", "native", "--at", AT)


def robots(root: Path, count: int) -> Path:
    """So many copies of one small keystore, each a robot's."""
    first = keystore(root / "r000/keys", {"/talker": (rule(("rt/chatter",)),)})
    for number in range(1, count):
        shutil.copytree(first, root / f"r{number:03}/keys", symlinks=True)
    return root


def summary(directory: Path) -> Any:
    document = json.loads((directory / "summary.json").read_text())
    schema("summary").validate(document)
    return document


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return robots(tmp_path_factory.mktemp("fleet"), 12)


def test_a_report_of_each_and_a_summary_of_all(fleet: Path, tmp_path: Path) -> None:
    code, page = answer("-r", fleet, *NATIVE, "-o", f"json={tmp_path}/out/", "-o", f"markdown={tmp_path}/out/")
    document = summary(tmp_path / "out")
    assert code == document["exit_code"] == 1
    assert [row["report"] for row in document["keystores"]] == [f"r{n:03}/keys/report.json" for n in range(12)]
    for row in document["keystores"]:
        report = json.loads((tmp_path / "out" / row["report"]).read_text())
        assert (report["keystore"]["digest"], report["verdict"]) == (row["digest"], row["verdict"])
        assert report["weakened"] == row["weakened"] == [f"--at {AT} (dates are judged as of then)"]
        assert "KA666" in {finding["code"] for finding in report["findings"]}
        assert (tmp_path / "out" / row["report"]).with_name("report.md").exists()
    assert page.splitlines()[-1] == "12 keystores: 0 incomplete, 12 fail, 0 pass; exit code 1"
    assert "and 7 more" in " ".join(page.split())  # where lines end hangs on how long the paths are
    assert f"Weakened gate: --at {AT} (dates are judged as of then)." in " ".join(page.split())


def test_the_page_says_of_how_many_keystores_the_gate_was_weakened() -> None:
    kept: dict[str, Any] = {"exit_code": 0, "verdict": Verdict.PASS, "counts": dict.fromkeys(Severity, 0)}
    rows = (
        Row(path="a", weakened=("--fail-on never", "2 findings accepted by a.toml"), **kept),
        Row(path="b", weakened=("--fail-on never",), **kept),
        without_report("c", 3, "nothing there"),
    )
    page = render_text(Summary(version="1", at=datetime.now(timezone.utc), exit_code=3, rows=rows, reports={}))
    told = [line.split(None, 1)[1] for line in page.splitlines() if line.startswith("WARNING")]
    assert told == ["Weakened gate: --fail-on never.", "Weakened gate: 2 findings accepted by a.toml (1 keystore)."]
    many = tuple(f"--ignore KA{number}" for number in range(101, 301))
    crowd = Summary(
        version="1", at=datetime.now(timezone.utc), exit_code=0, rows=(replace(rows[1], weakened=many),), reports={}
    )
    assert "and 190 more (all are in the JSON summary)" in render_text(crowd)


def test_no_older_report_stays_where_there_is_none_now(tmp_path: Path) -> None:
    root = robots(tmp_path / "fleet", 2)
    run = ("-r", root, *NATIVE, "-o", f"json={tmp_path}/out/", "-o", f"statement={tmp_path}/out/")
    answer(*run)
    older = [tmp_path / "out/r001/keys" / name for name in ("report.json", "report.statement.json")]
    assert all(path.exists() for path in older)
    shutil.rmtree(root / "r001/keys/enclaves/talker")
    assert answer(*run)[0] == 3
    assert summary(tmp_path / "out")["keystores"][1]["report"] is None
    assert not any(path.exists() for path in older)
    assert (tmp_path / "out/r000/keys/report.statement.json").exists()


def test_no_older_summary_speaks_of_a_run_that_ended_half_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robots(tmp_path / "all", 3)
    asked = (
        "-r",
        tmp_path / "all",
        *NATIVE,
        "--fail-on",
        "never",
        "-o",
        f"json={tmp_path}/out/",
        "-o",
        f"sarif={tmp_path}/all.sarif",
    )
    code, _ = answer(*asked)
    assert (code, summary(tmp_path / "out")["exit_code"]) == (0, 0)
    (own,) = (tmp_path / "out").glob("r001/**/*.json")
    own.unlink()
    own.mkdir()
    code, _ = answer(*asked)
    assert code == 2
    assert not (tmp_path / "out/summary.json").exists()
    assert f"No report was written to {tmp_path}/all.sarif." in capsys.readouterr().err


def test_a_link_in_the_place_of_a_summary_is_replaced(tmp_path: Path) -> None:
    run = ("-r", robots(tmp_path / "all", 1), *NATIVE, "-o", f"json={tmp_path}/out/")
    (tmp_path / "out").mkdir()
    (tmp_path / "shown.json").write_text("mine")
    (tmp_path / "out/summary.json").symlink_to(tmp_path / "shown.json")
    answer(*run)
    assert json.loads((tmp_path / "out/summary.json").read_text())["schema_version"] == 1
    assert not (tmp_path / "out/summary.json").is_symlink()
    assert (tmp_path / "shown.json").read_text() == "mine"


def test_a_summary_that_cannot_be_replaced_is_wrong_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out/summary.json").mkdir(parents=True)
    code, _ = answer("-r", robots(tmp_path / "all", 1), *NATIVE, "-o", f"json={tmp_path}/out/")
    assert code == 2
    assert f"Cannot write the json report to {tmp_path}/out/summary.json: " in capsys.readouterr().err


def test_reports_of_robots_that_left_are_named_and_stay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = robots(tmp_path / "fleet", 3)
    run = ("-r", root, *NATIVE, "-o", f"json={tmp_path}/out/")
    answer(*run)
    assert "not of this run" not in capsys.readouterr().err
    shutil.rmtree(root / "r001")
    answer(*run)
    stays = tmp_path / "out/r001/keys/report.json"
    assert stays.exists()
    assert f"keystore-audit: 1 report is not of this run, and stays: {stays}.\n" in capsys.readouterr().err


@pytest.mark.parametrize("form", ["text", "json", "sarif"])
def test_processes_say_what_one_says(fleet: Path, form: str) -> None:
    named = sorted(fleet.glob("*/keys"))
    assert answer(*named, *NATIVE, "-f", form, "-j", "2") == answer(*named, *NATIVE, "-f", form, "-j", "1")


def test_the_report_of_one_is_that_of_an_audit_of_its_own(fleet: Path, tmp_path: Path) -> None:
    one = tmp_path / "only" / "keys"
    shutil.copytree(fleet / "r000/keys", one)
    answer("-r", tmp_path / "only", *NATIVE, "-o", f"json={tmp_path}/out/")
    alone = answer(one, *NATIVE, "-f", "json")[1]
    assert (tmp_path / "out/keys/report.json").read_text() == alone


def test_a_broken_one_hides_no_other(fleet: Path, tmp_path: Path) -> None:
    root = tmp_path / "fleet"
    shutil.copytree(fleet, root)
    (root / "r003/keys/enclaves/talker/cert.pem").write_bytes(b"\xff" * 100)
    shutil.rmtree(root / "r004/keys/enclaves/talker")
    (root / "r005/keys/enclaves/talker/permissions.p7s").write_bytes(b"")
    code, page = answer("-r", root, *NATIVE, "-j", "2", "-o", f"json={tmp_path}/out/")
    rows = {row["path"].split("/")[-2]: row for row in summary(tmp_path / "out")["keystores"]}
    assert code == 4
    assert len(rows) == 12
    assert rows["r003"]["exit_code"] == 4
    assert (rows["r004"]["exit_code"], rows["r004"]["verdict"]) == (3, None)
    assert [name for name, row in rows.items() if row["exit_code"] == 1][-6:] == [f"r{n:03}" for n in range(6, 12)]
    assert "NO REPORT" in page
    assert "r004" in page


def test_settings_that_one_keystore_cannot_follow_name_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one, other = (keystore(tmp_path / name, {f"/{name}": (rule(("rt/x",)),)}) for name in ("talker", "lidar"))
    settings = tmp_path / "it.toml"
    settings.write_text('[[property]]\nname = "p"\nno_flow = { from = "/talker", to = "outsider" }\n')
    said = "it.toml:3: '/talker' names no enclave of this keystore."
    for stores, told in (((one, other), f"{other}: {settings.parent}/{said}"), ((other,), f"{settings.parent}/{said}")):
        assert answer(*stores, *NATIVE, "--settings", settings)[0] == 2
        assert capsys.readouterr().err.endswith(f"keystore-audit: {told}\n")


def test_each_directory_named_has_a_keystore(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What is packed, or has another name now, is out of the gate otherwise."""
    root = robots(tmp_path / "all", 1)
    (tmp_path / "packed").mkdir()
    code, page = answer("-r", root, tmp_path / "packed", *NATIVE)
    assert code == 3
    assert "NO REPORT" in page
    assert f"{tmp_path / 'packed'} is empty" in capsys.readouterr().err
    assert answer("-r", root, *NATIVE)[0] == 0


def test_what_was_not_looked_into_is_no_pass(tmp_path: Path, healthy_samples: Path) -> None:
    (tmp_path / "fleet").mkdir()
    shutil.copytree(healthy_samples / "talker_listener", tmp_path / "fleet/keys", symlinks=True)
    assert answer("-r", tmp_path / "fleet", *NATIVE)[0] == 0
    (tmp_path / "fleet/more").symlink_to(healthy_samples)
    assert answer("-r", tmp_path / "fleet", *NATIVE)[0] == 4


@pytest.fixture
def healthy_samples(repository: Path) -> Path:
    return repository / "sample_keystores/healthy"


def test_nothing_is_written_into_a_keystore(fleet: Path) -> None:
    before = sorted(path for path in fleet.rglob("*"))
    inside = str(fleet / "r000/keys/reports")
    assert answer("-r", fleet, *NATIVE, "-o", f"json={inside}/")[0] == 2
    assert answer("-r", fleet, *NATIVE, "-o", f"json={fleet}/")[0] == 2
    assert sorted(path for path in fleet.rglob("*")) == before


@pytest.mark.parametrize("name", ["report.json", "summary.json", "..", "a b", "é\n[red]"])
def test_names_of_directories_lead_nowhere_else(
    name: str, fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "here" / name).mkdir(exist_ok=True)
    monkeypatch.chdir(tmp_path / "here")
    shutil.copytree(fleet / "r000/keys", Path(name, "keys"))
    answer(f"{name}/keys", *NATIVE, "-o", "json=out/")
    written = [path.relative_to(Path.cwd() / "out") for path in Path("out").resolve().rglob("*") if path.is_file()]
    assert sorted(path.name for path in written) == ["report.json", "summary.json"]
    row = summary(Path("out"))["keystores"][0]
    assert Path("out", row["report"]).is_file()


def start(*args: str | Path, cwd: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "keystore_audit", *map(str, args)]
    return subprocess.Popen(command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)


def workers(pid: int) -> list[psutil.Process]:
    """The processes that audit: children of the one that they are forked from."""
    return [worker for child in psutil.Process(pid).children() for worker in child.children()]


def until_reports(directory: Path, count: int) -> None:
    end = time.monotonic() + 60
    while len(list(directory.rglob("report.json"))) < count:
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.fixture(scope="module")
def large_fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return robots(tmp_path_factory.mktemp("large"), 150)


def test_a_process_that_is_killed_loses_its_keystore_alone(large_fleet: Path, tmp_path: Path) -> None:
    running = start("-r", large_fleet, *NATIVE, "-j", "2", "-o", f"json={tmp_path}/out/", cwd=tmp_path)
    until_reports(tmp_path / "out", 5)
    workers(running.pid)[0].kill()
    _out, err = running.communicate(timeout=120)
    document = summary(tmp_path / "out")
    lost = [row for row in document["keystores"] if row["verdict"] is None]
    assert (running.returncode, len(lost), len(document["keystores"])) == (4, 1, 150)
    assert "ended early" in lost[0]["error"]
    assert b"ended early" in err
    assert len(list((tmp_path / "out").rglob("report.json"))) == 149


def test_an_interrupt_leaves_what_is_done(large_fleet: Path, tmp_path: Path) -> None:
    targets = ("-o", f"json={tmp_path}/out/", "-o", f"sarif={tmp_path}/all.sarif")
    running = start("-r", large_fleet, *NATIVE, "-j", "2", *targets, cwd=tmp_path)
    until_reports(tmp_path / "out", 5)
    children = workers(running.pid)
    os.killpg(running.pid, signal.SIGINT)  # as the terminal does it: everybody hears of it
    out, err = running.communicate(timeout=60)
    document = summary(tmp_path / "out")
    done = [row for row in document["keystores"] if row["verdict"] is not None]
    assert (running.returncode, document["exit_code"], document["interrupted"]) == (130, 130, True)
    assert len(done) == len(list((tmp_path / "out").rglob("report.json"))) >= 5
    assert len(done) + len(document["not_audited"]) == 150
    assert b"INTERRUPTED" in out
    assert b"Traceback" not in err
    assert not (tmp_path / "all.sarif").exists()
    psutil.wait_procs(children, timeout=10)
    assert not [child for child in children if child.is_running()]


def test_a_terminal_sees_how_far_it_is_and_others_do_not(fleet: Path, tmp_path: Path) -> None:
    words = ("-r", fleet, *NATIVE, "-j", "2", "-o", f"json={tmp_path}/out/")
    master, terminal = pty.openpty()
    command = [sys.executable, "-m", "keystore_audit", *map(str, words)]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120"}
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=terminal, env=environment)
    os.close(terminal)
    shown = b""
    with contextlib.suppress(OSError):  # how a terminal says that its last writer has gone
        while piece := os.read(master, 65536):
            shown += piece
    os.close(master)
    out, _err = running.communicate(timeout=60)
    assert running.returncode == 1
    assert b"reading identities" in shown
    assert b"auditing" in shown
    assert b"12/12" in shown
    assert re.search(rb"12 keystores in [0-9.]+ s, [0-9.]+ a second\.\r\n$", shown)
    assert b"\x1b" not in out
    silent = subprocess.run([*command, "-o", f"json={tmp_path}/again/"], capture_output=True)
    assert (silent.stdout, silent.stderr) == (out, b"")
