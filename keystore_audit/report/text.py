"""The report for people: readable at 80 columns, worst first, grouped by enclave.

It begins with what the verdict rests on and ends with what was checked, what was not, and the verdict.
Nothing is said by colour alone. Every name is escaped in `report.page`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

from keystore_audit.dataclass import dataclass, replace
from keystore_audit.findings import Finding, Outcomes, Result, Severity
from keystore_audit.grouped import grouped
from keystore_audit.model.meaning import Usability
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import ProfileResult, PropertyResult
from keystore_audit.report import authorities_text, ranking
from keystore_audit.report.content import EnclaveEntry, NoReport, Report, Verdict
from keystore_audit.report.engine_words import ENGINE_WORDS, sentence, until, warnings
from keystore_audit.report.findings_text import put_findings
from keystore_audit.report.json import TOOL
from keystore_audit.report.next_step import next_step
from keystore_audit.report.page import Page
from keystore_audit.report.paragraph import by_answer, worst_first
from keystore_audit.report.ros_nodes import nodes_beside
from keystore_audit.text import counted, instant, shorten, some

MAX_ENCLAVES: Final = 20
"""Enclaves listed by name where all is well; those that cannot start are always named."""

MAX_PATH: Final = 400
"""Characters of a path on a page about several keystores."""

MAX_TITLE: Final = 60
"""Characters of the keystore's path in the title, which is cut in the middle: its ends tell it apart."""

_STATUS_STYLE: Final = {Status.HOLDS: "green", Status.VIOLATED: "bold red", Status.UNKNOWN: "bold yellow"}
_VERDICT_STYLE: Final = {
    Verdict.PASS: "bold green",
    Verdict.FAIL: "bold white on red",
    Verdict.INCOMPLETE: "bold black on yellow",
}
_WARNING_STYLE: Final = "bold yellow"


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """How to show a report; nothing here changes what it says.

    `width` in columns. `min_severity` hides findings below it, and the report says how many. `quiet`: the
    verdict and what brought it about. `verbose`: the outcome of every rule too.
    """

    width: int = 80
    color: bool = False
    quiet: bool = False
    verbose: bool = False
    min_severity: Severity = Severity.INFO


PLAIN: Final = View()


def render(report: Report, view: View = PLAIN) -> str:
    """Return the report of one keystore as text that ends in a newline."""
    page = Page(width=view.width, color=view.color)
    if view.quiet:
        put_findings(page, report, _decisive(report))
    else:
        _opening(page, report)
        put_findings(page, report, report.shown(view.min_severity))
        if not report.findings:
            page.blank()
            page.put("No findings.")
        _enclaves(page, report.enclaves)
        if beside := nodes_beside(report.findings):
            page.put(beside, indent=2)
        _properties(page, report.properties)
        if view.verbose:
            authorities_text.put(page, report)
            ranking.put(page, report.blast_radius or ())
            _outcomes(page, report.outcomes)
        _checked(page, report, verbose=view.verbose)
    page.blank()
    _verdict(page, report, view)
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
        page.labelled("NO REPORT", said, indent=0, column=11, style="bold magenta")
    words = [f"{counts[verdict]} {verdict.value}" for verdict in Verdict]
    if missing:
        words.insert(0, f"{len(missing)} without a report")
    page.put((f"{len(verdicts) + len(missing)} keystores: {', '.join(words)}", "bold"))
    return page.render()


def _opening(page: Page, report: Report) -> None:
    """What is judged, and everything that the verdict rests on or that weakens it."""
    page.put(
        (f"{TOOL} {report.version}", "bold"),
        f": {shorten(report.keystore, MAX_TITLE)} "
        f"({report.layout} layout, {counted(len(report.enclaves), 'enclave')}), as of {instant(report.at)}",
    )
    page.blank()
    for number, assumed in enumerate((*(each.sentence for each in report.assumptions), *report.stated)):
        page.labelled("" if number else "Assumed", assumed, indent=0, column=9, style="bold")
    for warning in warnings(report):
        page.labelled("WARNING", warning, indent=0, column=9, style=_WARNING_STYLE)


def _open(report: Report) -> set[str]:
    """The rules that left something open."""
    return report.outcomes.some(Result.OPEN)


def _decisive(report: Report) -> tuple[Finding, ...]:
    """The findings that brought the verdict about: at or above the gate, or leaving a question open."""
    undecided = _open(report)
    gate = report.fail_on
    return tuple(
        finding
        for finding in report.findings
        if (gate is not None and finding.severity.at_least(gate)) or finding.code in undecided
    )


def _enclaves(page: Page, enclaves: Sequence[EnclaveEntry]) -> None:
    """Who can start: those that cannot by their reasons, the others in one line."""
    if not enclaves:
        return
    page.blank()
    page.put(("Enclaves", "bold underline"))
    starting = [entry.path for entry in enclaves if all(use.usable for use in entry.profiles.values())]
    others = (entry for entry in enclaves if not all(use.usable for use in entry.profiles.values()))
    for same, alike in grouped(others, _own_words).items():
        entry, several = alike[0], len(alike) > 1
        page.put(
            (", ".join(each.path for each in alike), "bold"), "" if several else f"  ({entry.directory})", indent=2
        )
        for usability, names in by_answer(dict(same) if several else entry.profiles).items():
            reasons = "; ".join(reason.rstrip(".") for reason in usability.reasons)
            why = f": {reasons}" if reasons else ""
            page.put(f"{_START_WORDS[usability.usable]} {_under(names, len(same))}{why}.", indent=4)
    if starting:
        page.put(f"{some(starting, MAX_ENCLAVES)}: can start under all profiles.", indent=2)


def _own_words(entry: EnclaveEntry) -> tuple[tuple[str, Usability], ...]:
    """Whether it starts, as it would be said of any other enclave for which the same is so."""
    own = entry.subject or entry.path
    return tuple(
        (name, replace(use, reasons=tuple(reason.replace(own, "its identity") for reason in use.reasons)))
        for name, use in entry.profiles.items()
    )


_START_WORDS: Final[Mapping[bool | None, str]] = {
    True: "can start",
    False: "CANNOT START",
    None: "UNKNOWN whether it can start,",
}


def _under(names: Sequence[str], total: int) -> str:
    return "under all profiles" if len(names) == total else f"under {', '.join(names)}"


def _properties(page: Page, results: Sequence[PropertyResult]) -> None:
    """One line a property and answer: equal answers of several profiles are one."""
    if not results:
        return
    page.blank()
    page.put(("Properties", "bold underline"))
    column = 12 + 2 + max(len(result.prop.id) for result in results)
    for result in results:
        groups = worst_first(result.profiles, _engines)
        for answer, names in groups:
            status = answer.status
            word = status.value if status is Status.HOLDS else status.value.upper()
            label = f"{word:<10}{result.prop.id}"
            whose = ", all profiles" if len(groups) == 1 else ", all others" if names is groups[-1][1] else ""
            under = ", ".join(each.value for each in result.needs) if status is Status.HOLDS else ""
            told = f"; if {under}" if under else ""
            page.labelled(label, _engines(answer) + whose + told, indent=2, column=column, style=_STATUS_STYLE[status])
            if not whose:
                page.put(f"under {', '.join(names)}", indent=12)
        if result.beside:
            page.put(result.beside, indent=12)


def _engines(answer: ProfileResult) -> str:
    """Who gave it; where they do not agree, what each says."""
    each = (f"{engine} says {status.value}" for engine, status in answer.engines.items())
    agree = set(answer.engines.values()) <= {answer.status}
    return ", ".join(answer.engines if agree else each) or "no engine"


def _outcomes(page: Page, outcomes: Outcomes) -> None:
    """Per rule, how often it passed, failed, did not apply or stayed open, and what stayed open."""
    page.blank()
    page.put(("Outcomes", "bold underline"))
    for rule, each in sorted(grouped(outcomes, lambda outcome: outcome.rule).items()):
        counts = Counter(outcome.outcome for outcome in each)
        words = ", ".join(f"{counts[result]} {_RESULT_WORDS[result]}" for result in Result if counts[result])
        open_subjects = [outcome.subject for outcome in each if outcome.outcome is Result.OPEN]
        subjects = f": {', '.join(open_subjects)}" if open_subjects else ""
        page.labelled(rule, words + subjects, indent=2, column=9, style="bold")


_RESULT_WORDS: Final = {
    Result.PASS: "pass",
    Result.FAIL: "fail",
    Result.NOT_APPLICABLE: "not applicable",
    Result.OPEN: "open",
}


def _checked(page: Page, report: Report, *, verbose: bool) -> None:
    """What was looked at, by whom, what was not, and when the answer changes by itself."""
    scope = report.scope
    page.blank()
    roots = ", ".join(report.roots)
    page.labelled(
        "Checked",
        f"{scope.certificates} certificates, {scope.documents} signed documents, {scope.channels} topic "
        f"channels, with {scope.rules} rules, under {', '.join(report.judged_profiles) or 'no profile'}"
        f"{f', links into {roots} followed' if report.roots else ''}.",
        indent=0,
        column=13,
        style="bold",
    )
    for run in report.engines:
        version = f" {run.version}" if run.version else ""
        words = f"{run.name}{version} {ENGINE_WORDS[run.status]}"
        reason = f": {run.reason}" if run.reason else ""
        size = f", asked about {run.atoms[1]} of {run.atoms[0]} atoms" if verbose and run.atoms else ""
        page.labelled("Engine", sentence(words + size + reason), indent=0, column=13, style="bold")
    for number, unchecked in enumerate(scope.not_checked):
        page.labelled("" if number else "Not checked", unchecked, indent=0, column=13, style="bold")
    if report.safe_until is None:
        dates = "No date on these files changes this answer."
    else:
        holds = "Holds until" if report.verdict is Verdict.PASS else "Changes at"
        dates = f"{holds} {instant(report.safe_until)}: {until(report)}"
    page.labelled("Dates", dates, indent=0, column=13, style="bold")


def _verdict(page: Page, report: Report, view: View) -> None:
    """The last paragraph: the verdict, its exit code, the counts and what is not shown."""
    counts = ", ".join(f"{count} {severity.value}" for severity, count in report.summary.items())
    accepted = len(report.accepted)
    counts += f"; {accepted} accepted" if accepted else ""
    least = report.fail_on
    gate = "never fails on findings" if least is None else f"fails at {least.value} or worse"
    page.put(
        (report.verdict.value.upper(), _VERDICT_STYLE[report.verdict]),
        f"  {shorten(report.keystore, MAX_TITLE)}: {counts}",
        f"; {gate}; exit code {report.exit_code}",
    )
    if report.holds_if:
        page.put((report.holds_if, "bold"))
    if report.verdict is Verdict.INCOMPLETE:
        undecided = sorted(_open(report))
        rules = f" (open: {', '.join(undecided)})" if undecided else ""
        page.put(f"Something could not be decided{rules}: this is no pass, whatever the counts say.")
    if view.quiet and report.weakened:
        page.put(f"Weakened gate: {'; '.join(report.weakened)}.")
    hidden = len(report.findings) - len(report.shown(view.min_severity))
    if hidden and not view.quiet:
        page.put(f"{hidden} below {view.min_severity.value} not shown (--min-severity).")
    step = next_step(report)
    if step and not view.quiet:
        page.put(step)
