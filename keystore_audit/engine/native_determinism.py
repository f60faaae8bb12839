"""Observational determinism, decided natively: every pair of states that two runs can be in (docs/model.md).

Two values are enough, since forwards pass samples on without looking at them: a difference between any two values
stays one if the one is mapped to 0 and the other to 1. So there are finitely many pairs; the search goes breadth
first, its first difference is a shortest one, and where it ends without one there is none in runs of any length.
Two runs are told round by round, up to that difference.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import product
from typing import Final, NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.engine.case import Case, step_at
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.asked import Behaviour, DeterminismAtom, Scheduler
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import ros_name
from keystore_audit.properties.result import Acts, Answer, Counterexample, Role, Round, Status, Step

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
    return together(map(_answer, asked.behaviours))


def together(answers: Iterable[Answer | None]) -> Answer:
    """One answer for all behaviours of a claim: unknown where there are none, or no answer about one."""
    statuses = []
    for number, each in enumerate(answers):
        if each is not None and each.status is Status.VIOLATED:
            return replace(each, behaviour=number)
        statuses.append(Status.UNKNOWN if each is None else each.status)
    return Answer(status=Status.HOLDS if {*statuses} == {Status.HOLDS} else Status.UNKNOWN)


def _answer(behaviour: Behaviour) -> Answer:
    certain = explore(behaviour, perhaps=False)
    if certain.rounds:
        return Answer(status=Status.VIOLATED, witnesses=({},), rounds=certain.rounds)
    free = explore(behaviour, perhaps=True)
    decided = certain.complete and free.complete and certain.shows and not free.rounds
    return Answer(status=Status.HOLDS if decided else Status.UNKNOWN)


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
        order = sorted(range(inputs), key=lambda number: (number in free, number))  # what both runs share comes first
        place = {number: place for place, number in enumerate(order)}
        self._places = [[place[n] + len(free) * (other and n in free) for n in range(inputs)] for other in (0, 1)]
        """By run, where each input stands in what is drawn: those of the other run that are free, after all else."""

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
        for drawn in product(VALUES, repeat=len(self._behaviour.inputs) + len(self._free)):
            one, other = (tuple(drawn[place] for place in places) for places in self._places)
            yield from product(self._of_run(pair[0], one), self._of_run(pair[1], other))

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


CALLED = ("A", "B")
"""What the two values are called."""


def describe_determinism(system: System, claim: DeterminismAtom, answer: Answer) -> Counterexample:
    """The two runs that an engine found, in the user's names."""
    behaviour = claim.behaviours[answer.behaviour]
    writers = [*_writers(system, behaviour)]
    rounds = []
    for number, both in enumerate(answer.rounds, 1):
        one, other = (_acts(behaviour, writers, run) for run in (both.one, both.other))
        if both.one == both.other:
            rounds += [f"round {number}: {one}"] if one else []
        else:
            nothing = "nothing happens"
            rounds.append(f"round {number}: in one run {one or nothing}, in the other {other or nothing}")
    free = [writers[number] for number in sorted(behaviour.free(perhaps=False))]
    named = ", ".join(f"{writer.who} on {_called(writer.topics[0])}" for writer in free)
    differing = f", but for {named}," if free else ""
    text = f"Two runs with the same inputs{differing} show different samples: {'; '.join(rounds)}."
    acting = [
        n for both in answer.rounds for run in (both.one, both.other) for n, v in enumerate(run.sent) if v is not None
    ]
    steps = (step for number in acting for step in _rights(system, behaviour.domain, writers[number]))
    return Counterexample(text=text, steps=tuple(dict.fromkeys(steps)))


def why_undecided(system: System, claim: DeterminismAtom) -> str:
    """Why nothing can be said, without a full stop."""
    if claim.undecided:
        return claim.undecided
    free = {
        behaviour.inputs[number].enclave
        for behaviour in claim.behaviours
        for number in behaviour.free(perhaps=True) - behaviour.free(perhaps=False)
    }
    names = sorted(system.enclaves[enclave].label for enclave in free if enclave is not None)
    if names:
        return f"what is high may reach {', '.join(names)}, and no [[forward]] says what happens there"
    return "the forwards can be in more states than are looked at"


class _Writer(NamedTuple):
    """Who publishes, and on which topics; `enclave`: its index."""

    who: str
    enclave: int | None
    topics: list[str]


def _writers(system: System, behaviour: Behaviour) -> Iterator[_Writer]:
    """The inputs, then the forwards."""
    for each in behaviour.inputs:
        who = "somebody" if each.enclave is None else system.enclaves[each.enclave].label
        yield _Writer(who, each.enclave, [behaviour.topics[each.topic]])
    for forward in behaviour.forwards:
        topics = [behaviour.topics[topic] for topic in sorted(forward.targets)]
        yield _Writer(system.enclaves[forward.enclave].label, forward.enclave, topics)


def _acts(behaviour: Behaviour, writers: list[_Writer], acts: Acts) -> str:
    told = []
    for number, value in enumerate(acts.sent):
        if value is None:
            continue
        writer, forward = writers[number], number - len(behaviour.inputs)
        onto = ", ".join(map(_called, writer.topics))
        if forward < 0:
            told.append(f"{writer.who} sends {CALLED[value]} on {onto}")
        else:
            first = next(slot for slot in behaviour.slots_of(forward) if slot in acts.taken)
            taken = _called(behaviour.topics[behaviour.slots[first].topic])
            told.append(f"{writer.who} forwards {CALLED[value]} from {taken} to {onto}")
    return " and ".join(told)


def _called(topic: str) -> str:
    return ros_name(topic).removesuffix(" (topic)")


def _rights(system: System, domain: int, writer: _Writer) -> Iterator[Step]:
    """The lines that let somebody publish what it does."""
    for topic in writer.topics if writer.enclave is not None else ():
        enclave = writer.enclave or 0
        channels = [n for n, each in enumerate(system.channels) if each.topic == topic and each.domain == domain]
        cases = (Case(system, {Role.ENCLAVE: enclave, Role.CHANNEL: number}) for number in channels)
        found = (case.right_steps(enclave, Operation.PUBLISH) for case in cases)
        yield next(filter(None, found), (step_at(None, topic, channel=topic, enclave=writer.who),))[0]
