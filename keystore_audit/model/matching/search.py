"""The shortest name for every set of expressions that an automaton can accept, by breadth-first search."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice
from typing import Protocol

from msgspec import Struct

from keystore_audit.model.matching.alphabet import Alphabet, Budget
from keystore_audit.model.matching.universe import DEAD, Universe

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
    known: Collection[frozenset[int]] = (),
) -> dict[frozenset[int], str]:
    """Return the shortest names that are none of `literals`, for the sets that are not `known`.

    `literals`: names, with what matches each. A set whose shortest name is a literal may hold nothing else, so it is
    searched again with the literals of these sets, and only those, left out.
    """
    names = shortest_names(automaton, universe, budget)
    names = {accepted: name for accepted, name in names.items() if accepted not in known}
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
