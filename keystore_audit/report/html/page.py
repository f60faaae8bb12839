"""The page: one file with everything in it, which a browser is told to fetch nothing for and to run nothing of."""

from __future__ import annotations

from base64 import b64encode
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Final

from msgspec import Struct

from keystore_audit.findings import SEVERITIES, Severity
from keystore_audit.properties.property import Status
from keystore_audit.report.content import WORST_FIRST, NoReport, Report, Verdict
from keystore_audit.report.html.blast_radius import blast_radius
from keystore_audit.report.html.certificates import certificates
from keystore_audit.report.html.element import BREAK, NOTHING, Html, element, joined, lines, style
from keystore_audit.report.html.findings import count, findings
from keystore_audit.report.html.flow_picture import flows
from keystore_audit.report.html.matrix import access
from keystore_audit.report.html.profiles import differing, side_by_side
from keystore_audit.report.html.questions import properties
from keystore_audit.report.html.sheet import Sheet, sheet
from keystore_audit.report.html.starting import starting
from keystore_audit.report.html.summary import head, verdict
from keystore_audit.report.html.timeline import timeline
from keystore_audit.text import instant, shorten

MAX_TITLE: Final = 80
"""Characters of a keystore's path in the window's title and in the table of several."""

MAX_LINK: Final = 26
"""Characters of it in the contents."""

MAX_CONTENTS: Final = 6
"""Keystores up to which the sections of each are in the contents."""


class _Section(Struct, frozen=True):
    """A part of a report. `badge`: a few characters beside its name in the contents."""

    key: str
    title: str
    badge: str
    body: Html


def render(reports: Sequence[Report], min_severity: Severity = Severity.INFO, missing: Sequence[NoReport] = ()) -> str:
    """Return the reports as one HTML document; findings below `min_severity` are counted and not shown.

    `missing`: keystores without a report, which come first.
    Without `Report.overview`, what pictures show is left out.
    """
    several = len(reports) > 1
    sheets = [sheet(report, f"k{n}-" if several else "", min_severity) for n, report in enumerate(reports, start=1)]
    sections = [(each, list(_sections(each))) for each in sheets]
    title = _title(reports, missing)
    skip = element("a", "Skip to the report", href="#main", class_="skip")
    few = len(sheets) <= MAX_CONTENTS
    listed = lines(_contents(each, parts if few else ()) for each, parts in sections)
    contents = element("nav", listed, aria_label="Contents")
    body = [
        _missing(missing) if missing else NOTHING,
        _several(sheets) if several else NOTHING,
        *(_report(each, parts) for each, parts in sections),
        _foot(reports),
    ]
    main = element("main", lines(body), id="main")
    document = element("html", _head(title), BREAK, element("body", skip, contents, BREAK, main), lang="en")
    return f"<!DOCTYPE html>\n{document.markup}\n"


def _title(reports: Sequence[Report], missing: Sequence[NoReport]) -> str:
    if missing:
        return f"INCOMPLETE: {len(missing)} of {len(reports) + len(missing)} without a report (keystore-audit)"
    worst = min((report.verdict for report in reports), key=WORST_FIRST.index)
    what = shorten(reports[0].keystore, MAX_TITLE) if len(reports) == 1 else f"{len(reports)} keystores"
    return f"{worst.value.upper()}: {what} (keystore-audit)"


@cache
def _sheet() -> str:
    """Our style sheet, as it stands between the tags: its hash is in the policy."""
    return Path(__file__).with_name("style.css").read_text(encoding="utf-8")


def _policy() -> str:
    """Nothing may be fetched or run; the one style sheet is known by its hash (Content Security Policy Level 3)."""
    digest = b64encode(sha256(_sheet().encode("utf-8")).digest()).decode("ascii")
    return (
        f"default-src 'none'; script-src 'none'; style-src 'sha256-{digest}'; img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )


def _head(title: str) -> Html:
    return element(
        "head",
        lines(
            [
                element("meta", charset="utf-8"),
                element("meta", http_equiv="Content-Security-Policy", content=_policy()),
                element("meta", name="viewport", content="width=device-width, initial-scale=1"),
                element("meta", name="referrer", content="no-referrer"),
                element("link", rel="icon", href="data:,"),  # else a browser asks the server for one
                element("title", title),
                style(_sheet()),
            ]
        ),
    )


def _contents(each: Sheet, sections: Sequence[_Section]) -> Html:
    """The sections with what is found in them, as links."""
    links = [
        element(
            "li",
            element(
                "a",
                section.title,
                element("span", section.badge, class_="badge") if section.badge else NOTHING,
                href=f"#{each.anchor(section.key)}",
            ),
        )
        for section in sections
    ]
    called = element("code", shorten(each.report.keystore, MAX_LINK)) if each.prefix else NOTHING
    top = element("a", verdict(each.report.verdict), called, href=f"#{each.anchor('top')}", class_="to-top")
    return element("div", top, element("ul", lines(links)) if links else NOTHING)


def _report(each: Sheet, sections: Sequence[_Section]) -> Html:
    parts = [
        element(
            "section",
            element("h2", section.title),
            BREAK,
            section.body,
            id=each.anchor(section.key),
            class_=section.key,
        )
        for section in sections
    ]
    return element("article", lines([head(each), *parts]), class_="report")


def _sections(each: Sheet) -> Iterator[_Section]:
    report = each.report
    overview = report.overview
    yield _Section("findings", "Findings", str(count(each)), findings(each))
    yield _Section("properties", "Properties", _statuses(report), properties(each))
    if overview is not None:
        yield _Section("access", "Who may do what", "", access(each, overview))
        yield _Section("flows", "Information flow", "", flows(each, overview))
        yield _Section("radius", "Blast radius", "", blast_radius(each, report.blast_radius))
    yield _Section("starting", "Who can start", "", starting(each))
    table = overview.access if overview is not None else None
    number = differing(each)
    yield _Section("profiles", "Implementations", str(number or ""), side_by_side(each, table))
    if overview is not None:
        yield _Section("certificates", "Certificates and signatures", "", certificates(each, overview.issuance))
        yield _Section("dates", "Dates", "", timeline(each, overview.periods))


def _statuses(report: Report) -> str:
    """How many properties do not hold."""
    counts = Counter(result.status for result in report.properties)
    marks = ((Status.UNKNOWN, "?"), (Status.VIOLATED, "✗"))
    return " ".join(f"{counts[status]} {mark}" for status, mark in marks if counts[status]) or "✓"


def _missing(missing: Sequence[NoReport]) -> Html:
    """Of what there is no report, and why."""
    rows = [
        element(
            "tr",
            element("td", verdict(Verdict.INCOMPLETE)),
            element("th", element("code", shorten(each.path, MAX_TITLE)), scope="row"),
            element("td", each.reason),
        )
        for each in missing
    ]
    heads = ("verdict", "keystore", "why there is no report")
    return _listed(f"{len(missing)} without a report", heads, rows)


def _several(sheets: Sequence[Sheet]) -> Html:
    """The verdicts of several keystores, each a link to its report."""
    counts = Counter(each.report.verdict for each in sheets)
    words = ", ".join(f"{counts[each]} {each.value}" for each in Verdict)
    rows = [
        element(
            "tr",
            element("td", verdict(each.report.verdict)),
            element(
                "th",
                element("a", element("code", shorten(each.report.keystore, MAX_TITLE)), href=f"#{each.anchor('top')}"),
                scope="row",
            ),
            *(element("td", str(each.report.summary[severity] or "–")) for severity in Severity),
        )
        for each in sheets
    ]
    heads = ("verdict", "keystore", *SEVERITIES)
    return _listed(f"{len(sheets)} keystores: {words}", heads, rows)


def _listed(title: str, heads: Sequence[str], rows: Sequence[Html]) -> Html:
    """Keystores in a table."""
    table = element(
        "table",
        element("thead", element("tr", *(element("th", text, scope="col") for text in heads))),
        element("tbody", lines(rows)),
        class_="several",
    )
    return element("section", element("h1", title), table)


def _foot(reports: Sequence[Report]) -> Html:
    told = dict.fromkeys(f"keystore-audit {report.version}, as of {instant(report.at)}." for report in reports)
    return element("footer", joined([element("p", text) for text in told]))
