"""Real audits: exit codes, streams, files, progress, and what no output ever holds."""

from __future__ import annotations

import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from keystore_audit.cli.program import run as run_here
from tests.schemas import schema

AT = ("--at", "2026-11-21T12:00:00Z", "--engine", "native")


class TestExitCodes:
    def test_0_nothing_at_or_above_the_gate(self, process: Any, healthy: Path) -> None:
        done = process(healthy, *AT)
        assert (done.returncode, done.stderr) == (0, b"")
        assert b"\nPASS  " in done.stdout

    def test_the_default_command_is_audit(self, keystore_audit: Any, healthy: Path) -> None:
        assert keystore_audit("audit", *AT, healthy).stdout == keystore_audit(*AT, healthy).stdout

    def test_1_findings(self, process: Any, stock: Path) -> None:
        done = process(stock, *AT)
        assert (done.returncode, done.stderr) == (1, b"")
        assert b"\nFAIL  " in done.stdout

    def test_1_becomes_0_where_nothing_fails_the_gate_and_says_so(self, keystore_audit: Any, stock: Path) -> None:
        done = keystore_audit(stock, *AT, "--fail-on", "never", "-f", "json")
        assert done.returncode == 0
        assert "--fail-on never" in json.loads(done.stdout)["weakened"]

    @pytest.mark.parametrize("form", ["text", "json"])
    @pytest.mark.parametrize(
        ("make", "words"),
        [
            (lambda _path: None, b"no-keystore"),
            (lambda path: path.touch(), b"directory"),
            (lambda path: path.mkdir(), b"no-keystore"),
        ],
        ids=["missing", "a file", "empty"],
    )
    def test_3_nothing_to_audit(self, keystore_audit: Any, tmp_path: Path, make: Any, words: bytes, form: str) -> None:
        make(tmp_path / "no-keystore")
        report = tmp_path / "report"
        done = keystore_audit(tmp_path / "no-keystore", *AT, "-f", form, "-o", f"json={report}")
        assert (done.returncode, done.stdout) == (3, b"")
        assert words in done.stderr
        assert b"No report was written to" in done.stderr
        assert not report.exists()

    @pytest.mark.parametrize("fail_on", ["high", "never"])
    def test_4_something_undecided_whatever_the_gate(
        self, keystore_audit: Any, healthy: Path, tmp_path: Path, fail_on: str
    ) -> None:
        broken = shutil.copytree(healthy, tmp_path / "broken", symlinks=True)
        certificate = next((broken / "enclaves").rglob("cert.pem"))
        certificate.write_bytes(b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n")
        done = keystore_audit(broken, *AT, "--fail-on", fail_on, "-f", "json")
        report = json.loads(done.stdout)
        assert (done.returncode, report["exit_code"], report["verdict"]) == (4, 4, "incomplete")
        assert "KA201" in {finding["code"] for finding in report["findings"]}
        quiet = keystore_audit(broken, *AT, "--fail-on", fail_on, "-q")
        assert quiet.returncode == 4
        assert b"KA201" in quiet.stdout
        assert b"this is no pass" in quiet.stdout

    def test_4_for_a_fault_of_our_own_without_its_words(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], healthy: Path
    ) -> None:
        import keystore_audit.pipeline

        def fault(*_args: object, **_more: object) -> None:
            raise RuntimeError("-----BEGIN PRIVATE KEY-----")

        monkeypatch.setattr(keystore_audit.pipeline, "audit", fault)
        for verbose in ([], ["-v"]):
            assert run_here([str(healthy), *verbose]) == 4
            out, err = capsys.readouterr()
            assert (out, "PRIVATE KEY" in err, "Traceback" in err) == ("", False, False)
            assert "A fault in keystore-audit itself stopped it" in err
            assert ("(RuntimeError at test_run.py:" in err) is bool(verbose)

    @pytest.mark.parametrize(("module", "installed"), [("lxml", False), ("keystore_audit.gone", True)])
    def test_4_for_a_module_that_is_not_installed(
        self,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
        healthy: Path,
        module: str,
        installed: bool,
    ) -> None:
        """As from a clone without its environment; a module of our own that is missing is our fault."""
        import keystore_audit.pipeline

        def missing(*_args: object, **_more: object) -> None:
            raise ModuleNotFoundError("No module", name=module)

        monkeypatch.setattr(keystore_audit.pipeline, "audit", missing)
        assert run_here([str(healthy)]) == 4
        _out, err = capsys.readouterr()
        assert ("The Python module lxml is not installed for " in err) is not installed
        assert ("A fault in keystore-audit itself" in err) is installed

    def test_130_interrupted(self, environment: dict[str, str], healthy: Path, tmp_path: Path) -> None:
        os.mkfifo(tmp_path / "fifo")  # writing to it waits for a reader
        command = [sys.executable, "-m", "keystore_audit", healthy, *AT, "-o", f"json={tmp_path}/fifo"]
        with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdout is not None
            for line in process.stdout:
                if line.startswith(b"PASS"):  # the verdict line, which wraps where the path is long
                    break
            time.sleep(0.2)
            process.send_signal(signal.SIGINT)
            _out, err = process.communicate(timeout=30)
        assert process.returncode == 130
        assert err.strip() == b"keystore-audit: Interrupted: there is no verdict."


class TestSeveralKeystores:
    def test_the_worst_code_counts_and_none_hides_another(
        self, keystore_audit: Any, healthy: Path, stock: Path, tmp_path: Path
    ) -> None:
        done = keystore_audit(stock, tmp_path / "nowhere", healthy, *AT, "-f", "json")
        assert done.returncode == 3
        document = json.loads(done.stdout)
        schema("report").validate(document)
        assert [report["exit_code"] for report in document["reports"]] == [1, 0]
        assert b"nowhere" in done.stderr

    def test_pass_and_fail_is_fail(self, keystore_audit: Any, healthy: Path, stock: Path) -> None:
        done = keystore_audit(healthy, stock, *AT)
        assert done.returncode == 1
        assert done.stdout.endswith(b"\n2 keystores: 1 pass, 1 fail, 0 incomplete\n")

    def test_two_roots_are_the_long_form_even_if_one_has_no_report(
        self, keystore_audit: Any, healthy: Path, tmp_path: Path
    ) -> None:
        document = json.loads(keystore_audit(healthy, tmp_path, *AT, "-f", "json").stdout)
        schema("report").validate(document)
        assert len(document["reports"]) == 1


class TestStreams:
    def test_files_hold_what_stdout_would(self, keystore_audit: Any, stock: Path, tmp_path: Path) -> None:
        targets = ("-o", f"json={tmp_path}/r.json", "-o", f"text={tmp_path}/r.txt")
        out = keystore_audit(stock, *AT, *targets, "--color", "always").stdout
        assert b"\x1b[" in out
        assert (tmp_path / "r.json").read_bytes() == keystore_audit(stock, *AT, "-f", "json").stdout
        assert (tmp_path / "r.txt").read_bytes() == keystore_audit(stock, *AT).stdout

    def test_durations_go_to_stderr(self, keystore_audit: Any, stock: Path) -> None:
        done = keystore_audit(stock, *AT, "-v", "-f", "json")
        assert done.stdout == keystore_audit(stock, *AT, "-f", "json").stdout
        assert re.match(rb" +\d+\.\d{3} s  reading and verifying\n", done.stderr)

    def test_an_ascii_terminal_is_no_obstacle(self, process: Any, healthy: Path, tmp_path: Path) -> None:
        named = tmp_path / "schlüssel"
        shutil.copytree(healthy, named, symlinks=True)
        done = process(named, *AT, env={"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"})
        assert done.returncode == 0
        assert rb"schl\xfcssel" in done.stdout

    def test_a_reader_that_leaves_is_no_error(self, environment: dict[str, str], stock: Path) -> None:
        read, write = os.pipe()
        os.close(read)
        command = [sys.executable, "-m", "keystore_audit", stock, *AT]
        done = subprocess.run(command, env=environment, stdout=write, stderr=subprocess.PIPE, check=False)
        os.close(write)
        assert (done.returncode, done.stderr) == (1, b"")

    def test_a_full_disk_is_said(self, environment: dict[str, str], stock: Path) -> None:
        command = [sys.executable, "-m", "keystore_audit", stock, *AT]
        with open("/dev/full", "wb") as full:
            done = subprocess.run(command, env=environment, stdout=full, stderr=subprocess.PIPE, check=False)
        assert done.returncode == 2
        assert done.stderr == b"keystore-audit: Cannot write the report to standard output: No space left on device.\n"

    @pytest.mark.parametrize("stderr", ["2>/dev/full", "2>&-"])
    @pytest.mark.parametrize(("args", "code"), [("-v", 0), ("--no-such-option", 2), ("/none", 3)])
    def test_a_full_or_closed_stderr_changes_no_exit_code(
        self, stderr: str, args: str, code: int, environment: dict[str, str], healthy: Path
    ) -> None:
        command = f'exec "$0" -m keystore_audit "$1" {" ".join(AT)} {args} {stderr}'
        run = ["sh", "-c", command, sys.executable, healthy]
        done = subprocess.run(run, env=environment, stdout=subprocess.PIPE, check=False)
        assert done.returncode == code

    def test_closed_stdout_is_said(self, environment: dict[str, str], stock: Path) -> None:
        command = f'exec "$0" -m keystore_audit "$1" {" ".join(AT)} >&-'
        done = subprocess.run(
            ["sh", "-c", command, sys.executable, stock], env=environment, stderr=subprocess.PIPE, check=False
        )
        assert done.returncode == 2
        assert done.stderr == b"keystore-audit: Cannot write the report: standard output is closed.\n"


def drain(terminal: int) -> Iterator[bytes]:
    while True:
        try:
            chunk = os.read(terminal, 65536)
        except OSError:  # the other end is closed
            return
        if not chunk:
            return
        yield chunk


class TestTerminal:
    def on_terminal(self, environment: dict[str, str], *args: object, stdout: bool) -> tuple[bytes, bytes]:
        """What a run writes to a terminal (stderr, and stdout if wanted) and to a piped stdout."""
        ours, theirs = pty.openpty()
        shown: list[bytes] = []
        reader = threading.Thread(target=lambda: shown.extend(drain(ours)))
        reader.start()
        done = subprocess.run(
            [sys.executable, "-m", "keystore_audit", *map(str, args)],
            env={**environment, "TERM": "xterm"},
            stdout=theirs if stdout else subprocess.PIPE,
            stderr=theirs,
            check=False,
        )
        os.close(theirs)
        reader.join(timeout=30)
        os.close(ours)
        return b"".join(shown), done.stdout or b""

    def test_a_bar_for_many_enclaves_on_stderr_only(self, environment: dict[str, str], many_enclaves: Path) -> None:
        shown, out = self.on_terminal(environment, many_enclaves, *AT, "-f", "json", stdout=False)
        assert b"enclaves" in shown
        assert re.search(rb"2\d/2\d", shown)
        assert len(json.loads(out)["enclaves"]) > 20

    def test_no_bar_for_few_and_none_if_quiet(
        self, environment: dict[str, str], healthy: Path, many_enclaves: Path
    ) -> None:
        few, _out = self.on_terminal(environment, healthy, *AT, "-f", "json", stdout=False)
        assert not re.search(rb"\d/\d", few)
        quiet, _out = self.on_terminal(environment, many_enclaves, *AT, "-q", stdout=False)
        assert quiet == b""

    def test_colour_on_a_terminal(self, environment: dict[str, str], stock: Path) -> None:
        coloured, _ = self.on_terminal(environment, stock, *AT, stdout=True)
        assert b"\x1b[1;37;41mFAIL" in coloured
        plain, _ = self.on_terminal({**environment, "NO_COLOR": "1"}, stock, *AT, stdout=True)
        assert b"\x1b[1;37;41m" not in plain


def test_hostile_file_names_reach_no_output(keystore_audit: Any, healthy: Path, tmp_path: Path) -> None:
    root = shutil.copytree(healthy, tmp_path / "keys\x1b[31m", symlinks=True)
    enclave = next(path.parent for path in sorted((root / "enclaves").rglob("cert.pem")))
    for name in ("\x1b]0;owned\x07", "\u202egnp", "[red]x", os.fsdecode(b"\xff\xfe"), "new\nline"):
        shutil.copytree(enclave, enclave.with_name(name), symlinks=True)
    for form in ("text", "json"):
        done = keystore_audit(root, *AT, "-f", form, "-v")
        for stream in (done.stdout, done.stderr):
            text = stream.decode()
            assert not set(text) & set("\x1b\x07\u202e\r\x9b")
            assert "\nline" not in text
    document = json.loads(done.stdout)
    schema("report").validate(document)
    assert any("%FF%FE" in entry["directory"] for entry in document["enclaves"])
    missing = keystore_audit(tmp_path / "\x1b[31mnone", *AT)
    assert (missing.returncode, b"\x1b" in missing.stderr) == (3, False)


def test_the_model_is_written_and_an_unwritable_place_is_said(
    keystore_audit: Any, healthy: Path, tmp_path: Path
) -> None:
    done = keystore_audit("model", healthy, "-o", tmp_path / "alloy", "--at", AT[1])
    assert (done.returncode, done.stdout) == (0, b"")
    assert any(path.suffix == ".als" for path in (tmp_path / "alloy").rglob("*"))
    (tmp_path / "file").touch()
    assert keystore_audit("model", healthy, "-o", tmp_path / "file" / "x").returncode == 2
    (tmp_path / "link").symlink_to(healthy)
    for place in (healthy, healthy / "model", tmp_path / "link" / "model"):
        done = keystore_audit("model", healthy, "-o", place)
        assert done.returncode == 2
        assert b"lies in the keystore that is audited" in done.stderr
    assert not (healthy / "model").exists()


BOTH = ("--engine", "both")


@pytest.mark.parametrize("command", ["audit", "flow", "engine"])
def test_a_jar_that_is_not_there_is_wrong_usage(keystore_audit: Any, healthy: Path, command: str) -> None:
    """It would leave the properties to the other engine, for a slip of the pen."""
    what = {"audit": [healthy], "flow": [healthy, "/talker", "/listener", *BOTH], "engine": []}[command]
    for env, args in (({}, ["--alloy-jar", "nosuch.jar"]), ({"KEYSTORE_AUDIT_ALLOY_JAR": "nosuch.jar"}, [])):
        done = keystore_audit(command, *what, *args, env=env)
        assert (done.returncode, done.stdout) == (2, b"")
        assert b"Invalid value for '--alloy-jar'" in done.stderr
        assert b"nosuch.jar" in done.stderr


@pytest.mark.parametrize(
    "what", [["audit"], ["flow", "/talker", "/listener"], ["flow", "--from-compromised", "/talker"]]
)
def test_a_jar_that_is_not_there_is_no_matter_where_nobody_asks_for_it(
    keystore_audit: Any, healthy: Path, what: list[str]
) -> None:
    """The variable is for all commands; what the command line names has to be there."""
    command, *more = what
    native = ["--engine", "native"]
    stale = keystore_audit(command, healthy, *more, *native, env={"KEYSTORE_AUDIT_ALLOY_JAR": "nosuch.jar"})
    assert stale.returncode in (0, 1)
    assert keystore_audit(command, healthy, *more, *native, "--alloy-jar", "nosuch.jar").returncode == 2


def test_engine_says_what_there_is(keystore_audit: Any, tmp_path: Path) -> None:
    nothing = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = keystore_audit("engine", env=nothing)
    assert (done.returncode, done.stderr) == (0, b"")
    assert re.match(rb"native  .*\nalloy   missing: ", done.stdout)
    (tmp_path / "wrong.jar").write_bytes(b"PK")
    for args in (["--alloy-jar", tmp_path / "wrong.jar"], ["install", "--from", tmp_path / "wrong.jar"]):
        done = keystore_audit("engine", *args, env=nothing)
        assert (done.returncode, done.stdout) == (4, b"")
        assert b"wrong.jar" in done.stderr
