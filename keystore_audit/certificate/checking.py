"""Whether a certificate proves its property of a keystore: every hop out of its compartment is refused, for its reason.

What there is comes from the keystore: participants, documents, signers, implementations, names. The certificate says
what may be inside and which lines refuse the rest; the question comes from whoever asks.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct

from keystore_audit.certificate.documents import Domains
from keystore_audit.certificate.errors import CannotTell, Refused
from keystore_audit.certificate.kinds import Row, row
from keystore_audit.certificate.names import Expressions, matches
from keystore_audit.certificate.powers import OUTSIDER, Because, Name, Peers
from keystore_audit.certificate.reading import Enclave, Store, read

AMBIENT: Final = ("rt/clock", "rt/parameter_events", "rt/rosout", "ros_discovery_info")
"""Topics that nearly every node has a right to: no flow takes them, unless they are asked about."""

EVERYBODY: Final = "*"
"""Whom a reason is about where there is no such topic."""

EVERYTHING: Final = "*"
"""The topics of a reason where no rule is about the domain: it is no name of a class."""

TAKEN, OVERHEARD = "taken", "overheard"
"""The ways of a sample: to a reader who listens for it; to who reads what is on the network."""


class Property(Struct, frozen=True, rename={"source": "from", "target": "to"}):
    """That nothing gets from one place to another, under an attacker: honest, source or relays.

    Places as on the command line. `through`: enclaves over which a flow does not count.
    """

    source: str
    target: str
    attacker: str = "relays"
    through: tuple[str, ...] = ()
    include_ambient: bool = False
    kind: str = "no-flow"


class Inside(Struct, frozen=True):
    """A name that may be inside, in one of the ways, as seen by peers of the enclave `peers`."""

    way: str
    peers: str
    domain: int
    topic: str


class Refusal(Struct, frozen=True):
    """Why a participant inside does not put anything on a name outside, or one outside gets nothing of one inside."""

    participant: str
    peers: str
    domain: int
    topic: str
    because: tuple[Because, ...]


class Compartment(Struct, frozen=True):
    """For implementations that agree in it: who and what may be inside."""

    profiles: tuple[str, ...]
    participants: tuple[str, ...]
    names: tuple[Inside, ...]
    refused: tuple[Refusal, ...]


class Certificate(Struct, frozen=True, forbid_unknown_fields=True):
    """What a file says. `documents`: of those that refuse something, the SHA-256 by place."""

    property: Property
    documents: dict[str, str]
    compartments: tuple[Compartment, ...]
    schema_version: int = 1


class Given(Struct, frozen=True):
    """What the command line says beside the property: implementations, instant (aware UTC), assumptions left out, and
    authorities by SHA-256 of certificate or key; none: whichever are there.
    """

    profiles: tuple[str, ...]
    at: datetime
    not_assumed: tuple[str, ...] = ()
    identity_cas: frozenset[str] = frozenset()
    permissions_cas: frozenset[str] = frozenset()


def encoded(certificate: Certificate) -> bytes:
    """The bytes of its file."""
    return msgspec.json.format(msgspec.json.encode(certificate), indent=1) + b"\n"


class Checker:
    """One keystore and one question. Raises CannotTell."""

    def __init__(self, keystore: Path, asked: Property, given: Given) -> None:
        self.store, self._asked, self._given = read(keystore), asked, given
        if {*given.not_assumed} - {"truthful-announcements"}:
            raise CannotTell("without these assumptions nobody can tell")
        if asked.kind != "no-flow" or asked.attacker not in ("honest", "source", "relays"):
            raise CannotTell("the checker does not know such a property")
        self._written = {topic for _domains, topics in _rules(self.store) for topic in topics}
        globs = [_dds(place) for place in (asked.source, asked.target) if ":" in place]
        self.expressions = Expressions([*self._written, *globs, *AMBIENT])
        self._implementations: dict[Row, Implementation] = {}
        for each in self.store.enclaves:
            for ca, trusted in ((each.identity_ca, given.identity_cas), (each.permissions_ca, given.permissions_cas)):
                if trusted and not {ca.fingerprint, ca.key} & trusted:
                    raise Refused(f"{ca.path} is not the authority that is trusted")

    def check(self, content: bytes) -> None:
        """Accepts the certificate, or raises Refused or CannotTell."""
        try:
            certificate = msgspec.json.decode(content, type=Certificate)
        except msgspec.DecodeError as error:
            raise Refused(f"this is no certificate: {error}") from error
        if certificate.property != self._asked:
            raise Refused("the certificate is about another property")
        names = [name for each in certificate.compartments for name in each.profiles]
        if sorted(names) != sorted(self._given.profiles):
            raise Refused("the certificate has not one compartment for each implementation that was asked about")
        for compartment in certificate.compartments:
            for implementation in dict.fromkeys(map(self.implementation, compartment.profiles)):
                implementation.check(compartment)
        if content != encoded(self.certificate(certificate.compartments)):
            raise Refused("the certificate is not in its one form, or a document is not the one that it names")

    def certificate(self, compartments: tuple[Compartment, ...]) -> Certificate:
        """The one of these compartments."""
        lines = {because for each in compartments for refusal in each.refused for because in refusal.because}
        digests = {path: self.store.digests[path] for path in sorted({because.document for because in lines})}
        return Certificate(self._asked, digests, compartments)

    @cached_property
    def names(self) -> list[Name]:
        """A name of each class, which nothing here tells apart from the others in it."""
        edges = (edge for domains, _topics in _rules(self.store) for low, high in domains for edge in (low, high + 1))
        topics = sorted((topic, ends) for ends, topic in self.expressions.classes().items())
        return [Name(domain, topic, ends) for domain in sorted({0, *edges}) for topic, ends in topics]

    def implementation(self, name: str) -> Implementation:
        """The keystore as an implementation has it; one for all that do the same."""
        found = row(name)
        if found not in self._implementations:
            if found.matches_octets and any("?" in text for text in self._written):
                raise CannotTell("? stands for a character or an octet, as the locale of a process has it")
            self._implementations[found] = Implementation(self, self._asked, self._given, found)
        return self._implementations[found]


class Implementation:
    """A keystore as one implementation has it, and a property of it."""

    def __init__(self, checker: Checker, asked: Property, given: Given, found: Row) -> None:
        self._store, self._asked = checker.store, asked
        self.names, self._expressions = checker.names, checker.expressions
        alike: dict[object, list[Enclave]] = {}
        for each in self._store.enclaves:
            trusted = each.identity_ca.fingerprint, each.permissions_ca.fingerprint, each.governance.text
            alike.setdefault(trusted, []).append(each)
        same = self._expressions, found, given.at, not given.not_assumed
        self.peers = [Peers(self._store, members, *same) for members in alike.values()]
        self.participants = [*(each.path for each in self._store.enclaves), OUTSIDER]
        self._source, self._target = (self._enclaves(place) for place in (asked.source, asked.target))
        self._listening = {"relays": {*self.participants}}.get(asked.attacker, {OUTSIDER})
        self._ending = (TAKEN, OVERHEARD) if asked.attacker == "relays" else (TAKEN,)
        self._attacking = {"relays": self._listening, "source": self._source}.get(asked.attacker, set[str]())
        self._passed = {path for glob in asked.through for path in self._enclaves(glob)} - self._source - self._target
        topics = (self._in(asked.source, name) and self._in(asked.target, name) for name in self.names)
        if self._source & self._target or any(topics):
            raise CannotTell("both places share something")

    def _enclaves(self, place: str) -> set[str]:
        """The participants of a place, none where it is topics."""
        if place == OUTSIDER:
            return {OUTSIDER}
        if ":" in place:
            return set()
        found = {each.path for each in self._store.enclaves if matches(place, each.path)}
        if not found:
            raise CannotTell(f"{place} names no enclave here")
        return found

    def _in(self, place: str, name: Name) -> bool:
        """Whether the name is one of the place's topics."""
        return ":" in place and bool(self._expressions.ends[_dds(place)] & name.ends)

    def _crossed(self, name: Name) -> bool:
        """Whether flows take the name, or begin or end there."""
        ambient = not self._asked.include_ambient and any(self._expressions.ends[each] & name.ends for each in AMBIENT)
        return not ambient or self._in(self._asked.source, name) or self._in(self._asked.target, name)

    def puts(self, peers: Peers, who: str, name: Name, way: str) -> bool:
        """Whether somebody puts samples on a name in one of the ways."""
        attacks = who in self._attacking
        powers = peers.powers(who, name, attacks)
        return powers.writes or (attacks and powers.forges) or (way == OVERHEARD and powers.own_writes)

    def gets(self, peers: Peers, who: str, name: Name, way: str) -> bool:
        """Whether somebody gets samples of a name in one of the ways."""
        powers = peers.powers(who, name, who in self._attacking)
        if way == OVERHEARD:
            return who in self._listening and (powers.reads or powers.overhears)
        return who in peers.members and (powers.reads or (bool(self._attacking) and powers.own_reads))

    def compartment(self, inside: set[str]) -> Compartment:
        """The one with these participants, and with the names that one of them puts something on or the flow begins at.

        Raises Refused for the first hop out of it that nothing refuses.
        """
        names, refused = list[Inside](), dict[Refusal, None]()
        outside = [who for who in self.participants if who not in inside | self._passed]
        within = [who for who in self.participants if who in inside]
        for peers, name in ((peers, name) for peers in self.peers for name in self.names if self._crossed(name)):
            place = peers.first.path, name.domain, name.topic
            domain, rule = peers.rules(name)
            if rule is None:
                named = name.topic if domain else EVERYTHING
                refused[Refusal(EVERYBODY, *place[:2], named, peers.refusals(OUTSIDER, name, "publish"))] = None
                continue
            for way in (TAKEN, OVERHEARD):
                held = self._in(self._asked.source, name) or any(self.puts(peers, who, name, way) for who in within)
                if held:
                    names.append(Inside(way, *place))
                    if self._in(self._asked.target, name) and way in self._ending:
                        raise Refused(f"where the flow ends, nothing refuses {_told(place)}")
                for who in outside if held else within:
                    if held and self.gets(peers, who, name, way):
                        raise Refused(f"nothing refuses that {who} gets {_told(place)}")
                    because = peers.refusals(who, name, "subscribe" if held else "publish")
                    refused[Refusal(who, *place, because)] = None
        return Compartment((), tuple(sorted(inside)), tuple(names), tuple(refused))

    def check(self, found: Compartment) -> None:
        """Accepts the compartment, or raises Refused."""
        inside = {*found.participants}
        if self._source - inside or self._target & inside or not inside <= {*self.participants}:
            raise Refused("who is inside is not all from whom the flow begins, or is where it ends, or nobody here")
        wanted, told = self.compartment(inside), {*found.refused}
        for each in wanted.refused:
            if each not in told:
                place = _told((each.peers, each.domain, each.topic))
                raise Refused(f"no reason, or none that is true, why {each.participant} takes no part in {place}")
        if msgspec.structs.replace(wanted, profiles=found.profiles) != found:
            raise Refused("the compartment holds other names than those inside put something on, or idle reasons")


def _told(place: tuple[str, int, str]) -> str:
    peers, domain, topic = place
    return f"{topic!r} in domain {domain}, as peers of {peers} see it"


def _dds(place: str) -> str:
    """The expression of DDS topics that a place of topics is."""
    kind, _colon, glob = place.partition(":")
    if kind not in ("topic", "dds") or not glob or (kind == "topic" and not glob.startswith("/")):
        raise CannotTell(f"{place} is no place that the checker knows")
    return f"rt{glob}" if kind == "topic" else glob


def _rules(store: Store) -> Iterator[tuple[Domains, Sequence[str]]]:
    """Domains and expressions of each rule."""
    for document in store.permissions:
        for rule in (rule for grant in document.grants for rule in grant.rules):
            yield rule.domains, rule.publish + rule.subscribe
    for domain in (domain for enclave in store.enclaves for domain in enclave.governance.rules):
        yield domain.domains, [topic.expression for topic in domain.topics]
