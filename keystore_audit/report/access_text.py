"""The access table for people: who may do what, topics by what protects them, enclaves by namespace.

The first thing said is where implementations differ; then the table that most of them share. Names are escaped here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.assumptions import Assumption, holds_if
from keystore_audit.grouped import grouped
from keystore_audit.model.tables.access_rows import Row, decision_rows, folded_by_owner
from keystore_audit.model.tables.access_table import AccessTable, Group
from keystore_audit.report.access_differences import differences, peers
from keystore_audit.report.access_matrix import Matrix, matrices, shown_name
from keystore_audit.report.access_words import full_name, namespace, protection_words
from keystore_audit.report.content import answered_if
from keystore_audit.report.paragraph import wrapped
from keystore_audit.text import counted, instant, shorten

LEGEND: Final = (
    "pub, sub, relay: publish, subscribe, relay a topic. req, rep: call, serve a service. call, exec: use, execute an "
    "action: all of its topics and services. ?: cannot be told. -: its participant does not start."
)
OWN_LEGEND: Final = " ~: the enclave's own name."
MANY: Final = 12
"""Enclaves beyond which topics of their own are one row for all."""

MAX_OF_NAMESPACE: Final = 3
"""Enclaves of one namespace that are named one by one."""

MAX_ROOT: Final = 50
"""Characters of the keystore's path in the title."""


class _Sheet(Struct, frozen=True, kw_only=True):
    """Lines of at most `width` columns."""

    width: int
    lines: list[str]

    def put(self, text: str, indent: int = 0, hanging: int | None = None) -> None:
        """Add a paragraph."""
        rest = " " * (indent if hanging is None else hanging)
        self.lines.append(wrapped(text, " " * indent, rest, width=self.width))

    def blank(self) -> None:
        """Leave one empty line."""
        if self.lines and self.lines[-1]:
            self.lines.append("")


def text(table: AccessTable, width: int) -> str:
    """The table at that many columns; ends in a newline."""
    sheet = _Sheet(width=width, lines=[])
    enclaves = len(table.groups[-1].enclaves)
    where = shorten(table.root, MAX_ROOT)
    when = f"domain {table.domain}, at {instant(table.at)}"
    sheet.put(f"Who may do what in {where} ({counted(enclaves, 'enclave')}), {when}")
    sheet.put(f"Assumed: {Assumption.ROBOTS_ENFORCE.statement}")
    sheet.put(f"What peers refuse {holds_if(answered_if(n for group in table.groups for n in group.profiles))}.")
    *others, main = table.groups
    rows = decision_rows(table, main)
    for group in others:
        _difference(sheet, table, group, main, rows)
    sheet.blank()
    names = ", ".join(main.profiles)
    sheet.put(f"Under all others ({names})" if others else f"Under every profile ({names})")
    _group(sheet, main, rows)
    for line in peers(table, main):
        sheet.put(line, hanging=2)
    return "\n".join(sheet.lines) + "\n"


def _group(sheet: _Sheet, group: Group, rows: Sequence[Row]) -> None:
    """The matrices of one group, each with the enclaves of its columns before it."""
    many = len(group.enclaves) > MANY
    if many:
        rows = folded_by_owner(rows)
    for matrix in matrices(group, rows, sheet.width):
        sheet.blank()
        for number, paths in matrix.columns:
            _column(sheet, number, paths, group)
        if not matrix.rows:
            told = None not in matrix.started.values()
            sheet.put("They may do nothing." if told else "What they may do cannot be told.", indent=2)
        _rows(sheet, matrix)
    if rows:
        sheet.blank()
        sheet.put(LEGEND + (OWN_LEGEND if many else ""))


def _column(sheet: _Sheet, number: int, paths: Sequence[str], group: Group) -> None:
    """Which enclaves a column stands for."""
    enclave = group.enclaves[paths[0]]
    named = ", ".join(_by_namespace(paths, group))
    words = {True: "", False: ": DO NOT START" if len(paths) > 1 else ": DOES NOT START", None: ": UNKNOWN"}
    reasons = f" ({'; '.join(enclave.reasons)})" if enclave.reasons else ""
    sheet.put(f"[{number}] {named}{words[enclave.usable]}{reasons}", hanging=5)


def _by_namespace(paths: Sequence[str], group: Group) -> Iterable[str]:
    """The enclaves, whole namespaces as one."""
    totals = Counter(map(namespace, group.enclaves))
    for space, own in grouped(paths, namespace).items():
        if space and totals[space] == len(own) > MAX_OF_NAMESPACE:
            yield f"{space}/... (all {len(own)})"
        else:
            yield from own


def _rows(sheet: _Sheet, matrix: Matrix) -> None:
    """The rows under what protects them."""
    heading = None
    labels = [_fitted(shown_name(row), matrix.label_width) for row in matrix.rows]
    times = Counter(labels)
    for row, label in zip(matrix.rows, labels, strict=True):
        words = protection_words(row.safeguards)
        if words != heading:
            heading = words
            sheet.blank()
            sheet.put(words, hanging=2)
            sheet.lines.append((" " * (2 + matrix.label_width) + "".join(matrix.heads)).rstrip())
        own = times[label] == 1
        if not own:  # cut, they are the same
            sheet.put(full_name(row), indent=2, hanging=4)
        sheet.lines.append(f"  {label if own else ' ' * matrix.label_width}{''.join(matrix.cells(row))}".rstrip())


def _fitted(name: str, width: int) -> str:
    return shorten(name, width - 1).ljust(width)


def _difference(sheet: _Sheet, table: AccessTable, group: Group, main: Group, rows: Sequence[Row]) -> None:
    """What a group has that the largest one has not, and the other way round."""
    sheet.blank()
    sheet.put(f"Different under {', '.join(group.profiles)}")
    for line in differences(table, group, main, rows):
        sheet.put(line, indent=2, hanging=4)
