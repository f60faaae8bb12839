"""The report for people: one screen at 80 columns, the verdict first, then causes, worst first over the keystore.

It ends with a line each of what was decided, what that rests on, what was not checked and how long it lasts.
Nothing is said by colour alone. Every name is escaped in `report.page`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from keystore_audit.assumptions import CONDITIONS
from keystore_audit.findings import OF_NETWORKS, Finding, Result, Severity
from keystore_audit.profiles import facts, implementations, shipped_by
from keystore_audit.properties.result import AssertedResult, Status
from keystore_audit.report.causes_text import (
    MAX_NAMED,
    put_accepted,
    put_full,
    put_headings,
    put_short,
)
from keystore_audit.report.content import NOT_CHECKED, PEERS_IN_SCOPE, PLAIN, NoReport, Report, Verdict, View
from keystore_audit.report.json import TOOL
from keystore_audit.report.page import Page
from keystore_audit.report.text_details import UNCHANGED, put_details, put_rows
from keystore_audit.report.view_model import Cause, Consequences, warnings
from keystore_audit.text import counted, instant, shorten, some
from keystore_audit.truth import Truth

MAX_PATH: Final = 400
"""Characters of a path on a page about several keystores."""

MAX_TITLE: Final = 60
"""Characters of the keystore's path in the title, which is cut in the middle: its ends tell it apart."""

MAX_NOT_CHECKED: Final = 2
"""Of what was not checked, so much is named; -v has all in full."""

MAX_CODES: Final = 12
"""Rules named that left something open."""

_VERDICT_STYLE: Final = {
    Verdict.PASS: "bold green",
    Verdict.FAIL: "bold white on red",
    Verdict.INCOMPLETE: "bold black on yellow",
}
_WARNING_STYLE: Final = "bold yellow"


def render(report: Report, view: View = PLAIN) -> str:
    """Return the report of one keystore as text that ends in a newline."""
    page = Page(width=view.width, color=view.color)
    every = Consequences(report.findings, report.properties)
    shown = report.shown(view.min_severity)
    consequences = every if len(shown) == len(report.findings) else Consequences(shown, report.properties)
    if not view.quiet:
        _audited(page, report)
    _verdict(page, report, every.causes)
    if report.holds_if and (view.quiet or view.verbose):  # else it has a line below the causes
        page.put((report.holds_if, "bold"))
    if view.quiet:
        put_headings(page, report, every)
        return page.render()
    if view.verbose:
        put_full(page, report, consequences)
        put_accepted(page, [finding for finding in shown if finding.suppressed is not None])
        put_details(page, report)
    else:
        put_short(page, report, consequences)
        _in_short(page, report)
    if hidden := len(report.findings) - len(shown):
        page.put(f"{hidden} below {view.min_severity.value} not shown (--min-severity).")
    return page.render()


def render_several(reports: Sequence[Report], view: View = PLAIN, missing: Sequence[NoReport] = ()) -> str:
    """Return the reports in the order given, those that are `missing`, and a line that sums them up."""
    parts = [render(report, view) for report in reports]
    verdicts = [report.verdict for report in reports]
    return "\n".join([*parts, render_total(verdicts, missing, width=view.width, color=view.color)])


def render_total(verdicts: Sequence[Verdict], missing: Sequence[NoReport], *, width: int, color: bool) -> str:
    """Return the line that sums up several reports, after one for each keystore that has none."""
    counts = Counter(verdicts)
    page = Page(width=width, color=color)
    for each in missing:
        said = f"{shorten(each.path, MAX_PATH)}: {each.reason}"
        page.labelled("NO REPORT", said, column=11, style="bold magenta")
    words = [f"{counts[verdict]} {verdict.value}" for verdict in Verdict]
    if missing:
        words.insert(0, f"{len(missing)} without a report")
    page.put((f"{len(verdicts) + len(missing)} keystores: {', '.join(words)}", "bold"))
    return page.render()


def _audited(page: Page, report: Report) -> None:
    """What is judged."""
    page.put(
        (f"{TOOL} {report.version}", "bold"),
        f"  {shorten(report.keystore, MAX_TITLE)}  "
        f"({report.layout}, {counted(len(report.enclaves), 'enclave')}, {report.at:%Y-%m-%d})",
    )


def _verdict(page: Page, report: Report, causes: Sequence[Cause]) -> None:
    """The verdict and its exit code, the causes by severity, for which implementations, and what weakens it."""
    counts = Counter(cause.severity for cause in causes)
    worst = min((cause.severity for cause in causes), key=lambda each: each.rank, default=None)
    told = [_counted_at(counts[severity], severity, severity is worst) for severity in Severity if counts[severity]]
    following = sum(len(cause.follow) + len(cause.stay) for cause in causes)
    besides = ((following, "that follow"), (len(report.accepted), "accepted"))
    beside = ", ".join(f"{count} {what}" for count, what in besides if count)
    beside = f" ({beside})" if beside else ""
    passed = f" for {report.scope}" if report.scope and report.verdict is Verdict.PASS else ""
    page.put(
        (f"{report.verdict.value.upper()}{passed}", _VERDICT_STYLE[report.verdict]),
        f"  {', '.join(told) or 'No findings'}{beside}; exit code {report.exit_code}",
    )
    if report.scope and not passed:
        page.put(f"scope: {report.scope}", indent=6)
    if report.network:
        page.put(f"judged too: {facts.ROUTED_SCOPE.format(shorten(report.network, MAX_TITLE))}", indent=6)
    deciding = [each for cause in causes for each in cause.every if each.fails(report.fail_on) or each.undecided]
    if report.verdict is not Verdict.PASS and deciding:
        page.put(f"{_BECAUSE[report.verdict]} {_whose(report, deciding)}", indent=6)
    if report.verdict is Verdict.INCOMPLETE:
        undecided = sorted(report.outcomes.some(Result.OPEN))
        rules = f" (open: {some(undecided, MAX_CODES)})" if undecided else ""
        page.put(f"Something could not be decided{rules}: this is no pass, whatever the counts say.", indent=6)
    for warning in warnings(report):
        page.labelled("WARNING", warning, column=9, style=_WARNING_STYLE)


_BY_FILES: Final = "KA828"
_BECAUSE: Final = {Verdict.FAIL: "fails on", Verdict.INCOMPLETE: "undecided on"}


def _counted_at(count: int, severity: Severity, worst: bool) -> str:
    if severity is Severity.INFO:
        return counted(count, "note")
    return f"{counted(count, 'cause')} at {severity.value}" if worst else f"{count} {severity.value}"


def _whose(report: Report, deciding: Sequence[Finding]) -> str:
    """The implementations for which these findings decide."""
    if all(each.code.startswith(OF_NETWORKS) for each in deciding):
        return facts.ROUTED_BY_FILES
    judged = report.judged_profiles
    concerned = {name for each in deciding for name in each.profiles or judged}
    names = [name for name in judged if name in concerned]
    if len(names) == len(judged):
        shipped = f" ({shipped_by(judged)})" if shipped_by(judged) else ""
        return f"every implementation judged{shipped}"
    return f"{implementations(names)} only"


def _in_short(page: Page, report: Report) -> None:
    """A line each of who cannot start, what was decided and accepted, what it rests on, and how long it lasts."""
    page.blank()
    starts = {each.path: {use.usable for use in each.profiles.values()} for each in report.enclaves}
    for usable, wherever, words in (
        (Truth.NO, True, "its DDS participant starts nowhere"),
        (Truth.NO, False, "its DDS participant does not start everywhere"),
        (Truth.UNKNOWN, False, "unknown whether its DDS participant starts"),
    ):
        if paths := [path for path, uses in starts.items() if usable in uses and (uses == {Truth.NO}) is wherever]:
            put_rows(page, "Enclaves", [f"{some(paths, MAX_NAMED)}: {words} (-v)"])
    if report.accepted:
        put_rows(page, "Accepted", [f"{counted(len(report.accepted), 'finding')}, not counted (-v)"])
    if report.properties:
        put_rows(page, "Properties", [_decided(report)])
    conditions = [each.condition for each in report.assumptions if each.needed_by and each.assumption in CONDITIONS]
    others = len(report.assumptions) + len(report.stated) - len(conditions) - bool(report.scope) - bool(report.network)
    if report.scope:
        conditions.insert(0, PEERS_IN_SCOPE)
    if report.network:
        conditions.insert(0, facts.ROUTED_IF)
    if conditions or others:
        put_rows(page, "Holds if", [f"{'; '.join([*conditions, *_more(others)])} (-v)"])
    if report.checked.not_checked:
        known = [words for words, said in NOT_CHECKED.items() if said in report.checked.not_checked][:MAX_NOT_CHECKED]
        more = _more(len(report.checked.not_checked) - len(known))
        put_rows(page, "Not checked", [f"{', '.join([*known, *more])} (-v)"])
    if report.safe_until is None:
        put_rows(page, "Valid", [UNCHANGED])
    else:
        holds = "Valid until" if report.verdict is Verdict.PASS else "Changes at"
        put_rows(page, holds, [f"{instant(report.safe_until)} (-v)"])


def _more(number: int) -> list[str]:
    return [f"{number} more"] if number else []


def _decided(report: Report) -> str:
    """How many properties hold, and who says so."""
    undecided = sum(each.status is Status.UNKNOWN for each in report.properties)
    unknown = f", {undecided} unknown" if undecided else ""
    reserved = sum(bool(each.beside) for each in report.properties)
    beside = f", {reserved} with a reservation (-v)" if reserved else ""
    answered = [run.name for run in report.answered]
    beside += f" {facts.ROUTED_ENFORCES_NONE}" if report.network else ""
    asserted = any(isinstance(each, AssertedResult) for each in report.properties)
    if report.network and asserted and _BY_FILES in report.outcomes.some(Result.PASS):
        beside += facts.ROUTED_VIOLATE_NONE
    agree = {True: f"{' and '.join(answered)} agree", None: f"{', '.join(answered) or 'no engine'} alone"}
    engines = agree.get(report.engines_agree, "the engines disagree")
    return f"{len(report.holding)} of {len(report.properties)} hold{unknown}{beside} ({engines})"
