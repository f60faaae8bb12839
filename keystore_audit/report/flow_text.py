"""The answer of `flow` for people: by attacker, profiles that answer alike together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from keystore_audit.assumptions import holds_if
from keystore_audit.findings import Location
from keystore_audit.model.formal.claim import Attacker
from keystore_audit.properties.counterexample import Counterexample, Step
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import AssertedResult, EngineRun, EngineStatus
from keystore_audit.report.flow_json import assumptions
from keystore_audit.report.page import profiles, rests_on, unbroken, worst_first
from keystore_audit.text import MAX_EXPRESSION, shorten, terminal

_WORDS: Final = {Status.VIOLATED: "FLOW", Status.HOLDS: "no flow", Status.UNKNOWN: "UNKNOWN"}
_ASSUMED: Final = {
    Attacker.HONEST: "nobody attacks; nodes may pass on whatever they read",
    Attacker.SOURCE: "the source attacks with the keys that it holds",
    Attacker.RELAYS: "everybody on the way attacks with the keys that it holds, and so does an outsider",
}


def text(
    title: str,
    results: Sequence[tuple[Attacker, AssertedResult]],
    engines: Sequence[EngineRun],
    doubts: Sequence[Location],
    *,
    at: str,
    ambient: bool,
) -> str:
    """Lines of 80 columns at most, as far as names allow. `at`: the instant asked about."""
    lines = [terminal(title)]
    if not ambient:
        lines.append("(apart from /clock, /parameter_events, /rosout and ros_discovery_info)")
    if conditions := holds_if(assumptions(results)):
        lines.append(unbroken(f"That there is no flow {conditions}."))
    unknown = False
    shown: set[tuple[Step, ...]] = set()
    for attacker, result in results:
        lines += ["", unbroken(f"If {_ASSUMED[attacker]}:")]
        for answer, names in worst_first(
            result.profiles, lambda each: each.counterexample and each.counterexample.text
        ):
            under = profiles(names, result.profiles)
            lines.append(unbroken(under, f"  {_WORDS[answer.status]:<8} ", " " * 11))
            unknown = unknown or answer.status is Status.UNKNOWN
            if answer.counterexample is not None:
                lines += _path(answer.counterexample, shown, certain=answer.status is Status.VIOLATED)
    lines.append("")
    if unknown and doubts:
        lines.append(unbroken(rests_on(doubts)))
    for run in engines:
        reason = "" if run.status is EngineStatus.OK else f" ({run.status.value}: {run.reason})"
        lines.append(unbroken(f"{'Not decided' if reason else 'Decided'} by {run.name}{reason}."))
    later = "dates may change it, and a property with `until` in the settings asks about later days too."
    lines.append(unbroken(f"As of {at}: {later}"))
    return "\n".join(lines) + "\n"


def _path(path: Counterexample, shown: set[tuple[Step, ...]], *, certain: bool) -> list[str]:
    """The way with its lines, these once: a flow without an attack is one with any."""
    lines = [unbroken(path.text if certain else f"Perhaps: {path.text}", " " * 11, " " * 11)]
    if path.steps and path.steps in shown:
        return [*lines, unbroken("by the same lines as above", " " * 13, " " * 15)]
    shown.add(path.steps)
    for step in path.steps:
        if step.path is not None:
            line = "" if step.line is None else f":{step.line}"
            who = f"{step.enclave}, " if step.enclave is not None else ""
            by = f" by {shorten(step.expression, MAX_EXPRESSION)}" if step.expression else ""
            place = f"{step.path}{line}  ({who}{step.witness}{by})"
            lines.append(unbroken(place, " " * 13, " " * 15))
    return lines
