"""Several runs of the Analyzer, side by side; each must answer every command that it was given."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final, TypeVar

from keystore_audit.engine.alloy.process import OUTPUT_DIRECTORY, Analyzer, AnalyzerProcess, Job, Output
from keystore_audit.engine.alloy.solution import failure, verdicts

PARALLEL: Final = 2
"""Analyzers side by side: one uses little more than one core."""

_POLL: Final = 0.01
"""Seconds between looks at a process."""

Result = TypeVar("Result")

Read = Callable[[int, Mapping[str, bool], Path], Result]
"""Makes a result of a job: its number, which of its commands have an instance, and where the instances are."""


def run(
    jobs: Sequence[Job],
    analyzer: Analyzer,
    read: Read[Result],
    check: Callable[[Output], Output] | None = None,
) -> list[Result]:
    """Return what `read` makes of each job, in their order. `check` sees what the Analyzer wrote first, and may raise.

    Raises an EngineError if one of them was not answered completely; then the others are ended.
    """
    results: dict[int, Result] = {}
    waiting = deque(enumerate(jobs))
    running: dict[int, AnalyzerProcess] = {}
    with ExitStack() as cleanup:
        while waiting or running:
            while waiting and len(running) < PARALLEL:
                number, job = waiting.popleft()
                running[number] = cleanup.enter_context(AnalyzerProcess(job, analyzer))
            for number, process in tuple(running.items()):
                output = process.poll(_POLL)
                if output is not None:
                    found = _verdicts(jobs[number], check(output) if check else output, analyzer)
                    results[number] = read(number, found, process.directory / OUTPUT_DIRECTORY)
                    running.pop(number).close()
    return [results[number] for number in range(len(jobs))]


def _verdicts(job: Job, output: Output, analyzer: Analyzer) -> Mapping[str, bool]:
    if output.status != 0:
        said = output.diagnostics + output.messages
        raise failure(output.status, said, java=analyzer.java, memory_mb=analyzer.memory_mb)
    return verdicts(output.diagnostics, job.commands)
