"""Flows by files of sessions and routers, as each engine decides, and what they say together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from keystore_audit.engine.engines import Asked, Engines, run_asked
from keystore_audit.profiles import Release
from keystore_audit.properties.result import Counterexample, EngineRun, ProfileResult, Status, Step
from keystore_audit.truth import Truth
from keystore_audit.zenoh.flow import Hop, found, told
from keystore_audit.zenoh.participants import NetworkFlows, Question

if TYPE_CHECKING:
    from keystore_audit.engine.alloy.install import Engine

Answer = tuple[Truth, tuple[Hop, ...]]
"""Whether something gets there, and the way by which it does, or may."""

_STATUSES: Final = {Truth.YES: Status.VIOLATED, Truth.NO: Status.HOLDS, Truth.UNKNOWN: Status.UNKNOWN}


def decide(
    flows: NetworkFlows, questions: Sequence[tuple[Question, Release]], engines: Engines
) -> tuple[tuple[EngineRun, ...], list[ProfileResult]]:
    """How each engine fared, and the result of each question. Raises errors.BudgetExceeded where there is too much.

    Alloy says whether anything may get through; what certainly gets through is decided natively.
    """

    def ask(engine: Engine) -> Asked[list[Answer]]:
        from keystore_audit.engine.alloy.routed import may_get_through
        from keystore_audit.engine.alloy.runner import analyzer_of

        with analyzer_of(engine, engines.timeout) as analyzer:
            may = [bool(flows.rights.doubts) or may_get_through(flows, *each, analyzer) for each in questions]
        return [(Truth.UNKNOWN if each else Truth.NO, ()) for each in may], None

    runs, answers = run_asked(lambda: [found(flows, *each) for each in questions], ask, engines, None)
    return runs, [_together({name: said[number] for name, said in answers.items()}) for number in range(len(questions))]


def _together(answers: Mapping[str, Answer]) -> ProfileResult:
    """The answer on which all engines that answered agree, else unknown."""
    truth, hops = answers.get("native", (Truth.UNKNOWN, ()))
    statuses = {name: _STATUSES[truth if truth.may and said.may else said] for name, (said, _hops) in answers.items()}
    every = {*statuses.values()}
    return ProfileResult(
        status=every.pop() if len(every) == 1 else Status.UNKNOWN,
        engines=statuses,
        counterexample=_way(hops) if hops else None,
    )


def _way(hops: Sequence[Hop]) -> Counterexample:
    """The way, with the line of each hop that lets it in."""
    steps = (
        Step(
            enclave=hop.receiver.label,
            channel=None,
            witness=hop.key,
            path=hop.location.path if hop.location is not None else None,
            line=hop.location.line if hop.location is not None else None,
        )
        for hop in hops
    )
    return Counterexample(text=told(hops), steps=tuple(steps))
