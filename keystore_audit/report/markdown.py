"""The report as Markdown, for a comment on a pull request: the verdict first, then findings, most of it folded away."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, Final

from markupsafe import Markup

from keystore_audit.findings import Finding, Severity
from keystore_audit.properties.result import Status
from keystore_audit.report.content import WORST_FIRST, NoReport, Report, Verdict
from keystore_audit.report.templated import environment, ours
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

MAX_LISTED: Final = 3
"""Places of one finding, and findings that say the same."""

MAX_NAME: Final = 120
"""Characters of a name or a reason in the head."""

_VERDICTS: Final = {
    Verdict.PASS: "PASS",
    Verdict.FAIL: "FAIL",
    Verdict.INCOMPLETE: ours("INCOMPLETE: something could not be decided"),
}


def render(reports: Sequence[Report], min_severity: Severity, missing: Sequence[NoReport] = ()) -> str:
    """Return the reports one after the other; findings below `min_severity` are counted and not shown.

    Of more reports than a comment holds all are listed and the worst are told, as many as fit. `missing`: keystores
    without a report, which come first.
    """
    # Of the room, those without a report have a tenth at most.
    first = _macros().unreported(missing, MAX_TOLD, MAX_NAME) if missing else ""
    room = MAX_LENGTH - len(first)
    budget = room // max(len(reports), 1)
    if budget < LEAST:
        return first + _worst(reports, min_severity, room)
    told = [_report(report, min_severity, budget) for report in reports]
    if sum(map(len, told)) + len(told) <= room:
        return first + "\n".join(told)
    return first + _worst(reports, min_severity, room)


def _worst(reports: Sequence[Report], least: Severity, room: int) -> str:
    """A list of all reports, and those that fit in so many characters, the worst first."""
    worst_first = sorted(reports, key=lambda report: (WORST_FIRST.index(report.verdict), report.keystore))
    text: str = _macros().table(worst_first, MAX_KEYSTORES, MAX_NAME)
    for number, report in enumerate(worst_first):
        told = _report(report, least, room // MAX_TOLD)
        if number == MAX_TOLD or len(text) + len(told) > room:
            return f"{text}\n{len(reports) - number} keystores are told in the full report alone.\n"
        text += f"\n{told}"
    return text


def _report(report: Report, least: Severity, budget: int) -> str:
    macros = _macros()
    head: str = macros.head(report, MAX_PROPERTIES, MAX_NAME, MAX_WEAKENED)
    accepted = ours("").join(_accepted(report.accepted, budget // 4))
    rest: str = macros.rest(report, until(report), assumed(report), accepted)
    shown = [finding for finding in report.shown(least) if finding.suppressed is None]
    consequences = Consequences(shown, report.properties)
    left = budget - len(head) - len(rest)
    items: list[str] = []
    untold = len(shown)
    for cause in consequences.causes:
        others, so = [*map(_of_other, cause.others)], consequences.so(cause.finding)
        item = macros.cause(cause.finding, others, so)
        left -= len(item)
        if left < 0:
            break
        items.append(item)
        untold -= 1 + len(others) + len(so)
    if len(items) > MAX_OPEN:
        items.insert(MAX_OPEN, "<details><summary>More findings</summary>\n\n")
        items.append("</details>\n\n")
    if untold:
        items.append(f"{untold} more findings are in the full report.\n\n")
    return "".join([head, *items, rest])


def _counts(report: Report) -> Markup:
    counts = [f"{count} {severity.value}" for severity, count in report.summary.items() if count]
    accepted = [f"{len(report.accepted)} accepted"] if report.accepted else []
    return ours(", ".join([*(counts or ["no findings"]), *accepted]))


def _of_other(finding: Finding) -> str:
    """The enclave of which the same is to be said, and where: all may have one place, as a governance is."""
    return " ".join((finding.enclave or "", *(f"({place})" for place in finding.locations[:1])))


def _accepted(findings: Sequence[Finding], budget: int) -> Iterator[str]:
    """What was accepted, in so many characters."""
    for number, finding in enumerate(findings):
        line: str = _macros().accepted(finding, MAX_NAME)
        budget -= len(line)
        if budget < 0:
            yield ours(f"- {len(findings) - number} more accepted findings are in the full report.\n")
            return
        yield line


@cache
def _macros() -> Any:
    made = environment(markdown)
    made.filters.update(
        counts=_counts,
        instant=lambda moment: ours(instant(moment)),
        listed=lambda each: ours(some([markdown(str(one)) for one in each], MAX_LISTED)),
        ours=ours,
        shorten=shorten,
        some=some,
    )
    made.globals.update(verdicts=_VERDICTS, holds=Status.HOLDS)
    return made.get_template("markdown.md.j2").module
