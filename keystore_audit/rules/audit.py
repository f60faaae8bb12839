"""KA9: the audit itself. What could not be decided is said, and never passes; nothing leaves these rules out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.assumptions import WORLD
from keystore_audit.findings import Act, Location, Remedy, Severity, decision, outside
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.access_view import ZONE_DECIDES
from keystore_audit.model.question import Doubt
from keystore_audit.properties.result import (
    AlloyResult,
    AssertedResult,
    EngineRun,
    EngineStatus,
    ProfileResult,
    PropertyResult,
    Status,
    UserResult,
)
from keystore_audit.rules.registry import MAX_LISTED, MAX_QUOTED, Context, Violation, listed, rule, sentence
from keystore_audit.rules.subjects import Crash
from keystore_audit.settings.suppressions import Fate, FileOfUses, Use
from keystore_audit.text import shorten

_CLAUSE: Final = "keystore-audit, docs/reference.md: an audit that could not decide everything never passes"


_SAY_THE_ZONE: Final = decision(
    "Give the robots' time zone, for example `--time-zone Europe/Berlin`. Or move <not_before> a day back, or "
    "<not_after> a day on.",
    Act.EDIT_PERMISSIONS,
)


@rule(
    "KA901",
    Severity.HIGH,
    _CLAUSE,
    outside("Bring the file into the form that the message asks for, and run the audit again."),
)
def undecided(doubt: Doubt) -> Iterator[Violation]:
    """Something that a robot might act on could not be read, and no other rule reports it at that place.

    It counts as able to do and grant anything: what it could affect is unknown.
    """
    yield Violation(
        f"{sentence(doubt.reason)}: it may {'be refused' if doubt.narrows else 'do or grant anything'}.",
        (doubt.location,),
        enclave=doubt.enclave,
        profiles=doubt.profiles,
        undecided=True,
        key=doubt.reason,
        remedy=_SAY_THE_ZONE if doubt.reason.endswith(ZONE_DECIDES) else None,
    )


@rule(
    "KA902",
    Severity.INFO,
    _CLAUSE,
    outside("Install keystore-audit with its extra [alloy], and run `keystore-audit engine install`."),
)
def engine_missing(run: EngineRun) -> Iterator[Violation]:
    """An engine is missing, and nobody asked for it by name: the other decided alone, and nothing checked it."""
    if run.status is EngineStatus.MISSING and not run.required:
        yield Violation(
            f"The engine {run.name} is not there ({sentence(run.reason)}): the properties were decided without it.",
            (),
            key=run.name,
        )


_NO_ANSWER: Final = {
    EngineStatus.MISSING: "is not there",
    EngineStatus.FAILED: "failed",
    EngineStatus.TIMEOUT: "ran out of time",
    EngineStatus.NOT_RUN: "was not run",
}


@rule(
    "KA903",
    Severity.HIGH,
    _CLAUSE,
    outside("Check it with `keystore-audit engine`, raise --timeout, or decide with --engine native."),
)
def engine_failed(run: EngineRun, context: Context) -> Iterator[Violation]:
    """An engine that was asked for by name, or was started, gave no answer. No answer never counts as "holds".

    If there was nothing to decide, see topic-classes-over-budget.
    """
    failed = run.status in (EngineStatus.FAILED, EngineStatus.TIMEOUT)
    absent = run.status in (EngineStatus.MISSING, EngineStatus.NOT_RUN) and run.required
    nothing_to_run = run.status is EngineStatus.NOT_RUN and context.meaning.over_budget is not None
    if (failed or absent) and not nothing_to_run:
        yield Violation(
            f"The engine {run.name} {_NO_ANSWER[run.status]}: {sentence(run.reason) or 'no reason was given'}.",
            (),
            undecided=True,
            key=run.name,
        )


def _disagree(answer: ProfileResult) -> bool:
    return len(set(answer.engines.values())) > 1


@rule(
    "KA904",
    Severity.CRITICAL,
    _CLAUSE,
    outside("Report this as a fault of keystore-audit, with the output of `keystore-audit model KEYSTORE -o DIR`."),
    applies=lambda result, _context: any(len(answer.engines) > 1 for answer in result.profiles.values()),
)
def engines_disagree(result: PropertyResult) -> Iterator[Violation]:
    """The engines give different answers: one of them is wrong, and neither is believed."""
    profiles = tuple(name for name, answer in result.profiles.items() if _disagree(answer))
    if profiles:
        said = "; ".join(
            f"under {name} " + ", ".join(f"{engine} says {status.value}" for engine, status in answer.engines.items())
            for name, answer in result.profiles.items()
            if name in profiles[:MAX_LISTED]
        )
        yield Violation(
            f"The engines disagree about {result.prop.id}: {said}.",
            (),
            profiles=profiles,
            undecided=True,
            key=result.prop.id,
            properties=(result.prop.id,),
        )


@rule(
    "KA905",
    Severity.HIGH,
    _CLAUSE,
    outside("Report this as a fault of keystore-audit, with the command and, if you may share it, the keystore."),
)
def rule_crashed(crash: Crash) -> Iterator[Violation]:
    """A rule ended in an error, so its question is undecided.

    Only its type is reported: the text may quote a key.
    """
    yield Violation(
        f"Rule {crash.rule} ended in an error ({crash.exception}) on {crash.subject}: its question is undecided.",
        (),
        undecided=True,
        key=f"{crash.rule} {crash.subject}",
    )


@rule(
    "KA906",
    Severity.HIGH,
    _CLAUSE,
    outside("Fix what the other findings call unread or unknown, and run the audit again."),
)
def property_undecided(result: PropertyResult, context: Context) -> Iterator[Violation]:
    """A property depends on what could not be read or is not assumed, or no engine gave an answer.

    In a mixed fleet it may also depend on whether two implementations complete a handshake with each other.

    "Holds" and "violated" are reported only if true whatever the unread parts say. Properties undecided for one reason
    are one finding; each that you assert has its own. See also engines-disagree.
    """
    profiles = _undecided(result)
    if profiles is None:
        return
    why, alike = _why(result, context), [result]
    if _is_ours(result):
        same = (profiles, why)
        alike = [each for each in context.results if _is_ours(each) and (_undecided(each), _why(each, context)) == same]
    ids = tuple(each.prop.id for each in alike)
    told = f"Undecided, since {why}: {result.prop.statement}"
    if len(alike) > 1:
        told = f"{len(alike)} properties are undecided, since {why}: {listed(ids)}."
    yield Violation(
        told,
        (*_asserted(result), *[doubt.location for doubt in context.meaning.doubts]),
        profiles=profiles,
        undecided=True,
        key="\n".join(ids),
        remedy=_undecided_remedy(result, context, why),
        shared=len(alike) > 1,
        properties=ids,
    )


def _undecided_remedy(result: PropertyResult, context: Context, why: str) -> Remedy | None:
    if _without_alloy(result, context):
        return _WITH_ALLOY
    if isinstance(result, AssertedResult) and result.reason:  # of determinism
        return _WITH_FORWARDS
    return _ONE_IMPLEMENTATION if why == _BETWEEN else None


def _is_ours(result: PropertyResult) -> bool:
    """Whether it is one of the properties that are asked of every keystore."""
    return type(result) is PropertyResult


def _undecided(result: PropertyResult) -> tuple[str, ...] | None:
    """The profiles under which it is undecided, which may be none at all; None: it is decided."""
    found = tuple(
        name for name, answer in result.profiles.items() if answer.status is Status.UNKNOWN and not _disagree(answer)
    )
    return found if found or not result.profiles else None


_BETWEEN: Final = "it is not known whether implementations that read the keystore differently talk to each other"


def _why(result: PropertyResult, context: Context) -> str:
    if isinstance(result, UserResult) and result.reason:
        return result.reason
    if any(answer.engines for answer in result.profiles.values()):
        doubts, systems = context.meaning.doubts, context.meaning.systems
        if doubts:
            return f"it depends on what is in {listed(dict.fromkeys(doubt.location.path for doubt in doubts))}"
        if lacking := {each.value for system in systems for each in WORLD - system.assumed}:
            return f"it depends on assumptions that were not made, {listed(sorted(lacking))}"
        if any(system.mixed for system in systems):
            return _BETWEEN
    return "no engine gave an answer"


_WITH_ALLOY: Final = outside(
    "Run the audit with `--engine both`; `keystore-audit engine` says whether the Alloy Analyzer is there."
)

_WITH_FORWARDS: Final = decision(
    "Declare what nodes forward with [[forward]] (docs/settings.md), or ask about fewer topics."
)


_ONE_IMPLEMENTATION: Final = decision(
    "Let the enclaves on the path run one implementation ([enclaves] in the settings). Or test the pair, and accept "
    "this finding with a [[suppression]] that says so."
)


def _without_alloy(result: PropertyResult, context: Context) -> bool:
    """Whether nobody was asked about a property that Alloy alone decides, and there was something to ask."""
    absent = (EngineStatus.MISSING, EngineStatus.NOT_RUN)
    asked = [run for run in context.engines if run.name == "alloy" and run.status not in absent]
    return isinstance(result, AlloyResult) and not asked and context.meaning.over_budget is None


def _asserted(result: PropertyResult) -> tuple[Location, ...]:
    """Where a property is asserted."""
    if isinstance(result, AssertedResult):
        return (replace(result.location, message="asserted here"),)
    return ()


@rule(
    "KA907",
    Severity.INFO,
    _CLAUSE,
    outside("Run with --engine native, or audit parts of the keystore, which is not at fault."),
)
def engine_out_of_scale(run: EngineRun) -> Iterator[Violation]:
    """The model is larger than an engine is known to decide, so it was not started: the other decided alone.

    If the engine was asked for by name, the audit is incomplete.
    """
    if run.status is EngineStatus.OUT_OF_SCALE:
        yield Violation(
            f"The model is too large for the engine {run.name}: {sentence(run.reason)}.",
            (),
            undecided=run.required,
            key=run.name,
        )


@rule(
    "KA908",
    Severity.HIGH,
    _CLAUSE,
    decision("Use fewer expressions with text between two *; each can double the number of classes of names."),
)
def topic_classes_over_budget(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """The expressions distinguish more classes of names than can be worked out, so no right was decided."""
    if context.meaning.over_budget is not None:
        yield Violation(f"No right could be decided: {sentence(context.meaning.over_budget)}.", (), undecided=True)


_ACCEPTING: Final = "keystore-audit, docs/settings.md: what is accepted has a reason, an owner and an end"


@rule(
    "KA909",
    Severity.MEDIUM,
    _ACCEPTING,
    decision(
        "Fix what was accepted, or accept it again with a reason that still holds and a new date. "
        "`keystore-audit baseline prune` removes ended entries from a baseline."
    ),
)
def suppression_expired(file: FileOfUses) -> Iterator[Violation]:
    """The date until which somebody accepted a finding has passed, so the finding counts again.

    The day ends at 23:59:59 UTC. One finding for each file, with the lines.
    """
    ended = [use for use in file.uses if use.fate is Fate.ENDED]
    if ended:
        again = len({finding.fingerprint for use in ended for finding in use.findings})
        yield Violation(
            f"{_counted(ended)} {'has' if len(ended) == 1 else 'have'} ended: {_first(ended)}. {_spoken(again)}.",
            _lines(ended),
        )


@rule(
    "KA910",
    Severity.LOW,
    _ACCEPTING,
    decision(
        "Remove the entry, so that it hides nothing later; in a baseline, `keystore-audit baseline prune` does so."
    ),
)
def suppression_unused(file: FileOfUses) -> Iterator[Violation]:
    """An entry accepts a finding that this audit does not make, or that has changed or become worse.

    It was fixed, moved or renamed, or needs other options. Entries for rules left out (--select, --ignore) are not
    checked. One finding for each file, with the lines.
    """
    unused = [use for use in file.uses if use.fate is Fate.UNUSED]
    if unused:
        yield Violation(
            f"{_counted(unused)} {'accepts' if len(unused) == 1 else 'accept'} nothing: {_first(unused)}.",
            _lines(unused),
        )


def _spoken(count: int) -> str:
    return {0: "No finding counts again", 1: "1 finding counts again"}.get(count, f"{count} findings count again")


def _counted(uses: Sequence[Use]) -> str:
    return "An entry" if len(uses) == 1 else f"{len(uses)} entries"


def _first(uses: Sequence[Use]) -> str:
    first = uses[0]
    return f"{'' if len(uses) == 1 else 'the first, '}{shorten(first.suppression.what, MAX_QUOTED)}: {first.why}"


def _lines(uses: Sequence[Use]) -> list[Location]:
    return [
        replace(use.suppression.location, message=shorten(f"{use.suppression.what}: {use.why}", MAX_QUOTED))
        for use in uses
    ]
