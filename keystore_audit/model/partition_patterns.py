"""Which classes of partitions an endpoint is met in whose partition is a pattern.

To permissions the partition of an endpoint is a plain string; to matching it is a pattern, which meets all names that
it matches (DDS 1.4, 2.2.3.13; measured on Cyclone DDS 0.10.2 and Fast DDS 2.9.1). So whoever may be in a class of
partitions that holds the string `*` meets everybody. Which classes meet is exact for `*` and `?`: a walk through the
pairs of a pattern and a name that it matches. Brackets are taken to match any one character, a character behind a
backslash is that character, and two patterns are taken to meet if one matches the other as a text: more may meet then
than do, never fewer.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from enum import IntEnum
from itertools import islice
from typing import Final, NamedTuple

from keystore_audit.model.alphabet import Alphabet, Budget
from keystore_audit.model.atoms import TopicClass
from keystore_audit.model.automaton import Automaton
from keystore_audit.model.coverage import has_wildcard
from keystore_audit.model.expression import Pattern
from keystore_audit.model.tokens import ANY_CHARACTER, CharSet

EVERY_PARTITION: Final = "*"
"""The partition in which an endpoint meets those of all others (DDS 1.4, 2.2.3.13)."""

MAX_PAIRS: Final = 200_000
"""Pairs of states that are visited: about two seconds. Beyond it the answer is unknown."""


class _Mode(IntEnum):  # pairs are looked up hundreds of thousands of times, and whole numbers are fast
    """Where in the pattern we are: between its characters, at a star, in brackets (empty still, or not), or escaped."""

    PLAIN = 0
    STAR = 1
    OPENED = 2
    BRACKETS = 3
    ESCAPED = 4


class _Pair(NamedTuple):
    """How far the pattern and the name are: states of the automaton. `begun`: the name has a character."""

    pattern: int
    name: int
    begun: bool
    mode: _Mode


def meetings(
    patterns: Sequence[Pattern], classes: Sequence[TopicClass], asked: Collection[int]
) -> dict[int, frozenset[int]]:
    """By class of partitions, of those `asked` about: the other classes that some pattern in it meets names of.

    `classes`: the first is the empty name, the default partition; the others are the classes of `patterns`, which
    class members index. Raises errors.BudgetExceeded.
    """
    everything = frozenset(n for n, pattern in enumerate(patterns) if pattern.matches(EVERY_PARTITION))
    found: dict[int, frozenset[int]] = {}
    walked: list[int] = []
    for place in asked:
        if place and classes[place].members == everything:
            found[place] = frozenset(range(len(classes))) - {place}
        elif place and not _is_plain(patterns, classes[place]):
            walked.append(place)
    if walked:
        met = _Walk(patterns).met()
        place_of = {each.members: place for place, each in enumerate(classes) if place}
        for place in walked:
            names = met.get(classes[place].members, frozenset())
            found[place] = frozenset(0 if each is None else place_of[each] for each in names) - {place}
    return {place: met for place, met in found.items() if met}


def between(
    columns: Iterable[Sequence[tuple[int, int]]], edges: Sequence[tuple[tuple[int, int], tuple[int, int]]]
) -> dict[int, frozenset[int]]:
    """What columns meet what other columns, since cells of theirs do."""
    if not edges:
        return {}
    place = {cell: number for number, cells in enumerate(columns) for cell in cells}
    found: dict[int, set[int]] = {}
    for one, other in edges:
        if place[one] != place[other]:
            found.setdefault(place[one], set()).add(place[other])
    return {number: frozenset(others) for number, others in found.items()}


def _is_plain(patterns: Sequence[Pattern], one: TopicClass) -> bool:
    """Whether it is the class of one name, which is no pattern."""
    name = one.witness
    return any(patterns[member].literal == name for member in one.members) and not has_wildcard(name)


_Met = Mapping[frozenset[int], Collection["frozenset[int] | None"]]
"""By what matches a pattern as a text: what matches the names that it matches, None for the empty name."""


class _Walk:
    """All pairs of a pattern and a name that it matches, as the states that these lead to."""

    def __init__(self, patterns: Sequence[Pattern]) -> None:
        message = f"{len(patterns)} expressions of partitions are more than can be compared as patterns"
        self._budget = Budget(4 * MAX_PAIRS, message)
        tokens = [pattern.tokens for pattern in patterns]
        used = {token for each in tokens for token in each}
        singles = {*"*?[]\\", *(token for token in used if isinstance(token, str))}
        sets = {token for token in used if isinstance(token, CharSet)} - {ANY_CHARACTER}
        alphabet = Alphabet(singles, sorted(sets, key=lambda charset: charset.ranges), self._budget)
        self._class = {character: alphabet.class_of(character) for character in "*?[]\\"}
        self._automaton = Automaton(tokens, alphabet, self._budget)

    def met(self) -> _Met:
        """All of them."""
        found: dict[frozenset[int], set[frozenset[int] | None]] = {}
        accepts = self._automaton.accepts
        start = _Pair(pattern=0, name=0, begun=False, mode=_Mode.PLAIN)
        seen = {start}
        pending = [start]
        while pending:
            pair = pending.pop()
            for after in self._steps(pair):
                if after.mode is _Mode.PLAIN:
                    name = accepts[after.name] if after.begun else None
                    found.setdefault(accepts[after.pattern], set()).add(name)
                if after not in seen:
                    self._budget.spend(4)
                    seen.add(after)
                    pending.append(after)
        return found

    def _steps(self, pair: _Pair) -> Iterator[_Pair]:
        """One step of the pattern, of the name, or of both."""
        mode = pair.mode
        if mode is _Mode.STAR:
            yield _Pair(pair.pattern, pair.name, pair.begun, _Mode.PLAIN)
            yield from self._any_name(pair)
        elif mode is _Mode.ESCAPED:
            yield from self._both(pair)
        elif mode is _Mode.PLAIN:
            yield from self._both(pair)
            yield self._reads(pair, "*", _Mode.STAR)
            yield from self._any_name(self._reads(pair, "?", _Mode.PLAIN))
            yield self._reads(pair, "[", _Mode.OPENED)
            yield self._reads(pair, "\\", _Mode.ESCAPED)
        else:
            by_class, default = self._automaton.moves(pair.pattern)
            for target in {default, *by_class.values()}:
                yield _Pair(target, pair.name, pair.begun, _Mode.BRACKETS)
            if mode is _Mode.BRACKETS:
                yield from self._any_name(self._reads(pair, "]", _Mode.PLAIN))

    def _reads(self, pair: _Pair, character: str, mode: _Mode) -> _Pair:
        """The pattern goes on by one character."""
        by_class, default = self._automaton.moves(pair.pattern)
        return _Pair(by_class.get(self._class[character], default), pair.name, pair.begun, mode)

    def _any_name(self, pair: _Pair) -> Iterator[_Pair]:
        """The name goes on by any character."""
        by_class, default = self._automaton.moves(pair.name)
        for target in {default, *by_class.values()}:
            yield _Pair(pair.pattern, target, True, pair.mode)

    def _both(self, pair: _Pair) -> Iterator[_Pair]:
        """Both go on by one character, which the pattern takes for itself: no star and no `?`, unless escaped."""
        of_pattern, default = self._automaton.moves(pair.pattern)
        of_name, name_default = self._automaton.moves(pair.name)
        wild = {self._class["*"], self._class["?"]} if pair.mode is _Mode.PLAIN else set()
        named = {*of_pattern, *of_name} - wild
        others = (n for n in range(self._automaton.alphabet.size) if n not in named and n not in wild)
        for number in (*named, *islice(others, 1)):
            yield _Pair(
                pattern=of_pattern.get(number, default),
                name=of_name.get(number, name_default),
                begun=True,
                mode=_Mode.PLAIN,
            )
