"""Flows and claims by enumeration, as docs/model.md words them: slow, and independent of both engines' ways.

What an enclave may do in a trust domain comes from `model.formal.attacker`, which the properties test; all from there
on is counted out here, participant by participant, with Python sets.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

from msgspec import Struct

from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind
from keystore_audit.model.formal.attacker import TrustDomainView
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from tests.engine.strangers_by_hand import published_elsewhere, read_elsewhere

OUTSIDER = -1
"""The participant without a key, beside the indices of enclaves."""


class Powers(Struct, frozen=True, dict=True):
    """Sets of channels of an enclave in a trust domain."""

    writes: frozenset[int]
    reads: frozenset[int]
    overhears: frozenset[int]
    forges: frozenset[int]
    publishes: frozenset[int]
    joins: frozenset[int]

    honest_writes: frozenset[int]
    honest_reads: frozenset[int]

    def learns(self) -> frozenset[int]:
        return self.reads | self.overhears


class ByHand:
    """One system at one moment (as `Permissions` takes it)."""

    def __init__(self, system: System, moment: int | None = None) -> None:
        self.system = system
        self.permissions = Permissions(system, moment)
        self.views = [
            TrustDomainView(system, trust_domain, self.permissions) for trust_domain in range(len(system.trust_domains))
        ]
        self.enclaves = range(len(system.enclaves))
        self._powers: dict[tuple[int, int], Powers] = {}

    def powers(self, enclave: int, trust_domain: int) -> Powers:
        if (enclave, trust_domain) not in self._powers:
            self._powers[enclave, trust_domain] = self._work_out(enclave, trust_domain)
        return self._powers[enclave, trust_domain]

    def _work_out(self, enclave: int, trust_domain: int) -> Powers:
        view = self.views[trust_domain]
        able = view.abilities(enclave)
        joined = view.joined(enclave) & view.protection.ruled if not view.open else view.joined(enclave)
        within = frozenset(c for c, atom in enumerate(self.system.channels) if joined >> atom.domain & 1)
        granted = frozenset(members(view.granted(enclave, Operation.PUBLISH) & view.protection.governed))
        return Powers(
            writes=frozenset(members(able.may_write)),
            reads=frozenset(members(able.may_read)),
            overhears=frozenset(members(able.overhears)),
            forges=frozenset(members(able.forges)),
            publishes=frozenset(members(able.may_write)) | (granted & within),
            joins=frozenset(members(joined)),
            honest_writes=self._honestly(enclave, trust_domain, Operation.PUBLISH) & frozenset(members(able.may_write)),
            honest_reads=self._honestly(enclave, trust_domain, Operation.SUBSCRIBE) & frozenset(members(able.may_read)),
        )

    def _honestly(self, enclave: int, trust_domain: int, operation: Operation) -> frozenset[int]:
        """As itself, by what documents grant it that are there, wherever it may be a participant by them."""
        view, atom, s, p = (
            self.views[trust_domain],
            self.system.enclaves[enclave],
            self.system,
            self.views[trust_domain].protection,
        )
        if not view.authenticated(enclave):
            return frozenset()
        if atom.opaque or any(document.opaque for document in s.documents):
            return frozenset(range(len(s.channels)))
        admitting = self.permissions.admitting(atom.identity, view.accepted)
        let_in = admitting or not view.reading.requires_grant
        controlled = p.write_controlled if operation is Operation.PUBLISH else p.read_controlled
        allowed = {
            met
            for grant in self.permissions.chosen(atom.identity, view.accepted)
            for channel in members(self.permissions.allowed(grant, operation))
            for met in (channel, *(s.meets[channel] if s.meets else ()))
        }
        return frozenset(
            number
            for number, channel in enumerate(s.channels)
            if (number in allowed or not controlled >> number & 1)
            and (
                (let_in and not p.join_controlled >> channel.domain & 1)
                or any(self.permissions.joins(grant) >> channel.domain & 1 for grant in admitting)
            )
        )

    def own_powers(self, enclave: int, trust_domain: int) -> tuple[frozenset[int], frozenset[int]]:
        """What it writes and reads by its own document alone, as peers of the trust domain see it."""
        view, atom, s = self.views[trust_domain], self.system.enclaves[enclave], self.system
        own = atom.permissions & view.accepted
        grants = self.permissions.chosen(atom.identity, own)
        unread = atom.opaque or any(s.documents[each].opaque for each in atom.permissions)
        p = view.protection
        joined = 0
        if atom.identity in s.trust_domains[trust_domain].refuses:
            return frozenset(), frozenset()
        if view.open:
            joined = self.permissions.all_domains
        elif view.authenticated(enclave):
            if unread:
                joined = p.ruled
            else:
                named = [n for n, each in enumerate(s.grants) if each.document in own and atom.identity in each.names]
                admitting = {*grants, *(named[:1] if view.reading.joins_out_of_date else ())}
                if admitting or not view.reading.requires_grant:
                    joined = p.ruled & ~p.join_controlled
                for grant in admitting:
                    joined |= p.ruled & self.permissions.joins(grant)

        def right(operation: Operation, controlled: int) -> frozenset[int]:
            found = set()
            for channel in members(p.governed):
                if not joined >> s.channels[channel].domain & 1:
                    continue
                allowed = any(self.permissions.allowed(grant, operation) >> channel & 1 for grant in grants)
                if unread or allowed or not controlled >> channel & 1:
                    found.add(channel)
            return frozenset(found)

        written = right(Operation.PUBLISH, p.write_controlled) - atom.refused_writes
        return written, right(Operation.SUBSCRIBE, p.read_controlled) - atom.refused_reads

    def acts_as(self, enclave: int) -> set[int]:
        atoms, certificates = self.system.enclaves, self.system.certificates
        one = atoms[enclave]
        if one.opaque:
            return set(self.enclaves)
        key = None if one.identity is None else certificates[one.identity].key
        return {
            f
            for f in self.enclaves
            if f == enclave
            or atoms[f].opaque
            or (key is not None and (i := atoms[f].identity) is not None and certificates[i].key == key)
        }

    def written_alone(self, enclave: int, trust_domain: int) -> frozenset[int]:
        atom = self.system.enclaves[enclave]
        return atom.writes_alone if atom.trust_domain == trust_domain else frozenset()

    def in_clear(self, trust_domain: int) -> frozenset[int]:
        p = self.views[trust_domain].protection
        return frozenset(members(p.governed & ~(p.rtps_encrypts | p.metadata_encrypts | p.data_encrypts)))

    def lets_anybody_in(self, trust_domain: int) -> frozenset[int]:
        return frozenset(members(self.views[trust_domain].protection.unauthenticated))

    def unguarded(self, trust_domain: int) -> frozenset[int]:
        p, found = self.views[trust_domain].protection, set()
        for channel in members(p.governed):
            lets_in = p.unauthenticated >> self.system.channels[channel].domain & 1
            inside = (p.metadata_authenticates | p.data_authenticates) >> channel & 1
            if not inside and (lets_in or not p.rtps_authenticates >> channel & 1):
                found.add(channel)
        return frozenset(found)


class Flow:
    """The flows of one claim. `fallen`: enclaves that attack as relays do, where all others are honest."""

    def __init__(self, hand: ByHand, claim: ClaimAtom, fallen: frozenset[int] = frozenset()) -> None:
        self.hand, self.claim = hand, claim
        self.trust_domains = range(len(hand.system.trust_domains))
        self.able = claim.kind is ClaimKind.ABLE
        self.relays = claim.attacker is Attacker.RELAYS and not self.able
        everybody = set(hand.enclaves) | {OUTSIDER}
        self.source = set(claim.source.enclaves) | ({OUTSIDER} if claim.source.outsider else set())
        self.target = set(claim.target.enclaves) | ({OUTSIDER} if claim.target.outsider else set())
        self.forgers = everybody if self.relays else set(fallen)
        self.listening = set(hand.enclaves) if self.relays else set(fallen)
        if claim.attacker is Attacker.SOURCE and not self.able:
            self.forgers = self.source

    def writes(self, enclave: int, trust_domain: int, *, attacks: bool = False) -> frozenset[int]:
        if self.able:
            return self.hand.own_powers(enclave, trust_domain)[0]
        powers = self.hand.powers(enclave, trust_domain)
        return powers.writes if self.relays or attacks else powers.honest_writes & self.own(enclave)

    @cached_property
    def mixed(self) -> bool:
        return len({each.reading for each in self.hand.system.trust_domains}) > 1

    def takes(self, enclave: int, *, attacks: bool = False) -> frozenset[int]:
        """What it reads as its own trust domain says, and where others are, as its own implementation says."""
        alone = self.hand.system.enclaves[enclave].reads_alone if self.mixed and not self.able else frozenset()
        return self.reads(enclave, self.member(enclave), attacks=attacks) | alone

    def own(self, enclave: int) -> frozenset[int]:
        """What its own implementation may let it write; all where it is that of every peer."""
        s, view = self.hand.system, self.hand.views[self.member(enclave)]
        channels = frozenset(range(len(s.channels)))
        if not self.mixed or s.enclaves[enclave].opaque or s.anything_granted:
            return channels
        documents = [n for n in view.accepted if n in view.documents]
        grants = self.hand.permissions.chosen(s.enclaves[enclave].identity, frozenset(documents))
        right = {c for grant in grants for c in members(self.hand.permissions.allowed(grant, Operation.PUBLISH))}
        right |= {met for c in right for met in (s.meets[c] if s.meets else ())}
        free = members(view.protection.governed & ~view.protection.write_controlled)
        return frozenset(right) | frozenset(free) | self.hand.written_alone(enclave, self.member(enclave))

    def reads(self, enclave: int, trust_domain: int, *, attacks: bool = False) -> frozenset[int]:
        if self.able:
            return self.hand.own_powers(enclave, trust_domain)[1]
        powers = self.hand.powers(enclave, trust_domain)
        return powers.reads if self.relays or attacks else powers.honest_reads

    def member(self, enclave: int) -> int:
        return self.hand.system.enclaves[enclave].trust_domain

    def imposes(self, holder: int, trust_domain: int) -> set[int]:
        """Channels on which an attacker has its samples taken in the trust domain."""
        if holder not in self.forgers:
            return set()
        found = set(self.hand.unguarded(trust_domain))  # as anybody on the network
        for guise in self.hand.acts_as(holder) if holder != OUTSIDER else ():
            powers = self.hand.powers(guise, trust_domain)
            found |= powers.writes | powers.forges
        return found

    @cached_property
    def hops(self) -> set[tuple[int, int, int]]:
        """(sender, channel, receiver)."""
        return {(e, c, f) for e, c, f in self._hops() if e != f and c not in self.claim.left_out}

    def _hops(self) -> Iterator[tuple[int, int, int]]:
        for f in self.hand.enclaves:
            yield from self._by_right(f)
            yield from self._imposed(f)
        if not self.able:
            for trust_domain in self.trust_domains:
                yield from self._intercepted(trust_domain)

    @cached_property
    def rightful(self) -> set[tuple[int, int]]:
        """Sender and receiver of hops by right."""
        left_out = self.claim.left_out
        return {(e, f) for g in self.hand.enclaves for e, c, f in self._by_right(g) if e != f and c not in left_out}

    def _by_right(self, f: int) -> Iterator[tuple[int, int, int]]:
        home = self.member(f)
        for e in self.hand.enclaves:
            there = self.member(e)
            if self.able and self.strangers(there, home):
                continue
            written = self.writes(e, home) & self.writes(e, there) if self.able else self.writes(e, home)
            for c in written & self.takes(f) & self.reads(f, there):
                yield e, c, f

    def strangers(self, one: int, other: int) -> bool:
        """Whether members of the two trust domains refuse each other for what they tell of their permissions CAs."""
        told = {self.hand.system.trust_domains[trust_domain].told for trust_domain in (one, other)} - {None}
        return len(told) > 1

    def _imposed(self, f: int) -> Iterator[tuple[int, int, int]]:
        attacks = f in self.listening
        for guise in self.hand.acts_as(f) if attacks else {f}:
            trust_domain = self.member(guise)
            for holder in self.forgers:
                alone = self.hand.system.enclaves[guise].reads_alone
                heard = self.reads(guise, trust_domain, attacks=attacks) | alone
                for c in self.imposes(holder, trust_domain) & heard:
                    yield holder, c, f

    def _intercepted(self, trust_domain: int) -> Iterator[tuple[int, int, int]]:
        """What is on the network as the trust domain protects it: the outsider listens whoever attacks."""
        hand = self.hand
        for e in (*hand.enclaves, OUTSIDER):
            sent = self.imposes(e, trust_domain)
            for mask in () if e == OUTSIDER else hand.acts_as(e) if e in self.forgers else {e}:
                sent |= self.writes(mask, trust_domain, attacks=e in self.forgers) | hand.written_alone(
                    mask, trust_domain
                )
            for c in sent:
                if c in hand.in_clear(trust_domain):
                    yield e, c, OUTSIDER
                for f in self.listening:
                    if c in hand.in_clear(trust_domain) or any(
                        c in hand.powers(guise, trust_domain).learns() for guise in hand.acts_as(f)
                    ):
                        yield e, c, f

    def gets(self) -> set[int]:
        """Who gets a sample of a channel of the source."""
        return set[int]().union(*map(self.getters, self.claim.source.channels))

    def getters(self, c: int) -> set[int]:
        """Who gets a sample of this channel."""
        found, clear = set(), any(c in self.hand.in_clear(trust_domain) for trust_domain in self.trust_domains)
        for f in self.hand.enclaves:
            attacks = f in self.listening
            as_whom = self.hand.acts_as(f) if attacks else {f}
            if any(c in self.takes(guise, attacks=attacks) for guise in as_whom) or (
                attacks
                and (
                    clear
                    or any(c in self.hand.system.enclaves[guise].reads_alone for guise in as_whom)
                    or any(
                        c in self.hand.powers(guise, trust_domain).learns()
                        for guise in as_whom
                        for trust_domain in self.trust_domains
                    )
                )
            ):
                found.add(f)
        return found | {OUTSIDER} if clear and not self.able else found

    def puts(self, holder: int) -> bool:
        """Whether it puts a sample on a channel of the target."""
        return bool(self.put(holder) & self.claim.target.channels)

    def put(self, holder: int) -> set[int]:
        """Channels on which it puts samples."""
        found = set[int]()
        for trust_domain in self.trust_domains:
            found |= self.imposes(holder, trust_domain)
            if holder in self.listening:
                for guise in self.hand.acts_as(holder):
                    found |= self.hand.system.enclaves[guise].writes_alone
            if holder != OUTSIDER and not (self.able and trust_domain != self.member(holder)):
                found |= self.writes(holder, trust_domain)
        return found

    def shortest(self) -> int | None:
        """The number of hops of a shortest flow, getting and putting included; None where there is none."""
        getters = self.gets()
        found = [1] if getters & self.target else []
        ways = dict.fromkeys(self.source, 0)
        for f in getters - set(self.claim.through):
            ways.setdefault(f, 1)
        length = 0
        while any(steps >= length for steps in ways.values()):
            for e in [e for e, steps in ways.items() if steps == length]:
                if self.puts(e):
                    found.append(length + 1)
                for sender, _channel, f in self.hops:
                    if sender != e:
                        continue
                    if f in self.target:
                        found.append(length + 1)
                    if f not in self.claim.through:
                        ways.setdefault(f, length + 1)
            length += 1
        return min(found, default=None)


def found_by(hand: ByHand, claim: ClaimAtom, one: int, other: int) -> bool:
    """Whether both may be in one domain: peers of one trust domain or two let both in, or one, and the other starts."""
    trust_domains = range(len(hand.system.trust_domains))
    here, there = (
        {
            domain
            for trust_domain in trust_domains
            for domain in hand.powers(each, trust_domain).joins | hand.lets_anybody_in(trust_domain)
        }
        for each in (one, other)
    )
    return any(
        (domain in there or (other, domain) in claim.starts)
        if domain in here
        else (domain in there and (one, domain) in claim.starts)
        for domain in range(len(hand.system.domains))
    )


def published_by_others(hand: ByHand, permitted: frozenset[int]) -> set[int]:
    views = enumerate(hand.views)
    found = (
        published_elsewhere(hand.system, view, hand.permissions, trust_domain, permitted)
        for trust_domain, view in views
    )
    return set[int]().union(*found)


def read_by_others(hand: ByHand, attacker: Attacker) -> set[int]:
    """What somebody reads who is no enclave here: anybody, or (an insider) with a grant."""
    if attacker is not Attacker.INSIDER:
        return set[int]().union(*(hand.in_clear(trust_domain) for trust_domain in range(len(hand.views))))
    views = enumerate(hand.views)
    return set[int]().union(
        *(read_elsewhere(hand.system, view, hand.permissions, trust_domain) for trust_domain, view in views)
    )


def violated(hand: ByHand, claim: ClaimAtom) -> bool:
    """Whether the claim is violated at the moment of `hand`."""
    if claim.kind is ClaimKind.NO_FLOW:
        return Flow(hand, claim).shortest() is not None
    if claim.kind is ClaimKind.ABLE:
        return any(Flow(hand, pair).shortest() is None for pair in claim.each_pair())
    return violated_by_some(hand, claim)


def violated_by_some(hand: ByHand, claim: ClaimAtom) -> bool:
    """The same of the kinds without flows."""
    s = hand.system
    if claim.kind is ClaimKind.ONLY_PUBLISH and claim.target.channels & published_by_others(
        hand, claim.source.certificates
    ):
        return True
    if claim.kind is ClaimKind.ENCRYPTED and claim.target.channels & read_by_others(hand, claim.attacker):
        return True
    for trust_domain in range(len(s.trust_domains)):
        for e in hand.enclaves:
            powers = hand.powers(e, trust_domain)
            if claim.kind is ClaimKind.ONLY_PUBLISH:
                if e not in claim.source.enclaves and powers.publishes & claim.target.channels:
                    return True
            elif claim.kind is ClaimKind.SEPARATE_DOMAINS:
                if e in claim.source.enclaves and any(found_by(hand, claim, e, f) for f in claim.target.enclaves):
                    return True
            elif claim.attacker is Attacker.INSIDER:
                holders = [f for f in hand.acts_as(e) if not (s.enclaves[f].opaque or s.enclaves[f].unmanaged)]
                if s.enclaves[e].unmanaged and not s.enclaves[e].opaque and holders:
                    continue
                learnt = hand.in_clear(trust_domain).union(
                    *(hand.powers(f, trust_domain).learns() for f in hand.acts_as(e))
                )
                maybe = s.enclaves[e].opaque or any(document.opaque for document in s.documents)
                given = hand.views[trust_domain].granted(e, Operation.SUBSCRIBE)
                entitled = {channel for channel in powers.reads if maybe or given >> channel & 1}
                if (learnt - entitled) & claim.target.channels:
                    return True
    return False
