"""Who may do what: enclaves by namespace against topics by what protects them.

Each right names the line that gives it, shown for the cell that is under the pointer or has the focus. Enclaves of one
namespace that may do the same are one column. What is left out is counted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Final

from msgspec import Struct

from keystore_audit.grouped import grouped
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.tables.access_rows import Row, decision_rows, folded_by_owner
from keystore_audit.model.tables.access_table import AccessTable, Group
from keystore_audit.model.tables.overview import Allowance, Overview
from keystore_audit.report.access_differences import peers
from keystore_audit.report.access_words import SHORT, full_name, namespace, protection_words, rights, worth_showing
from keystore_audit.report.html.element import NOTHING, Html, element, folded, items, joined, lines, name, some
from keystore_audit.report.html.protection import protected
from keystore_audit.report.html.sheet import Sheet
from keystore_audit.text import counted

MAX_COLUMNS: Final = 14
"""Columns of one matrix, so that it fits on a page."""

MAX_TOGETHER: Final = 14
"""Enclaves up to which all are in one matrix, whatever their namespaces, each with a column of its own."""

MAX_CELLS: Final = 12_000
"""Cells of all matrices: what a browser shows at once without effort."""

MAX_ROWS: Final = 250
"""Rows of one matrix; the least protected are drawn."""

MAX_OPEN: Final = 3
"""Kinds of namespaces up to which their matrices are seen without a click."""

MAX_ALIKE: Final = 300
"""Namespaces that are named where many are alike."""

MAX_NAMED: Final = 12
"""Enclaves or lines that are named for one column or cell."""

_NEEDS: Final = {
    "publish": (Operation.PUBLISH,),
    "subscribe": (Operation.SUBSCRIBE,),
    "relay": (Operation.RELAY,),
}
"""The operations of a right; services and actions need both publishing and subscribing."""

LEGEND: Final = (
    "pub, sub, relay: publish, subscribe, relay a topic. req, rep: call, serve a service. call, exec: use, execute an "
    "action, all of its topics and services. ?: cannot be told. –: its participant does not start. ~: the enclave's "
    "own name. Point at a cell, or move to it with the Tab key, to see which line gives the right."
)


class _Column(Struct, frozen=True):
    """Enclaves of one namespace that are alike."""

    paths: tuple[str, ...]
    usable: bool | None


def access(sheet: Sheet, overview: Overview) -> Html:
    """Return the matrices of the profiles that most answers are shared by, and what peers take besides."""
    table = overview.access
    if table is None:
        return element("p", f"Who may do what was not worked out: {overview.refused}", class_="soft")
    main = table.groups[-1]
    drawing = _Drawing(sheet, overview, table, main)
    told = [element("p", sentence) for sentence in peers(table, main)]
    notes = element("div", lines(told), class_="notes") if told else NOTHING
    under = sheet.under(main.profiles)
    intro = (
        f"In domain {table.domain}{', ' + under if under else ''}: what each enclave's own implementation lets it do."
    )
    return joined(
        [element("p", intro), lines(drawing.matrices()), element("p", LEGEND, class_="soft legend"), notes],
    )


class _Drawing:
    """Draws the matrices of one group of profiles."""

    def __init__(self, sheet: Sheet, overview: Overview, table: AccessTable, group: Group) -> None:
        self._sheet = sheet
        self._overview = overview
        self._group = group
        self._cells = MAX_CELLS
        many = len(group.enclaves) > MAX_TOGETHER
        rows = decision_rows(table, group)
        self._rows = folded_by_owner(rows) if many else rows
        self._many = many
        self._done = rights(self._rows)

    def matrices(self) -> Iterator[Html]:
        """One for all enclaves, or one folded for each namespace."""
        spaces = grouped(sorted(self._group.enclaves, key=lambda path: (namespace(path), path)), namespace)
        if not self._many:
            yield self._matrix([column for paths in spaces.values() for column in self._columns(paths)])
            return
        kinds = grouped(spaces, lambda space: self._kind(space, spaces[space]))
        drawn = [self._space(alike, spaces[alike[0]], open_=len(kinds) <= MAX_OPEN) for alike in kinds.values()]
        yield element("div", lines(drawn), class_="spaces-list")

    def _kind(self, space: str, paths: Sequence[str]) -> object:
        """What its enclaves may do, with the namespace's own name taken out: equal for robots that are alike."""
        own = f"{space}/"
        kind = []
        for path in paths:
            enclave = self._group.enclaves[path]
            may = (
                (row.label.replace(own, "\0"), row.sort, row.safeguards, words)
                for row, words in ((self._rows[number], words) for number, words in self._done.get(path, ()))
            )
            kind.append((path.removeprefix(own), enclave.usable, enclave.reasons, frozenset(may)))
        return tuple(kind) if space else (space, *kind)

    def _space(self, alike: Sequence[str], paths: Sequence[str], *, open_: bool) -> Html:
        """The matrices of one namespace, which stands for those that are alike."""
        columns = self._columns(paths)
        parts = [self._matrix(columns[start : start + MAX_COLUMNS]) for start in range(0, len(columns), MAX_COLUMNS)]
        kinds = f", {counted(len(columns), 'kind')}" if len(columns) < len(paths) else ""
        others = f", and {counted(len(alike) - 1, 'namespace')} alike" if len(alike) > 1 else ""
        head = joined([name(f"{alike[0]}/"), f" {counted(len(paths), 'enclave')}{kinds}{others}"])
        if others:
            named = some([f"{space}/" for space in alike[1:]], MAX_ALIKE - 1)
            parts.append(folded("Alike, but for the namespace's own name", items(named, class_="names"), class_="more"))
        return folded(head, lines(parts), open_=open_, class_="space")

    def _columns(self, paths: Sequence[str]) -> list[_Column]:
        """Enclaves that are alike together, unless there are few."""
        kinds: dict[object, list[str]] = {}
        for path in paths:
            enclave = self._group.enclaves[path]
            kind = (enclave.usable, enclave.reasons, tuple(self._done.get(path, ()))) if self._many else path
            kinds.setdefault(kind, []).append(path)
        return [_Column(tuple(alike), self._group.enclaves[alike[0]].usable) for alike in kinds.values()]

    def _matrix(self, columns: Sequence[_Column]) -> Html:
        wanted = {number for column in columns for number, _words in self._done.get(column.paths[0], ())}
        groups = _by_protection(worth_showing(self._rows, wanted))
        every = [row for _words, each in groups for row in each]
        rows = every[: min(MAX_ROWS, self._cells // len(columns))]
        self._cells -= len(rows) * len(columns)
        left_out = f"{counted(len(every) - len(rows), 'row')} not drawn; `keystore-audit access` has all."
        rest = element("p", left_out, class_="soft") if len(rows) < len(every) else NOTHING
        if not rows and every:
            return rest
        bodies = [self._body(words, each, columns) for words, each in _by_protection(rows)]
        table = element("table", self._head(columns), joined(bodies), class_="matrix")
        drawn = element("div", table, class_="wide", tabindex=0, role="region", aria_label="Access matrix")
        return joined([drawn, rest])

    def _head(self, columns: Sequence[_Column]) -> Html:
        """Namespaces above, then the enclaves, each a link to its information flow."""
        spaces = [(space, len(list(each))) for space, each in groupby(namespace(column.paths[0]) for column in columns)]
        above = [element("th", name(f"{space}/"), colspan=width, scope="colgroup") for space, width in spaces]
        corner = element("td", class_="corner")
        heads = [element("th", self._column_head(column), scope="col") for column in columns]
        first = element("tr", corner, joined(above), class_="spaces") if len(spaces) > 1 or self._many else NOTHING
        return element("thead", lines([first, element("tr", corner, lines(heads), class_="enclaves")]))

    def _column_head(self, column: _Column) -> Html:
        path = column.paths[0]
        shown = element("code", path.rpartition("/")[2] or "/")
        number = self._sheet.numbers.get(path)
        link = element("a", shown, href=f"#{self._sheet.anchor('flow', number)}") if number is not None else shown
        many = (
            element("span", f" and {len(column.paths) - 1} alike", class_="many") if len(column.paths) > 1 else NOTHING
        )
        state = {True: NOTHING, False: element("b", " does not start"), None: element("b", " unknown")}[column.usable]
        reasons = self._group.enclaves[path].reasons
        told = [
            _listed([name(each) for each in column.paths], "enclave"),
            *(element("p", reason) for reason in reasons),
        ]
        tip = element("span", joined(told), class_="tip") if len(column.paths) > 1 or reasons else NOTHING
        focus = {"tabindex": 0} if tip is not NOTHING else {}
        return element("div", element("span", link, many, state, class_="upright"), tip, class_="column", **focus)

    def _body(self, words: str, rows: Sequence[Row], columns: Sequence[_Column]) -> Html:
        """The rows with one protection, under a line that says it."""
        guard = protected(rows[0].safeguards)
        label = joined([element("span", guard.mark, class_="mark", aria_hidden="true"), words])
        head = element("tr", element("th", label, colspan=len(columns) + 1, scope="rowgroup"), class_="protection")
        return element("tbody", head, lines(self._row(row, columns) for row in rows), class_=guard.kind)

    def _row(self, row: Row, columns: Sequence[_Column]) -> Html:
        cells = [self._cell(row, column) for column in columns]
        return element("tr", element("th", name(full_name(row)), scope="row"), joined(cells))

    def _cell(self, row: Row, column: _Column) -> Html:
        path = column.paths[0]
        words = row.cells.get(path, ())
        if column.usable is None:
            return element("td", "?", class_="unknown")
        if not words:
            return element("td") if column.usable else element("td", "–", class_="unusable")
        short = [element("span", SHORT[word], class_=SHORT[word]) for word in words]
        more = f" (and {len(column.paths) - 1} alike)" if len(column.paths) > 1 else ""
        does = f" may {' and '.join(words)} "
        source = _listed(list(_sources(self._overview.allowances.get(path, ()), row, words)), "line")
        said = element("span", name(path), more, does, name(row.label), class_="who")
        tip = element("span", said, source, class_="tip")
        return element("td", joined(short), tip, class_="right", tabindex=0)


def _by_protection(rows: Iterable[Row]) -> Iterable[tuple[str, list[Row]]]:
    """The least protected first: that is what a reader looks for."""
    groups = grouped(rows, lambda row: (protected(row.safeguards).rank, protection_words(row.safeguards)))
    return [(words, each) for (_rank, words), each in sorted(groups.items(), key=lambda entry: entry[0])]


def _sources(allowances: Iterable[Allowance], row: Row, words: Sequence[str]) -> Iterator[Html]:
    """The lines that give the rights, each once."""
    needed = {operation for word in words for operation in _NEEDS.get(word, tuple(Operation)[:2])}
    told: dict[tuple[str, str], None] = {}
    for allowance in allowances:
        if allowance.operation in needed and allowance.names & row.names:
            told[str(allowance.location or ""), allowance.reason] = None
    for at, reason in told:
        yield joined([element("code", at, class_="place"), f" {reason}"])


def _listed(parts: Sequence[Html], noun: str) -> Html:
    """The parts as a list; many are counted."""
    kept = list(parts[:MAX_NAMED])
    if len(parts) > MAX_NAMED:
        kept.append(element("span", f"and {counted(len(parts) - MAX_NAMED, f'more {noun}', f'more {noun}s')}"))
    return items(kept)
