"""What became of the engines, and all else that makes a verdict reach less far than it seems to, in sentences."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from keystore_audit.properties.result import EngineRun, EngineStatus
from keystore_audit.report.content import Report

ENGINE_WORDS: Final = {
    EngineStatus.OK: "answered",
    EngineStatus.MISSING: "is missing",
    EngineStatus.FAILED: "failed",
    EngineStatus.TIMEOUT: "ran out of time",
    EngineStatus.OUT_OF_SCALE: "was not started, the model being too large for it",
    EngineStatus.NOT_RUN: "was not asked",
}
"""What became of an engine, behind its name."""

_RUNNING_SESSIONS: Final = "Sessions that run by then may go on: Fast DDS ends none when a grant ends."
"""Said with "safe until", which is about new sessions (read; Cyclone DDS and OpenDDS have timers)."""


def sentence(text: str) -> str:
    """With a full stop, where there is none."""
    return text if text.endswith((".", "!", "?")) else f"{text}."


def until(report: Report) -> str:
    """Why its answer changes at `safe_until`, with what goes on then, or why it never does."""
    why = report.safe_until_why
    return why if report.safe_until is None else f"{sentence(why)} {_RUNNING_SESSIONS}"


def engine(run: EngineRun, *, version: bool) -> str:
    """What became of it, with its `version` or without."""
    name = f"{run.name} engine {run.version}" if version and run.version else f"{run.name} engine"
    return sentence(f"The {name} {ENGINE_WORDS[run.status]}{f': {run.reason}' if run.reason else ''}")


def warnings(report: Report, *, versions: bool = False) -> Iterator[str]:
    """What is to be read first."""
    answered = [run.name for run in report.engines if run.status is EngineStatus.OK]
    rest = f" The properties rest on {' and '.join(answered)} alone." if answered else ""
    for run in report.engines:
        if run.status not in (EngineStatus.OK, EngineStatus.NOT_RUN):
            yield engine(run, version=versions) + rest
    if not answered:
        yield "No engine has answered: no property was decided."
    if report.engines_agree is False:
        yield "The engines disagree: wherever they do, the answer is unknown."
    for reason in report.weakened:
        yield sentence(f"Weakened gate: {reason}")
