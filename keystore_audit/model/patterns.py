"""Expressions of one sort of name, however many are written alike or mean the same to several implementations."""

from __future__ import annotations

from collections.abc import Sequence

from keystore_audit.model.atoms import TopicClass, classify
from keystore_audit.model.expression import Matcher, Pattern, parse
from keystore_audit.model.pattern_index import PatternIndex


class Patterns:
    """Expressions of one sort of name, each meaning once."""

    def __init__(self) -> None:
        self.patterns: list[Pattern] = []
        self._by_meaning: dict[object, int] = {}
        self._known: dict[tuple[str, Matcher], int] = {}
        self._literals: dict[str, int] = {}
        self._wildcards = PatternIndex()

    def number(self, text: str, matcher: Matcher) -> int:
        """The number of the pattern."""
        number = self._known.get((text, matcher))
        if number is None:
            pattern = parse(text, matcher)
            number = self._by_meaning.setdefault((pattern.rewinds, pattern.pieces), len(self.patterns))
            if number == len(self.patterns):
                self.patterns.append(pattern)
                if pattern.literal is None:
                    self._wildcards.add(number, pattern)
                else:
                    self._literals[pattern.literal] = number
            self._known[text, matcher] = number
        return number

    def classes(self) -> tuple[TopicClass, ...]:
        """The classes of all non-empty names."""
        return classify(self.patterns)

    def empty(self) -> TopicClass:
        """The class of the empty name alone: the default partition."""
        return TopicClass(members=self.matching(""), witness="", ros=False, infinite=False)

    def matching(self, name: str) -> frozenset[int]:
        """The patterns that match the name."""
        literal = self._literals.get(name)
        found = [number for number, pattern in self._wildcards.candidates(name) if pattern.matches(name)]
        return frozenset(found if literal is None else [literal, *found])

    def places(self, classes: Sequence[TopicClass]) -> list[list[int]]:
        """By pattern: the classes whose names it matches."""
        places: list[list[int]] = [[] for _ in self.patterns]
        for place, each in enumerate(classes):
            for member in each.members:
                places[member].append(place)
        return places
