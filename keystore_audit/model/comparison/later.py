"""Rights that begin later, before and after: of grants whose dates have not begun at the instant, and of those that
come up when one before them ends, where grants out of date are passed over.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from functools import reduce
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.model.comparison.change import Direction, Layer, direction_of
from keystore_audit.model.comparison.drafts import Draft, in_order
from keystore_audit.model.comparison.grants import NOTHING, Given, differing, either, given, is_refused
from keystore_audit.model.comparison.sides import Pair, Sides, View
from keystore_audit.model.formal.bit_sets import bits, union

KIND: Final = "later-rights"

_WORDS: Final = {
    Direction.GAINED: "may do more, once a grant counts that does not yet, on",
    Direction.LOST: "may do less, once a grant counts that does not yet, on",
    Direction.MIXED: "may do other things, once a grant counts that does not yet, on",
    Direction.CHANGED: "has other grants that do not count yet, with the same rights",
}


class _Later(NamedTuple):
    """A grant by what it says: when, and what it gives."""

    begins: datetime
    ends: datetime
    gives: Given


class _Side(Struct, frozen=True):
    """Those of an enclave in one keystore; `where`: the first of them. `now`: what its own grant in force gives."""

    grants: frozenset[_Later]
    now: Given
    where: Location | None

    @property
    def ever(self) -> Given:
        """What it may do now or later."""
        return either(self.now, self.soon)

    @property
    def soon(self) -> Given:
        """What these give together."""
        return reduce(either, (grant.gives for grant in self.grants), NOTHING)


def later_changes(sides: Sides, told: frozenset[str]) -> list[Draft]:
    """One draft for all enclaves whose grants that begin later changed alike.

    It is a gain where such a grant gives what none did before, now or later: what begins tomorrow is signed today.
    `told`: enclaves of which it is said that their grant has other dates.
    """
    found: dict[tuple[str, Direction], tuple[list[str], int, Location | None, Location | None]] = {}
    for pair in sides.pairs:
        for path, direction, channels, old, new in _differences(sides, pair):
            if direction is Direction.CHANGED and path in told:
                continue
            profiles, known, one, other = found.setdefault((path, direction), ([], 0, old, new))
            profiles += pair.profiles
            found[path, direction] = profiles, known | channels, one, other
    folds: dict[tuple[Direction, int, tuple[str, ...]], list[tuple[str, Location | None, Location | None]]] = {}
    for (path, direction), (profiles, channels, old, new) in found.items():
        folds.setdefault((direction, channels, in_order(profiles, sides)), []).append((path, old, new))
    return [
        Draft(
            layer=Layer.TRUST,
            kind=KIND,
            direction=direction,
            what=_WORDS[direction],
            enclaves=tuple(path for path, _old, _new in members),
            profiles=profiles,
            channels=channels,
            old=members[0][1],
            new=members[0][2],
        )
        for (direction, channels, profiles), members in folds.items()
    ]


def _differences(sides: Sides, pair: Pair) -> Iterator[tuple[str, Direction, int, Location | None, Location | None]]:
    later = tuple(_begin_later(view) for view in (pair.old, pair.new))
    if not any(later):  # nearly always
        return
    for path in sides.compared:
        if is_refused(sides, pair, path):
            continue
        old = _side(pair.old, later[0], path, sides.mask)
        new = _side(pair.new, later[1], path, sides.mask)
        if old.grants == new.grants:
            continue
        gained = _beyond(sides, pair, new.soon, old.ever)
        lost = _beyond(sides, pair, old.soon, new.ever)
        yield path, direction_of(gains=bool(gained), losses=bool(lost)), gained | lost, old.where, new.where


def _begin_later(view: View) -> list[int]:
    system = view.system
    ends: dict[tuple[int, int], int] = {}  # by document and certificate: when the first of its grants has ended
    found = []
    for number, grant in enumerate(system.grants):
        named = [(grant.document, certificate) for certificate in grant.names]
        earlier = [ends.get(each, grant.not_after) for each in named]
        comes_up = system.skips_grants_out_of_date and any(end < grant.not_after for end in earlier)
        if grant.not_before > system.now or (comes_up and grant.not_after > system.now):
            found.append(number)
        ends.update((each, min(end, grant.not_after)) for each, end in zip(named, earlier, strict=True))
    return found


def _side(view: View, later: list[int], path: str, mask: int) -> _Side:
    system = view.system
    enclave = view.enclave(path)
    found: set[_Later] = set()
    where = None
    for number in later:
        grant = system.grants[number]
        theirs = grant.document == enclave.permissions or grant.document in view.taken
        if theirs and enclave.identity in grant.names:
            gives = _within(view, given(view, number), mask)
            begins, ends = system.instants[grant.not_before], system.instants[grant.not_after]
            if any(gives) and begins <= ends:
                found.add(_Later(begins, ends, gives))
                where = where or grant.location
    return _Side(frozenset(found), _within(view, given(view, view.own_grant(path)), mask), where)


def _within(view: View, rights: Given, mask: int) -> Given:
    """Those of the channels that count, and of domains with such channels."""
    domains = bits(number for number, channels in enumerate(view.decisions.channels_in) if channels & mask)
    return Given(rights.publish & mask, rights.subscribe & mask, rights.relay & mask, rights.joined & domains)


def _beyond(sides: Sides, pair: Pair, one: Given, other: Given) -> int:
    """The channels on which something is given by one and not by the other."""
    return union(channels for _right, channels in differing(sides, pair, other, either(other, one)))
