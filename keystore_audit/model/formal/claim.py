"""A claim: a user's property about one system, or a question about flows, as facts for both engines (docs/model.md).

Places are sets of atoms; what a user wrote as globs has become indices here. Neither engine is told an answer.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location


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
    several names, in order, what these are. `pairs`: (able) from which place data must get to which, each of these; one
    with nothing in it is an enclave that could not be read. Empty: from some of `source` to some of `target`.
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
