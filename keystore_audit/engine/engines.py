"""Runs the engines that were asked for; one that did not answer is recorded, never taken for an answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.engine.agreement import EngineAnswers
from keystore_audit.engine.native import NativeEngine
from keystore_audit.errors import EngineError, EngineMissing, EngineOutOfScale, EngineTimeout
from keystore_audit.properties.result import Answer, EngineRun, EngineStatus, Status
from keystore_audit.resources import in_ci


class Engines(Struct, frozen=True, kw_only=True):
    """Who decides. `choice`: both, alloy, native, or auto: both, and native alone where Alloy cannot be had at all.

    `jar`: of Alloy, None: the one installed; `offline`: it is never fetched. `timeout`: of the solver, in seconds.
    """

    choice: str = "native"
    jar: Path | None = None
    offline: bool = False
    timeout: float = 120.0


def run_engines(
    native: NativeEngine, engines: Engines, stage: Callable[[str], None] | None
) -> tuple[tuple[EngineRun, ...], tuple[EngineAnswers, ...]]:
    """How each engine fared about the systems of `native`, and the answers of those that did."""
    choice = engines.choice
    runs: list[EngineRun] = []
    answers: list[EngineAnswers] = []
    if choice == "native":
        runs.append(_not_run("alloy", "--engine native"))
    else:
        run, found = _alloy(native, engines, stage)
        runs.append(run)
        if found is not None:
            answers.append(EngineAnswers(engine="alloy", answers=tuple(found)))
    if choice == "alloy":
        runs.append(_not_run("native", "--engine alloy"))
    else:
        answers.append(EngineAnswers(engine="native", answers=native.answers))
        runs.append(EngineRun(name="native", version=None, status=EngineStatus.OK, reason="", required=True))
    return tuple(runs), tuple(answers)


def _alloy(
    native: NativeEngine, engines: Engines, stage: Callable[[str], None] | None
) -> tuple[EngineRun, Sequence[Mapping[str, Answer]] | None]:
    """Alloy's answers, or why there are none. Once it was found or asked for by name, its failure counts."""
    from keystore_audit.engine.alloy.install import find  # a twentieth of a second, which the native engine spares
    from keystore_audit.engine.alloy.runner import examine

    asked = engines.choice in ("alloy", "both") or engines.jar is not None
    version: str | None = None
    try:
        engine = find(engines.jar, offline=engines.offline, ci=in_ci(), progress=stage)
        version = engine.version
        if stage:
            stage("asking the Alloy Analyzer")
        expected = None if engines.choice == "alloy" else [_statuses(answers) for answers in native.answers]
        found = examine(native.systems, java=engine.java, jar=engine.jar, timeout=engines.timeout, expected=expected)
    except EngineError as error:
        status = _FAILURES.get(type(error), EngineStatus.FAILED)
        required = asked or status in (EngineStatus.TIMEOUT, EngineStatus.FAILED)
        run = EngineRun(name="alloy", version=version, status=status, reason=error.message, required=required)
        return replace(run, atoms=error.atoms) if isinstance(error, EngineOutOfScale) else run, None
    atoms = max((decision.atoms for decision in found), key=lambda sizes: sizes[1], default=None)
    run = EngineRun(name="alloy", version=version, status=EngineStatus.OK, reason="", required=True, atoms=atoms)
    return run, native.checked([decision.answers for decision in found])


def _statuses(answers: Mapping[str, Answer]) -> dict[str, Status]:
    return {name: answer.status for name, answer in answers.items()}


_FAILURES: Final[dict[type[EngineError], EngineStatus]] = {
    EngineMissing: EngineStatus.MISSING,
    EngineOutOfScale: EngineStatus.OUT_OF_SCALE,
    EngineTimeout: EngineStatus.TIMEOUT,
}
"""What became of it; of other errors, it failed."""


def _not_run(name: str, reason: str) -> EngineRun:
    return EngineRun(name=name, version=None, status=EngineStatus.NOT_RUN, reason=reason, required=False)
