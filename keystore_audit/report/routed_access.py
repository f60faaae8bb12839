"""The table of `access` about a network: what enclaves can do with their own files, and by others' files alone."""

from __future__ import annotations

from collections.abc import Sequence

from keystore_audit.model.question import WORDS
from keystore_audit.report.access_text import csv_of
from keystore_audit.report.json import array, document, encoded, keys, picked
from keystore_audit.report.page import by_answer, profiles, wrapped
from keystore_audit.report.routed_answer import ASSUMED, doubted, unknown
from keystore_audit.text import instant, some, terminal
from keystore_audit.truth import Truth
from keystore_audit.zenoh.answers import RoutedRight, RoutedTable

HEADER = ("enclave", "operation", "name", "by own file", "by others' files")
MAX_TOLD = 3
MAX_PATTERNS = 5

_Row = tuple[str, str, str, str, str]


def json(table: RoutedTable) -> str:
    """A line for each right; ends in a newline."""
    head = {**picked(table, "domain", "folder", "patterns"), "at": instant(table.at), "unknown": unknown(table.doubts)}
    rights = [
        encoded(
            {
                **picked(right, "enclave", "operation", "name"),
                "decisions": {
                    release: {"decision": each.decided, "effective": each.accepted}
                    for release, each in right.answers.items()
                },
            }
        )
        for right in table.rights
    ]
    return document([*keys(head), array("rights", rights)])


def csv(table: RoutedTable) -> str:
    """RFC 4180, one row a right and release, safe to open in a spreadsheet."""
    rows = ((release, *row) for release in table.releases for row in _rows(table, release))
    return csv_of(("profile", *HEADER), rows)


def text(table: RoutedTable) -> str:
    """What is gained by dropping a file first; then, releases that answer alike together, all that somebody can do."""
    lines = [wrapped(_said(table)), terminal(f"  domain {table.domain}, at {instant(table.at)}")]
    lines.append(wrapped(ASSUMED.format(table.folder), "  ", "  "))
    for rows, names in by_answer({release: _rows(table, release) for release in table.releases}).items():
        shown = [row for row in rows if {*row[3:]} != {WORDS[Truth.NO]}]
        lines += ["", wrapped(profiles(names, table.releases)), *_aligned([HEADER, *shown])]
        lines += [f"  {len(rows) - len(shown)} more are denied by both"] * (len(shown) < len(rows))
    if table.patterns:
        lines += ["", wrapped(f"Patterns, not compared as such: {some(table.patterns, MAX_PATTERNS)}.", "  ", "  ")]
    return "\n".join([*lines, *doubted(table.doubts)]) + "\n"


def _said(table: RoutedTable) -> str:
    """The first line."""
    gained, open_ones = (
        [each for each in table.rights if each.gained is truth] for truth in (Truth.YES, Truth.UNKNOWN)
    )
    count = f"{len(table.rights)} rights"
    more = f", and of {len(open_ones)} it cannot be told" if open_ones else ""
    if gained:
        return (
            f"{len(gained)} of {count} are gained by dropping the own file{more}: {some(map(_told, gained), MAX_TOLD)}."
        )
    return f"None of {count} is known to be gained by dropping the own file{more}."


def _told(right: RoutedRight) -> str:
    return f"{right.enclave} {right.operation} {right.name}"


def _rows(table: RoutedTable, release: str) -> tuple[_Row, ...]:
    answers = ((right, right.answers[release]) for right in table.rights)
    return tuple((right.enclave, right.operation, right.name, each.decided, each.accepted) for right, each in answers)


def _aligned(rows: Sequence[_Row]) -> list[str]:
    """In columns."""
    escaped = [[*map(terminal, row)] for row in rows]
    widths = [max(map(len, column)) for column in zip(*escaped, strict=True)]
    return [
        "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in escaped
    ]
