"""The implementations side by side, where they do not give the same answer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.findings import Severity
from keystore_audit.model.tables.access_rows import decision_rows
from keystore_audit.model.tables.access_table import AccessTable
from keystore_audit.report.access_differences import differences
from keystore_audit.report.html.element import Html, element, items, joined, lines, name
from keystore_audit.report.html.sheet import FULL, Sheet, severity, status
from keystore_audit.text import counted

MAX_ROWS: Final = 60
"""Things that are set side by side."""

MAX_SENTENCES: Final = 30
"""Differences in access of one group of profiles."""

_STARTS: Final = {True: ("✓", "starts"), False: ("✗", "does not start"), None: ("?", "unknown")}


class _Row(Struct, frozen=True):
    """Something, and for each profile what is answered."""

    what: Html
    answers: tuple[Html, ...]


def side_by_side(sheet: Sheet, table: AccessTable | None) -> Html:
    """Return what differs as a table, profiles that always answer alike in one column, and in access in sentences."""
    rows = [*_starts(sheet), *_properties(sheet), *_findings(sheet)]
    parts: list[Html] = []
    if rows:
        parts.append(_table(sheet, rows[:MAX_ROWS]))
        if len(rows) > MAX_ROWS:
            parts.append(element("p", f"{len(rows) - MAX_ROWS} more differences. {FULL}", class_="soft"))
    parts += _access(table) if table is not None else []
    if parts:
        return joined(parts)
    words = f"All {len(sheet.profiles)} profiles give the same answers." if len(sheet.profiles) > 1 else "One profile."
    return element("p", words, class_="soft")


def differing(sheet: Sheet) -> int:
    """Return how many things differ, access apart."""
    return sum(1 for rows in (_starts(sheet), _properties(sheet), _findings(sheet)) for _row in rows)


def _table(sheet: Sheet, rows: Sequence[_Row]) -> Html:
    columns: dict[tuple[Html, ...], list[str]] = {}
    for number, profile in enumerate(sheet.profiles):
        columns.setdefault(tuple(row.answers[number] for row in rows), []).append(profile)
    heads = [
        element("th", lines(element("span", name(profile)) for profile in alike), scope="col")
        for alike in columns.values()
    ]
    head = element("thead", element("tr", element("td"), joined(heads)))
    body = [
        element(
            "tr", element("th", row.what, scope="row"), joined(element("td", answers[number]) for answers in columns)
        )
        for number, row in enumerate(rows)
    ]
    table = element("table", head, element("tbody", lines(body)), class_="profiles")
    return element("div", table, class_="wide", tabindex=0, role="region", aria_label="Profiles side by side")


def _starts(sheet: Sheet) -> Iterator[_Row]:
    """Enclaves whose participants are created under some profiles only."""
    for entry in sheet.report.enclaves:
        usable = [entry.profiles[profile].usable for profile in sheet.profiles]
        if len(set(usable)) > 1:
            answers = (_STARTS[each] for each in usable)
            yield _Row(name(entry.path), tuple(_answer(mark, words) for mark, words in answers))


def _answer(mark: str, words: str) -> Html:
    return joined([element("span", mark, class_="mark", aria_hidden="true"), words])


def _properties(sheet: Sheet) -> Iterator[_Row]:
    for result in sheet.report.properties:
        statuses = [result.profiles[profile].status for profile in sheet.profiles if profile in result.profiles]
        if len(set(statuses)) > 1 and len(statuses) == len(sheet.profiles):
            yield _Row(element("span", result.prop.statement), tuple(status(each) for each in statuses))


def _findings(sheet: Sheet) -> Iterator[_Row]:
    """Findings that are some profiles' only, by rule."""
    found: dict[tuple[str, tuple[str, ...]], int] = {}
    chosen = set(sheet.profiles)
    severities: dict[str, Severity] = {}
    names: dict[str, str] = {}
    for finding in sheet.shown:
        under = tuple(profile for profile in sheet.profiles if profile in finding.profiles)
        if finding.suppressed is None and under and set(under) != chosen:
            found[finding.code, under] = found.get((finding.code, under), 0) + 1
            severities.setdefault(finding.code, finding.severity)
            names[finding.code] = finding.name
    for (code, under), number in found.items():
        what = joined([severity(severities[code]), element("span", code, class_="code"), names[code]])
        has, has_not = _answer("✗", counted(number, "finding")), _answer("✓", "none")
        yield _Row(what, tuple(has if profile in under else has_not for profile in sheet.profiles))


def _access(table: AccessTable) -> list[Html]:
    *others, main = table.groups
    if not others:
        return []
    rows = decision_rows(table, main)
    parts = [element("h3", "What enclaves may do there, and not elsewhere")]
    for group in others:
        told = list(differences(table, group, main, rows))
        listed = [element("span", sentence) for sentence in told[:MAX_SENTENCES]]
        if len(told) > MAX_SENTENCES:
            listed.append(element("span", f"{len(told) - MAX_SENTENCES} more; `keystore-audit access` has all."))
        under = joined(["Under ", name(", ".join(group.profiles))])
        parts.append(element("div", element("p", under), items(listed), class_="notes"))
    return parts
