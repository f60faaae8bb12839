"""Whether a certificate proves its property of a keystore: every hop out of its compartment is refused, for its reason.

The facts come from the keystore: participants, documents, signers, implementations, names. The certificate says what
may be inside and which lines refuse the rest. The question comes from the user.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence, Set
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
from keystore_audit.certificate.powers import CERTIFIED, OUTSIDER, Because, Name, Peers
from keystore_audit.certificate.reading import Enclave, Store, read

AMBIENT: Final = ("rt/clock", "rt/parameter_events", "rt/rosout", "ros_discovery_info")
"""Topics that nearly every node has a right to: no flow takes them, unless they are asked about."""

ALL: Final = "*"
"""Stands for everybody in a reason where no such topic exists, and for its topic where no rule covers the domain."""

TAKEN, OVERHEARD = "taken", "overheard"
"""The ways of a sample: to a reader that subscribes to it, and to anybody who reads what is on the network."""


class NoFlow(Struct, frozen=True, tag_field="kind", tag="no-flow", rename={"source": "from", "target": "to"}):
    """That nothing gets from one place to another, under an attacker: honest, source or relays.

    Places as on the command line. `through`: enclaves over which a flow does not count.
    """

    source: str
    target: str
    attacker: str = "relays"
    through: tuple[str, ...] = ()
    include_ambient: bool = False


class OnlyPublish(Struct, frozen=True, tag_field="kind", tag="only-publish"):
    """That nobody but these enclaves (globs) may publish a topic, which is written as in settings."""

    topic: str
    enclaves: tuple[str, ...]


class Encrypted(Struct, frozen=True, tag_field="kind", tag="encrypted"):
    """That nobody reads the topic: no outsider; `against` insider: nobody whom no grant lets read it, whoever it is."""

    topic: str
    against: str


Property = NoFlow | OnlyPublish | Encrypted


class Inside(Struct, frozen=True):
    """A name that may be inside, in one of the ways, as seen by peers of the enclave `peers`."""

    way: str
    peers: str
    domain: int
    topic: str


class Refusal(Struct, frozen=True):
    """Why a participant puts nothing on a name outside, or gets nothing of one inside."""

    participant: str
    peers: str
    domain: int
    topic: str
    because: tuple[Because, ...]


class Compartment(Struct, frozen=True):
    """For implementations that agree in it: who and what may be inside. Of only-publish that is who may publish, of
    encrypted the names of the topic.
    """

    profiles: tuple[str, ...]
    participants: tuple[str, ...]
    names: tuple[Inside, ...]
    refused: tuple[Refusal, ...]


class Certificate(Struct, frozen=True, forbid_unknown_fields=True):
    """What a certificate says. `documents`: the SHA-256 of each that refuses something, by place."""

    property: Property
    documents: dict[str, str]
    compartments: tuple[Compartment, ...]
    schema_version: int = 1


class Given(Struct, frozen=True):
    """What the command line says beside the property: implementations, instant (aware UTC) and assumptions left out.
    Also authorities by SHA-256 of certificate or key; none: whichever are there.
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
        self._written = {topic for _domains, topics in _rules(self.store) for topic in topics}
        places = (asked.source, asked.target) if isinstance(asked, NoFlow) else (f"topic:{asked.topic}",)
        self.expressions = Expressions([*self._written, *(_dds(each) for each in places if ":" in each), *AMBIENT])
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
            raise Refused("the certificate must have one compartment for each implementation that was asked about")
        for compartment in certificate.compartments:
            for implementation in dict.fromkeys(map(self.implementation, compartment.profiles)):
                implementation.check(compartment)
        if content != encoded(self.certificate(certificate.compartments)):
            raise Refused("the certificate is not in canonical form, or a document is not the one that it names")

    def certificate(self, compartments: tuple[Compartment, ...]) -> Certificate:
        """The certificate with these compartments."""
        lines = {because for each in compartments for refusal in each.refused for because in refusal.because}
        digests = {path: self.store.digests[path] for path in sorted({because.document for because in lines})}
        return Certificate(self._asked, digests, compartments)

    @cached_property
    def names(self) -> list[Name]:
        """A name of each class; nothing here distinguishes it from the others in its class."""
        edges = (edge for domains, _topics in _rules(self.store) for low, high in domains for edge in (low, high + 1))
        topics = sorted((topic, ends) for ends, topic in self.expressions.classes().items())
        return [Name(domain, topic, ends) for domain in sorted({0, *edges}) for topic, ends in topics]

    def implementation(self, name: str) -> Implementation:
        """The keystore as an implementation has it; one for all that do the same."""
        found = row(name)
        if found not in self._implementations:
            if found.matches_octets and any("?" in text for text in self._written):
                raise CannotTell("? stands for a character or an octet, as the locale of a process has it")
            asked, given = self._asked, self._given
            kind = Flow(self, given, found, asked) if isinstance(asked, NoFlow) else Right(self, given, found, asked)
            self._implementations[found] = kind
        return self._implementations[found]


class Implementation(ABC):
    """A keystore as one implementation reads it, and a property of it."""

    source: Set[str]
    """Who has to be inside."""

    free: Set[str] = frozenset()
    """Who else may be."""

    putting: tuple[str, ...] = ("publish",)
    """The rights by which somebody puts something on a name."""

    def __init__(self, checker: Checker, given: Given, found: Row) -> None:
        self._store = checker.store
        self.names, self._expressions = checker.names, checker.expressions
        alike: dict[object, list[Enclave]] = {}
        for each in self._store.enclaves:
            trusted = each.identity_ca.fingerprint, each.permissions_ca.fingerprint, each.governance.text
            alike.setdefault(trusted, []).append(each)
        same = self._expressions, found, given.at, not given.not_assumed
        self.peers = [Peers(self._store, members, *same) for members in alike.values()]
        self.participants = [*(each.path for each in self._store.enclaves), OUTSIDER]

    def _named(self, glob: str) -> set[str]:
        """The enclaves of a glob."""
        found = {each.path for each in self._store.enclaves if matches(glob, each.path)}
        if not found:
            raise CannotTell(f"{glob} names no enclave here")
        return found

    def _in(self, place: str, name: Name) -> bool:
        """Whether the name is one of the place's topics."""
        return ":" in place and bool(self._expressions.ends[_dds(place)] & name.ends)

    @abstractmethod
    def asks(self, name: Name) -> bool:
        """Whether the property is about the name."""

    @abstractmethod
    def hops(self, peers: Peers, name: Name, inside: Set[str]) -> Iterator[tuple[str, bool, Mapping[str, bool]]]:
        """By way: whether the name is inside, and who then must get nothing of it, or else must put nothing there.

        Also whether each does. Raises Refused where the name must not be inside.
        """

    @cached_property
    def places(self) -> list[tuple[Peers, Name]]:
        """Each name that the property is about, as each trust domain sees it."""
        return [(peers, name) for peers in self.peers for name in self.names if self.asks(name)]

    def compartment(self, inside: Set[str]) -> Compartment:
        """The compartment with these participants. Raises Refused for the first hop out of it that nothing refuses."""
        names, refused = list[Inside](), dict[Refusal, None]()
        for peers, name in self.places:
            place = peers.first.path, name.domain, name.topic
            domain, rule = peers.rules(name)
            if rule is None:
                named = name.topic if domain else ALL
                refused[Refusal(ALL, *place[:2], named, peers.refusals(OUTSIDER, name))] = None
                continue
            for way, held, whom in self.hops(peers, name, inside):
                if held:
                    names.append(Inside(way, *place))
                for who, does in whom.items():
                    if does:
                        raise Refused(f"nothing refuses that {who} {'gets' if held else 'puts'} {_told(*place)}")
                    because = peers.refusals(who, name, *(("subscribe",) if held else self.putting))
                    refused[Refusal(who, *place, because)] = None
        return Compartment((), tuple(sorted(inside)), tuple(names), tuple(refused))

    def check(self, found: Compartment) -> None:
        """Accepts the compartment, or raises Refused."""
        inside = {*found.participants}
        if not self.source <= inside <= self.source | self.free:
            raise Refused("the compartment lacks a source, or holds somebody who must not be inside or is not here")
        wanted, told = self.compartment(inside), {*found.refused}
        for each in wanted.refused:
            if each not in told:
                place = _told(each.peers, each.domain, each.topic)
                raise Refused(f"there is no true reason why {each.participant} takes no part in {place}")
        if msgspec.structs.replace(wanted, profiles=found.profiles) != found:
            raise Refused("the compartment's names are not those that its members use, or it gives unneeded reasons")


class Flow(Implementation):
    """Whether nothing gets from one place to another."""

    putting = ("publish", "subscribe")  # whoever reads can forge, mostly

    def __init__(self, checker: Checker, given: Given, found: Row, asked: NoFlow) -> None:
        super().__init__(checker, given, found)
        self._asked = asked
        self.source, target = (self._enclaves(place) for place in (asked.source, asked.target))
        everybody = {*self.participants}
        attacking = {"honest": set[str](), "source": self.source, "relays": everybody}.get(asked.attacker)
        topics = (self._in(asked.source, name) and self._in(asked.target, name) for name in self.names)
        if attacking is None or self.source & target or any(topics):
            raise CannotTell("both places share something, or there is no such attacker")
        self._attacking, relays = attacking, asked.attacker == "relays"
        self._listening = everybody if relays else {OUTSIDER}
        self._ending = (TAKEN, OVERHEARD) if relays else (TAKEN,)
        self._passed = {path for glob in asked.through for path in self._enclaves(glob)} - self.source - target
        self.free = everybody - target

    def _enclaves(self, place: str) -> set[str]:
        """The participants of a place, none where it is topics."""
        return {OUTSIDER} if place == OUTSIDER else set() if ":" in place else self._named(place)

    def asks(self, name: Name) -> bool:
        """Whether flows take the name, or begin or end there."""
        ambient = not self._asked.include_ambient and any(self._expressions.ends[each] & name.ends for each in AMBIENT)
        return not ambient or self._in(self._asked.source, name) or self._in(self._asked.target, name)

    def hops(self, peers: Peers, name: Name, inside: Set[str]) -> Iterator[tuple[str, bool, Mapping[str, bool]]]:
        """A name is inside where somebody inside puts something, or the flow begins; not where it ends."""
        within = [who for who in self.participants if who in inside]
        outside = [who for who in self.participants if who not in inside | self._passed]
        for way in (TAKEN, OVERHEARD):
            held = self._in(self._asked.source, name) or any(self.puts(peers, who, name, way) for who in within)
            if held and self._in(self._asked.target, name) and way in self._ending:
                raise Refused(f"the flow ends at {_told(peers.first.path, name.domain, name.topic)}")
            does, whom = (self.gets, outside) if held else (self.puts, within)
            yield way, held, {who: does(peers, who, name, way) for who in whom}

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


class Right(Implementation):
    """Whether nobody else publishes a topic, or reads it, whoever else may have an identity."""

    def __init__(self, checker: Checker, given: Given, found: Row, asked: OnlyPublish | Encrypted) -> None:
        super().__init__(checker, given, found)
        globs, self._against = (asked.enclaves, "") if isinstance(asked, OnlyPublish) else ((), asked.against)
        self._topic = f"topic:{asked.topic}"
        self.source = {path for glob in globs for path in self._named(glob)}

    def asks(self, name: Name) -> bool:
        """Whether it is a name of the topic."""
        return self._in(self._topic, name)

    def hops(self, peers: Peers, name: Name, inside: Set[str]) -> Iterator[tuple[str, bool, Mapping[str, bool]]]:
        """An encrypted name is inside, for those with a grant; else nothing is, and holders of a subject inside may."""
        everybody = (OUTSIDER,) if self._against == OUTSIDER else (*self.participants, CERTIFIED, *peers.elsewhere)
        able = [(who, peers.powers(who, name, True)) for who in everybody]
        if self._against:
            yield OVERHEARD, True, {who: p.reads or p.overhears for who, p in able if not peers.entitled(who, name)}
        else:
            theirs = {each.identity.subject for each in self._store.enclaves if each.path in inside}
            yield TAKEN, False, {who: powers.writes for who, powers in able if who not in inside | theirs}


def _told(peers: str, domain: int, topic: str) -> str:
    return f"{topic!r} in domain {domain}, as peers of {peers} see it"


def _dds(place: str) -> str:
    """The expression of DDS topics that a place of topics is."""
    found = re.fullmatch("(?:topic:)?(?:(/.*)|dds:(.+))", place)
    if found is None:
        raise CannotTell(f"{place} is no place that the checker knows")
    return f"rt{found[1]}" if found[1] else found[2]


def _rules(store: Store) -> Iterator[tuple[Domains, Sequence[str]]]:
    """Domains and expressions of each rule."""
    for document in store.permissions:
        for rule in (rule for grant in document.grants for rule in grant.rules):
            yield rule.domains, rule.publish + rule.subscribe
    for domain in (domain for enclave in store.enclaves for domain in enclave.governance.rules):
        yield domain.domains, [topic.expression for topic in domain.topics]
