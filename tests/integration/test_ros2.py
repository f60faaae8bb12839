"""`ros2 security audit` through its entry point, and the package of a colcon workspace."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import click
import pytest

from keystore_audit.cli.audit import command
from keystore_audit.ros2 import AuditVerb

AT = ("--at", "2026-11-21T12:00:00Z", "--engine", "native")


@pytest.fixture(scope="module")
def keystores(repository: Path) -> Path:
    return repository / "sample_keystores"


def ros2(repository: Path, *args: str | Path, path: str = "") -> subprocess.CompletedProcess[str]:
    stub = repository / "tests/integration/ros2_stub.py"
    environment = {**os.environ, "PYTHONPATH": path}
    words = [sys.executable, str(stub), "security", "audit", *map(str, args)]
    return subprocess.run(words, capture_output=True, text=True, timeout=60, env=environment)


def test_the_installed_package_has_the_verb() -> None:
    (point,) = (each for each in entry_points(group="sros2.verb") if each.name == "audit")
    assert point.load() is AuditVerb


def test_it_says_what_the_command_says(repository: Path, keystores: Path) -> None:
    for sample, code in (("healthy/turtlesim", 0), ("stock/turtlesim", 1), ("nowhere", 3)):
        done = ros2(repository, keystores / sample, *AT, "--ignore", "KA2", "--ignore", "KA105", "-q")
        words = [sys.executable, "-m", "keystore_audit", keystores / sample, *AT]
        alone = subprocess.run([*words, "--ignore=KA2", "--ignore=KA105", "-q"], capture_output=True, text=True)
        assert (done.returncode, done.stdout, done.stderr) == (alone.returncode, alone.stdout, alone.stderr)
        assert done.returncode == code


def test_options_may_stand_first_and_wrong_ones_are_usage(repository: Path, keystores: Path) -> None:
    assert ros2(repository, *AT, "-f", "json", keystores / "healthy/turtlesim").returncode == 0
    wrong = ros2(repository, keystores / "healthy/turtlesim", "--engine", "none")
    assert (wrong.returncode, "is not one of" in wrong.stderr) == (2, True)


def test_its_help_has_every_option(repository: Path) -> None:
    text = ros2(repository, "--help").stdout
    assert text.count("Audit keystores: what the signed artifacts on disk really allow.") == 1
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            assert all(name in text for name in parameter.opts)


@pytest.mark.slow
def test_the_workspace_package_installs_and_has_the_verb(repository: Path, keystores: Path, tmp_path: Path) -> None:
    """As colcon's Python build does it: setup.py of a copy, installed below a prefix of its own."""
    source = shutil.copytree(repository / "ros2/keystore_audit_ros2", tmp_path / "src")
    build = [sys.executable, "setup.py", "-q", "install", "--prefix", str(tmp_path / "install")]
    record = ["--record", str(tmp_path / "record"), "--single-version-externally-managed"]
    done = subprocess.run(
        [*build, *record], cwd=source, capture_output=True, text=True, env={**os.environ, "PYTHONWARNINGS": "ignore"}
    )
    assert done.returncode == 0, done.stderr
    installed = (tmp_path / "record").read_text().split()
    assert any(name.endswith("share/ament_index/resource_index/packages/keystore_audit_ros2") for name in installed)
    assert any(name.endswith("share/keystore_audit_ros2/package.xml") for name in installed)
    site = str(next((tmp_path / "install").rglob("keystore_audit_ros2/__init__.py")).parents[1])
    program = "from importlib.metadata import *; print(*(e.value for e in entry_points(group='sros2.verb')))"
    listed = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": site}
    )
    assert "keystore_audit_ros2:AuditVerb" in listed.stdout
    assert ros2(repository, keystores / "healthy/turtlesim", *AT, path=site).returncode == 0
