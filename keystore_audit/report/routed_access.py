"""The table of `access` about a network: what enclaves can do with their own files, and by others' files alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from keystore_audit.model.question import WORDS
from keystore_audit.report.access_text import csv_of
from keystore_audit.report.json import array, document, encoded, keys, picked
from keystore_audit.report.page import by_answer, profiles, wrapped
from keystore_audit.report.routed_answer import ASSUMED, doubted, unknown
from keystore_audit.text import instant, some, terminal
from keystore_audit.truth import Truth
from keystore_audit.zenoh.answers import RoutedChange, RoutedRight, RoutedTable

CHANGED = ("", "enclave", "right", "before", "after")
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


def changes_text(old: RoutedTable, new: RoutedTable, found: Sequence[RoutedChange]) -> str:
    """What is gained first; of each right what becomes of it with the own file / without it, before and after."""
    counts = Counter(each.gained for each in found)
    told = f"{counts[Truth.YES]} rights are gained, {counts[Truth.NO]} lost or otherwise changed"
    if counts[Truth.UNKNOWN]:
        told += f"; of {counts[Truth.UNKNOWN]} it cannot be told"
    lines = [wrapped(f"{told}: {old.folder} → {new.folder}."), terminal(f"  domain {new.domain}, at {instant(new.at)}")]
    lines.append(wrapped(ASSUMED.format("its folder"), "  ", "  "))
    rows = {
        release: tuple(
            (_WORDS[each.gained], each.enclave, f"{each.operation} {each.name}", *_sides(each, release))
            for each in found
        )
        for release in new.releases
    }
    for shown, names in by_answer(rows).items():
        lines += ["", wrapped(profiles(names, new.releases)), *_aligned([CHANGED, *shown])] if shown else []
    return "\n".join([*lines, *doubted((*old.doubts, *new.doubts))]) + "\n"


_WORDS = {Truth.YES: "gained", Truth.NO: "lost", Truth.UNKNOWN: "unknown"}


def _sides(change: RoutedChange, release: str) -> tuple[str, str]:
    """Before and after."""
    before, after = (
        f"{answers[release].decided} / {answers[release].accepted}" if answers is not None else "no such enclave"
        for answers in (change.before, change.after)
    )
    return before, after


def changes_json(old: RoutedTable, new: RoutedTable, found: Sequence[RoutedChange]) -> str:
    """One line."""
    changed = [
        {
            **picked(each, "enclave", "operation", "name"),
            "gained": {Truth.YES: True, Truth.NO: False}.get(each.gained),
            **{
                side: {
                    name: {"decision": answer.decided, "effective": answer.accepted} for name, answer in answers.items()
                }
                if answers is not None
                else None
                for side, answers in (("before", each.before), ("after", each.after))
            },
        }
        for each in found
    ]
    head = {"old": old.folder, "new": new.folder, "domain": new.domain, "at": instant(new.at)}
    return encoded({**head, "changes": changed, "unknown": unknown((*old.doubts, *new.doubts))}) + "\n"


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
