"""Who can reach whom: all pairs of participants at once, where `flow` answers about two places (docs/model.md).

Sets of participants are bit sets, so a search takes whole sets in one step and leaves every participant once. Ten
thousand that all reach each other cost no more than ten thousand that reach nobody.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Final

from keystore_audit.model.formal.bit_sets import lowest, members, union
from keystore_audit.model.formal.flow import Lane


class Influence:
    """Hops and flows between the participants of some lanes, which are equally many in each.

    `hops`: by sender the receivers, itself perhaps among them.
    """

    def __init__(self, lanes: Sequence[Lane], participants: int) -> None:
        self._lanes = lanes
        self._all = (1 << participants) - 1
        self._number = participants
        self._getting = [_Holders(lane.gets, union(lane.puts)) for lane in lanes]
        self._known: list[dict[int, int]] = [{} for _ in lanes]
        self.hops = [self.receivers(sender, -1) for sender in range(participants)]

    def receivers(self, sender: int, channels: int) -> int:
        """Who gets samples of these channels from the sender, itself perhaps among them."""
        found = 0
        for lane, getting, known in zip(self._lanes, self._getting, self._known, strict=True):
            put = lane.puts[sender] & channels
            if put not in known:
                known[put] = getting.of(put)
            found |= known[put]
        return found

    @cached_property
    def flows(self) -> list[int]:
        """By participant: itself, and all that are reached from it."""
        components = list(self._components())
        component_of = {node: number for number, nodes in enumerate(components) for node in members(nodes)}
        reached = [0] * len(components)
        for number in range(len(components) - 1, -1, -1):  # those that it reaches come after it
            within = components[number]
            left = 0
            for node in members(within):
                left |= self.hops[node]
            found = within
            left &= ~found
            while left:
                found |= reached[component_of[lowest(left)]]
                left &= ~found
            reached[number] = found
        return [reached[component_of[node]] for node in range(self._number)]

    def _components(self) -> Iterator[int]:
        """Sets of participants that all reach each other, from sources to sinks (Kosaraju's algorithm)."""
        backward = Influence([Lane(puts=lane.gets, gets=lane.puts) for lane in self._lanes], self._number).hops
        left = self._all
        for root in reversed(self._finished()):
            if not left >> root & 1:
                continue
            found, edge = 0, 1 << root
            while edge:
                left &= ~edge
                found |= edge
                ahead = 0
                for node in members(edge):
                    ahead |= backward[node]
                edge = ahead & left
            yield found

    def _finished(self) -> list[int]:
        """Participants in the order in which a search in depth is done with them."""
        order: list[int] = []
        left = self._all
        while left:
            way = [lowest(left)]
            left &= left - 1
            while way:
                ahead = self.hops[way[-1]] & left
                if ahead:
                    way.append(lowest(ahead))
                    left &= ~(1 << way[-1])
                else:
                    order.append(way.pop())
        return order


_FEW_SETS: Final = 64
"""Different sets of channels up to which each is compared as a whole. Beyond it who has each channel is looked up."""


class _Holders:
    """Who has which channels; of those that nobody puts anything in, nothing is kept."""

    def __init__(self, sets: Sequence[int], channels: int) -> None:
        alike: dict[int, int] = {}
        for holder, each in enumerate(sets):
            alike[each & channels] = alike.get(each & channels, 0) | 1 << holder
        self._sets = list(alike.items())
        self._by_channel: dict[int, int] | None = None
        if len(alike) > _FEW_SETS:
            self._by_channel = {}
            for each, holders in self._sets:
                for channel in members(each):
                    self._by_channel[channel] = self._by_channel.get(channel, 0) | holders

    def of(self, channels: int) -> int:
        """Who has some of the channels."""
        if self._by_channel is None:
            return union(holders for each, holders in self._sets if each & channels)
        by_channel = self._by_channel
        return union(by_channel.get(channel, 0) for channel in members(channels))
