"""KA9: the audit itself. What could not be decided is said, and never passes."""

from __future__ import annotations

from collections.abc import Iterator

from keystore_audit.findings import Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import EngineRun, EngineStatus, PropertyResult
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Rule, Violation, rule

_CLAUSE = "keystore-audit: an audit that could not finish never passes"


@rule(
    "KA901",
    "undecided",
    Severity.HIGH,
    on=Keystore,
    clause=_CLAUSE,
    remedy="Make the file readable for the audit, in the form that the other findings about it ask for.",
)
def undecided(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Something could not be read that a robot might act on, so it counts as able to do anything.

    Safety is then unknown, not given: the properties that it could affect are undecided.
    """
    for doubt in context.meaning.doubts:
        yield Violation(
            message=f"Not read, so it may grant or do anything: {doubt.reason}.",
            locations=(doubt.location,),
            enclave=doubt.enclave,
            undecided=True,
            key=doubt.reason,
        )


@rule(
    "KA902",
    "engine-missing",
    Severity.INFO,
    on=EngineRun,
    clause=_CLAUSE,
    remedy="Install the extra [alloy] and run: keystore-audit engine install",
)
def engine_missing(run: EngineRun, _context: Context) -> Iterator[Violation]:
    """The Alloy Analyzer could not be had, so the native engine decided alone and nothing checked it."""
    if run.status is EngineStatus.MISSING and not run.required:
        yield Violation(
            message=f"The {run.name} engine is not there ({run.reason}): the native engine decided alone.",
            locations=(),
            key=run.name,
        )


@rule(
    "KA903",
    "engine-failed",
    Severity.HIGH,
    on=EngineRun,
    clause=_CLAUSE,
    remedy="Mend the engine (keystore-audit engine), give it more time (--timeout), or decide with --engine native.",
)
def engine_failed(run: EngineRun, _context: Context) -> Iterator[Violation]:
    """An engine that was asked for, or that was started, did not answer. No answer is never "holds"."""
    scale = run.status is EngineStatus.OUT_OF_SCALE
    if run.required and not scale and run.status not in (EngineStatus.OK, EngineStatus.NOT_RUN):
        yield Violation(
            message=f"The {run.name} engine gave no answer ({run.status.value}): {run.reason}",
            locations=(),
            undecided=True,
            key=run.name,
        )


@rule(
    "KA904",
    "engines-disagree",
    Severity.CRITICAL,
    on=PropertyResult,
    clause=_CLAUSE,
    remedy="Report this as a defect of keystore-audit, with the output of: keystore-audit model KEYSTORE -o DIR",
)
def engines_disagree(result: PropertyResult, _context: Context) -> Iterator[Violation]:
    """The two engines give different answers, so one of them is wrong and neither may be believed."""
    for profile, answer in result.profiles.items():
        if len(set(answer.engines.values())) > 1:
            said = ", ".join(f"{name}: {status.value}" for name, status in answer.engines.items())
            yield Violation(
                message=f"The engines disagree on {result.prop.id} under {profile}: {said}.",
                locations=(),
                profiles=(profile,),
                undecided=True,
                key=f"{result.prop.id} {profile}",
            )


@rule(
    "KA905",
    "rule-crashed",
    Severity.HIGH,
    on=Keystore,
    clause=_CLAUSE,
    remedy="Report this as a defect of keystore-audit; the audit counts as incomplete until then.",
    applies=lambda _keystore, _context: False,
)
def rule_crashed(_keystore: Keystore, _context: Context) -> Iterator[Violation]:
    """A rule ended in an error, so that what it checks is undecided. `judge` makes these findings."""
    yield from ()


RULE_CRASHED = rule_crashed


@rule(
    "KA906",
    "property-undecided",
    Severity.HIGH,
    on=PropertyResult,
    clause=_CLAUSE,
    remedy="Mend what the other findings call unread, and audit again.",
)
def property_undecided(result: PropertyResult, _context: Context) -> Iterator[Violation]:
    """A property holds if what was not read is harmless, and is violated if it is not; or no engine answered."""
    profiles = tuple(name for name, r in result.profiles.items() if r.status is Status.UNKNOWN)
    disagreement = any(len(set(r.engines.values())) > 1 for r in result.profiles.values())
    if (profiles or not result.profiles) and not disagreement:
        everywhere = len(profiles) == len(result.profiles)
        yield Violation(
            message=f"Undecided: {result.prop.statement} It depends on what could not be read, or no engine answered.",
            locations=(),
            profiles=() if everywhere else profiles,
            undecided=True,
            key=result.prop.id,
        )


@rule(
    "KA907",
    "engine-out-of-scale",
    Severity.INFO,
    on=EngineRun,
    clause=_CLAUSE,
    remedy="Nothing is wrong with the keystore; ask for --engine native where Alloy is not wanted.",
)
def engine_out_of_scale(run: EngineRun, _context: Context) -> Iterator[Violation]:
    """The model is larger than Alloy can take: the native engine decided alone, unless Alloy was asked for by name."""
    if run.status is EngineStatus.OUT_OF_SCALE:
        yield Violation(
            message=f"The model is too large for the {run.name} engine: {run.reason}",
            locations=(),
            severity=Severity.HIGH if run.required else None,
            undecided=run.required,
            key=run.name,
        )


@rule(
    "KA908",
    "topic-classes-over-budget",
    Severity.HIGH,
    on=Keystore,
    clause=_CLAUSE,
    remedy="Use fewer expressions with a literal between two *; each such infix can double the number of classes.",
)
def topic_classes_over_budget(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """The topic expressions make more classes of names than can be worked out, so no right could be decided exactly."""
    if context.meaning.over_budget is not None:
        yield Violation(message=context.meaning.over_budget, locations=(), undecided=True, key="budget")


AUDIT: tuple[Rule[Keystore] | Rule[EngineRun] | Rule[PropertyResult], ...] = (
    undecided,
    engine_missing,
    engine_failed,
    engines_disagree,
    rule_crashed,
    property_undecided,
    engine_out_of_scale,
    topic_classes_over_budget,
)
