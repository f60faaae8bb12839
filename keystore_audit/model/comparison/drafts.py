"""Changes while they are worked out: with their channels as bit sets, and what turns out to follow from them."""

from __future__ import annotations

from collections.abc import Iterable

from keystore_audit.dataclass import dataclass, field, replace
from keystore_audit.findings import Location
from keystore_audit.model.comparison.change import ORDER, Aspect, Change, Consequence, Direction, Influenced, Layer
from keystore_audit.model.comparison.sides import Sides


@dataclass(slots=True, kw_only=True, eq=False)
class Draft:
    """A change; the fields are those of `Change`. `channels`: what it is about.

    `everybody`: it bears on what peers accept from any enclave. `effects`: what follows from it, see `Effect`.
    `touched`: further enclaves that it bears on; `whole`: it may bear on any, as a change of the keystore does.
    """

    layer: Layer
    kind: str
    direction: Direction
    what: str
    enclaves: tuple[str, ...]
    profiles: tuple[str, ...]
    operation: str | None = None
    aspects: tuple[Aspect, ...] = ()
    channels: int = 0
    varies: bool = False
    everybody: bool = False
    touched: tuple[str, ...] = ()
    whole: bool = False
    reasons: tuple[str, ...] = ()
    influenced: Influenced | None = None
    old: Location | None = None
    new: Location | None = None
    effects: list[Effect] = field(default_factory=list)

    def change(self, sides: Sides, labels: tuple[str, ...] = ()) -> Change:
        """The change with its names and consequences."""
        return Change(
            layer=self.layer,
            kind=self.kind,
            direction=self.direction,
            what=self.what,
            enclaves=self.enclaves,
            profiles=self.profiles,
            operation=self.operation,
            aspects=self.aspects,
            names=sides.names(self.channels) if self.channels else None,
            varies=self.varies,
            reasons=self.reasons,
            influenced=self.influenced,
            old=self.old,
            new=self.new,
            consequences=tuple(effect.consequence(sides) for effect in sorted(_once(self.effects), key=_told_first)),
            labels=labels,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """Something that shows: the fields are those of `Consequence`."""

    what: str
    direction: Direction
    enclaves: tuple[str, ...]
    channels: int
    profiles: tuple[str, ...]
    reasons: tuple[str, ...] = ()
    influenced: Influenced | None = None
    parts: bool = False

    def consequence(self, sides: Sides) -> Consequence:
        """The same with names."""
        return Consequence(
            what=self.what,
            direction=self.direction,
            enclaves=self.enclaves,
            names=sides.names(self.channels) if self.channels else None,
            profiles=self.profiles,
            reasons=self.reasons,
            influenced=self.influenced,
            parts=self.parts,
        )


def _once(effects: Iterable[Effect]) -> Iterable[Effect]:
    """Those that say the same of other names in one: what a grant gives, and what peers make of it."""
    found: dict[Effect, int] = {}
    for effect in effects:
        key = replace(effect, channels=0)
        found[key] = found.get(key, 0) | effect.channels
    return [replace(effect, channels=channels) for effect, channels in found.items()]


def _told_first(effect: Effect) -> int:
    return ORDER.index(effect.direction)


def in_order(profiles: Iterable[str], sides: Sides) -> tuple[str, ...]:
    """The profiles in the order in which they were asked for."""
    wanted = set(profiles)
    return tuple(profile.name for profile in sides.profiles if profile.name in wanted)
