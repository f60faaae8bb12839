"""The report as Markdown, for a comment on a pull request: the verdict first, then findings, most of it folded away."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from keystore_audit.findings import Finding, Location, Severity
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import EngineStatus
from keystore_audit.report.content import Report, Verdict
from keystore_audit.report.encoded import instant
from keystore_audit.text import markdown, shorten

MAX_LENGTH: Final = 60_000
"""Characters of the whole; the comments of code hosting services take 65,536."""

MAX_OPEN: Final = 10
"""Findings that are shown without unfolding."""

_VERDICTS: Final = {
    Verdict.PASS: "PASS",
    Verdict.FAIL: "FAIL",
    Verdict.INCOMPLETE: "INCOMPLETE: something could not be decided",
}


def render(reports: Sequence[Report], min_severity: Severity) -> str:
    """Return the reports one after the other; findings below `min_severity` are counted and not shown."""
    budget = MAX_LENGTH // max(len(reports), 1)
    return "\n".join(_report(report, min_severity, budget) for report in reports)


def _report(report: Report, least: Severity, budget: int) -> str:
    head = [*_head(report)]
    body: list[str] = []
    shown = [finding for finding in report.findings if finding.severity.at_least(least) and finding.suppressed is None]
    used = sum(map(len, head))
    told = 0
    for number, finding in enumerate(shown):
        if number == MAX_OPEN:
            body += ["<details><summary>More findings</summary>", ""]
        item = [*_finding(finding)]
        used += sum(map(len, item)) + len(item)
        if used > budget:
            break
        body += item
        told += 1
    if told > MAX_OPEN:
        body += ["</details>", ""]
    if told < len(shown):
        body += [f"{len(shown) - told} more findings are in the full report.", ""]
    return "\n".join([*head, *body, *_rest(report)]) + "\n"


def _head(report: Report) -> Iterator[str]:
    yield f"## keystore-audit: {_VERDICTS[report.verdict]}"
    yield ""
    counts = ", ".join(f"{count} {severity.value}" for severity, count in report.summary.items() if count)
    yield f"{markdown(report.keystore)} at {instant(report.at)}: {counts or 'no findings'}."
    if report.weakened:
        yield f"**This gate was weakened:** {markdown(', '.join(report.weakened))}."
    for run in report.engines:
        if run.status not in (EngineStatus.OK, EngineStatus.NOT_RUN):
            yield f"**Engine {markdown(run.name)}:** {run.status.value}. {markdown(run.reason)}"
    yield ""
    if failed := [result for result in report.properties if result.status is not Status.HOLDS]:
        yield "| property | status |"
        yield "|---|---|"
        for result in failed:
            yield f"| {markdown(result.prop.statement)} | {result.status.value} |"
        yield ""


def _finding(finding: Finding) -> Iterator[str]:
    yield f"- **{finding.severity.value} {finding.code} {markdown(finding.name)}** {markdown(finding.message)}  "
    if finding.locations:
        yield f"  {_places(finding.locations)}  "
    yield f"  *What to do:* {markdown(finding.remedy)} ({markdown(finding.clause)})"
    yield ""


def _places(locations: Sequence[Location]) -> str:
    named = [markdown(f"{place.path}{'' if place.line is None else f':{place.line}'}") for place in locations[:3]]
    more = f" and {len(locations) - 3} more" if len(locations) > 3 else ""
    return ", ".join(named) + more


def _rest(report: Report) -> Iterator[str]:
    """What was accepted, and what the verdict rests on."""
    yield "<details><summary>What this rests on</summary>"
    yield ""
    until = "never" if report.safe_until is None else instant(report.safe_until)
    yield f"- Safe until: {until}. {markdown(report.safe_until_why)}".rstrip()
    yield from _items("Assumed", report.assumptions)
    yield from _items("Not checked", report.scope.not_checked)
    for finding in report.findings:
        if finding.suppressed is not None:
            reason = shorten(finding.suppressed.reason, 200)
            yield (
                f"- Accepted until {markdown(finding.suppressed.until)} by {markdown(finding.suppressed.owner)}: "
                f"{finding.code} {markdown(shorten(finding.message, 200))} ({markdown(reason)})"
            )
    answered = [run for run in report.engines if run.status is EngineStatus.OK]
    yield "- Engines: " + markdown(", ".join(f"{run.name} {run.version or ''}".rstrip() for run in answered))
    yield f"- Keystore: SHA-256 {report.digest}; keystore-audit {markdown(report.version)}"
    yield ""
    yield "</details>"


def _items(label: str, sentences: Iterable[str]) -> Iterator[str]:
    yield from (f"- {label}: {markdown(sentence)}" for sentence in sentences)
