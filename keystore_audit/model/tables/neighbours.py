"""From whom samples come to an enclave, and to whom its own go, in one step.

What is drawn of the information flow: not a question, and no engine decides it. Flows over several enclaves are those
of `model.formal.flow`, of which these are the hops.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.grouped import gathered
from keystore_audit.model.formal.asked import Attacker, Place
from keystore_audit.model.formal.attacker import trust_domain_views
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.flow import Flows, Lane, Search
from keystore_audit.model.formal.system import System
from keystore_audit.model.window import Window

ANYBODY: Final = None
"""Stands for whoever is on the network, without any key."""


class PeerGroup(Struct, frozen=True, kw_only=True):
    """Names (places in the access table) on which the same peers are at the other end.

    `peers`: paths of enclaves, ANYBODY last. `by_right`: peers grant it; else it takes a compromised sender or
    receiver, with the keys that it holds or as anybody on the network.
    """

    peers: tuple[str | None, ...]
    names: tuple[int, ...]
    by_right: bool


class Neighbourhood(Struct, frozen=True, kw_only=True):
    """The groups of peers to and from the enclave `path`; by right first, then those with the fewest peers."""

    path: str
    incoming: tuple[PeerGroup, ...]
    outgoing: tuple[PeerGroup, ...]


def neighbourhoods(system: System, window: Window, left_out: int, limit: int) -> tuple[Neighbourhood, ...]:
    """Of the first `limit` enclaves of the system. `left_out`: names (bit set) that are not looked at."""
    flows = Flows(system, trust_domain_views(system))
    kept = window.all & ~left_out if window.governed else 0
    honest = _Lanes(flows.by_right(), window, kept)
    attacked = _Lanes(flows.lanes(Search(attacker=Attacker.RELAYS, source=Place(), target=Place())), window, kept)
    labels: list[str | None] = [*(enclave.label for enclave in system.enclaves), ANYBODY]
    found = []
    for node, enclave in enumerate(system.enclaves[:limit]):
        by_right = honest.received(node), honest.sent(node)
        with_keys = attacked.received(node), attacked.sent(node)
        incoming, outgoing = (
            (*_groups(rightly, labels, by_right=True), *_groups(_beyond(able, rightly), labels, by_right=False))
            for rightly, able in zip(by_right, with_keys, strict=True)
        )
        found.append(Neighbourhood(path=enclave.label, incoming=incoming, outgoing=outgoing))
    return tuple(found)


def _beyond(able: Mapping[int, int], rightly: Mapping[int, int]) -> dict[int, int]:
    return {peer: names & ~rightly.get(peer, 0) for peer, names in able.items() if names & ~rightly.get(peer, 0)}


class _Lanes:
    """Who puts what into the lanes of a flow and gets what out of them, in names of the window."""

    def __init__(self, lanes: Iterable[Lane], window: Window, kept: int) -> None:
        self._puts: dict[int, list[tuple[int, int]]] = {}
        self._gets: dict[int, list[tuple[int, int]]] = {}
        self._putting: list[list[tuple[int, int]]] = []
        self._getting: list[list[tuple[int, int]]] = []
        for number, lane in enumerate(lanes):
            self._putting.append(_there(lane.puts, window, kept))
            self._getting.append(_there(lane.gets, window, kept))
            for node, names in self._putting[-1]:
                self._puts.setdefault(node, []).append((number, names))
            for node, names in self._getting[-1]:
                self._gets.setdefault(node, []).append((number, names))

    def sent(self, node: int) -> dict[int, int]:
        """By receiver: the names on which it gets samples of `node`."""
        return _met(node, self._puts.get(node, ()), self._getting)

    def received(self, node: int) -> dict[int, int]:
        """By sender: the names on which `node` gets its samples."""
        return _met(node, self._gets.get(node, ()), self._putting)


def _there(sets: Sequence[int], window: Window, kept: int) -> list[tuple[int, int]]:
    windowed = ((node, window.of(channels) & kept) for node, channels in enumerate(sets) if channels)
    return [(node, names) for node, names in windowed if names]


def _met(node: int, own: Iterable[tuple[int, int]], others: Sequence[list[tuple[int, int]]]) -> dict[int, int]:
    met: dict[int, int] = {}
    for lane, names in own:
        for other, theirs in others[lane]:
            common = names & theirs
            if common and other != node:
                met[other] = met.get(other, 0) | common
    return met


def _groups(met: Mapping[int, int], labels: Sequence[str | None], *, by_right: bool) -> list[PeerGroup]:
    """Names with the same peers are of one group."""
    masks = gathered((names, peer) for peer, names in met.items())
    parts: dict[int, tuple[int, ...]] = {}
    for mask, peers in masks.items():  # splits the names known so far, and adds the new ones
        new = mask
        split: dict[int, tuple[int, ...]] = {}
        for names, known in parts.items():
            new &= ~names
            if names & mask:
                split[names & mask] = (*known, *peers)
            if names & ~mask:
                split[names & ~mask] = known
        if new:
            split[new] = tuple(peers)
        parts = split
    groups = [
        PeerGroup(peers=tuple(labels[peer] for peer in sorted(peers)), names=tuple(members(names)), by_right=by_right)
        for names, peers in parts.items()
    ]
    return sorted(groups, key=lambda group: (len(group.peers), group.names))
