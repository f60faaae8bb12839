"""The report as one web page that needs nothing but itself: no network, no script, no other file.

`templates/` holds its structure; what is computed for it is here and in the modules of tables and pictures. Whatever
a template prints passes through `text.html`, so hidden and direction-changing characters are visible and nothing that a
keystore's author wrote becomes markup. Templates put no text of a keystore into attributes, and have no way to write it
as it is.
"""

from __future__ import annotations

import re
from base64 import b64encode
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from hashlib import sha256
from itertools import accumulate
from typing import Any, Final

from jinja2 import Environment
from jinja2.ext import Extension
from markupsafe import Markup
from msgspec import Struct

from keystore_audit.findings import Finding, Severity
from keystore_audit.grouped import grouped
from keystore_audit.profiles import facts, shipped_by
from keystore_audit.properties.result import Status
from keystore_audit.report.access_words import SHORT, full_name
from keystore_audit.report.content import STATUSES, WORST_FIRST, NoReport, Report, Verdict, none_here
from keystore_audit.report.html_tables import (
    Sheet,
    access,
    certificates,
    differing,
    profiles,
    properties,
    rankings,
    routed,
)
from keystore_audit.report.page import by_answer
from keystore_audit.report.pictures import flows, timeline
from keystore_audit.report.system_picture import system
from keystore_audit.report.templated import TEMPLATES, environment, ours
from keystore_audit.report.view_model import (
    HOW,
    Cause,
    assumed,
    concerned,
    declaring,
    engine,
    nodes_beside,
    starting,
    until,
    warnings,
)
from keystore_audit.text import counted, html, instant, shorten, some

MAX_LINES: Final = 21
LINES_OF_WARNINGS: Final = 5
MAX_LIGHT: Final = 3
"""Lines of causes on the first screen, how many a warning takes, and causes of low severity if there are no others."""

IN_LINE: Final = 56
"""Characters of such a line."""

MAX_SAID: Final = 340
"""Characters of a cause on the first screen."""

MAX_OPEN: Final = 4
"""Enclaves, or codes, named in a sentence about the verdict."""

_UNDECIDED: Final = "could not be decided, and what cannot be decided is no pass."

MAX_DECIDED: Final = 20
"""Causes of which a meeting decides: a page."""

MAX_TITLE: Final = 80
"""Characters of a keystore's path in the window's title."""

MAX_OF_RULE: Final = 30
"""Findings of one rule that are shown; a defect of 1,000 files is understood from a few."""

MAX_SEEN: Final = 4
"""Findings of one rule that are seen without a click."""

_UNBROKEN: Final = 20
"""Characters up to which a name is left in one piece."""

_MARKS: Final = {
    Severity.CRITICAL: "◆",
    Severity.HIGH: "▲",
    Severity.MEDIUM: "■",
    Severity.LOW: "●",
    Severity.INFO: "○",
    Status.HOLDS: "✓",
    Status.VIOLATED: "✗",
    Status.UNKNOWN: "?",
    Verdict.PASS: "✓",
    Verdict.FAIL: "✗",
    Verdict.INCOMPLETE: "?",
}
"""A shape for each, so that none is known by its colour alone."""


class _Lines(Extension):
    """The ends of a template's lines, and what indents them, are not on the page, save before an entry of a list."""

    def preprocess(self, source: str, name: str | None, filename: str | None = None) -> str:  # noqa: ARG002
        """Return the template without them."""
        return re.sub(
            r"\n\s*(<(?:article|li|section|tr)\b)|\n\s*", lambda found: "\n" * bool(found[1]) + (found[1] or ""), source
        )


def _breakable(text: str) -> Markup:
    """The text, which is best broken behind a slash where it is long."""
    return ours(html(text).replace("/", "/<wbr>") if len(text) > _UNBROKEN else html(text))


@cache
def _environment() -> Environment:
    made = environment(html, lines=False).overlay(extensions=[_Lines])
    made.filters.update(
        breakable=_breakable,
        counted=counted,
        full_name=full_name,
        g="{:g}".format,
        instant=instant,
        shorten=shorten,
        tenths=lambda number: f"{round(number, 1):g}",
    )
    made.globals.update(
        full="The JSON report has all (--format json).",
        incomplete=Verdict.INCOMPLETE,
        marks=_MARKS,
        none_here=none_here,
        routed_stolen=facts.ROUTED_STOLEN,
        severities=tuple(Severity),
        short=SHORT,
        max_said=MAX_SAID,
    )
    return made


class _Section(Struct, frozen=True, kw_only=True):
    """A part of a report. `badge`: beside its name in the contents. `view`: what its template shows."""

    key: str
    title: str
    badge: str = ""
    view: Any


def render(reports: Sequence[Report], min_severity: Severity = Severity.INFO, missing: Sequence[NoReport] = ()) -> str:
    """Return the reports as one HTML document; findings below `min_severity` are counted and not shown.

    `missing`: keystores without a report, which come first.
    Without `Report.overview`, what pictures show is left out.
    """
    sheets = [
        Sheet(report, f"k{number}-" if len(reports) > 1 else "", min_severity)
        for number, report in enumerate(reports, start=1)
    ]
    counts = Counter(report.verdict for report in reports)
    style = (TEMPLATES / "style.css").read_text(encoding="utf-8")
    page = _environment().get_template("page.html.j2")
    return page.render(
        reports=[(each, _head(each), [*_sections(each)]) for each in sheets],
        missing=missing,
        title=_title(reports, missing),
        policy=_policy(style),
        style=ours(style),
        verdicts=", ".join(f"{counts[each]} {each.value}" for each in Verdict),
        foot=dict.fromkeys(f"keystore-audit {each.version}, as of {instant(each.at)}." for each in reports),
    )


def _title(reports: Sequence[Report], missing: Sequence[NoReport]) -> str:
    if missing:
        return f"INCOMPLETE: {len(missing)} of {len(reports) + len(missing)} without a report (keystore-audit)"
    worst = min((report.verdict for report in reports), key=WORST_FIRST.index)
    what = shorten(reports[0].keystore, MAX_TITLE) if len(reports) == 1 else f"{len(reports)} keystores"
    return f"{worst.value.upper()}: {what} (keystore-audit)"


def _policy(style: str) -> str:
    """Nothing may be fetched or run; the one style sheet is known by its hash (Content Security Policy Level 3)."""
    digest = b64encode(sha256(style.encode("utf-8")).digest()).decode("ascii")
    return (
        f"default-src 'none'; script-src 'none'; style-src 'sha256-{digest}'; img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )


def _sections(sheet: Sheet) -> Iterator[_Section]:
    report, overview = sheet.report, sheet.report.overview
    of = " in DDS" if report.network else ""
    counting = sum(finding.suppressed is None for finding in sheet.shown)
    yield _Section(key="findings", title="Findings", badge=str(counting), view=_findings(sheet))
    yield _Section(key="properties", title=f"Properties{of}", badge=_statuses(report), view=properties(report))
    if report.network:
        yield _Section(key="routed", title=facts.ROUTED_TITLE, view=routed(report))
    if overview is not None:
        yield _Section(key="access", title=f"Who may do what{of}", view=access(sheet, overview))
        yield _Section(key="flows", title=f"Information flow{of}", view=flows(overview, len(report.enclaves)))
        yield _Section(key="radius", title=f"Blast radius{of}", view=rankings(report.blast_radius or ()))
    yield _Section(key="starting", title=f"Who can start{of}", view=_starting(report))
    rows = [*differing(sheet)]
    table = None if overview is None else overview.access
    yield _Section(
        key="profiles",
        title=f"Implementations{' of DDS' if of else ''}",
        view=profiles(sheet, rows, table),
    )
    if overview is not None:
        safe = report.safe_until if report.verdict is Verdict.PASS else None
        yield _Section(key="certificates", title="Certificates and signatures", view=certificates(overview.issuance))
        yield _Section(key="dates", title="Dates", view=timeline(overview.periods, report.at, safe))
    if causes := [each for each in sheet.consequences.causes if each.severity is not Severity.INFO]:
        yield _Section(key="meeting", title="For the meeting", view=_meeting(sheet, causes))
    yield _Section(key="basis", title="Assumptions, what was not checked, words", view=_basis(sheet))


def _statuses(report: Report) -> str:
    """How many properties do not hold."""
    counts = Counter(result.status for result in report.properties)
    return " ".join(f"{counts[each]} {_MARKS[each]}" for each in STATUSES[:2] if counts[each]) or "✓"


def _head(sheet: Sheet) -> Mapping[str, Any]:
    """The first screen: the verdict, who can do what, the causes with their fix, and the system that they are in."""
    report, overview = sheet.report, sheet.report.overview
    causes = sheet.consequences.causes
    weighing = [each for each in causes if each.decides(report.fail_on) or each.severity.at_least(Severity.MEDIUM)]
    warned = [*warnings(report, versions=True)]
    lines = [*accumulate((_lines(sheet, each) for each in weighing), initial=LINES_OF_WARNINGS * bool(warned))][1:]
    shown = [each for each, end in zip(weighing, lines, strict=True) if end <= MAX_LINES or each is weighing[0]]
    shown = shown or [*causes[:MAX_LIGHT]]
    return {
        "first": _first(sheet, shown),
        "scope": _subject(sheet),
        "rests": _assumes(report),
        "assumed": len(assumed(report)),
        "warnings": warned,
        "title": f"{counted(len(causes), 'cause')} behind {counted(sum(report.summary.values()), 'finding')}",
        "causes": shown,
        "more": f"{len(causes) - len(shown)} more under Findings." if len(causes) > len(shown) else "",
        "system": system([entry.path for entry in report.enclaves], overview, report.routed, shown, sheet.consequences),
    }


def _subject(sheet: Sheet) -> str:
    """What is judged, for which implementations, as of when."""
    report = sheet.report
    scope = report.scope or f"all that {shipped_by(sheet.profiles) or 'distributions'} ship"
    if report.network:
        scope = f"{facts.ROUTED_SCOPE.format(shorten(report.network, MAX_TITLE))}; for DDS apart from it"
    return f"Judged for {scope}, as of {report.at:%Y-%m-%d}."


def _lines(sheet: Sheet, cause: Cause) -> int:
    """How many a cause takes."""
    finding = cause.finding
    texts = (f"{finding.message[:MAX_SAID]} {sheet.of(finding)}", finding.fix.short)
    return sum(-(-len(text) // IN_LINE) for text in texts) + 1


def _first(sheet: Sheet, causes: Sequence[Cause]) -> str:
    """Which enclave can do what, of the first cause that says so; else what the first says, or the verdict."""
    report = sheet.report
    failing = [each for cause in causes for each in cause.every if each.fails(report.fail_on)]
    if report.verdict is Verdict.INCOMPLETE:
        open_of = [each.enclave for cause in causes for each in cause.every if each.undecided and each.enclave]
        whose = f" of {some(dict.fromkeys(open_of), MAX_OPEN)}" if open_of else ""
        return f"Something{whose} {_UNDECIDED}"
    if report.verdict is Verdict.PASS or not failing:
        return _meaning(report)
    paths = tuple(f"{entry.path} " for entry in report.enclaves)
    for finding in failing:
        said = sheet.consequences.example(finding)
        if said.startswith(paths):
            words = concerned(report, finding)
            only = f" On {words} only." if words else ""
            asserted = f" The settings forbid it: {', '.join(finding.properties)}." if finding.properties else ""
            way = said.split(" -> ")
            far = ", if nodes on the way pass it on" if len(way) > 3 else ""
            example = "For example, " if sheet.consequences.is_example(finding) else ""
            reaches = f"Data of {way[0]} can reach {way[-1].partition(' ')[0]}{far}: " if len(way) > 1 else example
            return f"{reaches}{said}{only}{asserted}"
    return failing[0].message


def _meeting(sheet: Sheet, causes: Sequence[Cause]) -> Mapping[str, Any]:
    """What is to be decided, and the lines of settings by which each finding of a cause would be accepted."""
    shown, notes = causes[:MAX_DECIDED], sheet.consequences.causes[len(causes) :]
    return {
        "causes": [(cause, [each for each in cause.every if not each.undecided][:MAX_OF_RULE]) for cause in shown],
        "left_out": len(causes) - len(shown),
        "meaning": _meaning(sheet.report),
        "assumes": _assumes(sheet.report),
        "accepted": sheet.report.accepted[:MAX_DECIDED],
        "notes": ", ".join(dict.fromkeys(each.finding.code for each in notes)),
        "subject": _subject(sheet),
    }


def _assumes(report: Report) -> str:
    """The conditions, in a sentence; empty where there are none."""
    if report.network:
        return f"This assumes that {facts.ROUTED_IF}."
    plainly = report.holds_if.replace("HOLDS IF", "Where this page says “holds”, it assumes:")
    said = report.holds_if if report.verdict is Verdict.PASS else plainly
    return f"{said}." if said else ""


def _basis(sheet: Sheet) -> Mapping[str, Any]:
    """Everything that the verdict rests on."""
    report, checked = sheet.report, sheet.report.checked
    looked_at = {
        "certificate": checked.certificates,
        "signed document": checked.documents,
        "topic channel": checked.channels,
        "rule": checked.rules,
    }
    return {
        "facts": [
            ("gate", _meaning(report)),
            *([("dates", _dates(report))] if report.verdict is Verdict.PASS else []),
            ("layout", f"{report.layout}, {counted(len(report.enclaves), 'enclave')}"),
            ("judged as", ", ".join(sheet.profiles)),
            ("properties", f"{len(report.holding)} of {len(report.properties)} hold"),
        ],
        "engines": [
            *(engine(run, version=True) for run in report.engines),
            *(["They agree."] if report.engines_agree else []),
        ],
        "looked_at": ", ".join(counted(number, noun) for noun, number in looked_at.items()),
        "assumed": assumed(report),
        "how": HOW,
        "declare": [*declaring(report)],
    }


def _meaning(report: Report) -> str:
    failing = [each.code for each in report.findings if each.fails(report.fail_on)]
    words = {
        Verdict.INCOMPLETE: f"Something {_UNDECIDED} ",
        Verdict.FAIL: f"Because of {some(dict.fromkeys(failing), MAX_OPEN)}. ",
        Verdict.PASS: "Nothing was found that fails this gate. " if report.fail_on is not None else "",
    }[report.verdict]
    gate = report.fail_on
    return words + ("Nothing fails this gate." if gate is None else f"The gate fails at {gate.value} or worse.")


def _dates(report: Report) -> str:
    if report.safe_until is None:
        return "No date in the keystore changes this answer."
    return f"This answer holds until {instant(report.safe_until)}: {until(report)}"


def _findings(sheet: Sheet) -> Mapping[str, Any]:
    """As the causes come, by rule, with remedy and clause said once."""
    consequences = sheet.consequences
    by_rule = grouped(consequences.told, lambda finding: (consequences.rank(finding)[0], finding.code))
    first = {code: rank for rank, code in reversed(by_rule)}
    return {
        "rules": [_rule(rank, found, first=first[code] == rank) for (rank, code), found in by_rule.items()],
        "consequences": consequences,
        "hidden": len(sheet.report.findings) - len(sheet.shown),
        "accepted": [finding for finding in sheet.shown if finding.suppressed is not None],
    }


def _rule(rank: int, found: Sequence[Finding], *, first: bool) -> Mapping[str, Any]:
    shown = found[:MAX_OF_RULE]
    return {
        "first": first,
        "worst": min((finding.severity for finding in found), key=lambda each: each.rank),
        "open": rank <= Severity.MEDIUM.rank,
        "found": found,
        "shown": shown,
        "seen": len(shown) if len(shown) <= MAX_SEEN + 1 else MAX_SEEN,
        "advice": dict.fromkeys(
            (each.clause, each.fix.text if len(found) == 1 else each.fix.general) for each in shown
        ),
    }


def _starting(report: Report) -> Mapping[str, Any]:
    """Which enclaves can start, and why the others cannot."""
    well, refused = starting(report)
    return {
        "well": [entry.path for entry in well],
        "refused": [(entry, [*by_answer(entry.profiles).items()]) for entry in refused],
        "beside": nodes_beside(report.findings),
    }
