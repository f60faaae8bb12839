"""What changed in meaning between two keystores, as values (docs/diff.md).

A change stands once, at the layer that causes it; what follows from it in later layers is a consequence of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from enum import Enum
from typing import Final

from msgspec import Struct

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.findings import Location
from keystore_audit.model.domains import Interval


class Layer(str, Enum):
    """Where a change is made, or, where none before it accounts for it, where it shows."""

    TRUST = "trust"
    GRANTS = "grants"
    ACCESS = "access"
    ATTACKERS = "attackers"
    INFLUENCE = "influence"


class Direction(str, Enum):
    """What became of rights and of what attackers can do.

    GAINED: more than before, or less protection. LOST: less. MIXED: some of both. CHANGED: something else than before,
    and neither more nor less by itself. INFO: nothing that anybody could notice.
    """

    GAINED = "gained"
    LOST = "lost"
    MIXED = "mixed"
    CHANGED = "changed"
    INFO = "info"

    @property
    def gains(self) -> bool:
        """Whether there is more than before."""
        return self in (Direction.GAINED, Direction.MIXED)


ORDER: Final = (Direction.GAINED, Direction.MIXED, Direction.CHANGED, Direction.LOST, Direction.INFO)
"""What is told first."""


def direction_of(gains: object, losses: object) -> Direction:
    """The direction of something that has gains, losses, both or neither: none of them is what is empty."""
    if gains:
        return Direction.MIXED if losses else Direction.GAINED
    return Direction.LOST if losses else Direction.CHANGED


def joint_direction(aspects: Iterable[Aspect]) -> Direction:
    """The direction of something that has these."""
    directions = {aspect.direction for aspect in aspects}
    losses = not directions.isdisjoint((Direction.LOST, Direction.MIXED))
    return direction_of(any(each.gains for each in directions), losses)


class FailOn(str, Enum):
    """Which changes a release is stopped for. GAINED: all but those by which there is less, or nothing else."""

    GAINED = "gained"
    ANY = "any"
    NONE = "none"


class Name(Struct, frozen=True, kw_only=True):
    """A DDS topic in a partition, in these domain ids. `several`: it stands for more names than itself."""

    topic: str
    partition: str
    domains: tuple[Interval, ...]
    several: bool


class Names(Struct, frozen=True, kw_only=True):
    """Names by witnesses, single ones first. `more`: how many others there are, each standing for itself or several.

    `infinite`: they are infinitely many. `domains`: all ids that some of them are in. `every`: they are all names of
    these domains.
    """

    shown: tuple[Name, ...]
    more: int
    infinite: bool
    domains: tuple[Interval, ...]
    every: bool


class Handover(Struct, frozen=True, kw_only=True):
    """A sample handed from one enclave to another: their paths, and on which topic."""

    sender: str
    name: Name
    receiver: str


class Influenced(Struct, frozen=True, kw_only=True):
    """Pairs of enclaves of which one reaches the other on one side alone.

    `ends`: the enclaves at either end of any. `way`: of one pair, how; never empty.
    """

    pairs: int
    ends: tuple[str, ...]
    way: tuple[Handover, ...]


class Aspect(Struct, frozen=True):
    """Something that a document says, before and after, in words. None: it said nothing."""

    what: str
    old: str | None
    new: str | None
    direction: Direction


class Consequence(Struct, frozen=True, kw_only=True):
    """What follows from a change. `what`: a verb phrase, as "may publish" or "can read without any key".

    `enclaves`: who; none: whoever is on the network. `parts`: each of them a part of the names, not the same for all.
    """

    what: str
    direction: Direction
    enclaves: tuple[str, ...]
    names: Names | None
    profiles: tuple[str, ...]
    reasons: tuple[str, ...] = ()
    influenced: Influenced | None = None
    parts: bool = False


class Change(Struct, frozen=True, kw_only=True):
    """One change. `kind` says which of its layer, as `identity-ca` or `protection`.

    `what`: a noun phrase or a verb phrase of the enclaves. `enclaves`: the paths of those that it is about; none: the
    keystore as a whole, or outsiders. `operation`: publish, subscribe, relay or join, of a right. `names`: what it is
    about. `profiles`: under which implementations it is a change. `varies`: they differ about the names. `old`, `new`:
    where that is written in either keystore. `labels`: those asked for that it is about. `until`: when what is lost
    ends, where peers of NEW take what was signed before (UTC, as reports write it). `against`: what was asked for
    (`diff.Intended`) and is not so any more, or not before that.
    """

    layer: Layer
    kind: str
    direction: Direction
    what: str
    enclaves: tuple[str, ...] = ()
    profiles: tuple[str, ...] = ()
    operation: str | None = None
    aspects: tuple[Aspect, ...] = ()
    names: Names | None = None
    varies: bool = False
    reasons: tuple[str, ...] = ()
    influenced: Influenced | None = None
    old: Location | None = None
    new: Location | None = None
    consequences: tuple[Consequence, ...] = ()
    labels: tuple[str, ...] = ()
    until: str | None = None
    against: tuple[str, ...] = ()

    @property
    def severity(self) -> str | None:
        """Of what is still effective, or was asked for and is lost."""
        return "high" if self.against else ("medium" if self.until else None)

    @property
    def passes(self) -> bool:
        """Whether nothing is worse than before: what is neither more nor less is something that nobody reviewed.

        Nor is anything lost that somebody needs, or left to somebody who is not to have it.
        """
        less = self.direction in (Direction.LOST, Direction.INFO)
        return less and not self.against and not any(each.direction.gains for each in self.consequences)


class Unread(Struct, frozen=True, kw_only=True):
    """Something in one of the keystores that could not be read: what it bears on is not compared.

    `side`: old or new. `enclave`: None where it concerns several, or one that is not known.
    """

    side: str
    enclave: str | None
    location: Location
    reason: str


class Comparison(Struct, frozen=True, kw_only=True):
    """What changed from one keystore to the other at `at` (aware UTC), under `profiles`.

    `domain`: the one that was looked at; None: all. `common`: enclaves of both. `labels`: where there are some, changes
    about others do not fail. `assumed`: what is taken for granted.
    """

    old: str
    new: str
    old_digest: str
    new_digest: str
    at: datetime
    domain: int | None
    profiles: tuple[str, ...]
    common: int
    changes: tuple[Change, ...]
    unknown: tuple[Unread, ...]
    labels: tuple[str, ...] = ()
    assumed: frozenset[Assumption] = EVERY

    def failing(self, fail_on: FailOn) -> tuple[Change, ...]:
        """The changes that stop a release."""
        if fail_on is FailOn.NONE:
            return ()
        about = [change for change in self.changes if change.labels or not self.labels]
        if fail_on is FailOn.GAINED:
            return tuple(change for change in about if not change.passes)
        return tuple(change for change in about if change.direction is not Direction.INFO)
