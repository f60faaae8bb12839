"""Observational determinism, decided natively: every pair of states that two runs can be in (docs/model.md).

Two values are enough, since forwards pass samples on without looking at them. A difference between any two values
remains if one becomes 0 and the other 1. So there are finitely many pairs. The search is breadth first, so its first
difference is a shortest one. If it ends without one, runs of any length have none. Two runs are told round by round, up
to that difference.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import product
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.model.formal.asked import Behaviour, DeterminismAtom, Differs, Scheduler
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import ros_name
from keystore_audit.properties.result import Answer, Content, Counterexample, Round, Status

MAX_PAIRS = 100_000
"""Pairs of steps that are looked at for one behaviour: six seconds; beyond it the answer is unknown."""

MAX_DEPTH = 16
"""Rounds that are looked at: Alloy is asked about as many, and with each a trace costs more."""

VALUES: Final = (None, 0, 1)
"""What is in a slot, or is published in a round: nothing, or one of two values."""

CALLED: Final = ("A", "B")
"""What the two values are called."""

_Step = tuple[Content, Content]
"""What one run publishes in a round, by writer, and what is in its slots after it."""


class Explored(Struct, frozen=True, kw_only=True):
    """`rounds`: a shortest pair of runs with a difference, in the last round; empty where there is none.

    `depth`: rounds after which no new pair of states comes, or the difference does. `shows`: something is ever seen.
    `complete`: the search was not given up.
    """

    rounds: tuple[Round, ...] = ()
    depth: int
    shows: bool
    complete: bool


def explore(behaviour: Behaviour, *, perhaps: bool) -> Explored:
    """Look for a difference, through all pairs of states; `perhaps`: inputs that may differ do."""
    return _explored(behaviour, behaviour.free(perhaps=perhaps))


def answer(asked: DeterminismAtom) -> Answer:
    """The answer about one claim, unknown where the forwards do not decide it."""
    return together(map(_answer, asked.behaviours))


def together(answers: Iterable[Answer | None]) -> Answer:
    """One answer for all behaviours of a claim: unknown where there are none, or no answer about one."""
    statuses = set()
    for number, each in enumerate(answers):
        if each is not None and each.status is Status.VIOLATED:
            return replace(each, behaviour=number)
        statuses.add(Status.UNKNOWN if each is None else each.status)
    return Answer(status=Status.HOLDS if statuses == {Status.HOLDS} else Status.UNKNOWN)


def _answer(behaviour: Behaviour) -> Answer:
    certain = explore(behaviour, perhaps=False)
    if certain.rounds:
        return Answer(status=Status.VIOLATED, witnesses=({},), rounds=certain.rounds)
    free = explore(behaviour, perhaps=True)
    decided = certain.complete and free.complete and certain.shows and not free.rounds
    return Answer(status=Status.HOLDS if decided else Status.UNKNOWN)


@lru_cache(maxsize=256)
def _explored(behaviour: Behaviour, free: frozenset[int]) -> Explored:
    """Explored layer by layer. Kept, since systems of many profiles share a behaviour, and Alloy needs its depth."""
    steps = lru_cache(maxsize=None)(lambda waiting, came: tuple(dict.fromkeys(_steps(behaviour, waiting, came))))
    seen = sorted(behaviour.seen())
    start: Content = (None,) * len(behaviour.slots)
    led: dict[_Step, tuple[Round, ...]] = {(start, start): ()}
    layer, depth, looked, shows = [(start, start)], 0, 0, False
    while layer:
        found = []
        for pair in layer:
            for inputs in _inputs(behaviour, free):
                for (one, left), (other, right) in product(*map(steps, pair, inputs)):
                    looked += 1
                    rounds, after = (*led[pair], (one, other)), (left, right)
                    shows = shows or any(one[writer] is not None for writer in seen)
                    if any(one[writer] != other[writer] for writer in seen):
                        return Explored(rounds=rounds, depth=depth, shows=True, complete=True)
                    if after not in led:
                        led[after] = rounds
                        found.append(after)
                    if looked > MAX_PAIRS:
                        return Explored(depth=depth, shows=shows, complete=False)
        layer = found
        depth += bool(found)
        if depth > MAX_DEPTH:
            return Explored(depth=depth, shows=shows, complete=False)
    return Explored(depth=depth, shows=shows, complete=True)


def _inputs(behaviour: Behaviour, free: frozenset[int]) -> Iterator[tuple[Content, Content]]:
    """What comes to two runs in a round: the same, but for what is free."""
    numbers = range(len(behaviour.inputs))
    for one in product(VALUES, repeat=len(numbers)):
        for other in product(*(VALUES if number in free else (one[number],) for number in numbers)):
            yield one, other


def _steps(behaviour: Behaviour, waiting: Content, came: Content) -> Iterator[_Step]:
    """All that one run can do in a round: each forward publishes what waits in a slot, each slot takes what comes."""
    choices: list[list[int | None]] = []
    for number, forward in enumerate(behaviour.forwards):
        ready: list[int | None] = [slot for slot in behaviour.slots_of(number) if waiting[slot] is not None]
        choices.append((ready[:1] if forward.scheduler is Scheduler.PRIORITY else ready) or [None])
    reaches = [*(each.reaches for each in behaviour.inputs), *(each.reaches for each in behaviour.forwards)]
    for chosen in product(*choices):
        sent = (*came, *(None if slot is None else waiting[slot] for slot in chosen))
        arrived: list[set[int | None]] = [set() for _ in waiting]
        for slots, value in zip(reaches, sent, strict=True):
            for slot in slots if value is not None else ():
                arrived[slot].add(value)
        kept = (None if slot in chosen else value for slot, value in enumerate(waiting))
        # of several samples that come to a slot in one round, any may be the newest
        newest = (new or {old} for new, old in zip(arrived, kept, strict=True))
        yield from ((sent, after) for after in product(*newest))


def describe_determinism(system: System, claim: DeterminismAtom, answer: Answer) -> Counterexample:
    """The two runs that an engine found, round by round, in the user's names."""
    behaviour = claim.behaviours[answer.behaviour]

    def labels(enclave: int | None, topics: Iterable[int]) -> tuple[str, str]:
        names = (ros_name(behaviour.topics[topic]).removesuffix(" (topic)") for topic in sorted(topics))
        return "somebody" if enclave is None else system.enclaves[enclave].label, ", ".join(names)

    inputs = [labels(each.enclave, [each.topic]) for each in behaviour.inputs]
    forwards = [labels(each.enclave, each.targets) for each in behaviour.forwards]
    acts = [(f"{who} sends", f"on {topic}") for who, topic in inputs]
    acts += [(f"{who} forwards", f"to {topics}") for who, topics in forwards]

    def told(run: Content) -> str:
        named = zip(acts, run, strict=True)
        return " and ".join(f"{does} {CALLED[value]} {where}" for (does, where), value in named if value is not None)

    rounds = []
    for number, both in enumerate(answer.rounds, 1):
        one, other = (told(run) or "nothing happens" for run in both)
        rounds.append(f"round {number}: {one if one == other else f'in one run {one}, in the other {other}'}")
    free = ", ".join(" on ".join(inputs[number]) for number in sorted(behaviour.free(perhaps=False)))
    text = f"Two runs with the same inputs{f', but for {free},' if free else ''} show different samples"
    return Counterexample(text=f"{text}: {'; '.join(rounds)}.", steps=())


def why_undecided(system: System, claim: DeterminismAtom) -> str:
    """Why nothing is decided, without a full stop."""
    if claim.undecided:
        return claim.undecided
    free = {
        each.enclave for behaviour in claim.behaviours for each in behaviour.inputs if each.differs is Differs.PERHAPS
    }
    names = sorted(system.enclaves[enclave].label for enclave in free if enclave is not None)
    if names:
        return f"what is high may reach {', '.join(names)}, and no [[forward]] says what happens there"
    return "the forwards can be in more states than are looked at"
