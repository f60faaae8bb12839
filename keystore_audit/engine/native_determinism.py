"""Observational determinism, decided natively: every pair of states that two runs can be in (docs/model.md).

Two values are enough, since forwards pass samples on without looking at them: a difference between any two values
stays one if the one is mapped to 0 and the other to 1. So there are finitely many pairs; the search goes breadth
first, its first difference is a shortest one, and where it ends without one there is none in runs of any length.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import product
from typing import Final

from msgspec import Struct

from keystore_audit.model.formal.behaviour import Behaviour, DeterminismAtom, Scheduler
from keystore_audit.properties.property import Acts, Answer, Round, Status

MAX_PAIRS = 100_000
"""Pairs of steps that are looked at for one behaviour: six seconds; beyond it the answer is unknown."""

MAX_DEPTH = 16
"""Rounds that are looked at: Alloy is asked about as many, and with each a trace costs more."""

VALUES: Final = (None, 0, 1)
"""What is in a slot, or is published in a round: nothing, or one of two values."""

Content = tuple["int | None", ...]
"""By slot, or by writer."""


_Step = tuple[Acts, Content]
"""What one run does in a round, and the slots after it."""

Pair = tuple[Content, Content]
"""The slots of two runs."""

Before = dict[Pair, "tuple[Pair, Round] | None"]
"""From which pair of states one comes, and by which round."""


class Explored(Struct, frozen=True, kw_only=True):
    """`rounds`: a shortest pair of runs with a difference, in the last round; empty where there is none.

    `depth`: rounds after which no new pair of states comes, or the difference does. `shows`: something is ever seen.
    `complete`: the search was not given up.
    """

    rounds: tuple[Round, ...]
    depth: int
    shows: bool
    complete: bool


def explore(behaviour: Behaviour, *, perhaps: bool) -> Explored:
    """Look for a difference; `perhaps`: inputs that perhaps differ may."""
    return _explored(behaviour, behaviour.free(perhaps=perhaps))


@lru_cache(maxsize=256)
def _explored(behaviour: Behaviour, free: frozenset[int]) -> Explored:
    """Kept, since the systems of many profiles have one behaviour, and Alloy asks for its depth."""
    return _Search(behaviour, free).explored()


def answer(asked: DeterminismAtom) -> Answer:
    """The answer about one claim, unknown where the forwards do not decide it."""
    if asked.undecided:
        return Answer(status=Status.UNKNOWN)
    statuses = []
    for number, behaviour in enumerate(asked.behaviours):
        certain = explore(behaviour, perhaps=False)
        if certain.rounds:
            return Answer(status=Status.VIOLATED, witnesses=({},), rounds=certain.rounds, behaviour=number)
        free = explore(behaviour, perhaps=True)
        decided = certain.complete and free.complete and certain.shows and not free.rounds
        statuses.append(Status.HOLDS if decided else Status.UNKNOWN)
    holds = bool(statuses) and all(status is Status.HOLDS for status in statuses)
    return Answer(status=Status.HOLDS if holds else Status.UNKNOWN)


class _Search:
    """One search through the pairs."""

    def __init__(self, behaviour: Behaviour, free: frozenset[int]) -> None:
        self._behaviour = behaviour
        self._free = free
        self._seen = sorted(behaviour.seen())
        inputs = len(behaviour.inputs)
        self._reaching = [
            [n for n, each in enumerate(behaviour.inputs) if slot in each.reaches]
            + [inputs + n for n, each in enumerate(behaviour.forwards) if slot in each.reaches]
            for slot in range(len(behaviour.slots))
        ]
        self._slots = [behaviour.slots_of(forward) for forward in range(len(behaviour.forwards))]
        self._steps: dict[Pair, tuple[_Step, ...]] = {}

    def explored(self) -> Explored:
        """All pairs, layer by layer."""
        empty: Content = (None,) * len(self._behaviour.slots)
        before: Before = {(empty, empty): None}
        layer = [(empty, empty)]
        depth, looked, shows = 0, 0, False
        while layer:
            found: list[Pair] = []
            for pair in layer:
                for (one, left), (other, right) in self._next(pair):
                    looked += 1
                    told = [one.sent[writer] for writer in self._seen]
                    shows = shows or any(value is not None for value in told)
                    both = Round(one=one, other=other)
                    if told != [other.sent[writer] for writer in self._seen]:
                        rounds = (*self._rounds(before, pair), both)
                        return Explored(rounds=rounds, depth=depth, shows=True, complete=True)
                    if (left, right) not in before:
                        before[left, right] = (pair, both)
                        found.append((left, right))
                    if looked > MAX_PAIRS:
                        return Explored(rounds=(), depth=depth, shows=shows, complete=False)
            layer = found
            depth += bool(found)
            if depth > MAX_DEPTH:
                return Explored(rounds=(), depth=depth, shows=shows, complete=False)
        return Explored(rounds=(), depth=depth, shows=shows, complete=True)

    @staticmethod
    @staticmethod
    def _rounds(before: Before, pair: Pair) -> tuple[Round, ...]:
        """What led to the pair."""
        rounds: list[Round] = []
        come = before[pair]
        while come is not None:
            rounds.append(come[1])
            come = before[come[0]]
        return tuple(reversed(rounds))

    def _next(self, pair: Pair) -> Iterator[tuple[_Step, _Step]]:
        """What two runs in these states can do in one round, with the same inputs but for the free ones."""
        inputs = range(len(self._behaviour.inputs))
        shared = [number for number in inputs if number not in self._free]
        free = sorted(self._free)
        for common in product(VALUES, repeat=len(shared)):
            fixed = dict(zip(shared, common, strict=True))
            for one, other in product(product(VALUES, repeat=len(free)), repeat=2):
                left = fixed | dict(zip(free, one, strict=True))
                right = fixed | dict(zip(free, other, strict=True))
                yield from product(
                    self._of_run(pair[0], tuple(left[number] for number in inputs)),
                    self._of_run(pair[1], tuple(right[number] for number in inputs)),
                )

    def _of_run(self, waiting: Content, came: Content) -> tuple[_Step, ...]:
        """All that one run can do in a round."""
        key = (waiting, came)
        if key not in self._steps:
            self._steps[key] = tuple(dict.fromkeys(self._possible(waiting, came)))
        return self._steps[key]

    def _possible(self, waiting: Content, came: Content) -> Iterator[_Step]:
        choices = [self._choices(number, waiting) for number in range(len(self._behaviour.forwards))]
        for chosen in product(*choices):
            taken = frozenset(slot for slot in chosen if slot is not None)
            sent = (*came, *(None if slot is None else waiting[slot] for slot in chosen))
            newest = [self._newest(slot, sent, waiting, taken) for slot in range(len(waiting))]
            for after in product(*newest):
                yield Acts(sent=sent, taken=tuple(sorted(taken))), after

    def _choices(self, forward: int, waiting: Content) -> list[int | None]:
        """The slots of which the forward may take the sample; None for no sample."""
        ready: list[int | None] = [slot for slot in self._slots[forward] if waiting[slot] is not None]
        first = self._behaviour.forwards[forward].scheduler is Scheduler.PRIORITY
        return (ready[:1] if first else ready) or [None]

    def _newest(self, slot: int, sent: Content, waiting: Content, taken: frozenset[int]) -> Iterable[int | None]:
        """What may be in a slot after the round: of several that came in it, any may be the newest."""
        arrived = {sent[writer] for writer in self._reaching[slot]} - {None}
        if arrived:
            return sorted(value for value in arrived if value is not None)
        return (None if slot in taken else waiting[slot],)
