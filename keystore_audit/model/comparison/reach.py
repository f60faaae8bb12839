"""What shows in what peers accept, in what attackers can do, and in whether participants start.

Each difference is a consequence of the change that accounts for it; a change of its own where none does.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from typing import Final, NamedTuple

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.comparison.causes import Causes, agreeing
from keystore_audit.model.comparison.change import Direction, Layer
from keystore_audit.model.comparison.drafts import Draft, Fold, Folds, told_beside
from keystore_audit.model.comparison.grants import (
    NOTHING,
    WORDS,
    Right,
    deciding,
    differing,
    either,
    given,
    whole,
)
from keystore_audit.model.comparison.sides import Pair, Sides, View
from keystore_audit.model.comparison.still import JOIN, PRESENTED_BEFORE, Still, may
from keystore_audit.model.comparison.trust import ADDED, REMOVED
from keystore_audit.model.formal import outsiders
from keystore_audit.model.formal.bit_sets import members, union

PRESENTED: Final = "right-presented"
MAX_APART: Final = 4
"""Sets of names, each of other enclaves, that stand apart among the consequences of one change."""


class _Key(NamedTuple):
    """A difference that shows. `draft`: what accounts for it. `operation`: None of what keys alone make possible.

    `own`: of endpoints that the enclave's own implementation makes, whatever its peers accept. `until`: when what is
    lost ends.
    """

    layer: Layer
    what: str
    gained: bool
    operation: str | None = None
    draft: Draft | None = None
    own: bool = False
    until: str | None = None


class Reach:
    """Works out what shows, and which of the changes accounts for it."""

    def __init__(self, sides: Sides, causes: Causes, still: Still) -> None:
        self._sides = sides
        self._causes = causes
        self._still = still
        self._found = Folds[_Key]()

    def work_out(self) -> list[Draft]:
        """Gives changes their consequences; returns what none of them accounts for."""
        for pair in self._sides.pairs:
            self._outsiders(pair)
            for path in self._sides.compared:
                self._insider(pair, path)
                self._presented(pair, path)
            for draft in self._causes.drafts:
                if draft.kind in (ADDED, REMOVED):
                    self._newcomers(pair, draft)
        return [*self._folded(), *self._starts()]

    def _insider(self, pair: Pair, path: str) -> None:
        """What peers accept from an enclave, and what its keys let it do beyond that."""
        views = pair.old, pair.new
        numbers = [view.numbers[path] for view in views]
        rights = self._causes.of(path)
        written, read = 0, 0  # by right before or after: no more than that shows in what keys make possible
        for operation in Operation:
            told = {True: 0, False: 0}
            before, after = (view.accepted(path, operation) for view in views)
            written |= before | after if operation is Operation.PUBLISH else 0
            read |= before | after if operation is Operation.SUBSCRIBE else 0
            for gained, channels in self._both_ways(before, after):
                left = channels
                for draft in rights:
                    same = draft.operation == operation.value and draft.direction.gains == gained
                    if draft.layer is Layer.GRANTS and same:
                        left &= ~draft.channels
                        told[gained] |= draft.channels
                told[gained] |= channels
                self._rights(pair, Layer.ACCESS, Right(operation.value, gained), path, left)
            if operation is not Operation.RELAY:
                self._own_endpoints(pair, path, operation, told)
        heard = [_overheard(view, number) for view, number in zip(views, numbers, strict=True)]
        forged = [_forged(view, number) for view, number in zip(views, numbers, strict=True)]
        for what, (before, after), by_right in (
            ("read without a right to", heard, read),
            ("pass for a writer of", forged, written),
        ):
            for gained, channels in self._both_ways(before & ~by_right, after & ~by_right):
                kept = "" if gained or not self._still.remains(pair) else f", {PRESENTED_BEFORE}"
                self._attribute(pair, _Key(Layer.ATTACKERS, f"{_can(gained)}{kept} {what}", gained), path, channels)

    def _rights(self, pair: Pair, layer: Layer, right: Right, path: str, channels: int) -> None:
        """What peers accept, or (of grants) what documents say that they take."""
        verb = f"{'have a grant to ' if layer is Layer.GRANTS else ''}{WORDS[right.operation]}"
        for part, until in self._still.split(pair, path, right.operation, channels, gained=right.gained):
            what = may(verb, until, gained=right.gained)
            self._attribute(pair, _Key(layer, what, right.gained, right.operation, until=until), path, part)

    def _own_endpoints(self, pair: Pair, path: str, operation: Operation, told: dict[bool, int]) -> None:
        """The endpoints that its own implementation makes, where no right that is `told` has said so."""
        before, after = (view.made(view.numbers[path], operation) for view in (pair.old, pair.new))
        what = f"create a {'writer' if operation is Operation.PUBLISH else 'reader'} of"
        for gained, channels in self._both_ways(before, after):
            key = _Key(Layer.ACCESS, f"{_can(gained)} {what}", gained, operation.value, own=True)
            self._attribute(pair, key, path, channels & ~told[gained])

    def _presented(self, pair: Pair, path: str) -> None:
        """What documents that peers take grant an enclave, where neither its own says so nor what they accept.

        That counts as soon as a governance covers the domain, or controls who publishes and subscribes.
        """
        views = pair.old, pair.new
        old, new = (reduce(either, (given(view, each) for each in view.presented(path)), NOTHING) for view in views)
        for right, channels in differing(self._sides, pair, old, new) if old != new else ():
            left = channels & ~self._told(pair, path, right)
            self._rights(pair, Layer.GRANTS, right, path, left)

    def _told(self, pair: Pair, path: str, right: Right) -> int:
        """Where the right is a change of the enclave's own document, or shows in what peers accept."""
        told = 0
        for draft in self._causes.of(path):
            same = draft.operation == right.operation and draft.direction.gains == right.gained
            told |= draft.channels if draft.layer is Layer.GRANTS and same else 0
        if right.operation == JOIN:
            return told
        operation = Operation(right.operation)
        before, after = (view.accepted(path, operation) for view in (pair.old, pair.new))
        return told | (after & ~before if right.gained else before & ~after)

    def _outsiders(self, pair: Pair) -> None:
        """What somebody without any key can do."""
        before, after = _outside(pair.old), _outside(pair.new)
        for what, channels in before.items():
            for gained, changed in self._both_ways(channels, after[what]):
                self._attribute(pair, _Key(Layer.ATTACKERS, f"{_can(gained)} {what}", gained), None, changed)

    def _newcomers(self, pair: Pair, draft: Draft) -> None:
        """What enclaves that one keystore alone has may do there."""
        gained = draft.kind == ADDED
        view = pair.new if gained else pair.old
        for path in draft.enclaves:
            for operation in Operation:  # nothing where it could not be read
                channels = view.accepted(path, operation) & self._sides.mask
                for part, until in self._still.split(pair, path, operation.value, channels, gained=gained):
                    what = may(WORDS[operation.value], until, gained=gained)
                    key = _Key(Layer.ACCESS, what, gained, operation.value, draft, until=until)
                    self._found.note(key, path, pair, part)

    def _both_ways(self, before: int, after: int) -> Iterator[tuple[bool, int]]:
        for gained, channels in ((True, after & ~before), (False, before & ~after)):
            if channels & self._sides.mask:
                yield gained, channels & self._sides.mask

    def _attribute(self, pair: Pair, key: _Key, path: str | None, channels: int) -> None:
        """Give the channels to the changes that account for them, the nearest first."""
        for draft, part in self._accounting(path, channels, gained=key.gained, own=key.own):
            if part & channels:
                self._found.note(key._replace(draft=draft), path, pair, part & channels)
                channels &= ~part
        if channels:
            view, place = pair.new if key.gained else pair.old, None
            if path is not None and key.operation is not None:
                place = _granting(view, path, key.operation, channels, own=key.own)
            old, new = (None, place) if key.gained else (place, None)
            self._found.note(key, path, pair, channels, old, new)

    def _accounting(self, path: str | None, channels: int, *, gained: bool, own: bool) -> Iterator[tuple[Draft, int]]:
        """Changes that may account for a difference of this enclave (None: of outsiders) on these channels.

        Of several alike, those first that are gains where this is one. `own`: of endpoints of its own, to which rules
        of whatever domain may apply.
        """
        rows = self._causes.rows[gained]
        for draft in rows:
            if path is None or path in draft.enclaves:
                yield draft, draft.channels
        of_enclave = self._causes.of(path) if path else ()
        rights = agreeing(each for each in of_enclave if each.layer is Layer.GRANTS)[gained]
        for draft in rights:
            yield draft, draft.channels
        everybody = self._causes.everybody[gained]
        for draft in everybody:
            if path is None or path in draft.enclaves:
                yield draft, channels
        for draft in rows:  # other enclaves' governance alone
            yield draft, draft.channels
        for draft in everybody:
            yield draft, channels
        for draft in rights:
            yield draft, self._in_domains_of(draft.channels)
        for draft in rights if own else ():
            yield draft, channels
        for draft in self._causes.grants[gained] if path is None else ():
            yield draft, self._in_domains_of(draft.channels) if draft.operation == "join" else draft.channels

    def _in_domains_of(self, channels: int) -> int:
        return union(within for within in self._sides.pairs[0].old.decisions.channels_in if within & channels)

    def _folded(self) -> list[Draft]:
        """Hands out the consequences, those of several enclaves together; returns what has no cause."""
        own = []
        effects: dict[tuple[Draft, _Key, tuple[str, ...]], list[Fold]] = {}
        for key, fold in self._found.folded(self._sides):
            if key.draft is None:
                own.append(_shown(key, fold))
            else:
                effects.setdefault((key.draft, key, fold.profiles), []).append(fold)
        for (cause, key, _profiles), several in effects.items():
            apart = several if len(several) <= MAX_APART else [_together(several)]
            for fold in apart:
                cause.account_for(_shown(key, fold), parts=apart is not several)
        return own

    def _starts(self) -> list[Draft]:
        """Enclaves whose participants start no longer, or now do: a change of its own where nothing accounts for it."""
        old, new = self._sides.usability
        found: dict[tuple[Draft | None, bool | None, tuple[str, ...]], dict[str, list[str]]] = {}
        for path in self._sides.compared:
            directories = [by_path[path].files.directory for by_path in self._sides.enclaves]
            causes = agreeing(self._causes.of(path))
            for profile in self._sides.profiles:
                before, after = old[directories[0], profile.name], new[directories[1], profile.name]
                if before.usable is not after.usable and None not in (before.usable, after.usable):
                    reasons = before.reasons if after.usable else after.reasons
                    cause = next(iter(causes[bool(after.usable)]), None)
                    paths = found.setdefault((cause, after.usable, reasons), {})
                    paths.setdefault(path, []).append(profile.name)
        return list(self._start_drafts(found))

    def _start_drafts(
        self, found: dict[tuple[Draft | None, bool | None, tuple[str, ...]], dict[str, list[str]]]
    ) -> Iterator[Draft]:
        for (cause, starts, reasons), paths in found.items():
            groups = gathered((tuple(names), path) for path, names in paths.items())
            direction = Direction.GAINED if starts else Direction.LOST
            what = "starts now" if starts else "no longer starts"
            for profiles, several in groups.items():
                shown = Draft(
                    layer=Layer.ACCESS,
                    kind="start",
                    direction=direction,
                    what=what,
                    enclaves=tuple(several),
                    profiles=profiles,
                    reasons=reasons,
                )
                yield from told_beside(cause, shown)


def _granting(view: View, path: str, operation: str, channels: int, *, own: bool) -> Location | None:
    """The rule of the enclave's `own` document, or of some other, that decides; for joining, the grant."""
    if own:
        return deciding(view, view.own_grant(path), Operation(operation), channels)
    enclave = view.enclave(path)
    for number in view.presented(path):
        if view.system.grants[number].document == enclave.permissions:
            continue
        rights = given(view, number)
        if operation == JOIN:
            if any(view.decisions.channels_in[domain] & channels for domain in members(rights.joined)):
                return whole(view, number)
        elif common := rights.of(Operation(operation)) & channels:
            return deciding(view, number, Operation(operation), common)
    return None


def _shown(key: _Key, fold: Fold) -> Draft:
    kind, gained = _kind(key), key.gained
    return fold.draft(
        layer=key.layer, kind=kind, gained=gained, what=key.what, operation=key.operation, until=key.until
    )


def _kind(key: _Key) -> str:
    if key.layer is Layer.GRANTS:
        return PRESENTED
    if key.own:
        return "own-endpoint"
    return "accepted" if key.operation else "capability"


def _together(several: list[Fold]) -> Fold:
    whom = [path for fold in several for path in fold.whom]
    return several[0]._replace(whom=whom, channels=union(fold.channels for fold in several))


def _can(gained: bool) -> str:
    return "can" if gained else "can no longer"


def _overheard(view: View, enclave: int) -> int:
    return union(realm.abilities(enclave).overhears for realm in view.realms)


def _forged(view: View, enclave: int) -> int:
    return union(realm.abilities(enclave).forges for realm in view.realms)


_OUTSIDE: Final = {
    "read": outsiders.read,
    "inject samples into": outsiders.inject_into,
    "learn the names of": outsiders.learn_of,
    "replay": outsiders.replay,
    "forge the liveliness of": outsiders.assert_liveliness_of,
}
"""What somebody without any key can do: as the properties have it."""


def _outside(view: View) -> dict[str, int]:
    """By verb phrase, the channels."""
    return {what: union(map(of, view.realms)) for what, of in _OUTSIDE.items()}
