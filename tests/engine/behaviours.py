"""Declared behaviours made by hand or by chance, and runs of them worked out in the plainest way, for tests."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator
from itertools import product

from keystore_audit.model.formal.asked import Behaviour, Differs, ForwardAtom, InputAtom, Scheduler, SlotAtom

Run = tuple[int | None, ...]


def behaviour(
    topics: int,
    forwards: Iterable[tuple[Scheduler, tuple[int, ...], tuple[int, ...]]],
    inputs: Iterable[tuple[int, Differs]],
    low: Iterable[int],
) -> Behaviour:
    """Forwards as (scheduler, from, to) and inputs as (topic, whether it differs); everybody reaches everybody."""
    declared = list(forwards)
    slots = tuple(SlotAtom(forward=n, topic=t) for n, (_s, sources, _t) in enumerate(declared) for t in sources)

    def reached(published: Iterable[int]) -> frozenset[int]:
        return frozenset(number for number, slot in enumerate(slots) if slot.topic in set(published))

    return Behaviour(
        domain=0,
        topics=tuple(f"rt/topic_{number}" for number in range(topics)),
        forwards=tuple(
            ForwardAtom(enclave=n, scheduler=scheduler, targets=frozenset(targets), reaches=reached(targets))
            for n, (scheduler, _sources, targets) in enumerate(declared)
        ),
        slots=slots,
        inputs=tuple(
            InputAtom(enclave=100 + n, topic=topic, differs=differs, reaches=reached([topic]))
            for n, (topic, differs) in enumerate(inputs)
        ),
        low=frozenset(low),
    )


def multiplexer(scheduler: Scheduler, *, second: Differs = Differs.NEVER) -> Behaviour:
    """Two inputs, forwarded to one topic."""
    return behaviour(3, [(scheduler, (0, 1), (2,))], [(0, Differs.NEVER), (1, second)], [2])


def random_behaviour(seed: int) -> Behaviour:
    """One or two forwards with at most three slots, and up to three inputs."""
    chance = random.Random(seed)
    topics = chance.randint(3, 5)
    forwards = []
    slots = chance.randint(1, 3)
    while slots > 0:
        sources = chance.sample(range(topics), min(slots, chance.randint(1, 2), topics))
        targets = chance.sample([t for t in range(topics) if t not in sources], 1)
        if not chance.randrange(4):
            targets = chance.sample(range(topics), 2)
        scheduler = chance.choice([Scheduler.PRIORITY, Scheduler.PRIORITY, Scheduler.ANY])
        forwards.append((scheduler, tuple(sources), tuple(targets)))
        slots -= len(sources)
    inputs = [
        (topic, chance.choice([*[Differs.NEVER] * 4, Differs.PERHAPS, Differs.ALWAYS]))
        for topic in chance.sample(range(topics), chance.randint(1, 3))
    ]
    if not chance.randrange(3):
        inputs.append(inputs[0])
    low = chance.choice([target for _scheduler, _sources, targets in forwards for target in targets])
    return behaviour(topics, forwards, inputs[:3], [low])


def next_runs(asked: Behaviour, waiting: Run, came: Run, *, resting: bool = False) -> Iterator[tuple[Run, Run]]:
    """Each (what is published, by writer; what waits afterwards) that may be, of one run.

    `resting`: a forward may let the round pass.
    """
    picks = []
    for number, forward in enumerate(asked.forwards):
        ready = [n for n, slot in enumerate(asked.slots) if slot.forward == number and waiting[n] is not None]
        picks.append([ready[0]] if ready and forward.scheduler is Scheduler.PRIORITY else ready or [-1])
        if resting and ready:
            picks[-1] = [*picks[-1], -1]
    for picked in product(*picks):
        sent = (*came, *(None if slot < 0 else waiting[slot] for slot in picked))
        writers = (*asked.inputs, *asked.forwards)
        options = []
        for slot, value in enumerate(waiting):
            fresh = [v for v, writer in zip(sent, writers, strict=True) if v is not None and slot in writer.reaches]
            options.append(fresh or [None if slot in picked else value])
        for after in product(*options):
            yield sent, after


def deterministic(asked: Behaviour, free: frozenset[int], values: int) -> bool:
    """Whether no two runs differ on what is low, over all pairs of states, with so many different values."""
    contents = (None, *range(values))
    empty: Run = (None,) * len(asked.slots)
    known = {(empty, empty)}
    pending = [(empty, empty)]
    watched = [n for n in range(asked.writers) if n in asked.seen()]
    while pending:
        one, other = pending.pop()
        for mine in product(contents, repeat=len(asked.inputs)):
            for yours in product(*(contents if n in free else (mine[n],) for n in range(len(mine)))):
                for (sent, after), (told, then) in product(next_runs(asked, one, mine), next_runs(asked, other, yours)):
                    if any(sent[n] != told[n] for n in watched):
                        return False
                    if (after, then) not in known:
                        known.add((after, then))
                        pending.append((after, then))
    return True


def deterministic_freely(asked: Behaviour, free: frozenset[int], rounds: int) -> bool:
    """Whether no two runs of so many rounds, in which each forward acts in its own time, differ up to stuttering.

    Of each writer that is seen, one run shows a beginning of what the other one shows, however often it repeats it.
    """
    watched = [n for n in range(asked.writers) if n in asked.seen()]
    empty: Run = (None,) * len(asked.slots)
    nothing = ((),) * len(watched)
    known = {(empty, nothing, empty, nothing)}
    for _round in range(rounds):
        after = set()
        for one, said, other, told in known:
            for mine in product((None, 0, 1), repeat=len(asked.inputs)):
                for yours in product(*((None, 0, 1) if n in free else (mine[n],) for n in range(len(mine)))):
                    here, there = (
                        {
                            (then, _shown(shown, sent, watched))
                            for sent, then in next_runs(asked, state, came, resting=True)
                        }
                        for state, shown, came in ((one, said, mine), (other, told, yours))
                    )
                    after |= {(*left, *right) for left, right in product(here, there)}
        known = after
        if any(not _alike(a, b) for _one, said, _other, told in known for a, b in zip(said, told, strict=True)):
            return False
    return True


def _shown(before: tuple[Run, ...], sent: Run, watched: list[int]) -> tuple[Run, ...]:
    """By writer, what it has shown, without repeats."""
    new = (sent[writer] for writer in watched)
    return tuple(
        old if value is None or old[-1:] == (value,) else (*old, value) for old, value in zip(before, new, strict=True)
    )


def _alike(one: Run, other: Run) -> bool:
    shorter = min(len(one), len(other))
    return one[:shorter] == other[:shorter]
