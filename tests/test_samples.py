"""Every sample keystore gives exactly the findings that stand beside it."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest

from keystore_audit import __version__, toml
from keystore_audit.cli import audit as command_line
from keystore_audit.cli.program import program as command
from keystore_audit.cli.program import run as program
from keystore_audit.options import Options
from tools.freeze import answers
from tools.samples.expectation import finding_line, with_engine
from tools.samples.store import copy_with_modes

ROOT = Path(__file__).parent.parent
SAMPLES = ROOT / "sample_keystores"
EXPECTATIONS = sorted(path for path in SAMPLES.rglob("*.toml") if path.with_suffix("").is_dir())


def name(path: Path) -> str:
    return path.relative_to(SAMPLES).with_suffix("").as_posix()


def as_built(expectation: Path, target: Path) -> tuple[Path, dict[str, Any]]:
    """A copy with the modes that the sample was built with, which git does not keep, and what is expected of it."""
    expected = toml.loads(expectation.read_text("utf-8"))
    copy_with_modes(expectation.with_suffix(""), target, int(expected["key_mode"], 8))
    return target, expected


def given_options(expectation: Path, keystore: Path) -> Options:
    """The sample's own options, for the keystore there; they name files below SAMPLES."""
    expected = toml.loads(expectation.read_text("utf-8"))
    return options_of(keystore, *with_engine(expected["options"]), "--at", expected["at"])


def options_of(keystore: Path, *words: str) -> Options:
    """What the command line makes of these words."""
    parent = click.Context(command)  # a command keeps the help option that it is asked for first, of whomever
    given = command_line.command.make_context("audit", [*words, str(keystore)], parent=parent).params
    return command_line.chosen(given, [str(keystore)])


def run(keystore: Path, *options: str) -> tuple[int, dict[str, Any]]:
    """The exit code and the JSON report of a whole audit in a process of its own."""
    command = [sys.executable, "-m", "keystore_audit", "audit", "--format", "json", *options, str(keystore)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120, cwd=SAMPLES)
    assert "Traceback" not in done.stderr, done.stderr
    assert done.stdout, done.stderr
    return done.returncode, json.loads(done.stdout)


def rows(report: dict[str, Any]) -> list[str]:
    """Findings as the expectation files write them."""
    return sorted(finding_line(finding) for finding in report["findings"])


Audit = Callable[..., tuple[int, dict[str, Any]]]
Golden = Callable[[str, str], None]


@pytest.fixture
def run_here(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], resident_analyzer: None) -> Audit:  # noqa: ARG001
    """As `run`, in this process."""
    monkeypatch.chdir(SAMPLES)

    def run_here(keystore: Path, *options: str) -> tuple[int, dict[str, Any]]:
        code = program(["audit", "--format", "json", *options, str(keystore)])
        written = capsys.readouterr()
        assert "Traceback" not in written.err, written.err
        assert written.out, written.err
        return code, json.loads(written.out)

    return run_here


FORMATS = ("html", "junit", "markdown", "sarif", "statement", "text")


@pytest.fixture
def beside_samples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, resident_analyzer: None) -> Path:  # noqa: ARG001
    """An empty folder to work in, where the files that options of samples name can be found."""
    for each in SAMPLES.iterdir():
        if each.is_dir():
            (tmp_path / each.name).symlink_to(each)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("expectation", EXPECTATIONS, ids=name)
def test_a_sample_gives_exactly_its_findings(expectation: Path, beside_samples: Path, golden: Golden) -> None:
    """And all that commands say of it, in every format, is what it was: `tools/freeze.py` shows a difference."""
    expected = toml.loads(expectation.read_text("utf-8"))
    target = beside_samples / "answers"
    answers(expectation.with_suffix(""), target, "native", FORMATS)
    code, _line, text = (target / "audit.json").read_text("utf-8").partition("\n")
    found = rows(json.loads(text))
    assert {"missing": sorted(set(expected["findings"]) - set(found))} == {"missing": []}
    assert {"unexpected": sorted(set(found) - set(expected["findings"]))} == {"unexpected": []}
    assert found == sorted(expected["findings"])
    assert int(code) == json.loads(text)["exit_code"] == expected["exit_code"]
    said = {each.name: each.read_bytes().replace(__version__.encode(), b"VERSION") for each in target.iterdir()}
    digests = (f"{each} {hashlib.sha256(said[each]).hexdigest()[:16]}\n" for each in sorted(said))
    golden(f"samples/{name(expectation)}.txt", "".join(digests))


def has_options(expectation: Path) -> bool:
    return bool(toml.loads(expectation.read_text("utf-8"))["options"])


WITH_ALLOY = [
    path
    for path in EXPECTATIONS
    if path.parent.name in ("flows", "healthy", "stock", "unknown")
    or (path.parent.name.startswith("KA7") and has_options(path))
]
"""Families of them, and those with claims or profiles of their own; tests/engine/test_samples_agree.py asks the
Analyzer about the properties of all samples, as the default profiles read them. Those of `healthy` start the program
and the Analyzer as a user does."""


@pytest.mark.parametrize("expectation", WITH_ALLOY, ids=name)
def test_both_engines_agree_on_a_sample(expectation: Path, tmp_path: Path, run_here: Audit) -> None:
    keystore, expected = as_built(expectation, tmp_path / "keystore")
    family = expectation.parent.name
    engine = "both" if family in ("healthy", "stock") else "auto"  # both solves each set of assumptions, too
    code, report = (run if family == "healthy" else run_here)(
        keystore, *with_engine(expected["options"], engine), "--at", expected["at"]
    )
    assert report["engines"]["alloy"]["status"] == "ok"
    assert report["engines"]["native"]["status"] == "ok"
    assert report["engines_agree"] is True
    assert code == expected["exit_code"]
    assert rows(report) == sorted(expected["findings"])


@pytest.mark.parametrize("healthy", sorted((SAMPLES / "healthy").glob("*.toml")), ids=name)
def test_a_healthy_sample_passes_with_every_property_but_forging_readers(healthy: Path, tmp_path: Path) -> None:
    keystore, _expected = as_built(healthy, tmp_path / "keystore")
    code, report = run(keystore, "--engine", "native")
    assert (code, report["verdict"]) == (0, "pass")
    assert report["weakened"] == []
    statuses = {prop["id"]: prop["status"] for prop in report["properties"]}
    assert statuses.pop("readers-cannot-forge") == "violated"
    assert set(statuses.values()) == {"holds"}
