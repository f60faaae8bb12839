"""The access table for people: who may do what, topics by what protects them, enclaves by namespace.

First comes where implementations differ, then the table that most of them share. Its matrices fit on a page, since
enclaves that may do the same are one column. Names are escaped here.
"""

from __future__ import annotations

import csv as writer
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from io import StringIO
from typing import Any, Final

from keystore_audit import __version__
from keystore_audit.assumptions import Assumption, holds_if
from keystore_audit.grouped import grouped
from keystore_audit.model.formal.rights import Safeguard
from keystore_audit.model.names import ros_name
from keystore_audit.model.question import WORDS
from keystore_audit.model.tables.access_rows import Row, decision_rows, folded_by_owner, label
from keystore_audit.model.tables.access_table import AccessTable, EnclaveRights, Group
from keystore_audit.profiles import at_work, declared
from keystore_audit.report.access_words import (
    SHORT,
    differences,
    full_name,
    namespace,
    peers,
    protection_words,
    rights,
    worth_showing,
)
from keystore_audit.report.content import answered_if
from keystore_audit.report.json import array, document, encoded, keys, picked
from keystore_audit.report.page import wrapped
from keystore_audit.text import counted, csv_cell, instant, shorten, terminal
from keystore_audit.truth import Truth

# The access table for programs: as JSON (docs/reference.md, `schemas/access.schema.json`), and as CSV.


SCHEMA_VERSION: Final = 1

HEADER: Final = (
    "profiles", "enclave", "usable", "operation", "name", "topic", "partition", "decision", "effective",
)  # fmt: skip
_USABLE: Final = {Truth.YES: "yes", Truth.NO: "no", Truth.UNKNOWN: "unknown"}


def json(table: AccessTable) -> str:
    """A line for each name, enclave and right; ends in a newline."""
    head = {
        "schema_version": SCHEMA_VERSION,
        "tool": {"name": "keystore-audit", "version": __version__},
        "keystore": {"path": table.root},
        "at": instant(table.at),
        "domain": table.domain,
        "complete": not table.has_unknown,
        "assumptions": [each.described for each in answered_if(each.name for each in at_work(table.fleets))],
        **({"declared": mixed} if (mixed := declared(table.fleets)) else {}),
    }
    names = array("names", [encoded(_name(table, number)) for number in range(len(table.names))])
    return document([*keys(head), names, array("groups", [_group(table, group) for group in table.groups])])


def _name(table: AccessTable, number: int) -> dict[str, Any]:
    named = table.names[number]
    ros = ros_name(named.topic) if named.ros else None
    one = not named.several
    return {**picked(named, "topic", "partition"), "ros": ros, "one": one, "expressions": named.expressions}


def _group(table: AccessTable, group: Group) -> str:
    enclaves = [encoded(_enclave(table, path, enclave)) for path, enclave in group.enclaves.items()]
    parts = [
        f'      "profiles": {encoded(group.profiles)}',
        array("protection", [encoded([*map(_safeguard, several)]) for several in group.safeguards], 6),
        array("enclaves", enclaves, 6),
        array("rights", [encoded(right) for right in _rights(table, group)], 6),
    ]
    return "{\n" + ",\n".join(parts) + "\n    }"


def _safeguard(safeguard: Safeguard) -> dict[str, Any]:
    return {
        **picked(safeguard, "governed", "encrypted", "authenticated"),
        "read_access_control": safeguard.read_controlled,
        "write_access_control": safeguard.write_controlled,
        "unauthenticated_participants": safeguard.unauthenticated,
    }


def _enclave(table: AccessTable, path: str, enclave: EnclaveRights) -> dict[str, Any]:
    otherwise = {operation: _rulings(enclave.otherwise(operation, table.rest)) for operation in enclave.rights}
    return {"path": path, "usable": enclave.usable.value, "reasons": enclave.reasons, "otherwise": otherwise}


def _rights(table: AccessTable, group: Group) -> Iterator[dict[str, Any]]:
    """Where something else holds than `otherwise`."""
    for path, enclave in group.enclaves.items():
        for operation in enclave.rights:
            for number, *rulings in enclave.exceptions(operation, table.rest):
                named = picked(table.names[number], "topic", "partition")
                yield {"enclave": path, "operation": operation, **named, **_rulings(rulings)}


def _rulings(both: Iterable[Truth]) -> dict[str, str]:
    return dict(zip(("decision", "effective"), (WORDS[each] for each in both), strict=True))


def csv(table: AccessTable) -> str:
    """RFC 4180, one row a right, safe to open in a spreadsheet; what is denied by everybody has no row."""
    return csv_of(HEADER, (row for group in table.groups for row in _csv_rows(table, group)))


def csv_of(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """The same of any rows."""
    out = StringIO()
    written = writer.writer(out, lineterminator="\r\n")
    written.writerow(header)
    written.writerows([csv_cell(cell) for cell in row] for row in rows)
    return out.getvalue()


def _csv_rows(table: AccessTable, group: Group) -> Iterator[tuple[str, ...]]:
    profiles = " ".join(group.profiles)
    for path, enclave in group.enclaves.items():
        for operation in enclave.rights:
            start = (profiles, path, _USABLE[enclave.usable], operation.value)
            otherwise = enclave.otherwise(operation, table.rest)
            if any(ruling.may for ruling in otherwise):
                yield (*start, "any other name", "", "", *(WORDS[ruling] for ruling in otherwise))
            for number, decision, effective in enclave.exceptions(operation, table.rest):
                named = table.names[number]
                yield (
                    *start, label(table, number), named.topic, named.partition, WORDS[decision], WORDS[effective],
                )  # fmt: skip


LEGEND: Final = (
    "pub, sub, relay: publish, subscribe, relay a topic. req, rep: call, serve a service. call, exec: use, execute an "
    "action (all its topics and services). ?: cannot be told. -: its participant does not start."
)
OWN_LEGEND: Final = " ~: the enclave's own name."
MANY: Final = 12
"""Enclaves beyond which topics of their own are one row for all."""

MAX_OF_NAMESPACE: Final = 3
"""Enclaves of one namespace that are named one by one."""

MAX_ROOT: Final = 50
"""Characters of the keystore's path in the title."""

MIN_LABEL: Final = 24
MAX_LABEL: Final = 48
"""Columns for the name of a topic."""

GAP: Final = 1
"""Between columns."""

INDENT: Final = 2

_Done = Sequence[tuple[int, tuple[str, ...]]]
"""Numbers of rows, and what may be done there."""


def text(table: AccessTable, width: int) -> str:
    """The table at that many columns; ends in a newline."""
    *others, main = table.groups
    enclaves = counted(len(main.enclaves), "enclave")
    where = f"domain {table.domain}, at {instant(table.at)}"
    if mixed := declared(table.fleets):
        where += f", {mixed}"
    refusing = answered_if(each.name for each in at_work(table.fleets))
    page = _Page(width)
    page.put(f"Who may do what in {shorten(table.root, MAX_ROOT)} ({enclaves}), {where}")
    page.put(f"Assumed: {Assumption.ROBOTS_ENFORCE.statement}")
    page.put(f"What peers refuse {holds_if(refusing)}.")
    rows = decision_rows(table, main)
    for group in others:
        page.blank()
        page.put(f"Different under {', '.join(group.profiles)}")
        for line in differences(table, group, main):
            page.put(line, indent=2, hanging=4)
    page.blank()
    names = ", ".join(main.profiles)
    page.put(f"Under all others ({names})" if others else f"Under every profile ({names})")
    page.matrices(main, rows)
    for line in peers(table, main):
        page.put(line, hanging=2)
    return "\n".join(page.lines) + "\n"


class _Page:
    """Lines of at most `width` columns."""

    def __init__(self, width: int) -> None:
        self.lines: list[str] = []
        self._width = width

    def put(self, text: str, indent: int = 0, hanging: int = 0) -> None:
        """Add a paragraph."""
        self.lines.append(wrapped(text, " " * indent, " " * max(indent, hanging), width=self._width))

    def blank(self) -> None:
        """Leave one empty line."""
        if self.lines and self.lines[-1]:
            self.lines.append("")

    def matrices(self, group: Group, rows: Sequence[Row]) -> None:
        """All enclaves and rows, in matrices that fit, each with the enclaves of its columns before it."""
        many = len(group.enclaves) > MANY
        if many:
            rows = folded_by_owner(rows)
        for columns in self._packs(group, rows):
            self.blank()
            for column in columns:
                self.put(f"[{column.number}] {column.said}", hanging=5)
            wanted = {number for column in columns for number, _words in column.done}
            shown = sorted(worth_showing(rows, wanted), key=lambda row: protection_words(row.safeguards))
            if shown:
                self._rows(columns, shown, self._label_width(rows))
            else:
                unknown = any(column.usable is Truth.UNKNOWN for column in columns)
                self.put("What they may do cannot be told." if unknown else "They may do nothing.", indent=2)
        if rows:
            self.blank()
            self.put(LEGEND + (OWN_LEGEND if many else ""))

    def _label_width(self, rows: Iterable[Row]) -> int:
        longest = max((len(_shown(row)) for row in rows), default=MIN_LABEL)
        return max(MIN_LABEL, min(longest + GAP, MAX_LABEL, self._width // 2))

    def _packs(self, group: Group, rows: Sequence[Row]) -> Iterator[list[_Column]]:
        """Columns that fit beside each other; a namespace that does not fit any more begins on a new page."""
        room = self._width + GAP - INDENT - self._label_width(rows)
        columns = [*_columns(group, rows)]
        spaces = grouped(columns, lambda column: column.space)
        pack: list[_Column] = []
        for column in columns:
            need = column.room
            if pack and pack[-1].space != column.space:
                whole = sum(each.room for each in spaces[column.space])
                need = whole if whole <= room else need
            if pack and sum(each.room for each in pack) + need > room:
                yield pack
                pack = []
            pack.append(column)
        if pack:
            yield pack

    def _rows(self, columns: Sequence[_Column], rows: Sequence[Row], width: int) -> None:
        """The rows under what protects them."""
        labels = [shorten(_shown(row), width - 1).ljust(width) for row in rows]
        times = Counter(labels)
        heads = "".join(f"[{column.number}]".ljust(column.width) for column in columns)
        heading = None
        for row, title in zip(rows, labels, strict=True):
            words = protection_words(row.safeguards)
            if words != heading:
                heading = words
                self.blank()
                self.put(words, hanging=2)
                self.lines.append((" " * (INDENT + width) + heads).rstrip())
            own = times[title] == 1
            if not own:  # cut, they are the same
                self.put(full_name(row), indent=2, hanging=4)
            cells = "".join(column.cell(row).ljust(column.width) for column in columns)
            self.lines.append(f"{' ' * INDENT}{title if own else ' ' * width}{cells}".rstrip())


class _Column:
    """Enclaves that may do the same: the rows in which they may do something, whether they start, and who they are."""

    def __init__(
        self, number: int, paths: Sequence[str], group: Group, done: Sequence[tuple[int, Sequence[str]]]
    ) -> None:
        enclave = group.enclaves[paths[0]]
        self.number, self.done, self.usable = number, done, enclave.usable
        self.space = namespace(paths[0])
        self._path = paths[0]
        longest = max((len("+".join(SHORT[word] for word in words)) for _row, words in done), default=0)
        self.width = max(longest, len(f"[{number}]")) + GAP
        self.room = max(longest, len(f"[{len(group.enclaves)}]")) + GAP
        states = {
            Truth.YES: "",
            Truth.NO: ": DO NOT START" if len(paths) > 1 else ": DOES NOT START",
            Truth.UNKNOWN: ": UNKNOWN",
        }
        reasons = f" ({'; '.join(enclave.reasons)})" if enclave.reasons else ""
        self.said = f"{', '.join(_by_namespace(paths, group))}{states[self.usable]}{reasons}"

    def cell(self, row: Row) -> str:
        """What they may do, in short."""
        if self.usable is Truth.UNKNOWN:
            return "?"
        return "+".join(SHORT[word] for word in row.cells.get(self._path, ())) or ("" if self.usable.must else "-")


def _columns(group: Group, rows: Sequence[Row]) -> Iterator[_Column]:
    done = rights(rows)

    def kind(path: str) -> object:
        return group.enclaves[path].usable, group.enclaves[path].reasons, *done.get(path, ())

    by_space = sorted(group.enclaves, key=lambda path: (namespace(path), path))
    for number, paths in enumerate(grouped(by_space, kind).values(), 1):
        yield _Column(number, paths, group, done.get(paths[0], ()))


def _by_namespace(paths: Sequence[str], group: Group) -> Iterable[str]:
    """The enclaves, whole namespaces as one."""
    totals = Counter(map(namespace, group.enclaves))
    for space, own in grouped(paths, namespace).items():
        if space and totals[space] == len(own) > MAX_OF_NAMESPACE:
            yield f"{space}/... (all {len(own)})"
        else:
            yield from own


def _shown(row: Row) -> str:
    return terminal(full_name(row))
