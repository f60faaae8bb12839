"""Topic classes: the coarsest partition of all names on which every expression is constant, with a witness of each.

These are the atomic predicates of Yang and Lam (Real-time verification of network properties using atomic predicates,
2013), over regular languages. A decision that depends on a name only through which expressions match it is constant on
a class. So one evaluation per class is exact for all names. Each expression without wildcards is a class. Those with
wildcards run in one lazy automaton, searched breadth first for the shortest name of every set of them.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Final, Protocol

from msgspec import Struct

from keystore_audit.errors import AuditError
from keystore_audit.model.matching.alphabet import DEAD, Alphabet, Budget, Universe, dds_names, ros_alphabet, ros_names
from keystore_audit.model.matching.automaton import STATE_UNITS, Automaton, PatternIndex, on_or_behind_cycle
from keystore_audit.model.matching.expression import Pattern
from keystore_audit.model.matching.tokens import Token
from keystore_audit.model.names import is_ros_dds_name
from keystore_audit.text import shorten

# The shortest name for every set of expressions that an automaton can accept, by breadth-first search.


_Prefix = tuple[int, int, int]
"""Names that begin alike: from, to (both included) in the sorted list, and the number of characters they share."""
_Place = tuple[int, int, _Prefix | None]
"""A state of the automaton, one of the universe, and the avoided names that begin so; None for none of them."""


class Walk(Protocol):
    """What is searched: an automaton, built as far as it is walked, whose state 0 is where every name begins."""

    @property
    def alphabet(self) -> Alphabet:
        """The classes of characters."""

    @property
    def accepts(self) -> Sequence[frozenset[int]]:
        """By state: what matches the names that lead there."""

    def moves(self, state: int) -> tuple[Mapping[int, int], int]:
        """The next state by character class, and that of every class that is not named."""


def shortest_names(
    automaton: Walk,
    universe: Universe,
    budget: Budget,
    *,
    avoid: Collection[str] = (),
    wanted: Collection[frozenset[int]] | None = None,
) -> dict[frozenset[int], str]:
    """Return a shortest name of `universe` for every set of expressions that exactly match one.

    Among equally short ones the most readable characters come first. Names in `avoid` do not count. With `wanted`, only
    those sets are looked for. Raises BudgetExceeded.
    """
    search = _Search(automaton, universe, _Avoided(avoid))
    found: dict[frozenset[int], _Place] = {}
    missing = set(wanted) if wanted is not None else None
    first: _Place = (0, 0, search.avoided.root)
    origins: dict[_Place, tuple[_Place | None, str]] = {}
    queue: deque[_Place | None] = deque([None])  # None: the empty name, which is in no universe
    while queue and (missing is None or missing):
        place = queue.popleft()
        reached = 0
        for character, target in search.steps(first if place is None else place):
            if target in origins:
                continue
            origins[target] = (place, character)
            queue.append(target)
            reached += 1
            if search.ends(target):
                accepted = automaton.accepts[target[0]]
                if accepted not in found and (missing is None or accepted in missing):
                    found[accepted] = target
                    if missing is not None:
                        missing.discard(accepted)
        budget.spend(reached)
    return {accepted: _spell(origins, place) for accepted, place in found.items()}


def residual_names(
    automaton: Walk,
    universe: Universe,
    budget: Budget,
    literals: Mapping[str, frozenset[int]],
    wanted: Collection[frozenset[int]] | None = None,
) -> dict[frozenset[int], str]:
    """Return the shortest names that are none of `literals`; with `wanted`, for those sets alone.

    `literals`: names, with what matches each. A set whose shortest name is a literal may hold nothing else. So it is
    searched again without the literals of such sets.
    """
    names = shortest_names(automaton, universe, budget, wanted=wanted)
    taken = {accepted for accepted, name in names.items() if name in literals}
    if not taken:
        return names
    avoid = [name for name, accepted in literals.items() if accepted in taken]
    again = shortest_names(automaton, universe, budget, avoid=avoid, wanted=taken)
    return {accepted: name for accepted, name in names.items() if accepted not in taken} | again


def _spell(origins: dict[_Place, tuple[_Place | None, str]], place: _Place) -> str:
    characters = []
    at: _Place | None = place
    while at is not None:
        at, character = origins[at]
        characters.append(character)
    return "".join(reversed(characters))


class _Search(Struct, frozen=True):
    """The product of automaton, universe and the tree of avoided names, walked but never built."""

    automaton: Walk
    universe: Universe
    avoided: _Avoided

    def ends(self, place: _Place) -> bool:
        """Whether a name may end here."""
        return self.universe.accepting[place[1]] and (place[2] is None or not self.avoided.is_whole(place[2]))

    def steps(self, place: _Place) -> Iterator[tuple[str, _Place]]:
        """One character for every way on."""
        state, name_state, prefix = place
        by_class, default = self.automaton.moves(state)
        name_moves, name_default = self.universe.moves[name_state]
        children = self.avoided.children(prefix) if prefix is not None else {}
        alphabet = self.automaton.alphabet
        told_apart = name_moves.keys() | {alphabet.class_of(character) for character in children}
        if name_default != DEAD:
            told_apart |= by_class.keys()
            # One class stands for all those that neither of the three tells apart.
            told_apart.update(islice((number for number in self.universe.classes if number not in told_apart), 1))
        for number in sorted(told_apart):
            name_target = name_moves.get(number, name_default)
            if name_target == DEAD or number not in self.universe.classes:
                continue
            target = by_class.get(number, default)
            if not children:
                yield alphabet.representatives[number], (target, name_target, None)
                continue
            for character, child in children.items():
                if alphabet.class_of(character) == number:
                    yield character, (target, name_target, child)
            other = alphabet.character(number, excluded=children)
            if other is not None:
                yield other, (target, name_target, None)


class _Avoided:
    """The tree of names that do not count, as ranges of a sorted list: only what is visited costs anything."""

    def __init__(self, names: Collection[str]) -> None:
        self._names = sorted(names)

    @property
    def root(self) -> _Prefix | None:
        """The empty beginning; None where there are no names."""
        return (0, len(self._names) - 1, 0) if self._names else None

    def is_whole(self, prefix: _Prefix) -> bool:
        """Whether this beginning is itself a name."""
        first, _, length = prefix
        return len(self._names[first]) == length

    def children(self, prefix: _Prefix) -> dict[str, _Prefix]:
        """The beginnings that are one character longer, by that character."""
        first, last, length = prefix
        children = {}
        at = first + self.is_whole(prefix)
        while at <= last:
            begin = self._names[at][: length + 1]
            behind = bisect_right(self._names, begin, at, last + 1, key=lambda name: name[: length + 1])
            children[begin[length]] = (at, behind - 1, length + 1)
            at = behind
        return children


DEFAULT_BUDGET: Final = 40_000
_STATES_PER_DOCUMENT: Final = 200
_MOST_STATES: Final = 100_000
"""States of the automaton. They take at most about 90 MB and two seconds, so a hostile document stays within 200 MB. A
keystore of many documents takes up to 180 MB and five seconds. Where the limit is exceeded, some ten automata are built
to find the documents that are too many (`AccessViews.within_budget`). 300 such robots took 55 s and 480 MB (measured).

Only texts between two stars multiply states. What `ros2 security` writes needs some hundreds. 10,000 namespaces, each
with `rt/…/*`, need 32,500. 200 robots, each with `rt/NAME/*` and `rt/*/NAME`, need 50,000: every two have names in
common. Beyond it the answer is "unknown", never a sample."""


def budget_of(documents: int) -> int:
    """The states for the expressions of so many documents."""
    return min(DEFAULT_BUDGET + _STATES_PER_DOCUMENT * documents, _MOST_STATES)


_MAX_QUOTED: Final = 60
"""Characters of the expression that the message about the budget quotes."""

_PIECES_PER_UNIT: Final = 8
"""Pieces between stars that are looked for in the time of one unit of the budget."""

_Set = frozenset[int]


class TopicClass(Struct, frozen=True, kw_only=True):
    """All names that exactly the expressions `members` match (indices into what was classified; may be empty).

    `witness`: a short, readable name of the class; one that ROS 2 can produce if there is one. `ros`: whether there is
    one; False is the mark `dds-only` of reports. `infinite`: whether the class has infinitely many names.
    """

    members: frozenset[int]
    witness: str
    ros: bool
    infinite: bool


def classify(
    patterns: Sequence[Pattern], *, prefer: Iterable[str] = (), budget: int = DEFAULT_BUDGET, topics: bool = True
) -> tuple[TopicClass, ...]:
    """Return the classes of all non-empty names without NUL, in the order of their witnesses.

    `prefer`: names known from elsewhere, taken as witnesses where they fit (a ROS 2 name rather than another, then the
    shortest). `budget`: states of the automaton that may be built. `topics`: False for names of another sort, of which
    ROS 2 prefers none. The patterns may be of different matchers. Equal arguments give equal results. Raises
    BudgetExceeded where the classes are too many; there is no partial answer.
    """
    return _Classification(patterns, budget, topics=topics).classes(prefer)


class _Classification:
    """The classes in the making: patterns by meaning, their automaton, and the names found so far."""

    def __init__(self, patterns: Sequence[Pattern], budget: int, *, topics: bool) -> None:
        self._topics = topics
        most = max(patterns, key=lambda pattern: len(pattern.pieces), default=None)
        example = f", as {shorten(most.text, _MAX_QUOTED)!r} has" if most is not None else ""
        self._budget = Budget(
            STATE_UNITS * budget,
            f"{len(patterns)} expressions need more than {budget} states to be told apart; most often too many of them "
            f"have text between two *{example}",
        )
        self._literals: dict[str, list[int]] = {}
        wildcards: dict[tuple[Token, ...], list[int]] = {}
        for number, pattern in enumerate(patterns):
            name = pattern.literal
            if name is None:
                wildcards.setdefault(pattern.tokens, []).append(number)
            elif name:  # the empty one matches no name
                self._literals.setdefault(name, []).append(number)
        self._numbers = list(wildcards.values())
        self._wildcards = [patterns[numbers[0]] for numbers in self._numbers]
        tokens = list(wildcards)
        self._alphabet = ros_alphabet(tokens, self._budget)
        self._automaton = Automaton(tokens, self._alphabet, self._budget)
        self._members: dict[_Set, _Set] = {}
        self._verifier = _Verifier(self._wildcards, self._budget)

    def classes(self, prefer: Iterable[str]) -> tuple[TopicClass, ...]:
        """All classes."""
        literal_sets = {name: self._accepted(name) for name in self._literals}
        found = [self._literal_class(name, accepted) for name, accepted in literal_sets.items()]
        infinite = self._infinite_sets()
        ros, others = self._residual_witnesses(literal_sets)
        preferred = self._preferred(prefer)
        for accepted in ros.keys() | others.keys():
            is_ros = accepted in ros
            witness = ros[accepted] if is_ros else others[accepted]
            better = preferred.get(accepted)
            if better is not None and is_ros_dds_name(better) >= is_ros:
                witness = better
            self._verifier.verify(witness, accepted)
            found.append(
                TopicClass(
                    members=self._members_of(accepted), witness=witness, ros=is_ros, infinite=accepted in infinite
                )
            )
        return tuple(sorted(found, key=lambda topic_class: topic_class.witness))

    def _accepted(self, name: str) -> _Set:
        return self._automaton.accepts[self._automaton.walk(name)]

    def _members_of(self, accepted: _Set) -> _Set:
        """The patterns that the numbers of wildcard expressions stand for."""
        members = self._members.get(accepted)
        if members is None:
            members = frozenset(number for wildcard in accepted for number in self._numbers[wildcard])
            self._members[accepted] = members
        return members

    def _literal_class(self, name: str, accepted: _Set) -> TopicClass:
        self._verifier.verify(name, accepted)
        members = self._members_of(accepted).union(self._literals[name])
        return TopicClass(members=members, witness=name, ros=self._topics and is_ros_dds_name(name), infinite=False)

    def _residual_witnesses(self, literal_sets: Mapping[str, _Set]) -> tuple[dict[_Set, str], dict[_Set, str]]:
        """The shortest names that are no literal: ROS 2's for every set that has one, others for the rest."""
        automaton, budget = self._automaton, self._budget
        ros = residual_names(automaton, ros_names(self._alphabet), budget, literal_sets) if self._topics else {}
        others = {accepted for accepted in automaton.accepts if accepted not in ros}  # all states are built
        return ros, residual_names(automaton, dds_names(self._alphabet), budget, literal_sets, others)

    def _infinite_sets(self) -> set[_Set]:
        """The sets of wildcard expressions that infinitely many names match."""
        return {self._automaton.accepts[state] for state in on_or_behind_cycle(self._automaton.successors())}

    def _preferred(self, prefer: Iterable[str]) -> dict[_Set, str]:
        """The best of the given names for every set, literals apart."""
        names = {name for name in prefer if name and "\0" not in name and name not in self._literals}
        best: dict[_Set, str] = {}
        for name in sorted(names, key=lambda name: (not is_ros_dds_name(name), len(name), name)):
            best.setdefault(self._accepted(name), name)
        return best


class _Verifier:
    """Asks the patterns themselves, with their own matcher, about a name that the automaton found."""

    def __init__(self, patterns: Sequence[Pattern], budget: Budget) -> None:
        self._budget = budget
        self._patterns = PatternIndex(enumerate(patterns))

    def verify(self, name: str, expected: _Set) -> None:
        """Raise AuditError unless exactly the patterns `expected` match `name`; only those that may are asked."""
        asked = list(self._patterns.candidates(name))
        self._budget.spend(sum(len(pattern.pieces) for _, pattern in asked) // _PIECES_PER_UNIT)
        matching = {number for number, pattern in asked if pattern.matches(name)}
        if matching != expected:
            raise AuditError(
                f"keystore-audit contradicts itself about which expressions match {name!r}; please report this"
            )
