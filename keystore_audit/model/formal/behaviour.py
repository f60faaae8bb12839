"""Declared behaviour as facts for both engines: forwards, what comes in, what is seen (docs/model.md, Determinism).

Everything goes in rounds. In each, every forward with samples that wait takes one and publishes it, and inputs come;
at its end all that was published stands in the slots that it reaches, the newest alone. Neither engine is told an
answer.
"""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from keystore_audit.findings import Location


class Scheduler(str, Enum):
    """Which of the samples that wait a forward takes: that of the first topic in its list, or any of them."""

    PRIORITY = "priority"
    ANY = "any"


class Differs(str, Enum):
    """Whether an input may be another one in the other run.

    PERHAPS: an enclave of which nobody says what it does, and which something high can reach, may let it differ.
    """

    NEVER = "never"
    PERHAPS = "perhaps"
    ALWAYS = "always"


class SlotAtom(Struct, frozen=True, kw_only=True):
    """Where the newest sample of a topic waits for a forward. Slots of one forward stand in the order of its list."""

    forward: int
    topic: int


class ForwardAtom(Struct, frozen=True, kw_only=True):
    """One declared forward. `enclave`: index in the system. `reaches`: slots that take what it publishes."""

    enclave: int
    scheduler: Scheduler
    targets: frozenset[int]
    reaches: frozenset[int]


class InputAtom(Struct, frozen=True, kw_only=True):
    """What an enclave without declared forwards may publish on a topic.

    `enclave`: index in the system; None: whoever it is, on a topic that is high. Several that are alike are one or two,
    which show all that more would show.
    """

    enclave: int | None
    topic: int
    differs: Differs
    reaches: frozenset[int]


class Behaviour(Struct, frozen=True, kw_only=True):
    """What can come to the low topics, in one domain class. `topics`: their DDS names; `low`: those that are seen."""

    domain: int
    topics: tuple[str, ...]
    forwards: tuple[ForwardAtom, ...]
    slots: tuple[SlotAtom, ...]
    inputs: tuple[InputAtom, ...]
    low: frozenset[int]

    @property
    def writers(self) -> int:
        """How many publish; inputs come first, forwards after them."""
        return len(self.inputs) + len(self.forwards)

    def free(self, *, perhaps: bool) -> frozenset[int]:
        """The inputs that may differ; `perhaps`: with those that perhaps do."""
        counted = {Differs.ALWAYS, Differs.PERHAPS} if perhaps else {Differs.ALWAYS}
        return frozenset(number for number, each in enumerate(self.inputs) if each.differs in counted)

    def seen(self) -> frozenset[int]:
        """The writers that publish on a low topic."""
        from_outside = {number for number, each in enumerate(self.inputs) if each.topic in self.low}
        forwarded = {len(self.inputs) + n for n, each in enumerate(self.forwards) if each.targets & self.low}
        return frozenset(from_outside | forwarded)

    def slots_of(self, forward: int) -> tuple[int, ...]:
        """The slots of a forward, in the order of its list."""
        return tuple(number for number, slot in enumerate(self.slots) if slot.forward == forward)


class Meeting(Struct, frozen=True, kw_only=True):
    """Which of the enclaves `candidates` hand samples of the channels `put` to `receiver`, which takes those of `got`.

    `receiver` None: which put anything there at all. What the engines' behaviours rest on, for Alloy to confirm.
    """

    candidates: frozenset[int]
    put: frozenset[int]
    receiver: int | None
    got: frozenset[int]
    senders: frozenset[int]


class Passage(Struct, frozen=True, kw_only=True):
    """A declared forward, whether or not a low topic depends on it. `reached`: something high may come to it."""

    enclave: int
    sources: frozenset[int]
    targets: frozenset[int]
    reached: bool


class Spread(Struct, frozen=True, kw_only=True):
    """The enclaves `inside`, to which something high may come or from which it comes; for Alloy to confirm.

    `declared`: enclaves with forwards. `first`: channels that are high. `left_out`: ambient channels.
    """

    inside: frozenset[int]
    declared: frozenset[int]
    first: frozenset[int]
    left_out: frozenset[int]
    passages: tuple[Passage, ...]


class DeterminismAtom(Struct, frozen=True, kw_only=True):
    """That what is seen on low topics is decided by inputs that are not high alone.

    `id`: unique, `[a-z0-9-]+`. `behaviours`: one for each domain class in which every declared forward is possible.
    `undecided`: why nothing can be said; empty where something can. `meetings` and `spread`: what the behaviours rest
    on.
    """

    id: str
    behaviours: tuple[Behaviour, ...]
    undecided: str
    location: Location
    meetings: tuple[Meeting, ...] = ()
    spread: Spread | None = None
