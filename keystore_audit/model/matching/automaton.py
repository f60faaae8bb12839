"""Which of many wildcard expressions match a name: one automaton for all of them, built as far as it is walked.

The expressions share their beginnings in one tree of tokens, a nondeterministic automaton in which `*` is a node that
leads to itself. Behind a SEARCH nothing is shared: its nodes lead back to the first of them on every character that is
not the next one. The subset construction is lazy, and its rows are sparse. A state names only the character classes
that lead elsewhere than all others, so neither 1,114,111 characters nor 256 bytes are ever listed.

A state never loses a node of `*`. So a state is the set of stars it has passed and the few other nodes it stands at.
What the stars contribute is computed once for all states that share them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.model.matching.alphabet import Alphabet, Budget
from keystore_audit.model.matching.expression import Pattern
from keystore_audit.model.matching.tokens import SEARCH, STAR, CharSet, Token

STATE_UNITS: Final = 4
"""Units of the budget that one state takes, an entry of a product with it being one."""
_NODES_PER_UNIT: Final = 8
_TARGETS_PER_UNIT: Final = 16
_MOVES_PER_UNIT: Final = 8

_FEW_STARS: Final = 8
"""Stars passed at once that people's expressions have; a state of more takes twice the time, and counts for two."""

_Nodes = frozenset[int]
_NONE: Final[_Nodes] = frozenset()


class _Moves(Struct, frozen=True):
    """Where nodes lead: `by_class` for the classes in it, `default` for every other class."""

    default: _Nodes
    by_class: Mapping[int, _Nodes]


class _Stars(Struct, frozen=True):
    """The star nodes that a state has passed, with what they do in every such state."""

    nodes: _Nodes
    moves: _Moves
    accepted: frozenset[int]


_NO_MOVES: Final = _Moves(_NONE, {})
_NO_STARS: Final = _Stars(nodes=_NONE, moves=_NO_MOVES, accepted=_NONE)


class _Row(dict[str, int]):
    """The next state by character, filled as it is asked: walking a name costs one look-up a character."""

    __slots__ = ("automaton", "state")

    def __init__(self, automaton: Automaton, state: int) -> None:
        super().__init__()
        self.automaton = automaton
        self.state = state

    def __missing__(self, character: str) -> int:
        by_class, default = self.automaton.moves(self.state)
        target = by_class.get(self.automaton.alphabet.class_of(character), default)
        self[character] = target
        return target


class Automaton:
    """The deterministic automaton of `expressions`, each a sequence of tokens; state 0 is where every name begins.

    `accepts[state]` are the numbers of the expressions that match the names that lead to `state`; equal sets are one
    object. Raises BudgetExceeded from any method that has to build a state beyond the budget.
    """

    def __init__(self, expressions: Sequence[Sequence[Token]], alphabet: Alphabet, budget: Budget) -> None:
        self.alphabet = alphabet
        self._budget = budget
        tree = _Tree(expressions, alphabet)
        self._star_nodes = tree.star_nodes
        self._node_moves = tree.moves
        self._node_accepts = tree.accepts
        self.accepts: list[frozenset[int]] = []
        self._shared_accepts: dict[frozenset[int], frozenset[int]] = {}
        self._states: list[tuple[_Stars, _Nodes]] = []
        self._moves: list[tuple[Mapping[int, int], int] | None] = []
        self._rows: list[_Row] = []
        self._number: dict[tuple[_Nodes, _Nodes], int] = {}
        self._stars: dict[_Nodes, _Stars] = {}
        self._target(self._passed(_NO_STARS, _NONE), tree.start)

    def __len__(self) -> int:
        """How many states were built so far."""
        return len(self._states)

    def successors(self) -> list[tuple[int, ...]]:
        """By state, where one character leads: all states are built."""
        found: list[tuple[int, ...]] = []
        while len(found) < len(self._states):
            by_class, default = self.moves(len(found))
            found.append(tuple({default, *by_class.values()}))
        return found

    def walk(self, name: str) -> int:
        """Return the state that `name` leads to."""
        rows = self._rows
        state = 0
        for character in name:
            state = rows[state][character]
        return state

    def moves(self, state: int) -> tuple[Mapping[int, int], int]:
        """Return the next state by character class, and that of every class that is not named."""
        known = self._moves[state]
        if known is None:
            known = self._moves[state] = self._build(state)
        return known

    def _build(self, state: int) -> tuple[dict[int, int], int]:
        stars, nodes = self._states[state]
        moves = _union([stars.moves, *(self._node_moves[node] for node in nodes)])
        self._budget.spend(len(moves.by_class) // _TARGETS_PER_UNIT)
        targets = {number: self._target(stars, found) for number, found in moves.by_class.items()}
        if len(targets) == self.alphabet.size:  # no character leads to the default
            default = targets[self.alphabet.rest]
        else:
            default = self._target(stars, moves.default)
        return {number: target for number, target in targets.items() if target != default}, default

    def _target(self, stars: _Stars, nodes: _Nodes) -> int:
        """Return the state of these nodes, some of which may be stars, behind those already passed."""
        if not nodes.isdisjoint(self._star_nodes):
            stars = self._passed(stars, nodes & self._star_nodes)
            nodes = nodes - self._star_nodes
        key = (stars.nodes, nodes)
        number = self._number.get(key)
        if number is None:
            self._budget.spend(STATE_UNITS + len(nodes) // _NODES_PER_UNIT)
            number = self._number[key] = len(self._states)
            self._states.append((stars, nodes))
            self._moves.append(None)
            self._rows.append(_Row(self, number))
            accepted = stars.accepted.union(*(self._node_accepts[node] for node in nodes))
            self.accepts.append(self._shared_accepts.setdefault(accepted, accepted))
        return number

    def _passed(self, before: _Stars, new: _Nodes) -> _Stars:
        nodes = before.nodes | new
        stars = self._stars.get(nodes)
        if stars is None:
            moves = _union([before.moves, *(self._node_moves[node] for node in new - before.nodes)])
            self._budget.spend(len(nodes) // _NODES_PER_UNIT + len(moves.by_class) // _MOVES_PER_UNIT)
            if len(nodes) > _FEW_STARS:
                self._budget.spend(STATE_UNITS)
            accepted = before.accepted.union(*(self._node_accepts[node] for node in new))
            stars = self._stars[nodes] = _Stars(nodes=nodes, moves=moves, accepted=accepted)
        return stars


def _union(several: Sequence[_Moves]) -> _Moves:
    """What all of them do at once."""
    if len(several) == 1:
        return several[0]
    default = _NONE.union(*(moves.default for moves in several))
    contributions: dict[int, list[_Nodes]] = {}
    by_class: dict[int, _Nodes] = {}
    if not default:  # nearly always: nobody waits for any character
        largest = max(several, key=lambda moves: len(moves.by_class), default=_NO_MOVES)
        by_class.update(largest.by_class)
        for moves in several:
            if moves is not largest:
                for number, nodes in moves.by_class.items():
                    contributions.setdefault(number, []).append(nodes)
    else:
        for number in {number for moves in several for number in moves.by_class}:
            contributions[number] = [moves.by_class.get(number, moves.default) for moves in several]
    for number, found in contributions.items():
        known = by_class.get(number)
        by_class[number] = found[0] if known is None and len(found) == 1 else (known or _NONE).union(*found)
    return _Moves(default, by_class)


class _Tree:
    """The tree of tokens. Node 0 is its root; a node that only leads on to a star is not stood at but skipped."""

    def __init__(self, expressions: Sequence[Sequence[Token]], alphabet: Alphabet) -> None:
        self._children: list[dict[Token, int]] = [{}]
        self._searches: list[list[int]] = [[]]
        self._restart: list[int | None] = [None]  # the node at which the search goes on that the node is part of
        self._ends: list[list[int]] = [[]]
        for number, tokens in enumerate(expressions):
            self._ends[self._node(tokens)].append(number)
        self.star_nodes = frozenset(children[STAR] for children in self._children if STAR in children)
        self.accepts = [frozenset(ends) for ends in self._ends]
        entered = [self._entered(node) for node in range(len(self._children))]
        self.start = entered[0]
        splits: dict[CharSet, tuple[bool, frozenset[int]]] = {}
        self.moves = [self._moves(node, entered, alphabet, splits) for node in range(len(self._children))]

    def _node(self, tokens: Sequence[Token]) -> int:
        """The node at which an expression ends."""
        node = 0
        restart: int | None = None
        for token in tokens:
            child = self._children[node].get(token)
            if child is None:
                child = len(self._children)
                if token is SEARCH:
                    restart = child
                    self._searches[node].append(child)
                else:
                    self._children[node][token] = child
                self._children.append({})
                self._searches.append([])
                self._restart.append(None if token is STAR else restart)
                self._ends.append([])
            node = child
        return node

    def _entered(self, node: int) -> _Nodes:
        """The nodes one stands at after entering `node`: a star may take no character."""
        children, stars = self._children[node], self._searches[node]
        if STAR in children:
            stars = [*stars, children[STAR]]
        is_more = self._ends[node] or len(children) > (STAR in children)
        return frozenset((node, *stars)) if is_more or not stars else frozenset(stars)

    def _moves(
        self,
        node: int,
        entered: Sequence[_Nodes],
        alphabet: Alphabet,
        splits: dict[CharSet, tuple[bool, frozenset[int]]],
    ) -> _Moves:
        restart = self._restart[node]
        otherwise = _NONE if restart is None else frozenset((restart,))
        several = []
        for token, child in self._children[node].items():
            if isinstance(token, str):
                several.append(_Moves(otherwise, {alphabet.class_of(token): entered[child]}))
            elif isinstance(token, CharSet):
                if token not in splits:
                    splits[token] = alphabet.split(token)
                is_default, classes = splits[token]
                several.append(
                    _Moves(entered[child], dict.fromkeys(classes, otherwise))
                    if is_default
                    else _Moves(otherwise, dict.fromkeys(classes, entered[child]))
                )
        return _union(several) if several else _Moves(otherwise, {})


def on_or_behind_cycle(successors: Sequence[Iterable[int]]) -> set[int]:
    """Return the states of a graph that infinitely many walks from somewhere end in: those on or behind a cycle.

    `successors[state]` are distinct. What remains when states that nothing (more) leads to are taken away, one by one.
    """
    incoming = [0] * len(successors)
    for targets in successors:
        for target in targets:
            incoming[target] += 1
    free = [state for state, count in enumerate(incoming) if not count]
    remaining = set(range(len(successors)))
    while free:
        state = free.pop()
        remaining.discard(state)
        for target in successors[state]:
            incoming[target] -= 1
            if not incoming[target]:
                free.append(target)
    return remaining


# Which of many expressions may match a name: by what it begins and ends with, instead of one after the other.


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
