"""Users' claims, decided natively over `keystore_audit.model` (docs/model.md, Claims)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from itertools import islice
from typing import Final, NamedTuple

from msgspec.structs import replace

from keystore_audit.engine.moments import changes
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place, Search, search_of
from keystore_audit.model.formal.attacker import TrustDomainView, trust_domain_views
from keystore_audit.model.formal.bit_sets import Abilities, bits, members, union
from keystore_audit.model.formal.fallen import Fall, falls
from keystore_audit.model.formal.flow import Flows, Leg
from keystore_audit.model.formal.permission import Decisions, Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.properties.result import Answer, Role, Status, Witness

Found = tuple[Witness, tuple[Leg, ...]]
"""What violates a claim: who plays which role, and the flow, where its kind has flows."""


class Claims:
    """The claims of one system at one moment. `trust_domains`: how peers in each see every enclave, then."""

    def __init__(self, system: System, trust_domains: Sequence[TrustDomainView]) -> None:
        self._system = system
        self._trust_domains = trust_domains
        self._flows = Flows(system, trust_domains)

    @cached_property
    def _insiders(self) -> list[int]:
        """Everybody but second certificates of enclaves' keys: enclaves are asked with all that their keys open."""
        system = self._system
        keys = {system.key_of(n) for n, enclave in enumerate(system.enclaves) if not enclave.unmanaged} - {None}
        return [n for n, enclave in enumerate(system.enclaves) if not enclave.unmanaged or system.key_of(n) not in keys]

    def violation(self, claim: ClaimAtom) -> Found | None:
        """What violates the claim, None where it holds."""
        return next(self.violations(claim), None)

    def violations(self, claim: ClaimAtom) -> Iterator[Found]:
        """All that violates the claim; of a flow, a shortest one alone."""
        return _KINDS[claim.kind](self, claim)

    def confirmed(self, claim: ClaimAtom, told: Answer, moment: int) -> Answer:
        """What another engine says of a claim that it found violated; UNKNOWN if its example violates nothing."""
        if claim.kind is ClaimKind.NO_FLOW:
            found = self.violation(claim)
            return _violated(found, moment) if found is not None else Answer(status=Status.UNKNOWN)
        shown = tuple(
            found
            for each in told.witnesses
            for found in islice((one for one, _legs in self.violations(claim) if each.items() <= one.items()), 1)
        )
        so = len(shown) == len(told.witnesses)
        return replace(told, witnesses=shown) if so else Answer(status=Status.UNKNOWN)

    def flows(self, claim: ClaimAtom) -> Iterator[Found]:
        """A shortest flow from source to target."""
        found = self._flows.shortest(search_of(claim))
        if found is not None:
            yield _ends(found), found

    def foreign_publishers(self, claim: ClaimAtom) -> Iterator[Found]:
        """Who else may write a channel of the target: enclaves, holders elsewhere, and anybody without a key."""
        asked = bits(claim.target.channels)
        for trust_domain, view in enumerate(self._trust_domains):
            for enclave in range(len(self._system.enclaves)):
                if enclave not in claim.source.enclaves:
                    for channel in members(_publishes(view.abilities(enclave)) & asked):
                        yield {Role.TRUST_DOMAIN: trust_domain, Role.ENCLAVE: enclave, Role.CHANNEL: channel}, ()
        for trust_domain, view in enumerate(self._trust_domains):
            for certificate, able in view.elsewhere.items():
                if certificate not in claim.source.certificates:
                    for channel in members(_publishes(able) & asked):
                        yield (
                            {Role.TRUST_DOMAIN: trust_domain, Role.CERTIFICATE: certificate, Role.CHANNEL: channel},
                            (),
                        )
            for witness in _nameless(trust_domain, view.joining_anybody, view.joining_known, asked):
                yield witness, ()

    def readings(self, claim: ClaimAtom) -> Iterator[Found]:
        """Channels of the target whose payload is read without a grant: by enclaves, holders elsewhere, or anybody."""
        asked, channels = bits(claim.target.channels), self._system.channels
        usual = bits(number for number in claim.target.channels if not channels[number].partition)
        found = self._by_insiders if claim.attacker is Attacker.INSIDER else self._by_outsiders
        for each in (usual, asked & ~usual):  # an example where the nodes of ROS 2 are is understood at once
            yield from ((witness, ()) for witness in found(each))

    def _by_outsiders(self, asked: int) -> Iterator[Witness]:
        """By outsiders. A topic that is named in a claim counts as written."""
        for trust_domain, view in enumerate(self._trust_domains):
            for channel in members(view.readable & asked):
                yield {Role.TRUST_DOMAIN: trust_domain, Role.CHANNEL: channel}

    def _by_insiders(self, asked: int) -> Iterator[Witness]:
        for trust_domain, view in enumerate(self._trust_domains):
            for enclave in self._insiders:
                learnt = union(view.abilities(each).knows for each in self._flows.acting(enclave))
                for channel in members(learnt & ~view.entitled(enclave) & asked):
                    yield {Role.TRUST_DOMAIN: trust_domain, Role.ENCLAVE: enclave, Role.CHANNEL: channel}
            for certificate, learnt in view.learnt_elsewhere.items():
                for channel in members(learnt & asked):
                    yield {Role.TRUST_DOMAIN: trust_domain, Role.CERTIFICATE: certificate, Role.CHANNEL: channel}
        for trust_domain, view in enumerate(self._trust_domains):
            yield from _nameless(trust_domain, view.readable, view.learnt_known, asked)

    def shared_domains(self, claim: ClaimAtom) -> Iterator[Found]:
        """Domains that an enclave of the source and one of the target can join, or the one can and the other starts in.

        An attacker accepts any peer there, and joins without its identity where anybody may. So each may join by a
        different trust domain, through peers that have nothing to do with the other.
        """
        joined = {
            enclave: [view.joined(enclave) | view.protection.unauthenticated for view in self._trust_domains]
            for enclave in claim.source.enclaves | claim.target.enclaves
        }
        alone: dict[int, int] = {}
        for enclave, domain in claim.starts:
            alone[enclave] = alone.get(enclave, 0) | 1 << domain
        somewhere = {enclave: union(domains) | alone.get(enclave, 0) for enclave, domains in joined.items()}
        for trust_domain in range(len(self._trust_domains)):
            for one in sorted(claim.source.enclaves):
                for other in sorted(claim.target.enclaves):
                    here = joined[one][trust_domain] | joined[other][trust_domain]
                    for domain in members(somewhere[one] & somewhere[other] & here):
                        roles = {
                            Role.TRUST_DOMAIN: trust_domain,
                            Role.ENCLAVE: one,
                            Role.OTHER: other,
                            Role.DOMAIN: domain,
                        }
                        yield roles, ()

    def inabilities(self, claim: ClaimAtom) -> Iterator[Found]:
        """Whether nothing gets from some source to some target while nobody attacks."""
        if next(self.cut_off(claim), None) is not None:
            yield {}, ()

    def cut_off(self, claim: ClaimAtom) -> Iterator[int]:
        """The pairs (by index) of a claim of ability between which nothing gets."""
        if not claim.pairs:
            if self._flows.shortest(search_of(claim)) is None:
                yield 0
            return
        put = self._flows.putters(self._flows.lanes(search_of(claim)))
        reached: dict[Place, frozenset[int]] = {}  # one search from each place
        for number, pair in enumerate(claim.each_pair()):
            if pair.source not in reached:
                reached[pair.source] = self._flows.reached(search_of(pair))
            found, asked = reached[pair.source], bits(pair.target.channels)
            ends = {*pair.target.enclaves, *([self._flows.outsider] if pair.target.outsider else [])}
            if not ends & found and not any(put[node] & asked for node in found if asked):
                yield number

    def ending(self, claim: ClaimAtom) -> frozenset[int]:
        """Enclaves that start now but not until the end of a claim of ability, where that alone violates it."""
        starting = replace(claim, through=claim.through - claim.stopping)
        return claim.stopping if self.violation(starting) is None else frozenset()


def _nameless(trust_domain: int, anybody: int, known: int, asked: int) -> Iterator[Witness]:
    """Of the channels asked about, those of anybody, and of any holder of an identity of the CA."""
    for channel in members((anybody | known) & asked):
        needs = int(not anybody >> channel & 1)
        yield {Role.TRUST_DOMAIN: trust_domain, Role.CHANNEL: channel, Role.WITH_IDENTITY: needs}


def _publishes(able: Abilities) -> int:
    """Channels on which readers take somebody's samples for those of a writer."""
    return able.may_write | able.unannounced


def _ends(path: Sequence[Leg]) -> Witness:
    """The enclaves at the ends of a flow."""
    ends = {Role.ENCLAVE: path[0].sender, Role.OTHER: path[-1].receiver}
    return {role: enclave for role, enclave in ends.items() if enclave is not None}


_KINDS: Mapping[ClaimKind, Callable[[Claims, ClaimAtom], Iterator[Found]]] = {
    ClaimKind.NO_FLOW: Claims.flows,
    ClaimKind.ONLY_PUBLISH: Claims.foreign_publishers,
    ClaimKind.ENCRYPTED: Claims.readings,
    ClaimKind.SEPARATE_DOMAINS: Claims.shared_domains,
    ClaimKind.ABLE: Claims.inabilities,
}


def claims_at(system: System, moment: int, decisions: Decisions) -> Claims:
    """The claims of the system at `moment`, as `permission.Permissions` takes one."""
    return Claims(system, trust_domain_views(system, Permissions(system, moment, decisions)))


def fallen(system: System, most: int, told: Iterable[frozenset[int]] | None = None) -> tuple[Fall, ...]:
    """By which smallest sets of `most` compromised participants the system's one claim is violated now.

    `told`: by another engine, of whose sets each gets its flow, which is empty where it has none.
    """
    flows, search = _who_falls(system)
    if told is None:
        return tuple(falls(flows, search, most))
    return tuple(Fall(each, flows.shortest(replace(search, compromised=each)) or ()) for each in told)


def first_fall(system: System, most: int) -> Fall | None:
    """The first of these sets, None where there is none; the others are not looked for."""
    return next(falls(*_who_falls(system), most), None)


def _who_falls(system: System) -> tuple[Flows, Search]:
    [claim] = system.claims
    return Flows(system, trust_domain_views(system)), search_of(claim)


def _violated(found: Found, moment: int) -> Answer:
    witness, legs = found
    return Answer(status=Status.VIOLATED, witnesses=(witness,), path=legs, moment=moment)


def answer(system: System, claim: ClaimAtom, now: Claims, moment: int, decisions: Decisions) -> Answer:
    """The answer about the claim from `moment` on, where `now` holds: violated if it is violated at any moment until
    its end.
    """
    last = moment if claim.until is None else 2 * claim.until
    for each in range(moment, max(moment, last) + 1):
        found = (now if each == moment else claims_at(system, each, decisions)).violation(claim)
        if found is not None:
            return _violated(found, each)
    return Answer(status=Status.HOLDS)


# Flows over time: what somebody got at one moment it may keep, and pass on at a later one (docs/model.md, Claims).
#
# Each engine decides each moment by itself. This is worked out natively alone, and only where no moment violates a
# claim that must hold until a date. So an answer about several moments is the native engine's alone.

MAX_AT_HAND: Final = 16
"""Moments whose flows are kept for the next claim; those of a large fleet take some ten megabytes each."""


class Stage(NamedTuple):
    """The hops of a flow that are taken at one moment (as `Permissions` takes it)."""

    moment: int
    legs: tuple[Leg, ...]


class KeptFlows:
    """Flows of one system from the audit on, over moments in order."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._decisions = Decisions(system)
        self._flows = lru_cache(MAX_AT_HAND)(self._flows_at)

    def flow(self, claim: ClaimAtom) -> tuple[Stage, ...] | None:
        """A flow that the claim excludes, over any number of moments until the claim's end; None: there is none."""
        if claim.kind is not ClaimKind.NO_FLOW or claim.until is None:
            return None
        search, kept = search_of(claim), list[frozenset[int]]()
        moments = [*changes(self._system, claim.until)]
        keeping: frozenset[int] = frozenset()
        for moment in moments:
            kept.append(keeping)
            stages = self._stages(search, moments, kept)
            if stages is not None:
                return stages
            keeping = self._flows(moment).reached(replace(search, keeping=keeping))
        return None

    def looks_beyond(self, claim: ClaimAtom) -> bool:
        """Whether there are several moments until the claim's end, so that single moments do not decide it."""
        return claim.until is not None and len([*changes(self._system, claim.until)]) > 1

    def takes_time(self, claim: ClaimAtom) -> bool:
        """Whether there is such a flow, but none as early within one moment."""
        return len(self.flow(claim) or ()) > 1

    def _stages(
        self, search: Search, moments: Sequence[int], kept: Sequence[frozenset[int]]
    ) -> tuple[Stage, ...] | None:
        """A flow that ends at the last moment in `kept` (who had what); within that moment alone if possible."""
        moment = moments[len(kept) - 1]
        flows = self._flows(moment)
        alone = flows.shortest(search)
        if alone is not None:
            return (Stage(moment, alone),)
        legs = flows.shortest(replace(search, keeping=kept[-1])) if kept[-1] else None
        if legs is None:
            return None
        begun = legs[0].sender
        holder = Place(outsider=True) if begun is None else Place(enclaves=frozenset({begun}))
        [node] = flows.nodes(holder)
        first = next(place for place, keeping in enumerate(kept) if node in keeping)
        before = self._stages(replace(search, target=holder), moments, kept[:first])
        if before is None:
            raise AssertionError("what was kept came from nowhere")
        return (*before, Stage(moment, legs))

    def _flows_at(self, moment: int) -> Flows:
        permissions = Permissions(self._system, moment, self._decisions)
        return Flows(self._system, trust_domain_views(self._system, permissions))
