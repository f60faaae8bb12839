"""What the enclaves' own permissions give, before and after: first match, default, domains and partitions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.comparison.change import Aspect, Direction, Layer
from keystore_audit.model.comparison.drafts import Draft, Folds
from keystore_audit.model.comparison.facts import Dates, other_dates, spanned
from keystore_audit.model.comparison.sides import Pair, Sides, View, is_void
from keystore_audit.model.comparison.still import JOIN, Still, may
from keystore_audit.model.formal.bit_sets import lowest, members
from keystore_audit.model.formal.system import GrantAtom

WORDS: Final = {
    "publish": "publish",
    "subscribe": "subscribe to",
    "relay": "relay",
    JOIN: "join",
}
"""Operations as verbs of what follows."""


class _Moved(NamedTuple):
    """An enclave whose grant has other dates."""

    path: str
    aspects: tuple[Aspect, ...]
    old: Location
    new: Location


class Right(NamedTuple):
    """An operation that somebody gained (or lost)."""

    operation: str
    gained: bool


class Given(NamedTuple):
    """What a grant gives: channels by operation, and domains that it lets its holder join."""

    publish: int
    subscribe: int
    relay: int
    joined: int

    def of(self, operation: Operation) -> int:
        """The channels on which the operation is given."""
        if operation is Operation.PUBLISH:
            return self.publish
        return self.subscribe if operation is Operation.SUBSCRIBE else self.relay


NOTHING: Final = Given(0, 0, 0, 0)


def grant_changes(sides: Sides, still: Still) -> list[Draft]:
    """One draft for each operation and direction, of all enclaves for which the same names changed."""
    folds = Folds[tuple[Right, str | None]]()
    for pair in sides.pairs:
        for path in sides.compared:
            for right, channels, old, new in _differences(sides, pair, path):
                for part, until in still.split(pair, path, right.operation, channels, gained=right.gained):
                    folds.note((right, until), path, pair, part, old, new)
    return [
        fold.draft(
            layer=Layer.GRANTS,
            kind="right",
            gained=right.gained,
            what=may(WORDS[right.operation], until, gained=right.gained),
            operation=right.operation,
            until=until,
        )
        for (right, until), fold in folds.folded(sides)
    ]


def _differences(sides: Sides, pair: Pair, path: str) -> Iterator[tuple[Right, int, Location | None, Location | None]]:
    if is_refused(sides, pair, path):
        return  # whether it starts says so
    grants = pair.old.own_grant(path), pair.new.own_grant(path)
    old, new = given(pair.old, grants[0]), given(pair.new, grants[1])
    if old == new:
        return
    for right, channels in differing(sides, pair, old, new):
        if right.operation == JOIN:
            one, other = (whole(view, grant) for view, grant in _both(pair, grants))
        else:
            operation = Operation(right.operation)
            one, other = (deciding(view, grant, operation, channels) for view, grant in _both(pair, grants))
        yield right, channels, one, other


def differing(sides: Sides, pair: Pair, old: Given, new: Given) -> Iterator[tuple[Right, int]]:
    """Operations with the channels on which they were gained, or lost; joining where that does not say it already."""
    touched = {True: 0, False: 0}
    for operation in Operation:
        before, after = old.of(operation) & sides.mask, new.of(operation) & sides.mask
        for gained, channels in ((True, after & ~before), (False, before & ~after)):
            if channels:
                touched[gained] |= channels
                yield Right(operation.value, gained), channels
    for gained, domains in ((True, new.joined & ~old.joined), (False, old.joined & ~new.joined)):
        bare = 0
        for domain in members(domains):
            channels = pair.old.decisions.channels_in[domain] & sides.mask
            if not channels & touched[gained]:  # else it goes without saying
                bare |= channels
        if bare:
            yield Right(JOIN, gained), bare


def validity_changes(sides: Sides, rights: list[Draft]) -> list[Draft]:
    """The dates of the grants that count, or would: one draft for all enclaves whose dates changed alike.

    Not where the new dates take all rights away, or give them: `rights` has that.
    """
    told = {path for draft in rights for path in draft.enclaves}
    found: dict[tuple[str, Direction], list[_Moved]] = {}
    pair = sides.pairs[0]
    for path in sides.compared:
        flips = (pair.old.own_grant(path) is None) != (pair.new.own_grant(path) is None)
        one, other = _naming(pair.old, path), _naming(pair.new, path)
        if one is None or other is None or (flips and path in told):
            continue
        dates = _dates(pair.old, one), _dates(pair.new, other)
        if dates[0] != dates[1]:
            words, aspects, direction = other_dates(*dates)
            found.setdefault((words, direction), []).append(_Moved(path, aspects, one.location, other.location))
    return [_validity_draft(sides, *words, moved) for words, moved in found.items()]


def _validity_draft(sides: Sides, words: str, direction: Direction, moved: list[_Moved]) -> Draft:
    return Draft(
        layer=Layer.TRUST,
        kind="grant-validity",
        direction=direction,
        what=f"its grant {words}",
        enclaves=tuple(each.path for each in moved),
        profiles=tuple(profile.name for profile in sides.profiles),
        aspects=spanned([each.aspects for each in moved]),
        old=moved[0].old,
        new=moved[0].new,
    )


def _dates(view: View, grant: GrantAtom) -> Dates:
    return view.system.instants[grant.not_before], view.system.instants[grant.not_after]


def _naming(view: View, path: str) -> GrantAtom | None:
    """The grant of the enclave's own document that counts, or, where none is in force, the first that names it."""
    own = view.own_grant(path)
    if own is not None:
        return view.system.grants[own]
    enclave = view.enclave(path)
    for grant in view.system.grants if enclave.permissions is not None else ():
        if grant.document == enclave.permissions and enclave.identity in grant.names:
            return grant
    return None


def _both(pair: Pair, grants: tuple[int | None, int | None]) -> tuple[tuple[View, int | None], ...]:
    return (pair.old, grants[0]), (pair.new, grants[1])


def given(view: View, grant: int | None) -> Given:
    """What the grant gives its holder; None: nothing."""
    if grant is None:
        return NOTHING
    allowed = view.decisions.allowed
    publish, subscribe, relay = (allowed(grant, operation) for operation in Operation)
    return Given(publish, subscribe, relay, view.decisions.joins(grant))


def either(one: Given, other: Given) -> Given:
    """What both give together."""
    return Given(*(mine | theirs for mine, theirs in zip(one, other, strict=True)))


def is_refused(sides: Sides, pair: Pair, path: str) -> bool:
    """Whether an implementation takes the enclave's permissions, old or new, for none."""
    return any(is_void(by_path[path].permissions, pair.lead, sides.accesses) for by_path in sides.enclaves)


def whole(view: View, grant: int | None) -> Location | None:
    """Where the grant begins."""
    return None if grant is None else view.system.grants[grant].location


def deciding(view: View, grant: int | None, operation: Operation, channels: int) -> Location | None:
    """The rule of the grant that decides about the first of the channels; where none does, the grant."""
    if grant is None:
        return None
    channel = lowest(channels)
    domain = view.system.channels[channel].domain
    for rule in view.decisions.rules[grant]:
        if domain in rule.domains and channel in rule.named(operation):
            return view.system.place(rule, operation, channel)
    return whole(view, grant)
