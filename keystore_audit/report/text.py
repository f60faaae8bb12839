"""The report for people: readable at 80 columns, worst first, grouped by enclave.

It begins with what the verdict rests on and ends with what was checked, what was not, and the verdict.
Nothing is said by colour alone. Every name is escaped in `report.page`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from keystore_audit.dataclass import dataclass
from keystore_audit.findings import Finding, Outcome, Result, Severity
from keystore_audit.model.meaning import Usability
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import EngineRun, EngineStatus, ProfileResult, PropertyResult
from keystore_audit.report import ranking
from keystore_audit.report.consequences import Consequences
from keystore_audit.report.content import EnclaveEntry, NoReport, Report, Verdict
from keystore_audit.report.encoded import instant
from keystore_audit.report.json import TOOL
from keystore_audit.report.next_step import OF_THE_AUDIT, next_step
from keystore_audit.report.page import Page, Piece
from keystore_audit.report.total import render_total
from keystore_audit.text import shorten

MAX_PLACES: Final = 6
"""Places shown of one finding: a defect of 1,000 files is understood from a few; JSON has them all."""

MAX_ALIKE: Final = 200
"""Findings of one code below one heading, the worst first: a hostile document has thousands; JSON has them all."""

MAX_ENCLAVES: Final = 20
"""Enclaves listed by name where all is well; those that cannot start are always named."""

MAX_TITLE: Final = 60
"""Characters of the keystore's path in the title, which is cut in the middle: its ends tell it apart."""

_SEVERITY_STYLE: Final = {
    Severity.CRITICAL: "bold white on red",
    Severity.HIGH: "bold red",
    Severity.MEDIUM: "bold yellow",
    Severity.LOW: "cyan",
    Severity.INFO: "dim",
}
_STATUS_STYLE: Final = {Status.HOLDS: "green", Status.VIOLATED: "bold red", Status.UNKNOWN: "bold yellow"}
_VERDICT_STYLE: Final = {
    Verdict.PASS: "bold green",
    Verdict.FAIL: "bold white on red",
    Verdict.INCOMPLETE: "bold black on yellow",
}
_WARNING_STYLE: Final = "bold yellow"
_ENGINE_WORDS: Final = {
    EngineStatus.OK: "answered",
    EngineStatus.MISSING: "is missing",
    EngineStatus.FAILED: "failed",
    EngineStatus.TIMEOUT: "ran out of time",
    EngineStatus.OUT_OF_SCALE: "was not started, the model being too large for it",
    EngineStatus.NOT_RUN: "was not asked",
}


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


def render(report: Report, view: View | None = None) -> str:
    """Return the report of one keystore as text that ends in a newline."""
    view = view or View()
    page = Page(width=view.width, color=view.color)
    if view.quiet:
        _findings(page, report, _decisive(report))
    else:
        _opening(page, report)
        _findings(page, report, _shown(report, view.min_severity))
        if not report.findings:
            page.blank()
            page.put("No findings.")
        _enclaves(page, report.enclaves)
        _properties(page, report.properties)
        if view.verbose:
            ranking.put(page, report.blast_radius or ())
            _outcomes(page, report.outcomes)
        _checked(page, report, verbose=view.verbose)
    page.blank()
    _verdict(page, report, view)
    return page.render()


def render_several(reports: Sequence[Report], view: View | None = None, missing: Sequence[NoReport] = ()) -> str:
    """Return the reports in the order given, those that are `missing`, and a line that sums them up."""
    view = view or View()
    parts = [render(report, view) for report in reports]
    verdicts = [report.verdict for report in reports]
    return "\n".join([*parts, render_total(verdicts, missing, width=view.width, color=view.color)])


def _opening(page: Page, report: Report) -> None:
    """What is judged, and everything that the verdict rests on or that weakens it."""
    many = "" if len(report.enclaves) == 1 else "s"
    page.put(
        (f"{TOOL} {report.version}", "bold"),
        f": {shorten(report.keystore, MAX_TITLE)} "
        f"({report.layout} layout, {len(report.enclaves)} enclave{many}), as of {instant(report.at)}",
    )
    page.blank()
    for number, assumption in enumerate(report.assumptions):
        page.labelled("" if number else "Assumed", assumption, indent=0, column=9, style="bold")
    for warning in _warnings(report):
        page.labelled("WARNING", warning, indent=0, column=9, style=_WARNING_STYLE)


def _warnings(report: Report) -> Iterable[str]:
    answered = [run.name for run in report.engines if run.status is EngineStatus.OK]
    for run in report.engines:
        if run.status in (EngineStatus.OK, EngineStatus.NOT_RUN):
            continue
        rest = f" The properties rest on {' and '.join(answered)} alone." if answered else ""
        yield f"{_engine_words(run)}{rest}"
    if not answered:
        yield "No engine has answered: no property was decided."
    if report.engines_agree is False:
        yield "The engines disagree: wherever they do, the answer is unknown."
    for reason in report.weakened:
        yield f"Weakened gate: {_sentence(reason)}"


def _engine_words(run: EngineRun) -> str:
    reason = f": {run.reason}" if run.reason else ""
    return _sentence(f"The {run.name} engine {_ENGINE_WORDS[run.status]}{reason}")


def _sentence(text: str) -> str:
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _shown(report: Report, least: Severity) -> tuple[Finding, ...]:
    return tuple(finding for finding in report.findings if finding.severity.at_least(least))


def _decisive(report: Report) -> tuple[Finding, ...]:
    """The findings that brought the verdict about: at or above the gate, or leaving a question open."""
    undecided = {outcome.rule for outcome in report.outcomes if outcome.outcome is Result.OPEN}
    gate = report.fail_on
    return tuple(
        finding
        for finding in report.findings
        if (gate is not None and finding.severity.at_least(gate)) or finding.code in undecided
    )


def _findings(page: Page, report: Report, shown: tuple[Finding, ...]) -> None:
    """Each enclave's findings, the enclave with the worst one first; the whole keystore is a group too."""
    consequences = Consequences(shown, report.properties)
    groups: dict[str | None, list[tuple[tuple[int, bool], Finding]]] = {}
    for finding in shown:
        if finding.suppressed is None and not consequences.told_elsewhere(finding):
            # Causes come before what they leave open.
            rank = consequences.rank(finding), finding.code.startswith(OF_THE_AUDIT)
            groups.setdefault(finding.enclave, []).append((rank, finding))
    profiles = frozenset(_chosen_profiles(report))
    explained: set[tuple[str, str, str]] = set()
    ordered = sorted(groups.items(), key=lambda group: (min(rank for rank, _ in group[1]), group[0] or ""))
    for enclave, ranked in ordered:
        page.blank()
        page.put((enclave or "The keystore as a whole", "bold underline"))
        told: Counter[str] = Counter()
        for _, finding in sorted(ranked, key=lambda entry: entry[0]):  # stable: else the report's order
            told[finding.code] += 1
            if told[finding.code] > MAX_ALIKE:
                continue
            page.blank()
            _finding(page, finding, profiles)
            _what_to_do(page, finding, explained)
            _consequences(page, consequences.of(finding))
        for code, more in (told - Counter(dict.fromkeys(told, MAX_ALIKE))).items():
            page.blank()
            page.put(f"and {more} more of {code} (all are in the JSON report)", indent=2)
    _suppressed(page, [finding for finding in shown if finding.suppressed is not None])


def _finding(page: Page, finding: Finding, profiles: frozenset[str]) -> None:
    """What was found, where, and for which implementations."""
    severity = finding.severity
    page.put((severity.value.upper(), _SEVERITY_STYLE[severity]), f"  {finding.code} {finding.name}", indent=2)
    page.put(finding.message, indent=4)
    for number, place in enumerate(finding.locations[:MAX_PLACES]):
        line = "" if place.line is None else f":{place.line}"
        note = f"  ({place.message})" if place.message else ""
        where: tuple[Piece, ...] = ((f"{place.path}{line}", "bold"), (note, ""))
        page.labelled("where" if number == 0 else "", *where, indent=4, column=12)
    if len(finding.locations) > MAX_PLACES:
        more = len(finding.locations) - MAX_PLACES
        page.put(f"and {more} more places (all are in the JSON report)", indent=12)
    if finding.profiles and not profiles <= frozenset(finding.profiles):
        page.labelled("under", ", ".join(finding.profiles), indent=4, column=12)


def _what_to_do(page: Page, finding: Finding, explained: set[tuple[str, str, str]]) -> None:
    """Clause and remedy, in full where they come first: a keystore repeats a defect in many enclaves."""
    key = (finding.code, finding.clause, finding.remedy)
    if key in explained:
        page.labelled("remedy", f"as for {finding.code} above", indent=4, column=12)
        return
    explained.add(key)
    for label, text in (("clause", finding.clause), ("remedy", finding.remedy)):
        if text:
            page.labelled(label, text, indent=4, column=12)


def _consequences(page: Page, consequences: Iterable[tuple[Finding, str]]) -> None:
    for consequence, example in consequences:
        page.labelled(
            "so",
            (consequence.severity.value.upper(), _SEVERITY_STYLE[consequence.severity]),
            f" {consequence.code}: property {consequence.name} is violated, e.g. {example}",
            indent=4,
            column=12,
        )


def _suppressed(page: Page, findings: Sequence[Finding]) -> None:
    """What somebody accepts, with who, why and until when."""
    if not findings:
        return
    page.blank()
    page.put((f"Accepted findings, not counted: {len(findings)}", "bold underline"))
    for finding in findings:
        if (accepted := finding.suppressed) is not None:
            severity = finding.severity
            page.put((severity.value.upper(), _SEVERITY_STYLE[severity]), f"  {finding.code} {finding.name}", indent=2)
            page.put(finding.message, indent=4)
            until = f"until {accepted.until} by {accepted.owner} ({accepted.source})"
            page.labelled("accepted", until, indent=4, column=14)
            page.labelled("reason", accepted.reason, indent=4, column=14)


def _chosen_profiles(report: Report) -> tuple[str, ...]:
    """The profiles that this audit judged under, in the report's order."""
    judged = [entry.profiles for entry in report.enclaves] + [result.profiles for result in report.properties]
    return tuple(dict.fromkeys(name for profiles in judged for name in profiles))


def _enclaves(page: Page, enclaves: Sequence[EnclaveEntry]) -> None:
    """Who can start: those that cannot with their reasons, the others in one line."""
    if not enclaves:
        return
    page.blank()
    page.put(("Enclaves", "bold underline"))
    starting = [entry.path for entry in enclaves if all(use.usable for use in entry.profiles.values())]
    for entry in enclaves:
        groups = _fold(entry.profiles)
        if all(usability.usable for usability, _ in groups):
            continue
        page.put((entry.path, "bold"), f"  ({entry.directory})", indent=2)
        for usability, names in groups:
            under = _under(names, len(entry.profiles))
            reasons = " ".join(_sentence(reason) for reason in usability.reasons)
            page.put(f"{_START_WORDS[usability.usable]} {under}. {reasons}".rstrip(), indent=4)
    if starting:
        listed = ", ".join(starting[:MAX_ENCLAVES])
        rest = f" and {len(starting) - MAX_ENCLAVES} more" if len(starting) > MAX_ENCLAVES else ""
        page.put(f"{listed}{rest}: can start under all profiles.", indent=2)


_START_WORDS: Final[Mapping[bool | None, str]] = {
    True: "can start",
    False: "CANNOT START",
    None: "UNKNOWN whether it can start",
}


def _fold(answers: Mapping[str, Usability]) -> list[tuple[Usability, list[str]]]:
    groups: dict[Usability, list[str]] = {}
    for name, usability in answers.items():
        groups.setdefault(usability, []).append(name)
    return list(groups.items())


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
        groups = _answers(result.profiles)
        for (status, engines), names in groups:
            word = status.value if status is Status.HOLDS else status.value.upper()
            label = f"{word:<10}{result.prop.id}"
            inline = ", all profiles" if len(groups) == 1 else ", all others" if names is groups[-1][1] else ""
            page.labelled(label, engines + inline, indent=2, column=column, style=_STATUS_STYLE[status])
            if not inline:
                page.put(f"under {', '.join(names)}", indent=12)


def _answers(profiles: Mapping[str, ProfileResult]) -> list[tuple[tuple[Status, str], list[str]]]:
    """Profiles by equal answer, the worst answer first."""
    groups: dict[tuple[Status, str], list[str]] = {}
    for name, result in profiles.items():
        statuses = set(result.engines.values())
        each = (f"{engine} says {status.value}" for engine, status in result.engines.items())
        engines = ", ".join(result.engines if statuses <= {result.status} else each) or "no engine"
        groups.setdefault((result.status, engines), []).append(name)
    order = [Status.UNKNOWN, Status.VIOLATED, Status.HOLDS]
    return sorted(groups.items(), key=lambda group: order.index(group[0][0]))


def _outcomes(page: Page, outcomes: Sequence[Outcome]) -> None:
    """Per rule, how often it passed, failed, did not apply or stayed open, and what stayed open."""
    page.blank()
    page.put(("Outcomes", "bold underline"))
    by_rule: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        by_rule.setdefault(outcome.rule, []).append(outcome)
    for rule, each in sorted(by_rule.items()):
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
    page.labelled(
        "Checked",
        f"{scope.certificates} certificates, {scope.documents} signed documents, {scope.channels} topic "
        f"channels, with {scope.rules} rules, under {', '.join(_chosen_profiles(report)) or 'no profile'}.",
        indent=0,
        column=13,
        style="bold",
    )
    for run in report.engines:
        version = f" {run.version}" if run.version else ""
        words = f"{run.name}{version} {_ENGINE_WORDS[run.status]}"
        reason = f": {run.reason}" if run.reason else ""
        size = f", asked about {run.atoms[1]} of {run.atoms[0]} atoms" if verbose and run.atoms else ""
        page.labelled("Engine", _sentence(words + size + reason), indent=0, column=13, style="bold")
    for number, sentence in enumerate(scope.not_checked):
        page.labelled("" if number else "Not checked", sentence, indent=0, column=13, style="bold")
    if report.safe_until is None:
        until = "No date on these files changes this answer."
    else:
        holds = "Holds until" if report.verdict is Verdict.PASS else "Changes at"
        until = f"{holds} {instant(report.safe_until)}: {_sentence(report.safe_until_why)}"
    page.labelled("Dates", until, indent=0, column=13, style="bold")


def _verdict(page: Page, report: Report, view: View) -> None:
    """The last paragraph: the verdict, its exit code, the counts and what is not shown."""
    counts = ", ".join(f"{count} {severity.value}" for severity, count in report.summary.items())
    accepted = sum(finding.suppressed is not None for finding in report.findings)
    counts += f"; {accepted} accepted" if accepted else ""
    least = report.fail_on
    gate = "never fails on findings" if least is None else f"fails at {least.value} or worse"
    page.put(
        (report.verdict.value.upper(), _VERDICT_STYLE[report.verdict]),
        f"  {shorten(report.keystore, MAX_TITLE)}: {counts}",
        f"; {gate}; exit code {report.exit_code}",
    )
    if report.verdict is Verdict.INCOMPLETE:
        undecided = sorted({outcome.rule for outcome in report.outcomes if outcome.outcome is Result.OPEN})
        rules = f" (open: {', '.join(undecided)})" if undecided else ""
        page.put(f"Something could not be decided{rules}: this is no pass, whatever the counts say.")
    if view.quiet and report.weakened:
        page.put(f"Weakened gate: {'; '.join(report.weakened)}.")
    hidden = len(report.findings) - len(_shown(report, view.min_severity))
    if hidden and not view.quiet:
        page.put(f"{hidden} below {view.min_severity.value} not shown (--min-severity).")
    step = next_step(report)
    if step and not view.quiet:
        page.put(step)
