"""Changes while they are worked out: with their channels as bit sets, and what turns out to follow from them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Generic, NamedTuple, TypeVar

from msgspec import Struct, field
from msgspec.structs import replace

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
from keystore_audit.model.comparison.sides import Pair, Sides
from keystore_audit.model.formal.bit_sets import union


class Draft(Struct, kw_only=True, eq=False):
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
    until: str | None = None
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
        self.until = max(filter(None, (self.until, shown.until)), default=None)
        self.effects[effect] = self.effects.get(effect, 0) | shown.channels

    def change(self, sides: Sides, labels: tuple[str, ...] = ()) -> Change:
        """The change with its names and consequences."""
        both = set(Change.__struct_fields__) & set(self.__struct_fields__)
        return Change(
            **{name: getattr(self, name) for name in both},
            names=_names(self.channels, sides),
            consequences=tuple(
                replace(effect, names=_names(channels, sides))
                for effect, channels in sorted(self.effects.items(), key=lambda each: ORDER.index(each[0].direction))
            ),
            labels=labels,
        )


class Fold(NamedTuple):
    """Whom a difference is about, each alike, and where that is written, old and new: of the first that has a place.

    `varies`: the channels are not the same under each of the profiles.
    """

    whom: list[str]
    profiles: tuple[str, ...]
    channels: int
    varies: bool
    old: Location | None
    new: Location | None

    def draft(
        self, *, layer: Layer, kind: str, gained: bool, what: str, operation: str | None, until: str | None
    ) -> Draft:
        """The change that it is."""
        return Draft(
            layer=layer,
            kind=kind,
            direction=Direction.GAINED if gained else Direction.LOST,
            what=what,
            enclaves=tuple(self.whom),
            profiles=self.profiles,
            operation=operation,
            channels=self.channels,
            varies=self.varies,
            old=self.old,
            new=self.new,
            until=until,
        )


_Key = TypeVar("_Key")


class Folds(Generic[_Key]):
    """Differences of several kinds (keys), noted one by one."""

    def __init__(self) -> None:
        self._channels: dict[tuple[_Key, str | None], dict[str, int]] = {}
        self._places: dict[tuple[_Key, str | None], tuple[Location | None, Location | None]] = {}

    def note(
        self,
        key: _Key,
        whom: str | None,
        pair: Pair,
        channels: int,
        old: Location | None = None,
        new: Location | None = None,
    ) -> None:
        """One about an enclave, a subject, or (None) whoever is on the network. The first place counts."""
        by_profile = self._channels.setdefault((key, whom), {})
        for profile in pair.profiles:
            by_profile[profile] = by_profile.get(profile, 0) | channels
        if old is not None or new is not None:
            self._places.setdefault((key, whom), (old, new))

    def folded(self, sides: Sides) -> Iterator[tuple[_Key, Fold]]:
        """All, those of one key with the same channels under each profile together."""
        folds: dict[tuple[_Key, tuple[tuple[str, int], ...]], list[str | None]] = {}
        for (key, whom), by_profile in self._channels.items():
            folds.setdefault((key, tuple(sorted(by_profile.items()))), []).append(whom)
        for (key, alike), several in folds.items():
            every = {channels for _profile, channels in alike}
            profiles = in_order((profile for profile, _channels in alike), sides)
            old, new = next((self._places[key, each] for each in several if (key, each) in self._places), (None, None))
            named = [each for each in several if each is not None]
            yield key, Fold(named, profiles, union(every), len(every) > 1, old, new)


def told_beside(cause: Draft | None, shown: Draft) -> list[Draft]:
    """What shows as a change of its own, unless it is a consequence of what accounts for it."""
    if cause is None:
        return [shown]
    cause.account_for(shown)
    return []


def _names(channels: int, sides: Sides) -> Names | None:
    return sides.names(channels) if channels else None


def in_order(profiles: Iterable[str], sides: Sides) -> tuple[str, ...]:
    """The profiles in the order in which they were asked for."""
    wanted = set(profiles)
    return tuple(profile.name for profile in sides.profiles if profile.name in wanted)
