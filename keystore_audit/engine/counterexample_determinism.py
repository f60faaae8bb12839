"""Says how determinism is violated: two runs, round by round, up to the first difference."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from keystore_audit.engine.case import Case, step_at
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.behaviour import Behaviour, DeterminismAtom
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import ros_name
from keystore_audit.properties.counterexample import Counterexample, Step
from keystore_audit.properties.property import Acts, Answer, Role

VALUES = ("A", "B")
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
            told.append(f"{writer.who} sends {VALUES[value]} on {onto}")
        else:
            first = next(slot for slot in behaviour.slots_of(forward) if slot in acts.taken)
            taken = _called(behaviour.topics[behaviour.slots[first].topic])
            told.append(f"{writer.who} forwards {VALUES[value]} from {taken} to {onto}")
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
