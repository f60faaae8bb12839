"""The report as Markdown, for a comment on a pull request: the verdict first, then findings, most of it folded away."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from keystore_audit.findings import Finding, Location, Severity
from keystore_audit.properties.result import Status
from keystore_audit.report.content import WORST_FIRST, NoReport, Report, Verdict
from keystore_audit.report.view_model import Consequences, assumed, until
from keystore_audit.text import instant, markdown, shorten, some

MAX_LENGTH: Final = 60_000
"""Characters of the whole; the comments of code hosting services take 65,536."""

LEAST: Final = 2_000
"""Characters that the report of a keystore takes at least."""

MAX_OPEN: Final = 10
"""Findings that are shown without unfolding."""

MAX_PROPERTIES: Final = 30
MAX_WEAKENED: Final = 20
MAX_KEYSTORES: Final = 100
MAX_TOLD: Final = 10
"""Properties, reasons, keystores in a list and keystores told in full: so many, and the rest is counted."""

MAX_NAME: Final = 120
"""Characters of a name or a reason in the head."""

_VERDICTS: Final = {
    Verdict.PASS: "PASS",
    Verdict.FAIL: "FAIL",
    Verdict.INCOMPLETE: "INCOMPLETE: something could not be decided",
}


def render(reports: Sequence[Report], min_severity: Severity, missing: Sequence[NoReport] = ()) -> str:
    """Return the reports one after the other; findings below `min_severity` are counted and not shown.

    Of more reports than a comment holds all are listed and the worst are told, as many as fit. `missing`: keystores
    without a report, which come first.
    """
    first = "".join(f"{line}\n" for line in _missing(missing))
    room = MAX_LENGTH - len(first)
    budget = room // max(len(reports), 1)
    if budget < LEAST:
        return first + _worst(reports, min_severity, room)
    told = [_report(report, min_severity, budget) for report in reports]
    if sum(map(len, told)) + len(told) <= room:
        return first + "\n".join(told)
    return first + _worst(reports, min_severity, room)


def _missing(missing: Sequence[NoReport]) -> Iterator[str]:
    """A tenth of the room at most."""
    if missing:
        yield f"## keystore-audit: INCOMPLETE: no report of {len(missing)}"
        yield ""
        for each in missing[:MAX_TOLD]:
            yield f"- {markdown(shorten(each.path, MAX_NAME))}: {markdown(shorten(each.reason, MAX_NAME))}"
        if len(missing) > MAX_TOLD:
            yield f"- and {len(missing) - MAX_TOLD} more"
        yield ""


def _worst(reports: Sequence[Report], least: Severity, room: int) -> str:
    """A list of all reports, and those that fit in so many characters, the worst first."""
    worst_first = sorted(reports, key=lambda report: (WORST_FIRST.index(report.verdict), report.keystore))
    lines = [f"## keystore-audit: {len(reports)} keystores", "", "| keystore | verdict | findings |", "|---|---|---|"]
    for report in worst_first[:MAX_KEYSTORES]:
        where = markdown(shorten(report.keystore, MAX_NAME))
        lines.append(f"| {where} | {report.verdict.value} | {_counts(report)} |")
    if len(reports) > MAX_KEYSTORES:
        lines += ["", f"{len(reports) - MAX_KEYSTORES} more keystores are in the full report."]
    text = "\n".join([*lines, ""])
    for number, report in enumerate(worst_first):
        told = _report(report, least, room // MAX_TOLD)
        if number == MAX_TOLD or len(text) + len(told) > room:
            return f"{text}\n{len(reports) - number} keystores are told in the full report alone.\n"
        text += f"\n{told}"
    return text


def _report(report: Report, least: Severity, budget: int) -> str:
    head, rest = [*_head(report)], [*_rest(report, budget // 4)]
    shown = [finding for finding in report.shown(least) if finding.suppressed is None]
    consequences = Consequences(shown, report.properties)
    left = budget - sum(len(line) + 1 for line in (*head, *rest))
    items: list[str] = []
    untold = len(shown)
    for cause in consequences.causes:
        finding, others, so = cause.finding, cause.others, consequences.so(cause.finding)
        item = "\n".join(_finding(finding, others, so))
        left -= len(item) + 1
        if left < 0:
            break
        items.append(item)
        untold -= 1 + len(others) + len(so)
    if len(items) > MAX_OPEN:
        items.insert(MAX_OPEN, "<details><summary>More findings</summary>\n")
        items.append("</details>\n")
    if untold:
        items.append(f"{untold} more findings are in the full report.\n")
    return "\n".join([*head, *items, *rest]) + "\n"


def _head(report: Report) -> Iterator[str]:
    scope = f" for {report.scope}" if report.scope else ""
    yield f"## keystore-audit: {_VERDICTS[report.verdict]}{scope}"
    yield ""
    yield f"{markdown(shorten(report.keystore, MAX_NAME))} at {instant(report.at)}: {_counts(report)}."
    if report.holds_if:
        yield ""
        yield f"**{markdown(report.holds_if)}**"
        yield ""
    if report.weakened:
        weakened = some((shorten(reason, MAX_NAME) for reason in report.weakened), MAX_WEAKENED)
        yield f"**This gate was weakened:** {markdown(weakened)}."
    for run in report.silent:
        yield f"**Engine {markdown(run.name)}:** {run.status.value}. {markdown(shorten(run.reason, MAX_NAME))}"
    yield ""
    if failed := [result for result in report.properties if result.status is not Status.HOLDS]:
        yield "| property | status |"
        yield "|---|---|"
        for result in failed[:MAX_PROPERTIES]:
            yield f"| {markdown(shorten(result.prop.statement, MAX_NAME))} | {result.status.value} |"
        yield ""
        if len(failed) > MAX_PROPERTIES:
            yield f"{len(failed) - MAX_PROPERTIES} more properties do not hold."
            yield ""
    told = [result for result in report.properties if result.beside]
    for result in told[:MAX_PROPERTIES]:
        yield f"{markdown(shorten(result.prop.statement, MAX_NAME))} {markdown(shorten(result.beside, 3 * MAX_NAME))}"
        yield ""
    if len(told) > MAX_PROPERTIES:
        yield f"Of {len(told) - MAX_PROPERTIES} more properties the full report says who could forge."
        yield ""


def _counts(report: Report) -> str:
    counts = [f"{count} {severity.value}" for severity, count in report.summary.items() if count]
    accepted = len(report.accepted)
    return ", ".join([*(counts or ["no findings"]), *([f"{accepted} accepted"] if accepted else [])])


def _finding(finding: Finding, others: Sequence[Finding], so: Iterable[tuple[Severity, str]]) -> Iterator[str]:
    """`others`: those that say the same of other enclaves; `so`: what follows from it."""
    yield f"- **{finding.severity.value} {finding.code} {markdown(finding.name)}** {markdown(finding.message)}  "
    if finding.locations:
        yield f"  {_places(finding.locations)}  "
    if others:
        yield f"  *Also:* {some([_of_other(other) for other in others], 3)}  "
    yield f"  *What to do:* {markdown(finding.fix.text)} ({markdown(finding.clause)})"
    for severity, sentence in so:
        yield f"  - so {severity.value} {markdown(sentence)}"
    yield ""


def _of_other(finding: Finding) -> str:
    """The enclave of which the same is to be said, and where: all may have one place, as a governance is."""
    return markdown(" ".join((finding.enclave or "", *(f"({place})" for place in finding.locations[:1]))))


def _places(locations: Sequence[Location]) -> str:
    return some([markdown(str(place)) for place in locations], 3)


def _rest(report: Report, budget: int) -> Iterator[str]:
    """What was accepted, in so many characters, and what the verdict rests on."""
    yield "<details><summary>What this rests on</summary>"
    yield ""
    end = "never" if report.safe_until is None else instant(report.safe_until)
    yield f"- Safe until: {end}. {markdown(until(report))}".rstrip()
    yield from _items("Assumed", assumed(report))
    yield from _items("Not checked", report.checked.not_checked)
    yield from _accepted(report.accepted, budget)
    yield "- Engines: " + markdown(", ".join(f"{run.name} {run.version or ''}".rstrip() for run in report.answered))
    yield f"- Keystore: SHA-256 {report.digest}; keystore-audit {markdown(report.version)}"
    yield ""
    yield "</details>"


def _accepted(findings: Sequence[Finding], budget: int) -> Iterator[str]:
    for number, finding in enumerate(findings):
        if (accepted := finding.suppressed) is not None:
            line = (
                f"- Accepted until {markdown(accepted.until)} by {markdown(shorten(accepted.owner, MAX_NAME))}: "
                f"{finding.code} {markdown(shorten(finding.message, 200))} ({markdown(shorten(accepted.reason, 200))})"
            )
            budget -= len(line) + 1
            if budget < 0:
                yield f"- {len(findings) - number} more accepted findings are in the full report."
                return
            yield line


def _items(label: str, sentences: Iterable[str]) -> Iterator[str]:
    yield from (f"- {label}: {markdown(sentence)}" for sentence in sentences)
