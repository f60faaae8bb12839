"""Causes in the report for people, worst first over the whole keystore: in short, or with all that is known of them.

A cause is shown in full if it is high or worse, fails the gate or leaves the audit open. That is its message, places,
the line of the document and one line to type. A medium one has about four lines, lesser ones share a line.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

from keystore_audit.findings import OF_THE_AUDIT, Finding, FixKind, Severity
from keystore_audit.grouped import grouped
from keystore_audit.report.content import Report, place_of
from keystore_audit.report.json import TOOL, script_command
from keystore_audit.report.page import Page, Piece
from keystore_audit.report.view_model import Cause, Consequences, concerned, within
from keystore_audit.text import counted, some, terminal

MAX_PLACES: Final = 6
"""Places shown of one finding: a defect of 1,000 files is understood from a few; JSON has them all."""

MAX_NAMED: Final = 3
"""Places and subjects named in a report that is not verbose."""

MAX_ALIKE: Final = 200
"""Causes of one code that are shown, the worst first: a hostile document has thousands; JSON has them all."""

MAX_MINOR: Final = 20
MAX_MEDIUM: Final = 3
"""The same of causes that decide nothing and are below high: in a verbose report, and in a short one."""

MAX_ABOUT: Final = 10
"""Enclaves named of those in which a cause is not shown."""

_STYLE: Final = {
    Severity.CRITICAL: "bold white on red",
    Severity.HIGH: "bold red",
    Severity.MEDIUM: "bold yellow",
    Severity.LOW: "cyan",
    Severity.INFO: "dim",
}


def put_short(page: Page, report: Report, consequences: Consequences) -> None:
    """Put the causes on the page as far as one screen has room for them."""
    own, lesser = list[Cause](), list[Cause]()
    for each in consequences.causes:
        (own if _weighs(report, each) or each.severity.at_least(Severity.MEDIUM) else lesser).append(each)

    def put(cause: Cause) -> None:
        _short(page, report, cause, consequences, weighs=_weighs(report, cause))

    _put(page, own, lambda cause: MAX_ALIKE if _weighs(report, cause) else MAX_MEDIUM, put)
    _lesser(page, lesser)


def put_headings(page: Page, report: Report, consequences: Consequences) -> None:
    """Put one line for each code that fails the gate or leaves the audit open, or warns of the audit itself."""

    def own(cause: Cause) -> bool:
        return cause.finding.code.startswith(OF_THE_AUDIT) and cause.severity.at_least(Severity.LOW)

    deciding = [cause for cause in consequences.causes if cause.decides(report.fail_on) or own(cause)]
    for alike in grouped(deciding, lambda cause: (cause.finding.code, cause.severity)).values():
        finding = alike[0].finding
        more = f" and {len(alike) - 1} more" if len(alike) > 1 else ""
        about = [*finding.properties[:1], *map(str, finding.locations[:1])]
        _heading(page, alike[0], f"  {'  '.join(about)}{more}")


def put_full(page: Page, report: Report, consequences: Consequences) -> None:
    """Put all that is known of each cause; those of one enclave that bring nothing about are counted after some."""

    def most(cause: Cause) -> int:
        follows = cause.follow or cause.stay
        return MAX_ALIKE if _weighs(report, cause) or follows or cause.finding.enclave is None else MAX_MINOR

    _put(page, consequences.causes, most, lambda cause: _full(page, report, cause, consequences))


def _weighs(report: Report, cause: Cause) -> bool:
    """Whether it has to be read: it decides the verdict, or would decide one by default."""
    return cause.decides(report.fail_on) or cause.severity.at_least(Severity.HIGH)


def _put(page: Page, causes: Sequence[Cause], most: Callable[[Cause], int], put: Callable[[Cause], None]) -> None:
    """Put the first causes of each code, as many as `most` says, and count the others with their enclaves."""
    told: Counter[str] = Counter()
    untold: dict[str, list[Cause]] = {}
    for cause in causes:
        code = cause.finding.code
        if told[code] < most(cause):
            told[code] += 1
            page.blank()
            put(cause)
        else:
            untold.setdefault(code, []).append(cause)
    for code, left in untold.items():
        enclaves = dict.fromkeys(each.enclave for cause in left for each in (cause.finding, *cause.others))
        about = f", about {some(filter(None, enclaves), MAX_ABOUT)}" if any(enclaves) else ""
        page.blank()
        page.put(f"and {len(left)} more of {code}{about} (all are in the JSON report)")


def put_accepted(page: Page, findings: Sequence[Finding]) -> None:
    """Put what somebody accepts, with who, why and until when."""
    if not findings:
        return
    page.blank()
    page.put((f"Accepted findings, not counted: {len(findings)}", "bold underline"))
    for finding in findings:
        if (accepted := finding.suppressed) is not None:
            severity = finding.severity
            page.put((severity.value.upper(), _STYLE[severity]), f"  {finding.code} {finding.name}", indent=2)
            page.put(finding.message, indent=4)
            until = f"until {accepted.until} by {accepted.owner} ({accepted.source})"
            page.labelled("accepted", until, indent=4, column=14)
            page.labelled("reason", accepted.reason, indent=4, column=14)


def _heading(page: Page, cause: Cause, beside: str = "") -> None:
    severity = cause.severity
    heading = (f"{severity.value.upper():<9}", _STYLE[severity])
    page.put(heading, (f"{cause.finding.code} {cause.finding.name}", "bold"), beside)


def _short(page: Page, report: Report, cause: Cause, consequences: Consequences, *, weighs: bool) -> None:
    _heading(page, cause)
    finding = cause.finding
    _message(page, finding, consequences)
    places = [str(place) for place in finding.locations]
    also = [each.enclave or str(each.locations[0]) for each in cause.others]
    where = some(places, MAX_NAMED if weighs else 1)
    page.labelled("-->", (where, "bold"), f"; also {some(also, MAX_NAMED)}" if also else "", indent=2, column=6)
    if weighs:
        _excerpt(page, report, finding)
    _under(page, report, finding)
    _so(page, cause, consequences)
    page.put((_fix(finding), "dim"), finding.fix.short, indent=2)
    if weighs:
        _command(page, report, finding)


def _fix(finding: Finding) -> str:
    """`fix (decision): `; a mechanical one is called by what does it."""
    kind = finding.fix.kind
    return f"fix ({'script' if kind is FixKind.MECHANICAL else kind.value}): "


def _command(page: Page, report: Report, finding: Finding) -> None:
    """The line to type: where there is a script the one that prints it, else the one that says more."""
    words = script_command(finding, report.keystore) if finding.fix.scripted else (TOOL, "explain", finding.code)
    page.verbatim(shlex.join(words))


def _full(page: Page, report: Report, cause: Cause, consequences: Consequences) -> None:
    _heading(page, cause)
    finding = cause.finding
    _message(page, finding, consequences)
    for number, place in enumerate(finding.locations[:MAX_PLACES]):
        note = f"  ({place.message})" if place.message else ""
        where: tuple[Piece, ...] = ((str(place), "bold"), (note, ""))
        page.labelled("-->" if number == 0 else "", *where, indent=2, column=10)
    if len(finding.locations) > MAX_PLACES:
        more = counted(len(finding.locations) - MAX_PLACES, "more place")
        page.put(f"and {more} (all are in the JSON report)", indent=10)
    _excerpt(page, report, finding)
    _under(page, report, finding)
    for number, other in enumerate(cause.others[:MAX_PLACES]):
        at = f"  ({other.locations[0]})" if other.enclave and other.locations else ""
        about = other.enclave or str(other.locations[0])
        page.labelled("also" if number == 0 else "", (about, "bold"), at, indent=2, column=10)
    if len(cause.others) > MAX_PLACES:
        page.put(f"and {len(cause.others) - MAX_PLACES} more (all are in the JSON report)", indent=10)
    page.labelled("clause", finding.clause, indent=2, column=10)
    likewise = " Likewise for the others." if cause.others else ""
    page.put((_fix(finding), "dim"), f"{finding.fix.text}{likewise}", indent=2)
    if finding.fix.scripted:
        _command(page, report, finding)
    for below, besides in (cause.follow, ""), (cause.stay, " It has other causes too."):
        for each in below:
            worth = each.severity.value.upper(), _STYLE[each.severity]
            page.labelled("so", worth, f" {consequences.sentence(each)}{besides}", indent=2, column=10)


def _message(page: Page, finding: Finding, consequences: Consequences) -> None:
    """What was found; an example where there may be more of it."""
    example = consequences.is_example(finding)
    page.put(f"E.g. {within(finding.message)}" if example else finding.message, indent=2)


def _excerpt(page: Page, report: Report, finding: Finding) -> None:
    """The line that the finding is about, marked as compilers do."""
    place = place_of(finding)
    line = report.excerpts.get(place) if place is not None else None
    if place is None or line is None:
        return
    shown = terminal(line)[: page.width - 9]
    page.put(f"{place[1]:>5} | {shown}")
    page.put(" " * 6 + "| ", ("^" * len(shown), "bold red"))


def _under(page: Page, report: Report, finding: Finding) -> None:
    """The implementations for which it is so, where it is not for all."""
    if told := concerned(report, finding):
        page.labelled("on", told, indent=2, column=6)


def _so(page: Page, cause: Cause, consequences: Consequences) -> None:
    """What follows: the codes, and one example of the worst."""
    if cause.follow:
        codes = some(dict.fromkeys(each.code for each in cause.follow), MAX_PLACES)
        number = f"{len(cause.follow)} more follow{'s' if len(cause.follow) == 1 else ''}"
        example = within(consequences.example(cause.follow[0])).split(": ")[0].rstrip(".")
        page.labelled("so", f"{example}; {number} from it: {codes}", indent=2, column=6)
    if cause.stay:
        codes = some(dict.fromkeys(each.code for each in cause.stay), MAX_PLACES)
        page.labelled("so", f"{codes} too, which have other causes as well and stay", indent=2, column=6)


def _lesser(page: Page, causes: Sequence[Cause]) -> None:
    """One line for each code at low, one for all notes."""
    if causes:
        page.blank()
    low = [cause for cause in causes if cause.severity is Severity.LOW]
    for code, alike in grouped(low, lambda cause: cause.finding.code).items():
        places = [str(cause.finding.locations[0]) for cause in alike if cause.finding.locations]
        many = f" ×{len(alike)}" if len(alike) > 1 else ""
        where = f"  {places[0]}" if places else ""
        page.put(("LOW      ", _STYLE[Severity.LOW]), f"{code} {alike[0].finding.name}{many}{where}")
    notes = dict.fromkeys(cause.finding.code for cause in causes if cause.severity is Severity.INFO)
    if notes:
        page.labelled("notes", f"{' '.join(notes)} (-v)", column=9)
