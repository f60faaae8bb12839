"""A short run of each coverage-guided target; `docs/testing.md` has the command for a long one."""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from tests.amount import tried
from tests.conftest import IN_CI
from tests.fuzz.targets import CORPUS, MAX_INPUT, MAX_STEPS, READERS
from tests.steps import steps

CHEAP = ("certificate", "pem", "cms", "xml", "crl", "private_key")
RUNS, FEWER = tried(5_000), tried(1_500)
"""Inputs of a target, by what one costs: some seconds each, and the same ones each time."""

SECONDS = 60
"""No run is meant to take so long."""

APART = ("sh", "-c", '"$@"; exit $?', "sh")
"""libFuzzer counts the most memory that a process ever had, and a child begins with its parent's (getrusage(2)).
Here that is the shell's, not that of these tests."""


@pytest.mark.parametrize("target", READERS)
def test_target(target: str, repository: Path, tmp_path: Path) -> None:
    if importlib.util.find_spec("atheris") is None:
        if IN_CI and (sys.platform, platform.machine()) == ("linux", "x86_64"):
            pytest.fail("atheris is missing, and CI has to fuzz")
        pytest.skip("atheris has no wheel here")
    runs = RUNS if target in CHEAP else FEWER
    done = subprocess.run(
        [
            *APART,
            sys.executable,
            "-m",
            "tests.fuzz.run",
            target,
            f"--runs={runs}",
            f"--seconds={SECONDS}",
            f"--crashes={tmp_path}",
        ],
        cwd=repository,
        env={**os.environ, "PYTHONPATH": str(repository)},
        capture_output=True,
        timeout=120,
        check=False,
    )
    output = done.stderr.decode("utf-8", "replace") + done.stdout.decode("utf-8", "replace")
    crashes = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert done.returncode == 0, f"{output[-3000:]}\n{crashes}"
    assert not crashes
    units = re.search(r"number_of_executed_units: (\d+)", output)
    assert units is not None, output[-3000:]
    assert int(units[1]) >= runs


@pytest.mark.parametrize("target", READERS)
def test_corpus(target: str) -> None:
    """What is kept is small, and each of it holds the promises without atheris too."""
    seeds = sorted((CORPUS / target).iterdir())
    assert len(seeds) >= 4
    for seed in seeds:
        data = seed.read_bytes()
        assert len(data) <= MAX_INPUT
        steps(partial(READERS[target], data), most=MAX_STEPS)
