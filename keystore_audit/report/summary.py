"""Many keystores on one page, and as JSON (`schemas/summary.schema.json`): and what they have in common."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, Final

from msgspec import Struct

from keystore_audit.findings import Severity
from keystore_audit.grouped import grouped
from keystore_audit.report.content import PLAIN, Report, Verdict, View
from keystore_audit.report.json import TOOL, array, document, encoded, keys, picked, total
from keystore_audit.report.page import Page
from keystore_audit.report.text import MAX_PATH
from keystore_audit.text import counted, instant, shorten

SCHEMA_VERSION: Final = 1
"""Rises when a key is removed or changes its meaning."""

MAX_NAMED: Final = 5
"""Keystores named where many have the same findings; the others are counted (text, unless it is verbose)."""

MAX_WEAKENED: Final = 10
"""Reasons why gates were laxer that are named on the page; the others are counted."""

_VERDICTS: Final = {Verdict.INCOMPLETE: "bold magenta", Verdict.FAIL: "bold red", Verdict.PASS: "bold green"}
"""In the order of the page: the worst first."""

Reason = tuple[str, str, Severity]
"""Code, name and severity of findings that fail the gate."""


class Row(Struct, frozen=True, kw_only=True):
    """What is kept of one keystore.

    `verdict` None: there is no report, and `error` says why. `failing`: what fails the gate, each code once, worst
    first, and of violated properties only those without a cause that fails it. `counts`: unsuppressed findings.
    `weakened`: what made its gate laxer than the default one, raw text.
    """

    path: str
    exit_code: int
    verdict: Verdict | None = None
    error: str = ""
    digest: str = ""
    enclaves: int = 0
    counts: Mapping[Severity, int]
    failing: tuple[Reason, ...] = ()
    safe_until: datetime | None = None
    weakened: tuple[str, ...] = ()


class Summary(Struct, frozen=True, kw_only=True):
    """A run over many keystores, in the order in which they were named.

    `not_audited`: those that an interrupt left out. `unseen`: what was not looked into, with the reason. `reports`:
    the directory of each report below where reports are, by the keystore's path.
    """

    version: str
    at: datetime
    exit_code: int
    rows: tuple[Row, ...]
    not_audited: tuple[str, ...] = ()
    unseen: tuple[tuple[str, str], ...] = ()
    reports: Mapping[str, str]
    interrupted: bool = False


def row(path: str, report: Report) -> Row:
    """What is kept of a report."""
    causes = [finding for finding in report.failing if not finding.explained_by] or report.failing
    reasons = {(finding.code, finding.name, finding.severity) for finding in causes}
    return Row(
        path=path,
        exit_code=report.exit_code,
        verdict=report.verdict,
        digest=report.digest,
        enclaves=len(report.enclaves),
        counts=report.summary,
        failing=tuple(sorted(reasons, key=lambda reason: (reason[2].rank, reason[0]))),
        safe_until=report.safe_until,
        weakened=report.weakened,
    )


def without_report(path: str, exit_code: int, error: str) -> Row:
    """What is kept of a keystore that has no report; `error`: why, raw text."""
    return Row(path=path, exit_code=exit_code, error=error, counts=dict.fromkeys(Severity, 0))


def render_json(summary: Summary, name: str) -> str:
    """Return the summary; `name`: of the report's file in each keystore's directory."""
    rows = [_row(each, f"{summary.reports[each.path]}{name}") for each in summary.rows]
    head = {
        "schema_version": SCHEMA_VERSION,
        "tool": {"name": TOOL, "version": summary.version},
        "at": instant(summary.at),
        **picked(summary, "exit_code", "interrupted"),
        "summary": total(each.counts for each in summary.rows),
        "not_audited": summary.not_audited,
        "unseen": [{"path": path, "reason": reason} for path, reason in summary.unseen],
    }
    return document([*keys(head), array("keystores", [*map(encoded, rows)])])


def _row(row: Row, report: str) -> dict[str, Any]:
    return {
        "path": row.path,
        "report": report if row.verdict else None,
        **picked(row, "verdict", "exit_code"),
        "error": row.error or None,
        "digest": row.digest or None,
        "enclaves": row.enclaves,
        "safe_until": row.safe_until and instant(row.safe_until),
        "weakened": row.weakened,
        "summary": row.counts,
        "failing": [dict(zip(("code", "name", "severity"), reason, strict=True)) for reason in row.failing],
    }


def render_text(summary: Summary, view: View = PLAIN) -> str:
    """Return a page: keystores with the same findings are one entry, those that pass are counted."""
    page = Page(width=view.width, color=view.color)
    page.put(
        (f"{TOOL} {summary.version}", "bold"),
        f": {counted(len(summary.rows), 'keystore')}, as of {instant(summary.at)}",
    )
    page.blank()
    for path, reason in summary.unseen:
        page.labelled("NOT SEEN", f"{shorten(path, MAX_PATH)}: {reason}", column=12, style="bold magenta")
    for each in summary.rows:
        if each.verdict is None:
            page.labelled("NO REPORT", each.error, column=12, style="bold magenta")
    _weakened(page, summary.rows)
    for verdict, style in _VERDICTS.items():
        if verdict is not Verdict.PASS or view.verbose:
            _entries(page, verdict, style, summary.rows, view)
    _frequent(page, summary.rows)
    _last(page, summary)
    return page.render()


def _weakened(page: Page, rows: Sequence[Row]) -> None:
    """What made gates laxer, and of how many keystores where it is not of all that have a report."""
    counts = Counter(reason for each in rows for reason in each.weakened)
    reports = sum(each.verdict is not None for each in rows)
    for reason, count in counts.most_common(MAX_WEAKENED):
        of = f" ({counted(count, 'keystore')})" if count < reports else ""
        said = f"Weakened gate: {shorten(reason, MAX_PATH)}{of}."
        page.labelled("WARNING", said, column=12, style="bold yellow")
    if len(counts) > MAX_WEAKENED:
        page.put(f"and {len(counts) - MAX_WEAKENED} more (all are in the JSON summary)", indent=12)


def _entries(page: Page, verdict: Verdict, style: str, rows: Sequence[Row], view: View) -> None:
    """The keystores of one verdict, those with the same reasons together, the largest group first."""
    groups = grouped((each for each in rows if each.verdict is verdict), lambda each: each.failing)
    for reasons, members in sorted(groups.items(), key=lambda group: -len(group[1])):
        named = members if view.verbose else members[:MAX_NAMED]
        more = f" and {len(members) - len(named):,} more" if len(named) < len(members) else ""
        codes = ", ".join(f"{code} {name}" for code, name, _severity in reasons)
        what = f"{counted(len(members), 'keystore')}" + (f": {codes}" if codes else "")
        page.labelled(verdict.value.upper(), what, column=12, style=style)
        page.put(", ".join(shorten(each.path, MAX_PATH) for each in named) + more, indent=12)


def _frequent(page: Page, rows: Sequence[Row]) -> None:
    """How many keystores each finding fails."""
    counts = Counter(reason for each in rows for reason in each.failing)
    if len(rows) < 2 or not counts:
        return
    page.blank()
    page.put(("Findings that fail the gate", "bold underline"))
    worst_first = sorted(counts.items(), key=lambda item: (item[0][2].rank, -item[1], item[0][0]))
    for (code, name, severity), count in worst_first:
        page.labelled(severity.value, f"{code} {name}: {counted(count, 'keystore')}", indent=2, column=12)


def _last(page: Page, summary: Summary) -> None:
    counts = Counter(each.verdict for each in summary.rows)
    words = [f"{counts[verdict]:,} {verdict.value}" for verdict in _VERDICTS]
    if counts[None]:
        words.insert(0, f"{counts[None]:,} without a report")
    ends = min((each.safe_until for each in summary.rows if each.safe_until is not None), default=None)
    page.blank()
    if ends is not None:
        page.put(f"The first of these answers that changes does so at {instant(ends)}.")
    if summary.interrupted:
        page.put(("INTERRUPTED", "bold magenta"), f": {counted(len(summary.not_audited), 'keystore')} not audited.")
    page.put((counted(len(summary.rows), "keystore"), "bold"), f": {', '.join(words)}; exit code {summary.exit_code}")
