"""How many may fall: which participants, compromised together, let something through (docs/model.md).

Compromised participants attack as relays do; all others are honest. More attackers never remove a flow, so the smallest
sets say it all.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.formal.asked import Attacker, Search
from keystore_audit.model.formal.bit_sets import bits, union
from keystore_audit.model.formal.flow import Flows, Leg

MAX_WORK: Final = 1_000_000
"""Sets that are tried, times pairs of a trust domain and a participant: half a minute."""


class Fall(NamedTuple):
    """A smallest set of participants that together let something through, and a shortest flow then."""

    fallen: frozenset[int]
    legs: tuple[Leg, ...]


def falls(flows: Flows, search: Search, most: int) -> Iterator[Fall]:
    """All smallest sets of at most `most` participants, in order of size.

    A set grows only by those at the border of what it reaches: without one of them nothing gets any further.
    Raises errors.BudgetExceeded where there is too much to try.
    """
    found: list[frozenset[int]] = []
    edge, work = [frozenset[int]()], 0
    for size in range(most + 1):
        wider: set[frozenset[int]] = set()
        for fallen in edge:
            if any(each <= fallen for each in found):
                continue
            work += flows.size
            if work > MAX_WORK:
                raise BudgetExceeded(f"Sets of up to {most} compromised enclaves are too many to try: ask for fewer.")
            asked = replace(search, compromised=fallen)
            legs = flows.shortest(asked)
            if legs is not None:
                found.append(fallen)
                yield Fall(fallen, legs)
            elif size < most:
                wider.update(fallen | {each} for each in _border(flows, asked))
        edge = sorted(wider, key=sorted)


def _border(flows: Flows, search: Search) -> set[int]:
    """Who, if everybody attacks, sends or gets on a hop that leads out of what is reached, or is at an end."""
    lanes = flows.lanes(replace(search, attacker=Attacker.RELAYS))
    first, last, usable = bits(search.source.channels), bits(search.target.channels), ~bits(search.left_out)
    inside = flows.reached(search) - {flows.outsider}
    outside = {*range(flows.outsider + 1)} - inside | flows.nodes(search.target)
    got, put = flows.getters(lanes), flows.putters(lanes)
    found = {node for node in outside if got[node] & first} | {node for node in inside if put[node] & last}
    for lane in lanes:
        sent = union(lane.puts[node] for node in inside) & usable
        taken = union(lane.gets[node] for node in outside) & usable
        found |= {node for node in inside if lane.puts[node] & taken}
        found |= {node for node in outside if lane.gets[node] & sent}
    return found - search.compromised - {flows.outsider}
