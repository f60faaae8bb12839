"""Whether data or control gets from one place to another: `flow`, and whoever wants the answer as a value."""

from __future__ import annotations

import os
from datetime import datetime

from msgspec import Struct

from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.agreement import EngineAnswers, combine_claims
from keystore_audit.engine.engines import Engines, run_engines
from keystore_audit.engine.horizon import with_conditions
from keystore_audit.engine.native import NativeEngine
from keystore_audit.findings import Location
from keystore_audit.model.claims.claims import with_claims
from keystore_audit.model.claims.stated import Claim
from keystore_audit.model.formal.asked import ATTACKERS, Attacker, ClaimKind
from keystore_audit.model.participants.doubt import keystore_doubts
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.properties.result import AssertedResult, EngineRun, EngineStatus, Status
from keystore_audit.settings.claims import place


class FlowQuestion(Struct, frozen=True, kw_only=True):
    """From where to where, as places are written in settings; `through`: globs on enclaves that do not count.

    `attackers`: None for each under whom there can be a flow at all.
    """

    source: str
    target: str
    attackers: tuple[Attacker, ...] | None = None
    through: tuple[str, ...] = ()
    include_ambient: bool = False


class FlowAnswer(Struct, frozen=True, kw_only=True):
    """Whether there is a flow, by attacker: a result is VIOLATED where there is one for certain.

    `doubts`: places of what could not be read, which an unknown answer depends on; none where no answer is unknown.
    """

    question: FlowQuestion
    at: datetime
    results: tuple[tuple[Attacker, AssertedResult], ...]
    engines: tuple[EngineRun, ...]
    doubts: tuple[Location, ...]

    @property
    def status(self) -> Status:
        """The worst of all: unknown, then violated (a flow), then holds (none)."""
        statuses = {result.status for _attacker, result in self.results}
        failed = any(run.required and run.status is not EngineStatus.OK for run in self.engines)
        if failed or Status.UNKNOWN in statuses:
            return Status.UNKNOWN
        return Status.VIOLATED if Status.VIOLATED in statuses else Status.HOLDS


def find_flow(
    path: str | os.PathLike[str],
    question: FlowQuestion,
    given: Circumstances,
    *,
    engines: Engines | None = None,
) -> FlowAnswer:
    """Whether there is a flow in the keystore at `path`.

    Raises errors.NothingToAudit, errors.UsageError for a place that names nothing there, and errors.BudgetExceeded
    where there are too many classes of names.
    """
    claims = questions(question)
    keystore = given.keystore(path)
    profiles, at, accesses = given.profiles, given.at, given.accesses(keystore)
    builder = SystemBuilder(keystore, profiles, at, accesses, claims=claims)
    native = NativeEngine(with_claims(builder.systems(), claims, builder.channels, keystore, {}))
    runs, answers = _decide(native, engines or Engines())
    results = combine_claims(claims, native.systems, answers, given.names)
    results = with_conditions(results, native.systems)
    asked = profiles if any(result.status is Status.UNKNOWN for result in results) else ()
    doubts = (doubt.location for profile in asked for doubt in keystore_doubts(keystore, profile, accesses))
    return FlowAnswer(
        question=question,
        at=at,
        results=tuple((claim.attacker, result) for claim, result in zip(claims, results, strict=True)),
        engines=runs,
        doubts=tuple(dict.fromkeys(doubts)),
    )


def _decide(native: NativeEngine, engines: Engines) -> tuple[tuple[EngineRun, ...], tuple[EngineAnswers, ...]]:
    """The engines' answers; the native one alone is asked about the flow and nothing else."""
    if engines.choice == "native":
        run = EngineRun(name="native", version=None, status=EngineStatus.OK, reason="", required=True)
        return (run,), (EngineAnswers(engine="native", answers=native.claim_answers()),)
    return run_engines(native, engines, None)


def questions(question: FlowQuestion) -> tuple[Claim, ...]:
    """That there is no flow, under each attacker. Raises errors.UsageError for places that are none."""
    source, target = place(question.source), place(question.target)
    attackers = question.attackers
    if attackers is None:
        attackers = tuple(each for each in ATTACKERS if not (source.outsider and each is Attacker.HONEST))
    return tuple(
        Claim(
            id=f"no-flow-{attacker.value}",
            statement=f"Nothing gets from {question.source} to {question.target}.",
            kind=ClaimKind.NO_FLOW,
            attacker=attacker,
            source=source,
            target=target,
            through=question.through,
            include_ambient=question.include_ambient,
            location=Location("", beside=True),
            place="",
        )
        for attacker in attackers
    )
