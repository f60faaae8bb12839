"""What is asked of a system: claims of flows, and of determinism."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

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
    """Which enclaves hand samples of the channels to `receiver`; None: which put anything there at all.

    What the engines' behaviours rest on, for Alloy to confirm.
    """

    channels: frozenset[int]
    receiver: int | None
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


# A claim: a user's property about one system, or a question about flows, as facts for both engines (docs/model.md).
#
# Places are sets of atoms; what a user wrote as globs has become indices here. Neither engine is told an answer.


class ClaimKind(str, Enum):
    """What is claimed of the places."""

    NO_FLOW = "no-flow"
    ONLY_PUBLISH = "only-publish"
    ENCRYPTED = "encrypted"
    SEPARATE_DOMAINS = "separate-domains"
    ABLE = "able"


class Attacker(str, Enum):
    """Who does more than its rights let it: the first three on the way of a flow, the last two before encryption."""

    HONEST = "honest"
    SOURCE = "source"
    RELAYS = "relays"
    OUTSIDER = "outsider"
    INSIDER = "insider"


ATTACKERS: Final = (Attacker.HONEST, Attacker.SOURCE, Attacker.RELAYS)
"""Of flows, from the least to the most that is assumed of them: each can do all that the one before can."""


class Place(Struct, frozen=True, kw_only=True):
    """Where a flow begins or ends: enclaves, channels, or the one participant without any key.

    `certificates`: (only-publish, MUST) those that no enclave has, but one that was left out and is meant may have.
    """

    enclaves: frozenset[int] = frozenset()
    channels: frozenset[int] = frozenset()
    outsider: bool = False
    certificates: frozenset[int] = frozenset()


class ClaimAtom(Struct, frozen=True, kw_only=True):
    """One claim. `id`: unique, `[a-z0-9-]+`. `through`: enclaves that a flow may not pass for it to count (`no-flow`).

    `left_out`: ambient channels that no flow takes. `until`: the last instant (index) at which it must hold, None: now
    alone. `location`: where the user wrote it. `starts`: (separate-domains) enclaves with domains in which their own
    implementation starts them, where some peers do not let them in. `names`: by channel of its places that stands for
    several names, in order, what these are. `pairs`: (able) data must get from the first place of each to the second. A
    place with nothing in it is an unread enclave. Empty: from some of `source` to some of `target`.
    `stopping`: (able) those of `through` that start at the audit instant, and not at each until the last.
    """

    id: str
    kind: ClaimKind
    attacker: Attacker
    source: Place
    target: Place
    through: frozenset[int]
    left_out: frozenset[int]
    until: int | None
    location: Location
    starts: frozenset[tuple[int, int]] = frozenset()
    names: tuple[tuple[int, str], ...] = ()
    pairs: tuple[tuple[Place, Place], ...] = ()
    stopping: frozenset[int] = frozenset()

    def each_pair(self) -> Iterator[ClaimAtom]:
        """The same claim of each pair by itself; who may not be passed is no place either, so that it is cut off."""
        for source, target in self.pairs or ((self.source, self.target),):
            yield replace(self, source=self._without(source), target=self._without(target), pairs=())

    def _without(self, place: Place) -> Place:
        return replace(place, enclaves=place.enclaves - self.through) if self.pairs else place


class PlaceAtom(Struct, frozen=True, kw_only=True):
    """What a user calls `name`: enclaves, or channels (the other is None).

    `unread`: (MAY only) there are enclaves of which nobody knows what they are called, so that some may be among them.
    """

    name: str
    enclaves: frozenset[int] | None
    channels: frozenset[int] | None
    unread: bool = False


class Search(Struct, frozen=True, kw_only=True):
    """What a flow is asked for. `through`: enclaves that it may not pass. `left_out`: channels that no hop takes.

    Of attacker HONEST only: `compromised`, enclaves that attack as relays do, while all others are honest; `own`: every
    enclave uses its own permissions document alone. `keeping`: participants who got it before and may have kept it, so
    that it goes on from them too (`engine/native_claims.py`).
    """

    attacker: Attacker
    source: Place = Place()
    target: Place = Place()
    through: frozenset[int] = frozenset()
    left_out: frozenset[int] = frozenset()
    compromised: frozenset[int] = frozenset()
    own: bool = False
    keeping: frozenset[int] = frozenset()


def search_of(claim: ClaimAtom) -> Search:
    """The flow that a claim is about: one that must not be, or one that must be though nobody attacks."""
    own = claim.kind is ClaimKind.ABLE
    return Search(
        attacker=Attacker.HONEST if own else claim.attacker,
        source=claim.source,
        target=claim.target,
        through=claim.through,
        left_out=claim.left_out,
        own=own,
    )
