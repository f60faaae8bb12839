"""What tests read of the Analyzer in a JVM that stays is what a process of its own writes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy.export import commands
from keystore_audit.engine.alloy.facts import KEYSTORE, MAIN, facts
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.process import OUTPUT_DIRECTORY, Analyzer, AnalyzerProcess, Job, Output
from keystore_audit.properties import PROPERTIES
from tests.engine.alloy_batch import engine, shipped
from tests.engine.systems import stock

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]


def run(found: Engine, changed: dict[str, str]) -> tuple[Output, dict[str, str]]:
    """What it writes, and the instances."""
    files = shipped() | {KEYSTORE: facts(stock()), MAIN: commands(PROPERTIES, stock())} | changed
    job = Job(files=files, main=MAIN, commands=(), atoms=10)
    analyzer = Analyzer(java=found.java, jar=found.jar, timeout=240, memory_mb=1024)
    with AnalyzerProcess(job, analyzer) as process:
        output = None
        while output is None:
            output = process.poll(1)
        said = output.diagnostics.replace(str(process.directory), "")
        return replace(output, diagnostics=said), instances(process.directory / OUTPUT_DIRECTORY)


def instances(folder: Path) -> dict[str, str]:
    """By file, without where the model was and when it was asked."""
    return {
        path.name: re.sub(r'(builddate|filename|maxseq|command)="[^"]*"', "", path.read_text()).split("<source")[0]
        for path in folder.glob("*.xml")
    }


def both(changed: dict[str, str], request: pytest.FixtureRequest) -> Iterator[tuple[Output, dict[str, str]]]:
    """A process of its own, then the one that stays."""
    yield run(engine(), changed)
    request.getfixturevalue("resident_analyzer")
    yield run(engine(), changed)


def test_both_write_the_same(request: pytest.FixtureRequest) -> None:
    process, here = both({}, request)
    assert here == process
    assert len(here[1]) > 3


@pytest.mark.parametrize("asked", ["check {{{", "check Another for 0"])
def test_an_error_is_one_here_too(asked: str, request: pytest.FixtureRequest) -> None:
    (process, _), (here, _) = both({MAIN: f"module audit\nopen vacuity\n{asked}"}, request)
    assert here.status == process.status == 1
    assert complaint(here) == complaint(process)


def complaint(output: Output) -> list[str]:
    """What it says, without where in its code."""
    return [line for line in output.diagnostics.splitlines() if line and not line.startswith("\tat ")]
