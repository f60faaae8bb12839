"""Says how determinism is violated: two runs, round by round, up to the first difference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from keystore_audit.engine.case import Case, step_at
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.behaviour import Behaviour, DeterminismAtom
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import ros_name
from keystore_audit.properties.counterexample import Counterexample, Step
from keystore_audit.properties.property import Acts, Answer, Role, Round

VALUES = ("A", "B")
"""What the two values are called."""


def describe_determinism(system: System, claim: DeterminismAtom, answer: Answer) -> Counterexample:
    """The two runs that an engine found, in the user's names."""
    told = _Telling(system, claim.behaviours[answer.behaviour])
    rounds = "; ".join(filter(None, (told.round(number, each) for number, each in enumerate(answer.rounds, 1))))
    text = f"Two runs with the same inputs{told.differing()} show different samples: {rounds}."
    return Counterexample(text=text, steps=tuple(dict.fromkeys(told.steps(answer.rounds))))


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


class _Telling:
    """Names for the participants of one behaviour."""

    def __init__(self, system: System, behaviour: Behaviour) -> None:
        self._system = system
        self._behaviour = behaviour

    def differing(self) -> str:
        """Which inputs may differ."""
        free = sorted(self._behaviour.free(perhaps=False))
        named = (f"{self._who(number)} on {self._on(number)}" for number in free)
        return f", but for {', '.join(named)}," if free else ""

    def round(self, number: int, both: Round) -> str:
        """What happens in a round, once where both runs do the same."""
        if both.one == both.other:
            said = self._acts(both.one)
            return f"round {number}: {said}" if said else ""
        one, other = (self._acts(run) or "nothing happens" for run in (both.one, both.other))
        return f"round {number}: in one run {one}, in the other {other}"

    def _acts(self, acts: Acts) -> str:
        told = []
        for number, value in enumerate(acts.sent):
            if value is None:
                continue
            forward = number - len(self._behaviour.inputs)
            if forward < 0:
                told.append(f"{self._who(number)} sends {VALUES[value]} on {self._on(number)}")
            else:
                told.append(self._forward(forward, acts.taken, VALUES[value]))
        return " and ".join(told)

    def _who(self, number: int) -> str:
        enclave = self._behaviour.inputs[number].enclave
        return "somebody" if enclave is None else self._system.enclaves[enclave].label

    def _on(self, number: int) -> str:
        return self._topic(self._behaviour.inputs[number].topic)

    def _forward(self, number: int, taken: Sequence[int], value: str) -> str:
        forward = self._behaviour.forwards[number]
        first = next(slot for slot in self._behaviour.slots_of(number) if slot in taken)
        onto = ", ".join(self._topic(topic) for topic in sorted(forward.targets))
        who = self._system.enclaves[forward.enclave].label
        return f"{who} forwards {value} from {self._topic(self._behaviour.slots[first].topic)} to {onto}"

    def _topic(self, number: int) -> str:
        return ros_name(self._behaviour.topics[number]).removesuffix(" (topic)")

    def steps(self, rounds: Sequence[Round]) -> Iterator[Step]:
        """The lines that let each one publish what it does."""
        for both in rounds:
            for acts in (both.one, both.other):
                for number, value in enumerate(acts.sent):
                    if value is not None:
                        yield from self._right(number)

    def _right(self, writer: int) -> Iterator[Step]:
        inputs = self._behaviour.inputs
        if writer < len(inputs):
            enclave, topics = inputs[writer].enclave, {inputs[writer].topic}
        else:
            forward = self._behaviour.forwards[writer - len(inputs)]
            enclave, topics = forward.enclave, set(forward.targets)
        if enclave is None:
            return
        for topic in sorted(topics):
            name = self._behaviour.topics[topic]
            for number, channel in enumerate(self._system.channels):
                if channel.topic == name and channel.domain == self._behaviour.domain:
                    case = Case(self._system, {Role.ENCLAVE: enclave, Role.CHANNEL: number})
                    found = case.right_steps(enclave, Operation.PUBLISH)
                    if found:
                        yield found[0]
                        break
            else:
                label = self._system.enclaves[enclave].label
                yield step_at(None, name, channel=name, enclave=label)
