"""Pairs of enclaves between which data can get now, or can no longer: who accounts for that, and one of the ways."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from keystore_audit.model.comparison.change import Direction, Handover, Influenced, Layer
from keystore_audit.model.comparison.facts import ADDED, REMOVED, Causes, Draft, shares
from keystore_audit.model.comparison.grants import PRESENTED_BEFORE
from keystore_audit.model.comparison.sides import Sides, View
from keystore_audit.model.formal.attacker import realm_views
from keystore_audit.model.formal.bit_sets import bits, lowest, members, union
from keystore_audit.model.formal.claim import Attacker, Place
from keystore_audit.model.formal.flow import Flows, Lane, Leg, Search
from keystore_audit.model.formal.influence import Influence
from keystore_audit.model.names import AMBIENT


class _Side:
    """One keystore: the compared enclaves come first, in one order on both sides, then those that it alone has."""

    def __init__(self, view: View, paths: Sequence[str], left_out: int, kept: int) -> None:
        self._flows = Flows(view.system, realm_views(view.system, view.permissions))
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


def influence_changes(sides: Sides, causes: Causes) -> Iterator[Draft]:
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
    """Those of which the other side has not both ends are among them."""
    both = (1 << common) - 1
    found = {}
    for node, reached in enumerate(side.graph.flows):
        before = other.graph.flows[node] & both if node < common else 0
        others = reached & ~before & ~(1 << node)
        if others:
            found[node] = others
    return found


def _hops(sides: Sides, causes: Causes, side: _Side, other: _Side, *, gained: bool) -> Iterator[_Blame]:
    """Each hop of one side that the other has not, once, with the change that accounts for it."""
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
    """The pairs, and the way of one of them: of one that is a hop itself, if there is one."""
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
