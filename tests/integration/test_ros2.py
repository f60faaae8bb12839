"""The verbs of `ros2 security` in the package of a colcon workspace: our programs, in an environment of their own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

AT = ("--at", "2026-11-21T12:00:00Z", "--engine", "native")
Call = Callable[..., subprocess.CompletedProcess[str]]
PROGRAMS = Path(sys.executable).parent


@pytest.fixture(scope="module")
def keystores(repository: Path) -> Path:
    return repository / "sample_keystores"


@pytest.fixture(scope="module")
def workspace(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of modules of a workspace with the package, built as colcon does: setup.py of a copy, with a prefix.

    A module beside it is what sros2 works with, and no audit can.
    """
    folder = tmp_path_factory.mktemp("workspace")
    source = shutil.copytree(repository / "ros2/keystore_audit_ros2", folder / "src")
    build = [sys.executable, "setup.py", "-q", "install", "--prefix", str(folder / "install")]
    record = ["--record", str(folder / "record"), "--single-version-externally-managed"]
    quiet = {**os.environ, "PYTHONWARNINGS": "ignore"}
    done = subprocess.run([*build, *record], cwd=source, capture_output=True, text=True, env=quiet)
    assert done.returncode == 0, done.stderr
    installed = (folder / "record").read_text().split()
    assert any(name.endswith("share/ament_index/resource_index/packages/keystore_audit_ros2") for name in installed)
    assert any(name.endswith("share/keystore_audit_ros2/package.xml") for name in installed)
    modules = next((folder / "install").rglob("keystore_audit_ros2/__init__.py")).parents[1]
    (modules / "cryptography.py").write_text("raise ImportError('another version')\n")
    return modules


@pytest.fixture(scope="module")
def ros2(repository: Path, workspace: Path) -> Call:
    """`ros2 security`, by a Python that has the workspace's modules and the standard library alone."""

    def call(*args: str | Path, **variables: str) -> subprocess.CompletedProcess[str]:
        words = [sys.executable, "-S", repository / "tests/integration/ros2_stub.py", "security", *args]
        path = {"PATH": f"{PROGRAMS}:{os.environ['PATH']}", "PYTHONPATH": str(workspace)}
        environment = {**os.environ, **path, **variables}
        return subprocess.run(words, capture_output=True, text=True, timeout=60, env=environment)

    return call


def alone(*args: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([PROGRAMS / "keystore-audit", "audit", *args], capture_output=True, text=True, timeout=60)


def test_the_audit_says_what_the_program_says(ros2: Call, keystores: Path) -> None:
    for sample, code in (("healthy/turtlesim", 0), ("stock/turtlesim", 1), ("nowhere", 3)):
        words = (*AT, keystores / sample, "--ignore", "KA2", "--ignore", "KA105", "-q")  # an option first
        done, own = ros2("audit", *words), alone(*words)
        assert (done.returncode, done.stdout, done.stderr) == (own.returncode, own.stdout, own.stderr)
        assert done.returncode == code


def test_no_word_is_taken_by_ros2(ros2: Call, keystores: Path) -> None:
    assert ros2("audit", "--help").stdout == alone("--help").stdout
    assert ros2("audit", *AT, "--", keystores / "healthy/turtlesim").returncode == 0
    twice = ros2("audit", *AT, "--domain", "1", "--domain", "2", keystores / "healthy/turtlesim")
    assert (twice.returncode, "--domain is given twice" in twice.stderr) == (2, True)
    assert "--settle" in ros2("record", "-h").stdout


def test_programs_are_found_on_the_path_or_in_the_folder_that_the_variable_names(ros2: Call, tmp_path: Path) -> None:
    absent = ros2("audit", "--help", PATH=str(tmp_path))
    assert (absent.returncode, absent.stdout) == (2, "")
    assert "keystore-audit is not on PATH (KEYSTORE_AUDIT_BIN is not set): install it apart" in absent.stderr
    assert ros2("audit", "--help", PATH=str(tmp_path), KEYSTORE_AUDIT_BIN=str(PROGRAMS)).returncode == 0
    for verb in ("audit", "record"):
        elsewhere = ros2(verb, "--help", KEYSTORE_AUDIT_BIN=str(tmp_path))
        assert (elsewhere.returncode, "in the folder that KEYSTORE_AUDIT_BIN names" in elsewhere.stderr) == (2, True)


def test_the_package_brings_nothing_into_the_python_of_ros(workspace: Path) -> None:
    """A version of cryptography that sros2 cannot use would come with keystore-audit."""
    (metadata,) = workspace.glob("*.egg-info/requires.txt")
    assert metadata.read_text().split() == ["setuptools"]
