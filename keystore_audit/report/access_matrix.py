"""Matrices of rows and enclaves that fit on a page: enclaves that may do the same are one column."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.model.tables.access_rows import Row
from keystore_audit.model.tables.access_table import Group
from keystore_audit.report.access_words import SHORT, full_name, namespace, protection_words, rights, worth_showing
from keystore_audit.text import terminal

MIN_LABEL: Final = 24
MAX_LABEL: Final = 48
"""Columns for the name of a topic."""

GAP: Final = 1
"""Between columns."""

INDENT: Final = 2


class Matrix(Struct, frozen=True, kw_only=True):
    """`columns`: (number, paths of the enclaves that are alike). `rows`: those in which any of them may do something,
    by what protects them. `started`: by number, whether the enclaves start.
    """

    columns: tuple[tuple[int, tuple[str, ...]], ...]
    rows: tuple[Row, ...]
    started: Mapping[int, bool | None]
    label_width: int
    widths: tuple[int, ...]

    @property
    def heads(self) -> list[str]:
        """The heads of the columns."""
        return [f"[{number}]".ljust(width) for (number, _paths), width in zip(self.columns, self.widths, strict=True)]

    def cells(self, row: Row) -> list[str]:
        """What the enclaves of each column may do."""
        return [
            cell(row, paths[0], self.started[number]).ljust(width)
            for (number, paths), width in zip(self.columns, self.widths, strict=True)
        ]


def cell(row: Row, path: str, started: bool | None) -> str:
    """What an enclave may do, in short."""
    if started is None:
        return "?"
    return "+".join(SHORT[word] for word in row.cells.get(path, ())) or ("" if started else "-")


def matrices(group: Group, rows: Sequence[Row], width: int) -> Iterator[Matrix]:
    """All enclaves and rows, in matrices of at most `width` columns of characters, namespace by namespace."""
    done = rights(rows)
    columns: dict[tuple[object, ...], list[str]] = {}
    for path in sorted(group.enclaves, key=lambda path: (namespace(path), path)):
        enclave = group.enclaves[path]
        columns.setdefault((enclave.usable, enclave.reasons, *done.get(path, ())), []).append(path)
    room = width + GAP - INDENT - _label_width(rows, width)
    number = 1
    for pack in _packs(list(columns.values()), group, rows, done, room):
        yield _matrix(pack, number, group, rows, width, done)
        number += len(pack)


def shown_name(row: Row) -> str:
    """The name of the row, escaped, in full."""
    return terminal(full_name(row))


def _label_width(rows: Iterable[Row], width: int) -> int:
    longest = max((len(shown_name(row)) for row in rows), default=MIN_LABEL)
    return max(MIN_LABEL, min(longest + GAP, MAX_LABEL, width // 2))


def _column_width(
    paths: Sequence[str], number: int, rows: Sequence[Row], mine: Iterable[tuple[int, tuple[str, ...]]]
) -> int:
    texts = [cell(rows[row], paths[0], True) for row, _words in mine]
    return max(map(len, [*texts, f"[{number}]"])) + GAP


def _packs(
    columns: Sequence[Sequence[str]],
    group: Group,
    rows: Sequence[Row],
    done: Mapping[str, Sequence[tuple[int, tuple[str, ...]]]],
    room: int,
) -> Iterator[list[Sequence[str]]]:
    """Columns that fit beside each other; a namespace that does not fit any more begins on a new page."""
    widths = [_column_width(paths, len(group.enclaves), rows, done.get(paths[0], ())) for paths in columns]
    pack: list[Sequence[str]] = []
    used = 0
    for number, paths in enumerate(columns):
        begins = not pack or namespace(pack[-1][0]) != namespace(paths[0])
        need = widths[number]
        if begins:
            same = [n for n in range(number, len(columns)) if namespace(columns[n][0]) == namespace(paths[0])]
            whole = sum(widths[n] for n in same)
            need = whole if whole <= room else need
        if pack and used + need > room:
            yield pack
            pack, used = [], 0
        pack.append(paths)
        used += widths[number]
    if pack:
        yield pack


def _matrix(
    pack: Sequence[Sequence[str]],
    first: int,
    group: Group,
    rows: Sequence[Row],
    width: int,
    done: Mapping[str, Sequence[tuple[int, tuple[str, ...]]]],
) -> Matrix:
    wanted = {number for paths in pack for number, _words in done.get(paths[0], ())}
    shown = sorted(worth_showing(rows, wanted), key=lambda row: protection_words(row.safeguards))
    return Matrix(
        columns=tuple((first + place, tuple(paths)) for place, paths in enumerate(pack)),
        rows=tuple(shown),
        started={first + place: group.enclaves[paths[0]].usable for place, paths in enumerate(pack)},
        label_width=_label_width(rows, width),
        widths=tuple(
            _column_width(paths, first + place, rows, done.get(paths[0], ())) for place, paths in enumerate(pack)
        ),
    )
