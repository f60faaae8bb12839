"""Which of many expressions may match a name: by what it begins and ends with, instead of one after the other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.model.matching.expression import Pattern

_ANY_LENGTH: Final = -1
"""Stands for the length of the names that an expression with a star matches."""


class PatternIndex:
    """Expressions with wildcards, each with a number, by the length, beginning and end of the names that they match.

    Names are asked of those alone that agree in all three: of 3,000 expressions like `rt/arm1*` a handful.
    """

    def __init__(self, patterns: Iterable[tuple[int, Pattern]] = ()) -> None:
        self._alike: dict[tuple[int, str, str], list[tuple[int, Pattern]]] = {}
        self._shapes: dict[int, set[tuple[int, int]]] = {}
        for number, pattern in patterns:
            self.add(number, pattern)

    def add(self, number: int, pattern: Pattern) -> None:
        """One more."""
        length = len(pattern.pieces[0]) if len(pattern.pieces) == 1 else _ANY_LENGTH
        prefix, suffix = pattern.prefix, pattern.suffix
        self._alike.setdefault((length, prefix, suffix), []).append((number, pattern))
        self._shapes.setdefault(length, set()).add((len(prefix), len(suffix)))

    def candidates(self, name: str) -> Iterator[tuple[int, Pattern]]:
        """Those that may match the name, in no particular order."""
        size = len(name)
        for length in (_ANY_LENGTH, size):
            for before, behind in self._shapes.get(length, ()):
                if before <= size and behind <= size:
                    yield from self._alike.get((length, name[:before], name[size - behind :]), ())
