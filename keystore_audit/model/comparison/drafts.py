"""Changes while they are worked out: with their channels as bit sets, and what turns out to follow from them."""

from __future__ import annotations

from collections.abc import Iterable

from keystore_audit.dataclass import dataclass, field, replace
from keystore_audit.findings import Location
from keystore_audit.model.comparison.change import (
    ORDER,
    Aspect,
    Change,
    Consequence,
    Direction,
    Influenced,
    Layer,
    Names,
)
from keystore_audit.model.comparison.sides import Sides


@dataclass(slots=True, kw_only=True, eq=False)
class Draft:
    """A change; the fields are those of `Change`. `channels`: what it is about.

    `everybody`: it bears on what peers accept from any enclave. `effects`: what follows from it, with the channels in
    place of names. `touched`: further enclaves that it bears on; `whole`: it may bear on any, as a change of the
    keystore does.
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
    effects: dict[Consequence, int] = field(default_factory=dict)

    def account_for(self, shown: Draft, *, parts: bool = False) -> None:
        """Make a consequence of what shows; those that say the same of other names are one."""
        effect = Consequence(
            what=shown.what,
            direction=shown.direction,
            enclaves=shown.enclaves,
            names=None,
            profiles=shown.profiles,
            reasons=shown.reasons,
            influenced=shown.influenced,
            parts=parts,
        )
        self.effects[effect] = self.effects.get(effect, 0) | shown.channels

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
            names=_names(self.channels, sides),
            varies=self.varies,
            reasons=self.reasons,
            influenced=self.influenced,
            old=self.old,
            new=self.new,
            consequences=tuple(
                replace(effect, names=_names(channels, sides))
                for effect, channels in sorted(self.effects.items(), key=lambda each: ORDER.index(each[0].direction))
            ),
            labels=labels,
        )


def _names(channels: int, sides: Sides) -> Names | None:
    return sides.names(channels) if channels else None


def in_order(profiles: Iterable[str], sides: Sides) -> tuple[str, ...]:
    """The profiles in the order in which they were asked for."""
    wanted = set(profiles)
    return tuple(profile.name for profile in sides.profiles if profile.name in wanted)
