"""Constant relations as Alloy functions, in a form that the Analyzer parses fast.

What costs is the type of a union, a sum of products of atoms that the parser merges pair by pair. So unions are
balanced trees, rows with equal right sides stand together, large sets and long relations are cut into private
functions, whose declared type is one product. Measured at 500 enclaves and 1,000 topics: 110 s to parse as one flat
union, 3.8 s so.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from msgspec import Struct, field

from keystore_audit.engine.alloy.atoms import Sort

NAMED_SET: Final = 40
"""Atoms up to which a union stands in the row itself; a larger one is a function of its own, shared by all rows."""

TYPE_BUDGET: Final = 200
"""Tuples of one union's type; what goes beyond is cut into private functions."""

RUN: Final = 8
"""Terms of a union without parentheses; a longer one is a balanced tree."""

LINES: Final = "\n\t+ "
"""Rows stand on lines of their own, so that two models can be compared line by line."""


class Row(Struct, frozen=True, kw_only=True):
    """Some tuples of a relation, `left -> right`; `weight`: how many its type has."""

    expression: str
    weight: int


class Relations(Struct):
    """Writes functions. `private`: the helper functions that were needed so far and are not taken yet."""

    private: list[str] = field(default_factory=list)
    _named: dict[tuple[str, tuple[int, ...]], str] = field(default_factory=dict)

    def take_private(self) -> list[str]:
        """Return the helper functions written since the last call."""
        taken, self.private = self.private, []
        return taken

    def atoms(self, sort: Sort, members: Iterable[int]) -> str:
        """Return the function body for the atoms of `sort` with these indices."""
        which = tuple(sorted(members))
        return self._atoms(sort, which) if which else "none"

    def subset(self, name: str, sort: Sort, members: Iterable[int]) -> str:
        """Return the function `name` that is these atoms of `sort`."""
        return function(name, f"set {sort.sig}", self.atoms(sort, members))

    def rows(self, left: Sort, right: Sort, rows: Sequence[Iterable[int]]) -> list[Row]:
        """Return the relation that takes atom i of `left` to the atoms `rows[i]` of `right`."""
        by_right: dict[tuple[int, ...], list[int]] = {}
        for index, row in enumerate(rows):
            if key := tuple(sorted(row)):
                by_right.setdefault(key, []).append(index)
        return [self._row(left, tuple(which), right, key) for key, which in by_right.items()]

    def constant_rows(self, left: Sort, values: Sequence[str]) -> list[Row]:
        """Return the relation that takes atom i of `left` to the atom called `values[i]`."""
        holders: dict[str, list[int]] = {}
        for index, value in enumerate(values):
            holders.setdefault(value, []).append(index)
        return [
            Row(expression=f"{self._atoms(left, tuple(which))} -> {value}", weight=_weight(which))
            for value, which in sorted(holders.items())
        ]

    def relation(self, name: str, declared: str, rows: Sequence[Row]) -> str:
        """Return the function `name` that is the union of `rows`."""
        unions = [union([row.expression for row in block], LINES) for block in _blocks(rows)]
        if len(unions) > 1:
            unions = [self._help(f"{name}_{number}", declared, body) for number, body in enumerate(unions)]
        return function(name, declared, union(unions, LINES) or "none -> none")

    def _row(self, left: Sort, which: tuple[int, ...], right: Sort, key: tuple[int, ...]) -> Row:
        expression = f"{self._atoms(left, which)} -> {self._atoms(right, key)}"
        return Row(expression=expression, weight=_weight(which) * _weight(key))

    def _atoms(self, sort: Sort, which: tuple[int, ...]) -> str:
        """Return an expression for some atoms of a sort: one, the sig for all, a union, a named set for many."""
        if len(which) == 1:
            return sort.name(which[0])
        if len(which) == len(sort.atoms):
            return sort.sig
        if len(which) <= NAMED_SET:
            return f"({union([sort.name(index) for index in which])})"
        if (sort.sig, which) not in self._named:
            self._named[sort.sig, which] = self._name_set(sort, which)
        return self._named[sort.sig, which]

    def _name_set(self, sort: Sort, which: tuple[int, ...]) -> str:
        name = f"some_{sort.sig}_{len(self._named)}"
        parts = [which[start : start + TYPE_BUDGET] for start in range(0, len(which), TYPE_BUDGET)]
        unions = [union([sort.name(index) for index in part]) for part in parts]
        if len(unions) > 1:
            declared = f"set {sort.sig}"
            unions = [self._help(f"{name}_{number}", declared, body) for number, body in enumerate(unions)]
        return self._help(name, f"set {sort.sig}", union(unions))

    def _help(self, name: str, declared: str, body: str) -> str:
        self.private.append("private " + function(name, declared, body))
        return name


def function(name: str, declared: str, body: str) -> str:
    """Return a function without arguments, on one line if its body is."""
    if "\n" in body:
        return f"fun {name}: {declared} {{\n\t{body}\n}}"
    return f"fun {name}: {declared} {{ {body} }}"


def union(terms: Sequence[str], plus: str = " + ") -> str:
    """Return the union of `terms` as a balanced tree; the empty text for none."""
    if len(terms) <= RUN:
        return plus.join(terms)
    middle = len(terms) // 2
    return f"({union(terms[:middle], plus)}){plus}({union(terms[middle:], plus)})"


def _weight(which: Sequence[int]) -> int:
    """Return the size of the type of a set: that of its atoms, or 1 where a function declares it."""
    return len(which) if len(which) <= NAMED_SET else 1


def _blocks(rows: Sequence[Row]) -> Iterator[list[Row]]:
    """Cut rows into blocks within the budget."""
    block: list[Row] = []
    size = 0
    for row in rows:
        if block and size + row.weight > TYPE_BUDGET:
            yield block
            block, size = [], 0
        block.append(row)
        size += row.weight
    if block:
        yield block
