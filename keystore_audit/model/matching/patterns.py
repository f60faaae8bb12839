"""Expressions of one sort of name, however many are written alike or mean the same to several implementations."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence, Set
from functools import lru_cache
from typing import Final

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.matching.alphabet import Alphabet, Budget
from keystore_audit.model.matching.atoms import TopicClass, budget_of, classify
from keystore_audit.model.matching.automaton import Automaton, PatternIndex
from keystore_audit.model.matching.expression import Pattern, has_wildcard, parse
from keystore_audit.profiles import Matcher

# Which classes of partitions an endpoint is met in whose partition is a pattern.
#
# To permissions the partition of an endpoint is a plain string. To matching it is a pattern, which meets all names
# that it matches (DDS 1.4, 2.2.3.13; measured on Cyclone DDS 0.10.2 and Fast DDS 2.9.1). So who is allowed in a class
# of partitions that holds the string `*` meets everybody. Which classes meet is exact for `*` and `?`: a walk through
# the pairs of a pattern and a name that it matches. Brackets are taken to match any one character, and a character
# behind a backslash is that character. Two patterns are taken to meet if one matches the other as a text. More may meet
# then than do, never fewer.


EVERY_PARTITION: Final = "*"
"""The partition in which an endpoint meets those of all others (DDS 1.4, 2.2.3.13)."""

_SPECIAL: Final = "*?[]\\"
"""Characters that mean something in a pattern of partitions."""

MAX_PAIRS: Final = 200_000
"""Pairs of states that are visited: about a second. Beyond it the answer is unknown."""


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
        met = _Walk(patterns, {classes[place].members for place in walked}).met()
        place_of = {each.members: place for place, each in enumerate(classes) if place}
        for place in walked:
            names = met.get(classes[place].members, frozenset())
            found[place] = frozenset(0 if each is None else place_of[each] for each in names) - {place}
    return {place: met for place, met in found.items() if met}


def _is_plain(patterns: Sequence[Pattern], one: TopicClass) -> bool:
    """Whether it is the class of one name, which is no pattern."""
    name = one.witness
    return any(patterns[member].literal == name for member in one.members) and not has_wildcard(name)


_Met = Mapping[frozenset[int], Collection["frozenset[int] | None"]]
"""By what matches a pattern as a text: what matches the names that it matches, None for the empty name."""


class _Walk:
    """All pairs of a pattern in one of the classes `wanted` and a name that it matches, as the states they lead to.

    Left out are pairs from which no pattern goes on to one of these classes. Where a pattern stays in its class
    whatever follows, a star meets most. What a pair leads to depends on where in the pattern it is. The kinds say this:
    between two characters, at a star, in brackets, behind what takes any character, and behind a backslash.
    """

    def __init__(self, patterns: Sequence[Pattern], wanted: Collection[frozenset[int]]) -> None:
        message = f"{len(patterns)} expressions of partitions are more than can be compared as patterns"
        budget = Budget(4 * MAX_PAIRS, message)
        tokens = [pattern.tokens for pattern in patterns]
        alphabet = Alphabet(tokens, budget, _SPECIAL)
        self._character = {character: alphabet.class_of(character) for character in _SPECIAL}
        self._wild = {self._character["*"], self._character["?"]}
        self._automaton = Automaton(tokens, alphabet, budget)
        self._after = self._automaton.successors()
        self._empty = len(self._after)  # stands for the beginning of a name without a character yet
        self._after.append(self._after[0])
        self._leads = self._leading(wanted)
        self._plain, self._stars, self._brackets, self._any, self._escaped = (
            _Pairs(self._empty + 1, budget, units) for units in (4, 4, 4, 2, 2)
        )

    def _leading(self, wanted: Collection[frozenset[int]]) -> bytearray:
        """By state, whether some continuation of a pattern there is in a class that is asked about."""
        before: list[list[int]] = [[] for _ in self._after]
        for state, targets in enumerate(self._after[: self._empty]):
            for target in targets:
                before[target].append(state)
        pending = [state for state, accepted in enumerate(self._automaton.accepts) if accepted in wanted]
        leads = bytearray(len(self._after))
        while pending:
            state = pending.pop()
            if not leads[state]:
                leads[state] = True
                pending += before[state]
        return leads

    def met(self) -> _Met:
        """All of them."""
        found: dict[frozenset[int], set[frozenset[int] | None]] = {}
        accepts: list[frozenset[int] | None] = [*self._automaton.accepts, None]
        ways = (
            (self._plain.pending, self._read),
            (self._stars.pending, self._star),
            (self._brackets.pending, self._in_brackets),
            (self._any.pending, self._any_character),
            (self._escaped.pending, self._both),
        )
        self._read(0, self._empty)  # not recorded: no partition is called ""
        while any(pending for pending, _ in ways):
            for pending, go_on in ways:
                while pending:
                    pattern, name = pending.pop()
                    if go_on == self._read or (go_on == self._star and self._stays(pattern)):
                        found.setdefault(self._automaton.accepts[pattern], set()).add(accepts[name])
                    go_on(pattern, name)
        return found

    def _stays(self, pattern: int) -> bool:
        """Whether a pattern stays in its class whatever follows."""
        return self._after[pattern] == (pattern,)

    def _go_on(self, pattern: int, name: int) -> None:
        """We are between two characters of the pattern."""
        if self._leads[pattern]:
            (self._stars if self._stays(pattern) else self._plain).add(pattern, name)

    def _read(self, pattern: int, name: int) -> None:
        """The next character of a pattern."""
        for character, pairs in (("*", self._stars), ("?", self._any), ("\\", self._escaped)):
            target = self._reads(pattern, character)
            if self._leads[target]:
                pairs.add(target, name)
        self._open(self._reads(pattern, "["), name)
        self._both(pattern, name, self._wild)

    def _reads(self, pattern: int, character: str) -> int:
        """The pattern goes on by one character."""
        by_class, default = self._automaton.moves(pattern)
        return by_class.get(self._character[character], default)

    def _open(self, pattern: int, name: int) -> None:
        """The next character in brackets."""
        for target in self._after[pattern]:
            if self._leads[target]:
                self._brackets.add(target, name)

    def _in_brackets(self, pattern: int, name: int) -> None:
        """Behind a character in brackets, one more or the end of them."""
        self._open(pattern, name)
        closed = self._reads(pattern, "]")
        if self._leads[closed]:
            self._any.add(closed, name)

    def _star(self, pattern: int, name: int) -> None:
        """A star takes one more character, or no more."""
        if not self._stays(pattern):
            self._plain.add(pattern, name)
        for target in self._after[name]:
            self._stars.add(pattern, target)

    def _any_character(self, pattern: int, name: int) -> None:
        """The pattern has taken any character of the name."""
        for target in self._after[name]:
            self._go_on(pattern, target)

    def _both(self, pattern: int, name: int, wild: Set[int] = frozenset()) -> None:
        """Both go on by one character, which the pattern takes for itself: none that is `wild`."""
        of_pattern, default = self._automaton.moves(pattern)
        of_name, name_default = self._automaton.moves(name if name != self._empty else 0)
        named = {*of_pattern, *of_name} - wild if self._leads[default] else of_pattern.keys() - wild
        for number in named:
            self._go_on(of_pattern.get(number, default), of_name.get(number, name_default))
        if self._leads[default]:
            others = (n for n in range(self._automaton.alphabet.size) if n not in named and n not in wild)
            if any(True for _ in others):
                self._go_on(default, name_default)


class _Pairs:
    """Pairs of states, how far a pattern and a name are: those that were seen, and those to go on from."""

    __slots__ = ("_budget", "_names", "_seen", "_units", "pending")

    def __init__(self, names: int, budget: Budget, units: int) -> None:
        self._budget, self._names, self._units = budget, names, units
        self._seen: set[int] = set()
        self.pending: list[tuple[int, int]] = []

    def add(self, pattern: int, name: int) -> None:
        """One more, if it was not seen."""
        number = pattern * self._names + name
        if number not in self._seen:
            self._budget.spend(self._units)
            self._seen.add(number)
            self.pending.append((pattern, name))


OTHER_PARTITION: Final = "other"
"""What a partition is called that no document names: `rt/a`, as a topic would be, reads as if it were one."""

MAX_KEPT: Final = 2_000
"""Expressions whose classes are kept for who asks again, as the ranking of up to 100 enclaves does."""


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

    def classes(self, documents: int = 0) -> tuple[TopicClass, ...]:
        """The classes of all non-empty names; `documents`: how many the expressions are of."""
        return classes_of(self.patterns, documents, topics=self._topics)

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


def classes_of(patterns: Sequence[Pattern], documents: int = 0, *, topics: bool = True) -> tuple[TopicClass, ...]:
    """What `atoms.classify` returns or raises: the same for those who ask about the same expressions in turn.

    The systems, the lines on which profiles differ and the ranking of enclaves do, of one keystore. `documents`: how
    many they are of. `topics`: False where they are of partitions.
    """
    budget = budget_of(documents)
    if len(patterns) > MAX_KEPT:
        return _classified(patterns, budget, topics=topics)
    found = _classes(_Expressions(patterns), budget, topics)
    if isinstance(found, str):
        raise BudgetExceeded(found)
    return found


def _classified(patterns: Sequence[Pattern], budget: int, *, topics: bool) -> tuple[TopicClass, ...]:
    return classify(patterns, prefer=() if topics else (OTHER_PARTITION,), budget=budget, topics=topics)


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
def _classes(expressions: _Expressions, budget: int, topics: bool) -> tuple[TopicClass, ...] | str:
    """Or why there are none: to come upon the limit takes longest, and the error itself would keep whoever asked."""
    try:
        return _classified(expressions.patterns, budget, topics=topics)
    except BudgetExceeded as exceeded:
        return exceeded.message


@lru_cache(maxsize=1)
def _meetings(expressions: _Expressions, asked: tuple[int, ...]) -> Mapping[int, frozenset[int]]:
    default = frozenset(number for number, pattern in enumerate(expressions.patterns) if pattern.matches(""))
    empty = TopicClass(members=default, witness="", ros=False, infinite=False)
    return meetings(expressions.patterns, [empty, *classes_of(expressions.patterns, topics=False)], asked)
