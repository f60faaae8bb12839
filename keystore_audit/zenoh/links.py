"""Who is linked to whom, and how far messages come: over links, and through processes that pass them on.

Measured (tests/oracles/zenoh): a router passes on, but not from a peer to a peer. A peer passes on between a client and
any other process. Who connects knows the listener's certificate; the listener knows the other's only with mutual TLS.
A client sends whether or not it was told of a receiver, and so does a peer to a router; others do not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, cached_property, lru_cache
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.crl import extension_of
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.profiles import Release
from keystore_audit.truth import Truth, all_of
from keystore_audit.zenoh.access_control import Decision, Flow, Key, Kind, Remote, decide
from keystore_audit.zenoh.configuration import PROTOCOLS, SECURED, Endpoint, Mode
from keystore_audit.zenoh.network import CONNECTING, LISTENING, Network, Process, common_name


class Message(Struct, frozen=True):
    """A message that has to pass, away from the asker or back to it."""

    kind: Kind
    away: bool
    key: Key


_INTERESTS: Final = (Kind.SUBSCRIBE, Kind.SERVE, Kind.TOKEN_SUBSCRIBE)
"""Messages that announce a receiver; they go the opposite way of what it receives."""


class Tie(Struct, frozen=True, kw_only=True):
    """A link. `near`: None, an attacker's own end, which checks nothing. `sure`: whether the link is there.

    `mode`: what the near end is; an attacker chooses. `seen`: what the far process knows of the near one; `sees`: the
    other way about.
    """

    near: Process | None
    mode: Mode
    far: Process
    seen: Remote
    sees: Remote
    sure: Truth

    def crossed(self, messages: Sequence[Message], release: Release) -> Truth:
        """Whether all messages pass."""
        found = self.sure
        for _process, decision in self._decisions(messages, release):
            found = all_of((found, decision.truth))
            if found is Truth.NO:  # most of what is asked
                break
        return found

    def decisive(self, messages: Sequence[Message], release: Release) -> tuple[Process, Decision]:
        """What stops one of them, and in whose file; else what lets the first pass."""
        return min(self._decisions(messages, release), key=lambda each: OBSTACLES.index(each[1].truth))

    def judges(self, kind: Kind, away: bool) -> Iterator[tuple[Process, Remote, Flow]]:
        """Who decides about such a message, and of whom; nobody where it need not pass at all."""
        ends = (self.mode, self.far.says.mode)
        sender, receiver = reversed(ends) if away else ends
        unasked = sender is Mode.CLIENT or (sender is Mode.PEER and receiver is Mode.ROUTER)
        if kind in _INTERESTS and unasked:
            return
        if self.near is not None:
            yield self.near, self.sees, Flow.EGRESS if away else Flow.INGRESS
        yield self.far, self.seen, Flow.INGRESS if away else Flow.EGRESS

    def _decisions(self, messages: Sequence[Message], release: Release) -> Iterator[tuple[Process, Decision]]:
        for message in messages:
            for process, remote, flow in self.judges(message.kind, message.away):
                yield process, decided(process, remote, message.kind, flow, message.key, release)


@lru_cache(maxsize=65536)
def decided(process: Process, remote: Remote, kind: Kind, flow: Flow, key: Key, release: Release) -> Decision:
    """What a process lets through: asked once, on however many ways."""
    if process.says.undecided:
        return Decision(Truth.UNKNOWN, None, "what passes its links is not known")
    for refusal in process.says.refusals:
        if not {*release.asked}.isdisjoint(refusal.releases):
            return Decision(Truth.UNKNOWN, refusal.line, f"some releases refuse the file: {refusal.reason}")
    return decide(process.says.access, remote, kind, flow, key, release)


OBSTACLES: Final = (Truth.NO, Truth.UNKNOWN, Truth.YES)
"""How several answers that all have to be yes are told: as the first of these."""


class Links:
    """All links of a network."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self.attacks = cache(self._attacked)

    def of(self, process: Process) -> tuple[Tie, ...]:
        """The links whose near end is this process."""
        return self._ties.get(id(process), ())

    @cached_property
    def unseen(self) -> tuple[tuple[Process, Endpoint], ...]:
        """Endpoints that processes connect to, and where none of the network listens."""
        listening = [end for each in self._network.processes for end in each.says.listens]
        return tuple(
            (each, end)
            for each in self._network.started
            for end in each.says.connects
            if not end.multicast and not any(fits(end, other).may for other in listening)
        )

    def _attacked(self, who: Enclave | Process | None) -> tuple[Tie, ...]:
        """The links that a holder of the enclave's key can have without its file; None: without any key.

        They are those of all enclaves of the same key. Of a process of no enclave, whoever takes its place.
        """
        key = who.identity.key if isinstance(who, Enclave) and who.identity is not None else None
        owners = self._network.named.owners.values()
        alike = tuple(each for each in owners if each.identity is not None and each.identity.key == key)
        return tuple(tie for each in alike or (who,) for tie in self._attacked_by(each))

    def _attacked_by(self, who: Enclave | Process | None) -> Iterator[Tie]:
        certificate = None if who is None else who.certificate if isinstance(who, Process) else who.identity
        started = self._network.started
        own = [each for each in self._network.processes if who is not None and who in (each, each.owner)]
        for process in started:
            yield from self._attacks(process, certificate)
        for process in started:
            yield from self._led(process, own, certificate) if process not in own else ()

    def _attacks(self, process: Process, certificate: Certificate | None) -> Iterator[Tie]:
        name = common_name(certificate) if certificate is not None else None
        for end in (*process.says.listens, *(each for each in process.says.connects if each.multicast)):
            known, sure = None, Truth.YES if end.protocol in PROTOCOLS else Truth.UNKNOWN
            if process.says.mutual(end):
                if certificate is None:
                    continue
                known, sure = name, self._network.trusts(process, end, certificate, CONNECTING)
            seen = Remote(known, end.protocol, free=end.multicast, chosen=True)
            yield from (Tie(near=None, mode=mode, far=process, seen=seen, sees=seen, sure=sure) for mode in Mode)
        yield from self._sought(process, certificate)

    def _led(self, process: Process, own: Sequence[Process], certificate: Certificate | None) -> Iterator[Tie]:
        """The links that a process makes itself, to where the attacker's own listen."""
        for end, their in (met for each in own for met in self._met(process, each)):
            known, sure = None, [Truth.YES if end is None else fits(end, their)]
            if their.protocol in SECURED:
                if certificate is None:
                    continue
                known = common_name(certificate)
                sure += [
                    self._network.trusts(process, end, certificate, LISTENING),
                    self._verified(process, end, certificate),
                ]
            elif their.protocol not in PROTOCOLS:
                sure.append(Truth.UNKNOWN)
            seen, there = Remote(known, their.protocol, free=their.multicast, chosen=True), all_of(sure)
            if there.may:
                yield from (Tie(near=None, mode=mode, far=process, seen=seen, sees=seen, sure=there) for mode in Mode)

    def _sought(self, process: Process, certificate: Certificate | None) -> Iterator[Tie]:
        """The links that a process makes itself, to any announced address (measured). By multicast anybody can
        announce; by gossip only a process with a link to one that passes it on can.
        """
        says = process.says
        if not says.seeks or (certificate is None and not says.multicast):
            return
        told = Truth.YES if says.multicast or len(self._around[id(process)]) > 1 else Truth.UNKNOWN
        ways = [Remote(None, "tcp", chosen=True)] if says.plain else []
        if certificate is not None and any(each.protocol in SECURED for each in (*says.listens, *says.connects)):
            ways.append(Remote(common_name(certificate), "tls", chosen=True))
        for seen in ways:
            for mode in (Mode.PEER, Mode.ROUTER):
                sure = told if seen.name is None else Truth.UNKNOWN
                yield Tie(near=None, mode=mode, far=process, seen=seen, sees=seen, sure=sure)

    @cached_property
    def _ties(self) -> dict[int, tuple[Tie, ...]]:
        found: dict[int, list[Tie]] = {}
        started = self._network.started
        for one in started:
            for other in started:
                for end, their in self._met(one, other):
                    connecting, listening, sure = self._shaken(one, end, other, their)
                    sure = all_of((sure, Truth.YES if end is None else fits(end, their)))
                    if sure.may:
                        found.setdefault(id(one), []).append(
                            Tie(near=one, mode=one.says.mode, far=other, seen=listening, sees=connecting, sure=sure)
                        )
                        found.setdefault(id(other), []).append(
                            Tie(near=other, mode=other.says.mode, far=one, seen=connecting, sees=listening, sure=sure)
                        )
        return {process: tuple(ties) for process, ties in found.items()}

    def _met(self, one: Process, other: Process) -> Iterator[tuple[Endpoint | None, Endpoint]]:
        """Over which endpoints the one connects to the other: None for its own, where it heard of the other."""
        if one is other:
            return
        for their in other.says.listens:
            yield from ((end, their) for end in one.says.connects if fits(end, their).may)
            if their.multicast and any(end.multicast and end.host == their.host for end in one.says.listens):
                yield None, their
        peers = one.says.mode is Mode.PEER and other.says.mode is Mode.PEER
        scouted = one.says.multicast and other.says.multicast
        if peers and (scouted or self._gossiped(one, other)):
            yield from ((None, their) for their in other.says.listens)

    def _gossiped(self, one: Process, other: Process) -> bool:
        """Whether some process is connected to both, so that each hears of the other."""
        if not (one.says.gossip and other.says.gossip):
            return False
        return bool(self._around[id(one)] & self._around[id(other)])

    @cached_property
    def _around(self) -> dict[int, set[int]]:
        """By process, it and those that gossip and that it connects to."""
        gossiping = [each for each in self._network.started if each.says.gossip]
        return {
            id(one): {id(one)}
            | {
                id(each)
                for each in gossiping
                if any(fits(end, their).may for end in one.says.connects for their in each.says.listens)
            }
            for one in self._network.started
        }

    def _shaken(
        self, one: Process, end: Endpoint | None, other: Process, their: Endpoint
    ) -> tuple[Remote, Remote, Truth]:
        """What the connecting side knows of the other, what the other knows of it, and whether there is a link."""
        if their.protocol not in SECURED:
            both = Remote(None, their.protocol, free=their.multicast)
            return both, both, Truth.YES if their.protocol in PROTOCOLS else Truth.UNKNOWN
        shown = self._certificate(one, end, "connect_certificate")
        answered = self._certificate(other, their, "listen_certificate")
        mutual = other.says.mutual(their)
        shows = one.says.tls(end, "enable_mtls")[0] is True
        sure = [self._network.trusts(one, end, answered, LISTENING), self._verified(one, end, answered)]
        if mutual:
            trusted = self._network.trusts(other, their, shown, CONNECTING)
            sure.append(trusted if shows else Truth.NO)
        name = common_name(answered) if answered is not None else None
        known = common_name(shown) if shown is not None and mutual else None
        return Remote(name, their.protocol), Remote(known, their.protocol), all_of(sure)

    def _certificate(self, process: Process, end: Endpoint | None, name: str) -> Certificate | None:
        said, _line = process.says.tls(end, name)
        found = self._network.named.certificates_at(said) if isinstance(said, str) else None
        return found.first if found is not None else None

    def _verified(self, one: Process, end: Endpoint | None, answered: Certificate | None) -> Truth:
        """Whether the name that it connects to is in the certificate of the other (SAN; measured)."""
        if one.says.tls(end, "verify_name_on_connect")[0] is False:
            return Truth.YES
        names = alternative_names(answered) if answered is not None else ()
        if answered is None or (end is None and names):
            return Truth.UNKNOWN
        return Truth.YES if end is not None and end.host in names else Truth.NO


def alternative_names(certificate: Certificate) -> tuple[str, ...]:
    """The names and addresses that a certificate is for."""
    from cryptography.x509 import SubjectAlternativeName

    found = extension_of(certificate.parsed.extensions, SubjectAlternativeName)
    return tuple(f"{each.value}" for each in found) if found is not None else ()


def fits(connecting: Endpoint, listening: Endpoint) -> Truth:
    """Whether one address leads to the other; certain only if both have one host by all names that are known here."""
    if (connecting.protocol, connecting.port) != (listening.protocol, listening.port):
        return Truth.NO
    alike = connecting.host == listening.host or (connecting.loopback and listening.loopback)
    return Truth.YES if alike or listening.anywhere else Truth.UNKNOWN


Way = tuple[Tie, ...]


def find_way(
    links: Links,
    begins: Sequence[Tie],
    messages: Sequence[Message],
    ends: Callable[[Process], bool],
    release: Release,
    *,
    certain: bool,
) -> Way | None:
    """The fewest links over which all messages may (`certain`: do) pass; None: there are none."""

    def crossing(tie: Tie) -> bool:
        crossed = tie.crossed(messages, release)
        return crossed.must if certain else crossed.may

    return next((way for way, _what in ways(links, begins, crossing, {}, certain=certain) if ends(way[-1].far)), None)


def ways(
    links: Links,
    begins: Sequence[Tie],
    crossing: Callable[[Tie], int],
    more: Mapping[int, Sequence[Tie]],
    *,
    certain: bool,
) -> Iterator[tuple[Way, int]]:
    """The fewest links over which things get to each place, and which of them first do by these.

    `crossing`: (bits) what gets over a link. `more`: by process (its id) links that it has beside those of the network.
    `certain`: what may not be passed on does not count.
    """
    seen: dict[tuple[int, int, Mode], int] = {}
    found: list[tuple[Way, int]] = [((tie,), -1) for tie in begins]
    for way, before in found:  # grows
        tie = way[-1]
        state = (id(tie.near), id(tie.far), tie.mode)
        known = seen.get(state, 0)
        new = before & ~known and before & ~known & crossing(tie)
        if not new:
            continue
        seen[state] = known | new
        yield way, new
        # What is certain passes nobody twice. Of the rest loops alone are left in, that it may not seem less.
        passers = [each.near for each in (way if certain else way[-1:])]
        for onward in (*links.of(tie.far), *more.get(id(tie.far), ())):
            passed = _passes_on(tie.far, tie.mode, onward.far.says.mode)
            if onward.far not in passers and (passed.must if certain else passed.may):
                found.append(((*way, onward), new))


def _passes_on(process: Process, before: Mode, after: Mode) -> Truth:
    """Whether a process passes on between links to processes of these modes."""
    peers = before is Mode.PEER and after is Mode.PEER
    if process.says.mode is Mode.ROUTER:
        brokering = Truth.UNKNOWN if process.says.brokering else Truth.NO
        return brokering if peers else Truth.YES
    return Truth.YES if process.says.mode is Mode.PEER and Mode.CLIENT in (before, after) else Truth.NO
