"""Differences in what peers accept, what attackers can do, whether participants start, and where data gets.

Each difference is a consequence of the change that accounts for it, or else a change of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.comparison.change import Direction, Handover, Influenced, Layer
from keystore_audit.model.comparison.facts import ADDED, REMOVED, Causes, Draft, agreeing, shares
from keystore_audit.model.comparison.grants import (
    JOIN,
    PRESENTED_BEFORE,
    Right,
    both_ways,
    deciding,
    differing,
    either,
    given,
    right_drafts,
)
from keystore_audit.model.comparison.sides import Pair, Sides, View
from keystore_audit.model.formal import rights as outsiders
from keystore_audit.model.formal.asked import Attacker, Place, Search
from keystore_audit.model.formal.attacker import TrustDomainView, trust_domain_views
from keystore_audit.model.formal.bit_sets import bits, lowest, members, union
from keystore_audit.model.formal.flow import Flows, Lane, Leg
from keystore_audit.model.formal.influence import Influence
from keystore_audit.model.names import AMBIENT
from keystore_audit.truth import Truth

PRESENTED: Final = "right-presented"
OWN: Final = "own-endpoint"
CAPABILITY: Final = "capability"

_OUTSIDE: Final[Mapping[str, Callable[[TrustDomainView], int]]] = {
    "read": outsiders.read,
    "inject samples into": outsiders.inject_into,
    "learn the names of": outsiders.learn_of,
    "replay": outsiders.replay,
    "forge the liveliness of": outsiders.assert_liveliness_of,
}
"""What somebody without any key can do: as the properties have it."""


def reach_changes(sides: Sides, causes: Causes) -> Iterator[Draft]:
    """The differences, each with its cause if there is one."""
    for pair in sides.pairs:
        yield from _attributed(sides, causes, pair, _outsiders(sides, pair))
        for path in sides.compared:
            yield from _attributed(sides, causes, pair, _insider(sides, causes, pair, path))
            yield from _attributed(sides, causes, pair, _presented(sides, causes, pair, path))
        for draft in causes.drafts:
            if draft.kind in (ADDED, REMOVED):
                yield from _newcomers(sides, pair, draft)
    yield from _starts(sides, causes)
    yield from _influences(sides, causes)


def _insider(sides: Sides, causes: Causes, pair: Pair, path: str) -> Iterator[Draft]:
    """What peers accept from an enclave, and what its keys let it do beyond that."""
    views = [(view, view.numbers[path]) for view in (pair.old, pair.new)]
    by_right: dict[Operation, int] = {}  # before or after: no more than that shows in what keys make possible
    for operation in Operation:
        accepted = [view.accepted(path, operation) for view, _number in views]
        by_right[operation] = union(accepted)
        made = [0, 0] if operation is Operation.RELAY else [view.made(number, operation) for view, number in views]
        for gained, shown in both_ways(sides, *accepted):
            right = Right(operation.value, gained)
            left = shown & ~_granted(causes, path, right)
            yield from right_drafts(sides, pair, path, right, left, layer=Layer.ACCESS, kind="accepted")
        for gained, shown in both_ways(sides, *made):
            right = Right(operation.value, gained)
            told = dict(both_ways(sides, *accepted)).get(gained, 0)
            left = shown & ~(told | _granted(causes, path, right) if told else 0)
            end = "writer" if operation is Operation.PUBLISH else "reader"
            what = f" create a {end} of"
            yield _shown(pair, OWN, what, left, gained=gained, path=path, operation=operation.value)
    for what, of, operation in (
        ("read without a right to", "overhears", Operation.SUBSCRIBE),
        ("pass for a writer of", "forges", Operation.PUBLISH),
    ):
        before, after = (
            union(getattr(trust_domain.abilities(number), of) for trust_domain in view.trust_domains)
            & ~by_right[operation]
            for view, number in views
        )
        for gained, channels in both_ways(sides, before, after):
            kept = PRESENTED_BEFORE if not gained and pair.kept.keeps else ""
            yield _shown(pair, CAPABILITY, f"{kept} {what}", channels, gained=gained, path=path)


def _shown(
    pair: Pair,
    kind: str,
    what: str,
    channels: int,
    *,
    gained: bool,
    path: str | None = None,
    operation: str | None = None,
) -> Draft:
    return Draft(
        layer=Layer.ATTACKERS if kind == CAPABILITY else Layer.ACCESS,
        kind=kind,
        direction=Direction.GAINED if gained else Direction.LOST,
        what=f"{'can' if gained else 'can no longer'}{what}",
        enclaves=() if path is None else (path,),
        profiles=pair.profiles,
        operation=operation,
        channels=channels,
    )


def _granted(causes: Causes, path: str, right: Right) -> int:
    """The channels on which the right is a change of the enclave's own document."""
    return union(
        draft.channels
        for draft in causes.of(path)
        if draft.layer is Layer.GRANTS and draft.operation == right.operation and draft.direction is right.direction
    )


def _presented(sides: Sides, causes: Causes, pair: Pair, path: str) -> Iterator[Draft]:
    """What documents that peers take grant an enclave, where neither its own says so nor what they accept.

    That counts as soon as a governance covers the domain, or controls who publishes and subscribes.
    """
    old, new = (either([given(view, each) for each in view.presented(path)]) for view in (pair.old, pair.new))
    for right, channels in differing(sides, pair, old, new):
        told = _granted(causes, path, right)
        if right.operation != JOIN:
            before, after = (view.accepted(path, Operation(right.operation)) for view in (pair.old, pair.new))
            told |= after & ~before if right.gained else before & ~after
        yield from right_drafts(
            sides, pair, path, right, channels & ~told, layer=Layer.GRANTS, kind=PRESENTED, verb="have a grant to "
        )


def _outsiders(sides: Sides, pair: Pair) -> Iterator[Draft]:
    """What somebody without any key can do."""
    for what, of in _OUTSIDE.items():
        before, after = (union(map(of, view.trust_domains)) for view in (pair.old, pair.new))
        for gained, channels in both_ways(sides, before, after):
            yield _shown(pair, CAPABILITY, f" {what}", channels, gained=gained)


def _newcomers(sides: Sides, pair: Pair, draft: Draft) -> Iterator[Draft]:
    """What enclaves of only one keystore may do there."""
    gained = draft.kind == ADDED
    view = pair.new if gained else pair.old
    for path in draft.enclaves:
        for operation in Operation:  # nothing where it could not be read
            right, channels = Right(operation.value, gained), view.accepted(path, operation) & sides.mask
            for each in right_drafts(sides, pair, path, right, channels, layer=Layer.ACCESS, kind="accepted"):
                yield replace(each, cause=draft)


def _attributed(sides: Sides, causes: Causes, pair: Pair, drafts: Iterable[Draft]) -> Iterator[Draft]:
    """Gives the channels to the changes that account for them, the nearest first."""
    for draft in drafts:
        for cause, part in shares(_accounting(sides, causes, draft), draft.channels):
            gained, place = draft.direction is Direction.GAINED, None
            if cause is None and draft.enclaves and draft.operation is not None:
                place = _granting(pair.new if gained else pair.old, draft, part)
            places = (None, place) if gained else (place, None)
            yield replace(draft, cause=cause, channels=part, old=places[0], new=places[1])


def _accounting(sides: Sides, causes: Causes, shown: Draft) -> Iterator[tuple[Draft, int]]:
    """Changes that may account for a difference of this enclave, or of outsiders, and on which channels.

    Of several alike, gains come first where this is a gain. Rules of any domain may apply to its own endpoints.
    """
    gained, path, channels = shown.direction is Direction.GAINED, next(iter(shown.enclaves), None), shown.channels
    rows, everybody = causes.rows[gained], causes.everybody[gained]
    of_enclave = causes.of(path) if path is not None else ()
    rights = agreeing(each for each in of_enclave if each.layer is Layer.GRANTS)[gained]
    yield from ((draft, draft.channels) for draft in rows if path is None or path in draft.enclaves)
    yield from ((draft, draft.channels) for draft in rights)
    yield from ((draft, channels) for draft in everybody if path is None or path in draft.enclaves)
    yield from ((draft, draft.channels) for draft in rows)  # other enclaves' governance alone
    yield from ((draft, channels) for draft in everybody)
    yield from ((draft, _in_domains_of(sides, draft.channels)) for draft in rights)
    yield from ((draft, channels) for draft in rights if shown.kind == OWN)
    for draft in causes.grants[gained] if path is None else ():
        yield draft, _in_domains_of(sides, draft.channels) if draft.operation == JOIN else draft.channels


def _in_domains_of(sides: Sides, channels: int) -> int:
    return union(within for within in sides.pairs[0].old.decisions.channels_in if within & channels)


def _starts(sides: Sides, causes: Causes) -> Iterator[Draft]:
    """Enclaves whose participants no longer start, or now do; a change of its own where nothing accounts for it."""
    found: dict[tuple[Draft | None, str, tuple[str, ...]], list[Draft]] = {}
    for path in sides.compared:
        directories = [by_path[path].files.directory for by_path in sides.enclaves]
        for profile in sides.profiles:
            before, after = (
                usable[directory, profile.name] for usable, directory in zip(sides.usability, directories, strict=True)
            )
            if before.usable is after.usable or Truth.UNKNOWN in (before.usable, after.usable):
                continue
            starts = after.usable.must
            draft = Draft(
                layer=Layer.ACCESS,
                kind="start",
                direction=Direction.GAINED if starts else Direction.LOST,
                what="starts now" if starts else "no longer starts",
                enclaves=(path,),
                profiles=(profile.name,),
                reasons=before.reasons if starts else after.reasons,
                cause=next(iter(agreeing(causes.of(path))[starts]), None),
            )
            found.setdefault((draft.cause, draft.what, draft.reasons), []).append(draft)
    for several in found.values():
        yield from several


def _granting(view: View, draft: Draft, channels: int) -> Location | None:
    """The rule of the enclave's own document, or of some other, that decides; for joining, the grant."""
    path, operation = draft.enclaves[0], draft.operation or JOIN
    if draft.kind == OWN:
        return deciding(view, view.own_grant(path), operation, channels)
    for number in view.presented(path):
        common = given(view, number).channels(view, operation) & channels
        if common and view.system.grants[number].document not in view.enclave(path).permissions:
            return deciding(view, number, operation, common)
    return None


class _Side:
    """One keystore. The compared enclaves come first, in the same order on both sides, then those of it alone."""

    def __init__(self, view: View, paths: Sequence[str], left_out: int, kept: int) -> None:
        self._flows = Flows(view.system, trust_domain_views(view.system, view.permissions))
        self._left_out = frozenset(members(left_out))
        self._nobody = frozenset(range(len(view.system.enclaves))) - {view.numbers[path] for path in paths}
        self._numbers = [view.numbers[path] for path in paths]
        self._view = view
        self.paths = paths
        lanes = self._flows.lanes(self._search(Place(), Place()))
        ours = (
            ([part[number] & kept for number in self._numbers] for part in (each.puts, each.gets)) for each in lanes
        )
        self.graph = Influence([Lane(puts=puts, gets=gets) for puts, gets in ours], len(paths))

    def _search(self, source: Place, target: Place) -> Search:
        return Search(
            attacker=Attacker.HONEST, source=source, target=target, through=self._nobody, left_out=self._left_out
        )

    def way(self, source: int, target: int) -> tuple[Leg, ...]:
        """A shortest flow between two participants, by the numbers of the system."""
        ends = (Place(enclaves=frozenset({self._numbers[each]})) for each in (source, target))
        return self._flows.shortest(self._search(*ends)) or ()

    def label(self, enclave: int | None) -> str:
        """The path of an enclave of the system."""
        return "" if enclave is None else self._view.system.enclaves[enclave].label


class _Blame(NamedTuple):
    """Hops from a sender that a change made, or took away."""

    draft: Draft | None
    sender: int
    receivers: int


_Pairs = dict[int, int]
"""By participant: those that it reaches on one side alone."""


def _influences(sides: Sides, causes: Causes) -> Iterator[Draft]:
    """Flows that came or went, each with its cause if there is one."""
    for pair in sides.pairs:
        everything, kept = pair.old.decisions.all_channels, sides.mask & ~sides.named(AMBIENT)
        ordered = [[*sides.compared, *sides.alone(side)] for side in range(2)]
        old, new = (
            _Side(view, paths, everything & ~kept, kept)
            for view, paths in zip((pair.old, pair.new), ordered, strict=True)
        )
        if ordered[0] == ordered[1] and old.graph.hops == new.graph.hops:
            continue
        for gained, side, other in ((False, old, new), (True, new, old)):
            pairs = _pairs(side, other, len(sides.compared))
            blames = [*_hops(sides, causes, side, other, gained=gained)] if pairs else []
            for cause, shared in _shared(side, blames, pairs).items():
                before = PRESENTED_BEFORE if not gained and pair.kept.keeps else ""
                yield Draft(
                    layer=Layer.INFLUENCE,
                    kind="flow",
                    direction=Direction.GAINED if gained else Direction.LOST,
                    what="data can now get" if gained else f"data can no longer get{before}",
                    profiles=pair.profiles,
                    influenced=_influenced(sides, side, shared, [each for each in blames if each.draft is cause]),
                    cause=cause,
                )


def _pairs(side: _Side, other: _Side, common: int) -> _Pairs:
    """The pairs of one side alone; pairs of which the other side lacks an end are among them."""
    both = (1 << common) - 1
    found = {}
    for node, reached in enumerate(side.graph.flows):
        before = other.graph.flows[node] & both if node < common else 0
        others = reached & ~before & ~(1 << node)
        if others:
            found[node] = others
    return found


def _hops(sides: Sides, causes: Causes, side: _Side, other: _Side, *, gained: bool) -> Iterator[_Blame]:
    """Each hop of one side that the other lacks, once, with the change that accounts for it."""
    number = {path: number for number, path in enumerate(sides.compared)}
    both = (1 << len(number)) - 1
    coming = next((each for each in causes.drafts if each.kind == (ADDED if gained else REMOVED)), None)
    rights = [
        (draft, bits(number[path] for path in draft.enclaves if path in number)) for draft in causes.grants[gained]
    ]
    for sender, receivers in enumerate(side.graph.hops):
        if sender >= len(number):
            yield _Blame(coming, sender, receivers)
            continue
        hops = receivers & ~(other.graph.hops[sender] & both)
        if hops & ~both:
            yield _Blame(coming, sender, hops & ~both)
        left = hops & both & ~(1 << sender)
        for draft, part in shares(_from(side, sender, causes, rights, gained=gained), left):
            yield _Blame(draft, sender, part)


def _from(
    side: _Side, sender: int, causes: Causes, rights: list[tuple[Draft, int]], *, gained: bool
) -> Iterator[tuple[Draft, int]]:
    """Changes with the receivers that they may account for, the nearest first; `rights`: with whose they are."""
    path, receivers = side.paths[sender], side.graph.receivers
    yield from ((draft, receivers(sender, draft.channels)) for draft in causes.rows[gained])
    for draft, members_of in rights:
        if draft.operation == "publish" and path in draft.enclaves:
            yield draft, receivers(sender, draft.channels)
        elif draft.operation == "subscribe" and members_of:
            yield draft, receivers(sender, draft.channels) & members_of
    everybody = causes.everybody[gained]
    yield from ((draft, -1) for draft in everybody if path in draft.enclaves)
    yield from ((draft, -1) for draft in everybody)
    yield from ((draft, -1 if path in draft.enclaves else members_of) for draft, members_of in rights)


def _shared(side: _Side, blames: list[_Blame], pairs: _Pairs) -> dict[Draft | None, _Pairs]:
    """The pairs by the change that made a hop on a way between them, each once."""
    drafts = dict.fromkeys(each.draft for each in blames)
    if len(drafts) == 1:
        return {next(iter(drafts)): pairs}
    flows = side.graph.flows
    left = dict(pairs)
    shared: dict[Draft | None, _Pairs] = {}
    for blame in blames:
        ends, todo = 0, blame.receivers
        while todo:
            reached = flows[lowest(todo)]
            ends |= reached
            todo &= ~reached
        for node, others in list(left.items()):
            if flows[node] >> blame.sender & 1 and others & ends:
                of_draft = shared.setdefault(blame.draft, {})
                of_draft[node] = of_draft.get(node, 0) | others & ends
                left[node] = others & ~ends
                if not left[node]:
                    del left[node]
    return shared


def _influenced(sides: Sides, side: _Side, pairs: _Pairs, blames: list[_Blame]) -> Influenced:
    """The pairs, and the way of one of them; preferably of one that is a hop itself."""
    direct = ((each.sender, pairs.get(each.sender, 0) & each.receivers) for each in blames)
    source, targets = next((each for each in direct if each[1]), next(iter(pairs.items())))
    way = side.way(source, lowest(targets))
    hops = []
    for leg in way:
        name = sides.witnesses(1 << leg.channel)[0]
        hops.append(Handover(sender=side.label(leg.sender), name=name, receiver=side.label(leg.receiver)))
    ends = union(1 << node | others for node, others in pairs.items())
    return Influenced(
        pairs=sum(each.bit_count() for each in pairs.values()),
        ends=tuple(side.paths[node] for node in members(ends)),
        way=tuple(hops),
    )
