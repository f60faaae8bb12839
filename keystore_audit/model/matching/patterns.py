"""Expressions of one sort of name, however many are written alike or mean the same to several implementations."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from typing import Final

from keystore_audit.model.matching.atoms import TopicClass, classify
from keystore_audit.model.matching.expression import Pattern, parse
from keystore_audit.model.matching.partition_patterns import meetings
from keystore_audit.model.matching.pattern_index import PatternIndex
from keystore_audit.profiles import Matcher

OTHER_PARTITION: Final = "other"
"""What a partition is called that no document names: `rt/a`, as a topic would be, reads as if it were one."""

MAX_KEPT: Final = 50_000
"""Expressions whose classes are kept for who asks again; those of more are some 100 MB."""


class Patterns:
    """Expressions of one sort of name, each meaning once. `topics`: False for those of partitions."""

    def __init__(self, *, topics: bool = True) -> None:
        self._topics = topics
        self.patterns: list[Pattern] = []
        self._by_meaning: dict[object, int] = {}
        self._known: dict[tuple[str, Matcher], int] = {}
        self._literals: dict[str, int] = {}
        self._wildcards = PatternIndex()
        self._matching: dict[str, frozenset[int]] = {}

    def number(self, text: str, matcher: Matcher) -> int:
        """The number of the pattern."""
        number = self._known.get((text, matcher))
        if number is None:
            pattern = parse(text, matcher)
            number = self._by_meaning.setdefault(pattern.meaning, len(self.patterns))
            if number == len(self.patterns):
                self.patterns.append(pattern)
                self._matching.clear()
                if (literal := pattern.literal) is None:
                    self._wildcards.add(number, pattern)
                else:
                    self._literals[literal] = number
            self._known[text, matcher] = number
        return number

    def classes(self) -> tuple[TopicClass, ...]:
        """The classes of all non-empty names."""
        return classes_of(self.patterns, topics=self._topics)

    def meetings(self, asked: Collection[int]) -> Mapping[int, frozenset[int]]:
        """By class of partitions, of those `asked` about, what it meets: places in `empty` and, behind it, `classes`.

        Raises errors.BudgetExceeded.
        """
        return _meetings(_Expressions(self.patterns), tuple(asked))

    def empty(self) -> TopicClass:
        """The class of the empty name alone: the default partition."""
        return TopicClass(members=self.matching(""), witness="", ros=False, infinite=False)

    def matching(self, name: str) -> frozenset[int]:
        """The patterns that match the name."""
        known = self._matching.get(name)
        if known is None:
            literal = self._literals.get(name)
            found = [number for number, pattern in self._wildcards.candidates(name) if pattern.matches(name)]
            known = self._matching[name] = frozenset(found if literal is None else [literal, *found])
        return known

    def places(self, classes: Sequence[TopicClass]) -> list[list[int]]:
        """By pattern: the classes whose names it matches."""
        places: list[list[int]] = [[] for _ in self.patterns]
        for place, each in enumerate(classes):
            for member in each.members:
                places[member].append(place)
        return places


def classes_of(patterns: Sequence[Pattern], *, topics: bool = True) -> tuple[TopicClass, ...]:
    """What `atoms.classify` returns or raises: the same for those who ask about the same expressions in turn.

    The systems, the lines on which profiles differ and the ranking of enclaves do, of one keystore. `topics`: False
    where they are of partitions.
    """
    if len(patterns) <= MAX_KEPT:
        return _classes(_Expressions(patterns), topics)
    return _classified(patterns, topics=topics)


def _classified(patterns: Sequence[Pattern], *, topics: bool) -> tuple[TopicClass, ...]:
    return classify(patterns, prefer=() if topics else (OTHER_PARTITION,), topics=topics)


class _Expressions:
    """Patterns, which are equal if they mean the same in the same order."""

    __slots__ = ("_hash", "_meanings", "patterns")

    def __init__(self, patterns: Sequence[Pattern]) -> None:
        self.patterns = tuple(patterns)
        self._meanings = tuple([pattern.meaning for pattern in patterns])
        self._hash = hash(self._meanings)

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Expressions) and self._meanings == other._meanings


@lru_cache(maxsize=4)
def _classes(expressions: _Expressions, topics: bool) -> tuple[TopicClass, ...]:
    return _classified(expressions.patterns, topics=topics)


@lru_cache(maxsize=1)
def _meetings(expressions: _Expressions, asked: tuple[int, ...]) -> Mapping[int, frozenset[int]]:
    default = frozenset(number for number, pattern in enumerate(expressions.patterns) if pattern.matches(""))
    empty = TopicClass(members=default, witness="", ros=False, infinite=False)
    return meetings(expressions.patterns, [empty, *classes_of(expressions.patterns, topics=False)], asked)
