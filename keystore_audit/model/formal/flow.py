"""Information flow: whether, and how, what starts at one place may arrive at another (docs/model.md).

Breadth-first search from participants over sets of channels and back, never over pairs of enclaves. A *lane* is one
way of hops: participant e hands a sample of channel c to another, f. For this e must put c into the lane, and f must
get c out of it. Sets of channels are bit sets; the outsider is the participant after the last enclave.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set
from functools import cache, cached_property, lru_cache
from operator import attrgetter, itemgetter
from typing import Final, NamedTuple

from msgspec.structs import replace

from keystore_audit.model.formal.asked import Attacker, Place, Search
from keystore_audit.model.formal.attacker import TrustDomainView
from keystore_audit.model.formal.bit_sets import Abilities, bits, members, union
from keystore_audit.model.formal.rights import OwnRights
from keystore_audit.model.formal.system import System, easiest

MAX_AT_HAND: Final = 8
"""Attackers whose lanes are kept for the next search."""


class Leg(NamedTuple):
    """One hop of a flow. None: the outsider, or, at the ends, that the flow begins or ends at the channel itself."""

    sender: int | None
    channel: int
    receiver: int | None


class Lane:
    """One way in which hops are possible: what each participant puts in and gets out.

    `heard`: the receivers only listen, so no flow ends where something is put. `lured`: they receive from attackers
    alone, so no flow begins where something is got.
    """

    def __init__(self, puts: Sequence[int], gets: Sequence[int], *, heard: bool = False, lured: bool = False) -> None:
        self.puts = puts
        self.gets = gets
        self.heard = heard
        self.lured = lured

    @cached_property
    def _levels(self) -> list[Sequence[int]]:
        """The union of what participants get, of pairs of them, of fours …, so that few are looked at."""
        levels = [self.gets]
        while len(levels[-1]) > 1:
            below = levels[-1]
            above = [one | other for one, other in zip(below[::2], below[1::2], strict=False)]
            levels.append(above if len(below) % 2 == 0 else [*above, below[-1]])
        return levels

    def getting(self, channels: int) -> list[int]:
        """The participants that get one of the channels."""
        places = [0]
        for level in range(len(self._levels) - 1, -1, -1):
            sets = self._levels[level]
            places = [place for place in places if place < len(sets) and sets[place] & channels]
            if level:
                places = [below for place in places for below in (2 * place, 2 * place + 1)]
        return places


class Flows:
    """Flows of one system at one moment. `trust_domains`: how peers in each see every enclave, then."""

    def __init__(self, system: System, trust_domains: Sequence[TrustDomainView]) -> None:
        self._system = system
        self._trust_domains = trust_domains
        self._member = [enclave.trust_domain for enclave in system.enclaves]
        self.outsider = len(system.enclaves)
        self.rightful = cache(self.by_right)
        self._powers = cache(self._powers_in)
        self._attacked = lru_cache(MAX_AT_HAND)(self._attacked_by)

    def shortest(self, search: Search) -> tuple[Leg, ...] | None:
        """A shortest flow, None where there is none."""
        return _Walk(self, self._system, search).shortest()

    def reached(self, search: Search) -> frozenset[int]:
        """The participants that data gets to from the source, the source's enclaves among them, whatever the target."""
        return _Walk(self, self._system, replace(search, target=Place())).reached()

    @property
    def size(self) -> int:
        """How much one search looks at: pairs of a trust domain and a participant."""
        return len(self._trust_domains) * (self.outsider + 1)

    def nodes(self, place: Place) -> set[int]:
        """The participants of a place."""
        return {*place.enclaves, *([self.outsider] if place.outsider else [])}

    def lanes(self, search: Search) -> list[Lane]:
        """The ways in which hops are possible under the attacker."""
        if search.own:
            return self.rightful(own=True)
        if search.attacker is Attacker.RELAYS:
            everybody = frozenset(range(self.outsider + 1))
            return self._attacked(everybody, everybody)
        alone = search.attacker is Attacker.SOURCE
        forging = frozenset(self.nodes(search.source)) if alone else search.compromised
        return [*self.rightful(own=False), *self._attacked(forging, search.compromised | {self.outsider})]

    def by_right(self, *, own: bool = False, among: Collection[int] | None = None) -> list[Lane]:
        """By trust domain of sender and receiver: what is written and read by right on both sides, `among` these."""
        rights = [each.abilities for each in self._own] if own else [each.honest for each in self._trust_domains]
        everybody = range(len(self._system.enclaves))
        among = everybody if among is None else among
        used = sorted(set(self._member))
        # Where implementations differ, a reader's own may let it read what those like it would not concede it.
        alone = self._system.mixed and not own
        reads = attrgetter("reads_at_all" if alone else "may_read")
        lanes = []
        for there in range(len(rights)):
            written = [rights[there](e).may_write & self._lets[e] if e in among else 0 for e in everybody]
            read = [reads(rights[there](e)) if self._member[e] == there and e in among else 0 for e in everybody]
            if alone:
                lanes.append(Lane([0] * (self.outsider + 1), [*read, 0]))
            for here in used:
                if own and not self._system.trust_domains[here].talks_to(self._system.trust_domains[there]):
                    continue
                sent, shared = written, read
                if here != there or alone:
                    shared = [one and one & rights[here](e).may_read for e, one in enumerate(read)]
                    if own:
                        sent = [one and one & rights[here](e).may_write for e, one in enumerate(written)]
                if len(used) > 1:
                    sent = [one if self._member[e] == here else 0 for e, one in enumerate(sent)]
                lanes.append(Lane([*sent, 0], [*shared, 0]))
        return lanes

    @cached_property
    def _lets(self) -> list[int]:
        """By enclave: what its own implementation may let it write. Peers' views say it, unless the fleet is mixed."""
        own = [self._trust_domains[member] for member in self._member]
        return [view.written_as_itself(e) if self._system.mixed else -1 for e, view in enumerate(own)]

    def _attacked_by(self, forging: frozenset[int], listening: frozenset[int]) -> list[Lane]:
        """Forgers send and listeners receive as anybody whose key they have, with all that keys allow.

        What is made so is on the network for every listener, as is what is written by right. All others are honest:
        they take what is made, and do not hide what their governance leaves in clear.
        """
        lanes = []
        for trust_domain, view in enumerate(self._trust_domains):
            makes, airs, hears, learns = self._powers(trust_domain)
            made, learnt = _of(forging, makes), _of(listening, learns)
            if forging:
                lanes.append(Lane(made, _of(listening, hears)))
                lanes.append(Lane(_of(forging, airs), learnt, heard=listening == {self.outsider}))
            if len(forging) <= self.outsider:
                written = [view.honest(e).writes_at_all & lets for e, lets in enumerate(self._lets)]
                lanes.append(Lane(made, [*self._of_members(trust_domain, view.honest), 0], lured=True))
                lanes.append(Lane([*written, 0], learnt, heard=True))
        return lanes

    def _powers_in(self, trust_domain: int) -> tuple[Sequence[int], ...]:
        """By participant in a trust domain, if it attacks: what it makes, exposes, hears as a reader, and learns."""
        view = self._trust_domains[trust_domain]
        makes = self._joined(self.as_any([self._forged(view, e) for e in range(self.outsider)]), view.injectable)
        shows = [*self.as_any([able.writes_at_all for able in view.everybody()]), 0]
        return (
            makes,
            [one | other for one, other in zip(makes, shows, strict=True)],
            [*self.as_any(self._of_members(trust_domain, view.abilities)), 0],
            self._joined(self.as_any([able.knows for able in view.everybody()]), view.readable),
        )

    @staticmethod
    def _joined(enclaves: Sequence[int], anybody: int) -> list[int]:
        """By participant: what attacking enclaves can do, and what anybody can: a key only adds to that."""
        return [*(one | anybody for one in enclaves), anybody]

    @cached_property
    def readable(self) -> int:
        """Channels that some trust domain leaves in clear."""
        return union(view.readable for view in self._trust_domains)

    @cached_property
    def injectable(self) -> int:
        """Channels on which readers of some trust domain take samples from anybody."""
        return union(view.injectable for view in self._trust_domains)

    def _of_members(self, trust_domain: int, able: Callable[[int], Abilities]) -> list[int]:
        """By enclave: the channels that it reads if the writer gives its keys to anybody."""
        return [able(e).reads_at_all if m == trust_domain else 0 for e, m in enumerate(self._member)]

    @cached_property
    def _own(self) -> list[OwnRights]:
        """By trust domain: what enclaves may do that use only their own permissions documents."""
        return [OwnRights(self._system, view, view.refuses) for view in self._trust_domains]

    @staticmethod
    def _forged(view: TrustDomainView, enclave: int) -> int:
        """Channels on which members of the trust domain take its samples for those of some writer."""
        able = view.abilities(enclave)
        return able.may_write | able.forges if able.forges else able.may_write

    @cached_property
    def _opaque(self) -> list[int]:
        return [number for number in range(self.outsider) if self._system.anybody(number)]

    @cached_property
    def _holders(self) -> dict[int, list[int]]:
        """By key: the enclaves that have it."""
        return self._system.holders()

    def acting(self, enclave: int) -> Iterable[int]:
        """The enclaves whose key the enclave has, or may have."""
        if self._system.anybody(enclave):
            return range(self.outsider)
        key = self._system.key_of(enclave)
        return [*([enclave] if key is None else self._holders[key]), *self._opaque]

    def as_any(self, sets: Sequence[int]) -> list[int]:
        """For each enclave, the union of the sets of those as which it can act."""
        doubtful = union(sets[enclave] for enclave in self._opaque)
        joint = [one | doubtful for one in sets] if doubtful else [*sets]
        for group in self._holders.values():
            if len(group) > 1:
                together = doubtful | union(sets[enclave] for enclave in group)
                for enclave in group:
                    joint[enclave] = together
        everything = union(sets) if self._opaque else 0
        for enclave in self._opaque:
            joint[enclave] = everything
        return joint

    def putters(self, lanes: Iterable[Lane]) -> list[int]:
        """By participant: the channels on which it can put samples for more than listeners."""
        return self._over([lane.puts for lane in lanes if not lane.heard])

    def getters(self, lanes: Iterable[Lane]) -> list[int]:
        """By participant: the channels of which it gets samples, whoever writes them."""
        return self._over([lane.gets for lane in lanes if not lane.lured])

    def _over(self, sets: Iterable[Sequence[int]]) -> list[int]:
        """By participant: the union over lanes."""
        return [union(each) for each in zip([0] * (self.outsider + 1), *sets, strict=True)]


def _of(attacking: Set[int], sets: Sequence[int]) -> list[int]:
    """By participant: its set if it attacks."""
    return [one if node in attacking else 0 for node, one in enumerate(sets)]


class _Walk:
    """One search, layer by layer: those that a sample reaches after so many hops."""

    def __init__(self, flows: Flows, system: System, search: Search) -> None:
        self._flows = flows
        self._search = search
        self._channels = system.channels
        self._left_out = bits(search.left_out)
        self._lanes = flows.lanes(search)
        self._seen = [0] * len(self._lanes)
        self._ends = flows.nodes(search.target)
        self._layers: list[list[int]] = []

    def shortest(self) -> tuple[Leg, ...] | None:
        """The flow."""
        source = self._search.source
        if source.channels:
            return self._from_channels(bits(source.channels))
        first = sorted({*self._flows.nodes(source), *self._search.keeping})
        return self._spread(first, looping=self._ends.intersection(first))

    def reached(self) -> frozenset[int]:
        """All that are reached, where there is no target."""
        self.shortest()
        return frozenset(node for layer in self._layers for node in layer)

    def _from_channels(self, channels: int) -> tuple[Leg, ...] | None:
        """The flow from somebody who gets a sample of one of them."""
        got = self._flows.getters(self._lanes)
        getting = [node for node, each in enumerate(got) if each & channels]
        for node in getting:
            if node in self._ends:
                return (Leg(None, self._one(got[node] & channels), self._name(node)),)
        first = [node for node in getting if node not in self._search.through]
        found = self._spread(sorted({*first, *self._search.keeping}), looping=set())
        if found is None:
            return None
        begun = self._flows.outsider if found[0].sender is None else found[0].sender
        if begun not in getting:
            return found
        return (Leg(None, self._one(got[begun] & channels), self._name(begun)), *found)

    def _spread(self, first: list[int], looping: set[int]) -> tuple[Leg, ...] | None:
        """Goes on from the participants `first`. `looping`: those among them that are ends, which others must reach."""
        asked = bits(self._search.target.channels)
        put = self._flows.putters(self._lanes) if asked else []
        active = set(first)
        layer = first
        while layer:
            self._layers.append(layer)
            putting = [node for node in layer if put[node] & asked] if asked else []
            if putting:
                node, legs = self._back(putting)
                return (*legs, Leg(self._name(node), self._one(put[node] & asked), None))
            arrived, looped = self._next(layer, looping)
            ends = sorted((self._ends & arrived) - active | looped)
            if ends:
                self._layers.append(ends)
                return self._back(ends)[1]
            layer = sorted(arrived - active - self._search.through)
            active.update(layer)
        return None

    def _next(self, layer: Sequence[int], looping: Collection[int]) -> tuple[set[int], set[int]]:
        """Whom the layer reaches over channels that nobody used before, and which of `looping` it reaches."""
        arrived: set[int] = set()
        looped: set[int] = set()
        within = set(layer)
        for number, lane in enumerate(self._lanes):
            once, twice = 0, 0
            for node in layer:
                sent = lane.puts[node]
                if looping:
                    twice |= once & sent
                once |= sent
            once &= ~self._left_out
            for node in looping:
                others = once & (twice | ~lane.puts[node]) if node in within else once
                if others & lane.gets[node]:
                    looped.add(node)
            arrived.update(lane.getting(once & ~self._seen[number]))
            self._seen[number] |= once
        return arrived, looped

    def _back(self, ends: Iterable[int]) -> tuple[int, tuple[Leg, ...]]:
        """One end in the last layer, and the hops to it: of equally short flows, the one with the fewest attacks."""
        ways = [set(ends)]
        for layer in reversed(self._layers[:-1]):
            ways.append({sender for sender in layer if any(self._hop(sender, node) for node in ways[-1])})
        best: dict[int, tuple[int, tuple[Leg, ...]]] = dict.fromkeys(sorted(ways[-1]), (0, ()))
        for receivers in reversed(ways[:-1]):
            best = {node: self._best(best, node) for node in sorted(receivers)}
        end = min(best, key=lambda node: best[node][0])
        return end, best[end][1]

    def _best(self, best: Mapping[int, tuple[int, tuple[Leg, ...]]], node: int) -> tuple[int, tuple[Leg, ...]]:
        """The hops to `node`, and how many of them are attacks, from those to each predecessor."""
        hops = ((attacks, legs, sender, self._hop(sender, node)) for sender, (attacks, legs) in best.items())
        found = [(attacks + hop[0], legs, sender, hop[1]) for attacks, legs, sender, hop in hops if hop]
        attacks, legs, sender, channels = min(found, key=itemgetter(0))
        return attacks, (*legs, Leg(self._name(sender), self._one(channels), self._name(node)))

    def _hop(self, sender: int, node: int) -> tuple[int, int] | None:
        """Whether it takes an attack to hand a sample over, and on which channels; None: it is impossible.

        Of those, where the sender alone attacks, if there are such.
        """
        if sender != node:
            rightful = self._flows.rightful(own=self._search.own)
            for attack, lanes in enumerate((rightful, self._lanes)):
                common = union(lane.puts[sender] & lane.gets[node] for lane in lanes) & ~self._left_out
                if common:
                    return attack, common & union(lane.gets[node] for lane in rightful) or common
        return None

    def _one(self, channels: int) -> int:
        return easiest(self._channels, members(channels))

    def _name(self, node: int) -> int | None:
        return None if node == self._flows.outsider else node
