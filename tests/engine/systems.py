"""Systems made by hand or by chance, for tests of both engines.

A `Builder` begins with nothing; `healthy()` is a small keystore in which every property holds and each has something
to speak of, so that a test states only what it changes. `random_system(seed)` is a healthy one in which everything
may be otherwise, to a degree that is drawn too: all-random keystores violate everything and prove little.
"""

from __future__ import annotations

import random
from collections.abc import Collection, Iterator, Sequence
from datetime import datetime, timedelta, timezone
from itertools import product

from msgspec import Struct, field, structs
from msgspec.structs import replace

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.findings import Location
from keystore_audit.keystore.typed import ProtectionKind
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.system import (
    CertificateAtom,
    ChannelAtom,
    DocumentAtom,
    DomainAtom,
    DomainRuleAtom,
    GrantAtom,
    Participant,
    ParticipantKind,
    Reading,
    RuleAtom,
    System,
    TopicRuleAtom,
    TrustDomainAtom,
)

INSTANTS = 5
"""Instants of every system; the audit is at the middle one unless said."""

STRONG = ProtectionKind.ENCRYPT_WITH_ORIGIN_AUTHENTICATION


class Builder(Struct):
    """A system in the making: each method adds an atom and returns its index."""

    pins_signer: bool = True
    skips_grants_out_of_date: bool = True
    requires_grant: bool = False
    joins_out_of_date: bool = False
    asks_announced_only: bool = False
    assumed: frozenset[Assumption] = EVERY
    may: bool = False
    now: int = 2
    certificates: list[CertificateAtom] = field(default_factory=list)
    documents: list[DocumentAtom] = field(default_factory=list)
    trust_domains: list[TrustDomainAtom] = field(default_factory=list)
    enclaves: list[Participant] = field(default_factory=list)
    domains: list[DomainAtom] = field(default_factory=list)
    channels: list[ChannelAtom] = field(default_factory=list)
    domain_rules: list[DomainRuleAtom] = field(default_factory=list)
    topic_rules: list[TopicRuleAtom] = field(default_factory=list)
    grants: list[GrantAtom] = field(default_factory=list)
    rules: list[RuleAtom] = field(default_factory=list)

    def certificate(
        self,
        issuers: Collection[int] | None = None,
        *,
        authority: bool = False,
        fit_to_sign: bool = True,
        key: int | None = None,
        not_before: int = 0,
        not_after: int = INSTANTS - 1,
        label: str | None = None,
        place: str | None = None,
    ) -> int:
        """`issuers`: None for itself alone; `key`: None for one of its own."""
        index = len(self.certificates)
        self.certificates.append(
            CertificateAtom(
                label=label or f"certificate {index}",
                location=Location(path=place or f"{index}.cert.pem"),
                issuers=frozenset({index} if issuers is None else issuers),
                authority=authority,
                fit_to_sign=fit_to_sign,
                key=100 + index if key is None else key,
                not_before=not_before,
                not_after=not_after,
            )
        )
        return index

    def document(
        self,
        signers: Collection[int],
        *,
        intact: bool = True,
        opaque: bool = False,
        label: str | None = None,
        place: str | None = None,
    ) -> int:
        index = len(self.documents)
        self.documents.append(
            DocumentAtom(
                label=label or f"document {index}",
                location=Location(path=place or f"{index}.p7s"),
                intact=intact,
                signers=frozenset(signers),
                opaque=opaque,
            )
        )
        return index

    def trust_domain(
        self,
        identity_ca: Collection[int],
        permissions_ca: Collection[int],
        governance: int | None,
    ) -> int:
        self.trust_domains.append(
            TrustDomainAtom(
                identity_ca=frozenset(identity_ca),
                permissions_ca=frozenset(permissions_ca),
                governance=governance,
                revoked=frozenset(),
            )
        )
        return len(self.trust_domains) - 1

    def unread(self, trust_domain: int) -> None:
        """The CA files of the trust domain could not be read, and so neither what they say of documents."""
        number = self.certificate((), fit_to_sign=False)
        self.certificates[number] = replace(self.certificates[number], opaque=True)
        unread = frozenset({number})
        governance = self.document((), intact=False, opaque=True)
        self.trust_domains[trust_domain] = TrustDomainAtom(
            identity_ca=unread, permissions_ca=unread, governance=governance, revoked=frozenset()
        )

    def enclave(
        self,
        trust_domain: int,
        identity: int | None,
        permissions: int | None,
        *,
        opaque: bool = False,
        label: str | None = None,
    ) -> int:
        index = len(self.enclaves)
        label = label or f"/enclave_{index}"
        self.enclaves.append(
            Participant(
                label=label,
                location=Location(path=f"enclaves{label}"),
                trust_domain=trust_domain,
                identity=identity,
                permissions=frozenset(() if permissions is None else (permissions,)),
                kind=ParticipantKind.UNREAD if opaque else ParticipantKind.ENCLAVE,
            )
        )
        return index

    def domain(self, low: int, high: int) -> int:
        self.domains.append(DomainAtom(label=f"domains {low} to {high}", intervals=((low, high),)))
        return len(self.domains) - 1

    def channel(self, domain: int, topic: str, partition: str = "", *, infinite: bool = False) -> int:
        self.channels.append(
            ChannelAtom(domain=domain, topic=topic, partition=partition, ros=topic.startswith("rt/"), infinite=infinite)
        )
        return len(self.channels) - 1

    def domain_rule(
        self,
        document: int,
        domains: Collection[int],
        *,
        allow_unauthenticated_participants: bool = False,
        enable_join_access_control: bool = True,
        discovery: ProtectionKind = STRONG,
        rtps: ProtectionKind = STRONG,
    ) -> int:
        index = len(self.domain_rules)
        self.domain_rules.append(
            DomainRuleAtom(
                document=document,
                domains=frozenset(domains),
                allow_unauthenticated_participants=allow_unauthenticated_participants,
                enable_join_access_control=enable_join_access_control,
                discovery_protection_kind=discovery,
                liveliness_protection_kind=STRONG,
                rtps_protection_kind=rtps,
                location=Location(path=f"{document}.p7s", line=10 + index),
            )
        )
        return index

    def topic_rule(
        self,
        domain_rule: int,
        channels: Collection[int],
        *,
        enable_discovery_protection: bool = True,
        enable_read_access_control: bool = True,
        enable_write_access_control: bool = True,
        metadata: ProtectionKind = STRONG,
        data: ProtectionKind = ProtectionKind.ENCRYPT,
    ) -> int:
        index = len(self.topic_rules)
        self.topic_rules.append(
            TopicRuleAtom(
                domain_rule=domain_rule,
                channels=frozenset(channels),
                enable_discovery_protection=enable_discovery_protection,
                enable_liveliness_protection=True,
                enable_read_access_control=enable_read_access_control,
                enable_write_access_control=enable_write_access_control,
                metadata_protection_kind=metadata,
                data_protection_kind=data,
                location=Location(path=f"{self.domain_rules[domain_rule].document}.p7s", line=100 + index),
            )
        )
        return index

    def grant(
        self,
        document: int,
        names: Collection[int],
        *,
        not_before: int = 0,
        not_after: int = INSTANTS - 1,
        default_allow: bool = False,
    ) -> int:
        index = len(self.grants)
        self.grants.append(
            GrantAtom(
                document=document,
                names=frozenset(names),
                not_before=not_before,
                not_after=not_after,
                default_allow=default_allow,
                location=Location(path=f"{document}.p7s", line=10 + index),
            )
        )
        return index

    def rule(
        self,
        grant: int,
        domains: Collection[int],
        *,
        publish: Collection[int] = (),
        subscribe: Collection[int] = (),
        relay: Collection[int] = (),
        allow: bool = True,
    ) -> int:
        index = len(self.rules)
        self.rules.append(
            RuleAtom(
                grant=grant,
                allow=allow,
                domains=frozenset(domains),
                publish=frozenset(publish),
                subscribe=frozenset(subscribe),
                relay=frozenset(relay),
                location=Location(path=f"{self.grants[grant].document}.p7s", line=100 + index),
            )
        )
        return index

    def system(self) -> System:
        start = datetime(2020, 1, 1, tzinfo=timezone.utc)
        return System(
            profiles=("spec",),
            readings=(
                Reading(
                    pins_signer=self.pins_signer,
                    skips_grants_out_of_date=self.skips_grants_out_of_date,
                    requires_grant=self.requires_grant,
                    joins_out_of_date=self.joins_out_of_date,
                    asks_announced_only=self.asks_announced_only,
                ),
            ),
            assumed=self.assumed,
            may=self.may,
            instants=tuple(start + timedelta(days=365 * number) for number in range(INSTANTS)),
            now=self.now,
            certificates=tuple(self.certificates),
            documents=tuple(self.documents),
            trust_domains=tuple(self.trust_domains),
            enclaves=tuple(self.enclaves),
            domains=tuple(self.domains),
            channels=tuple(self.channels),
            domain_rules=tuple(self.domain_rules),
            topic_rules=tuple(self.topic_rules),
            grants=tuple(self.grants),
            rules=tuple(self.rules),
        )


IDENTITY_CA, PERMISSIONS_CA, TALKER_IDENTITY, LISTENER_IDENTITY = range(4)
GOVERNANCE, TALKER_PERMISSIONS, LISTENER_PERMISSIONS = range(3)
TALKER, LISTENER = range(2)
CHATTER, OTHER_TOPIC = range(2)


def healthy_builder() -> Builder:
    """The talker publishes rt/chatter, the listener subscribes to it; every property holds."""
    b = Builder()
    b.certificate(authority=True, label="public/identity_ca.cert.pem")
    b.certificate(authority=True, label="public/permissions_ca.cert.pem")
    b.certificate([IDENTITY_CA], label="/talker")
    b.certificate([IDENTITY_CA], label="/listener")
    b.document([PERMISSIONS_CA], label="enclaves/governance.p7s")
    b.document([PERMISSIONS_CA], label="enclaves/talker/permissions.p7s")
    b.document([PERMISSIONS_CA], label="enclaves/listener/permissions.p7s")
    b.trust_domain([IDENTITY_CA], [PERMISSIONS_CA], GOVERNANCE)
    b.enclave(0, TALKER_IDENTITY, TALKER_PERMISSIONS, label="/talker")
    b.enclave(0, LISTENER_IDENTITY, LISTENER_PERMISSIONS, label="/listener")
    b.domain(0, 0)
    b.channel(0, "rt/chatter")
    b.channel(0, "any", infinite=True)
    b.domain_rule(GOVERNANCE, [0])
    b.topic_rule(0, [CHATTER, OTHER_TOPIC])
    b.grant(TALKER_PERMISSIONS, [TALKER_IDENTITY])
    b.rule(0, [0], publish=[CHATTER])
    b.grant(LISTENER_PERMISSIONS, [LISTENER_IDENTITY])
    b.rule(1, [0], subscribe=[CHATTER])
    return b


def healthy() -> System:
    return healthy_builder().system()


def stock() -> System:
    """Talker and listener as `ros2 security` makes them: one CA for both roles, and its default governance."""
    b = healthy_builder()
    b.certificates.clear()
    b.documents.clear()
    b.trust_domains.clear()
    ca = b.certificate(authority=True, label="CN=sros2CA", place="public/ca.cert.pem")
    for number, enclave in enumerate(b.enclaves):
        place = f"enclaves{enclave.label}/cert.pem"
        identity = b.certificate([ca], label=f"CN={enclave.label}", place=place, key=number)
        b.enclaves[number] = replace(enclave, identity=identity, location=Location(path=f"enclaves{enclave.label}"))
    places = ["enclaves/governance.p7s", *(f"enclaves{enclave.label}/permissions.p7s" for enclave in b.enclaves)]
    for place in places:
        b.document([ca], label=place, place=place)
    b.trust_domain([ca], [ca], GOVERNANCE)
    encrypt = ProtectionKind.ENCRYPT
    b.domain_rules[0] = replace(
        b.domain_rules[0],
        discovery_protection_kind=encrypt,
        liveliness_protection_kind=encrypt,
        rtps_protection_kind=ProtectionKind.SIGN,
        location=Location(path=places[GOVERNANCE], line=6),
    )
    b.topic_rules[0] = replace(
        b.topic_rules[0],
        metadata_protection_kind=encrypt,
        data_protection_kind=encrypt,
        location=Location(path=places[GOVERNANCE], line=20),
    )
    for number, grant in enumerate(b.grants):
        place = places[grant.document]
        b.grants[number] = replace(grant, names=frozenset({1 + number}), location=Location(path=place, line=6))
        b.rules[number] = replace(b.rules[number], location=Location(path=place, line=13))
    return b.system()


def random_system(seed: int) -> System:
    """A small well-formed system drawn from `seed`: every kind of atom and fact of docs/model.md can occur."""
    return _Chance(seed).system()


class _Chance:
    """Draws a system. `odd(p)`: whether something departs from a healthy keystore; more so in some systems."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.mess = self.random.choice([0.0, 0.05, 0.15, 0.4, 1.0])
        may = self.random.random() < 0.5
        self.b = Builder(
            pins_signer=self.random.random() < 0.6,
            skips_grants_out_of_date=self.random.random() < 0.5,
            requires_grant=self.random.random() < 0.3,
            may=may,
            now=2 if not self.odd() else self.random.randrange(INSTANTS),
        )
        self.opaque = 0.1 if may and self.random.random() < 0.4 else 0.0
        self.weak = self.random.random() < 0.3

    def odd(self, probability: float = 0.5) -> bool:
        return self.random.random() < self.mess * probability

    def some(self, items: Sequence[int], probability: float = 0.5) -> list[int]:
        return [item for item in items if self.random.random() < probability]

    def system(self) -> System:
        self.trust()
        self.topics()
        for document in sorted(
            {trust_domain.governance for trust_domain in self.b.trust_domains if trust_domain.governance is not None}
        ):
            self.governance(document)
        for document in range(len(self.b.documents)):
            self.permissions(document)
        self.liveliness()
        self.unread()
        self.permissions_cas()
        return self.b.system()

    def liveliness(self) -> None:
        """Drawn last: what was drawn before stays as it is."""
        b, kinds = self.b, list(ProtectionKind)
        if not self.odd():
            return
        b.domain_rules = [
            replace(rule, liveliness_protection_kind=self.random.choice(kinds)) for rule in b.domain_rules
        ]
        b.topic_rules = [
            replace(rule, enable_liveliness_protection=self.random.random() < 0.5) for rule in b.topic_rules
        ]

    def unread(self) -> None:
        """A trust domain whose CA files could not be read: drawn last as well."""
        if self.opaque and self.random.random() >= 0.5:
            self.b.unread(self.random.randrange(len(self.b.trust_domains)))

    def permissions_cas(self) -> None:
        """What trust domains tell of their permissions CAs, where it is compared: drawn after all others."""
        if self.odd(0.4):
            told = [0, 1, None] if self.b.may else [0, 1]
            self.b.trust_domains = [
                replace(trust_domain, told=self.random.choice(told)) for trust_domain in self.b.trust_domains
            ]
        if self.odd(0.4):
            refused = frozenset(n for n in range(len(self.b.certificates)) if self.odd())
            self.b.trust_domains = [
                replace(trust_domain, refuses=refused) if self.odd(0.5) else trust_domain
                for trust_domain in self.b.trust_domains
            ]

    def dates(self) -> tuple[int, int]:
        if not self.odd(0.3):
            return 0, INSTANTS - 1
        low, high = self.random.randrange(INSTANTS), self.random.randrange(INSTANTS)
        return (low, high) if self.odd(0.2) else (min(low, high), max(low, high))

    def trust(self) -> None:
        """Authorities, identities, documents, trust domains and enclaves."""
        b = self.b
        for _ in range(self.random.randint(1, 3)):
            low, high = self.dates()
            b.certificate(authority=not self.odd(0.2), fit_to_sign=not self.odd(), not_before=low, not_after=high)
        authorities = list(range(len(b.certificates)))
        governances = [self.document(authorities[-1:]) for _ in range(1 + self.odd(0.4))]
        for _ in range(1 + self.odd() + self.odd()):
            self.trust_domain(authorities, governances)
        for _ in range(self.random.randint(1, 4)):
            self.member(authorities)
        everybody = range(len(b.certificates))
        if self.odd(0.4):
            trust_domain = b.trust_domains[0]
            b.trust_domains[0] = TrustDomainAtom(
                identity_ca=trust_domain.identity_ca,
                permissions_ca=trust_domain.permissions_ca,
                governance=trust_domain.governance,
                revoked=frozenset(self.some(everybody, 0.3)),
            )

    def document(self, usual: Sequence[int]) -> int:
        signers: Collection[int] = usual
        if self.odd(0.4):
            signers = self.some(range(len(self.b.certificates)))
        opaque = self.random.random() < self.opaque
        return self.b.document(signers, intact=not self.odd(0.2), opaque=opaque)

    def trust_domain(self, authorities: Sequence[int], governances: Sequence[int]) -> None:
        identity_ca: Collection[int] = authorities[:1]
        permissions_ca: Collection[int] = authorities[-1:]
        if self.odd(0.4):
            identity_ca, permissions_ca = self.some(authorities), self.some(authorities)
        governance = None if self.odd(0.1) else self.random.choice(governances)
        self.b.trust_domain(identity_ca, permissions_ca, governance)

    def member(self, authorities: Sequence[int]) -> None:
        b = self.b
        low, high = self.dates()
        trust_domain = self.random.randrange(len(b.trust_domains))
        issuers: Collection[int] = authorities[:1]
        if self.odd(0.3):
            issuers = self.some(range(len(b.certificates)))
        identity = b.certificate(
            issuers,
            authority=self.odd(0.1),
            fit_to_sign=self.random.random() < 0.6,
            key=100 + self.random.randrange(len(b.certificates)) if self.odd(0.3) else None,
            not_before=low,
            not_after=high,
        )
        permissions = self.document(authorities[-1:])
        if self.odd(0.1):
            permissions = self.random.randrange(len(b.documents))
        b.enclave(
            trust_domain,
            None if self.odd(0.1) else identity,
            None if self.odd(0.1) else permissions,
            opaque=self.random.random() < self.opaque,
        )

    def topics(self) -> None:
        b = self.b
        for number in range(self.random.randint(1, 2)):
            b.domain(number, number)
        for number in range(self.random.randint(1, 4)):
            b.channel(self.random.randrange(len(b.domains)), f"rt/topic_{number}")

    def kind(self, usual: ProtectionKind) -> ProtectionKind:
        if self.weak:
            return self.random.choice([ProtectionKind.NONE, ProtectionKind.NONE, ProtectionKind.SIGN])
        return self.random.choice(list(ProtectionKind)) if self.odd(0.7) else usual

    def governance(self, document: int) -> None:
        b = self.b
        domains, channels = range(len(b.domains)), range(len(b.channels))
        origin = STRONG if self.random.random() < 0.5 else ProtectionKind.ENCRYPT
        for _ in range(self.random.randint(1, 2)):
            domain_rule = b.domain_rule(
                document,
                domains if not self.odd() else self.some(domains, 0.6),
                allow_unauthenticated_participants=self.odd(0.3),
                enable_join_access_control=not self.odd(0.4),
                discovery=self.kind(ProtectionKind.ENCRYPT),
                rtps=self.kind(origin),
            )
            for _ in range(self.random.randint(1, 3)):
                b.topic_rule(
                    domain_rule,
                    channels if not self.odd() else self.some(channels, 0.6),
                    enable_discovery_protection=not self.odd(0.3),
                    enable_read_access_control=not self.odd(0.3),
                    enable_write_access_control=not self.odd(0.3),
                    metadata=self.kind(origin),
                    data=self.kind(ProtectionKind.ENCRYPT),
                )

    def permissions(self, document: int) -> None:
        """Grants of a document, and now and then of a governance document, where they must not matter."""
        b = self.b
        holders = [e.identity for e in b.enclaves if document in e.permissions and e.identity is not None]
        if not holders and not self.odd(0.3):
            return
        domains, channels = range(len(b.domains)), range(len(b.channels))
        for _ in range(1 + self.odd() + self.odd()):
            low, high = self.dates()
            names = holders if not self.odd(0.4) else self.some(range(len(b.certificates)))
            grant = b.grant(document, names, not_before=low, not_after=high, default_allow=self.odd(0.2))
            for _ in range(self.random.randint(0, 3)):
                b.rule(
                    grant,
                    self.some(domains, 0.8),
                    allow=self.random.random() < 0.7,
                    publish=self.some(channels, 0.4),
                    subscribe=self.some(channels, 0.4),
                    relay=self.some(channels, 0.1),
                )


def lively(system: System, seed: int) -> System:
    """The same system with more grants, so that data flows: every grant ends with rules drawn from `seed`."""
    chance = random.Random(f"lively {seed}")
    rules = list(system.rules)
    everywhere = frozenset(range(len(system.domains)))
    for number, grant in enumerate(system.grants):
        named = [frozenset(c for c in range(len(system.channels)) if chance.random() < 0.45) for _ in range(2)]
        rules.append(
            RuleAtom(
                grant=number,
                allow=True,
                domains=everywhere,
                publish=named[0],
                subscribe=named[1],
                relay=frozenset(),
                location=Location(path=grant.location.path, line=900 + number),
            )
        )
    return replace(system, rules=tuple(rules))


def with_claims(system: System, seed: int, count: int = 4) -> System:
    """The same system with claims drawn from `seed`, of all kinds; some have an empty place, as in MUST.

    In every third one enclaves read and write what peers need not concede, in every tenth their own implementations
    refuse it. In every fifth one grants name somebody who is no enclave here.
    """
    system = _named_elsewhere(system, seed) if seed % 5 == 2 else system
    chance = random.Random(f"claims {seed}")
    claims = tuple(_random_claim(system, chance, number) for number in range(count))
    enclaves = _alone(system, seed) if seed % 3 == 0 else system.enclaves
    enclaves = _refused(enclaves, system, seed) if seed % 10 == 7 else enclaves
    return judging(replace(system, claims=claims, enclaves=enclaves), joins_out_of_date=seed % 10 == 4)


def mixed(system: System, seed: int) -> System:
    """A fleet of two implementations: the other one reads some of the documents otherwise, and some enclaves run it."""
    chance = random.Random(f"mixed {seed}")
    documents, domain_rules, topic_rules, grants, rules = (
        getattr(system, sort) for sort in ("documents", "domain_rules", "topic_rules", "grants", "rules")
    )
    other = Reading(**{name: chance.random() < 0.5 for name in _FLAGS})

    def lost() -> bool:
        return chance.random() < 0.25

    copies = [
        replace(
            each, reading=1, intact=each.intact and not lost(), signers=frozenset(s for s in each.signers if not lost())
        )
        for each in documents
    ]
    further = len(documents)
    own = [{**trust, "reading": 1} for trust in map(structs.asdict, system.trust_domains)]
    for each in own:
        each["governance"] = None if each["governance"] is None else each["governance"] + further
    count = len(system.trust_domains)
    return replace(
        system,
        readings=(*system.readings, other),
        documents=(*documents, *copies),
        trust_domains=(*system.trust_domains, *(TrustDomainAtom(**each) for each in own)),
        enclaves=tuple(
            replace(
                each,
                trust_domain=each.trust_domain + count * (chance.random() < 0.5),
                permissions=each.permissions | {n + further for n in each.permissions},
            )
            for each in system.enclaves
        ),
        domain_rules=(*domain_rules, *(replace(each, document=each.document + further) for each in domain_rules)),
        topic_rules=(
            *topic_rules,
            *(replace(each, domain_rule=each.domain_rule + len(domain_rules)) for each in topic_rules),
        ),
        grants=(
            *grants,
            *(
                replace(each, document=each.document + further, default_allow=each.default_allow ^ lost())
                for each in grants
            ),
        ),
        rules=(*rules, *(replace(each, grant=each.grant + len(grants), allow=each.allow ^ lost()) for each in rules)),
    )


_FLAGS = ("pins_signer", "skips_grants_out_of_date", "requires_grant", "joins_out_of_date", "asks_announced_only")


def judging(system: System, **flags: bool) -> System:
    """The same system, with implementations of which this is true."""
    return replace(system, readings=tuple(replace(each, **flags) for each in system.readings))


def _some(system: System, chance: random.Random, share: float) -> frozenset[int]:
    return frozenset(channel for channel in range(len(system.channels)) if chance.random() < share)


def _named_elsewhere(system: System, seed: int) -> System:
    chance = random.Random(f"elsewhere {seed}")
    number = len(system.certificates)
    issuers = frozenset[int]().union(*(trust_domain.identity_ca for trust_domain in system.trust_domains))
    made = replace(
        system.certificates[0], label="somebody else", issuers=issuers, authority=False, fit_to_sign=False, key=9_999
    )
    named = {grant for grant in range(len(system.grants)) if chance.random() < 0.4}
    return replace(
        system,
        certificates=(*system.certificates, made),
        grants=tuple(
            replace(grant, names=grant.names | {number}) if place in named else grant
            for place, grant in enumerate(system.grants)
        ),
        trust_domains=tuple(
            replace(trust_domain, revoked=trust_domain.revoked | {number}) if chance.random() < 0.2 else trust_domain
            for trust_domain in system.trust_domains
        ),
    )


def _alone(system: System, seed: int) -> tuple[Participant, ...]:
    chance = random.Random(f"readers {seed}")
    read = [replace(each, reads_alone=_some(system, chance, 0.2)) for each in system.enclaves]
    both = [replace(each, writes_alone=_some(system, chance, 0.2)) for each in read]
    return tuple(replace(each, later=tuple(_changing(each, system, seed * 100 + n))) for n, each in enumerate(both))


def _changing(enclave: Participant, system: System, seed: int) -> Iterator[tuple[int, Participant]]:
    """What its own implementation lets it do from later moments on."""
    chance = random.Random(f"later {seed}")
    for moment in range(2 * system.now + 1, 2 * len(system.instants)):
        if chance.random() < 0.2:
            made = replace(enclave, reads_alone=_some(system, chance, 0.2))
            yield moment, replace(made, writes_alone=_some(system, chance, 0.2))


def _refused(enclaves: Sequence[Participant], system: System, seed: int) -> tuple[Participant, ...]:
    chance = random.Random(f"refused {seed}")
    return tuple(
        replace(each, refused_writes=_some(system, chance, 0.3), refused_reads=_some(system, chance, 0.3))
        for each in enclaves
    )


def _random_claim(system: System, chance: random.Random, number: int) -> ClaimAtom:
    def some(items: Sequence[object], probability: float) -> frozenset[int]:
        return frozenset(index for index in range(len(items)) if chance.random() < probability)

    def place() -> Place:
        kind = chance.random()
        if kind < 0.6:
            return Place(enclaves=some(system.enclaves, 0.4))
        return Place(channels=some(system.channels, 0.4)) if kind < 0.9 else Place(outsider=True)

    kind = chance.choice([ClaimKind.NO_FLOW, ClaimKind.NO_FLOW, ClaimKind.NO_FLOW, *ClaimKind])
    source, target = place(), place()
    attacker = chance.choice([Attacker.HONEST, Attacker.SOURCE, Attacker.RELAYS])
    if kind is ClaimKind.ABLE:
        attacker = Attacker.HONEST
    elif kind is not ClaimKind.NO_FLOW:
        enclaves = Place(enclaves=some(system.enclaves, 0.5))
        if kind is ClaimKind.ONLY_PUBLISH:
            enclaves = replace(enclaves, certificates=_permitted(system, number))
        source = enclaves if kind in (ClaimKind.ONLY_PUBLISH, ClaimKind.SEPARATE_DOMAINS) else Place()
        target = Place(channels=some(system.channels, 0.5))
        if kind is ClaimKind.SEPARATE_DOMAINS:
            target = Place(enclaves=some(system.enclaves, 0.4))
        attacker = chance.choice([Attacker.OUTSIDER, Attacker.INSIDER])
    flows = kind in (ClaimKind.NO_FLOW, ClaimKind.ABLE)
    pairs: tuple[tuple[Place, Place], ...] = ()
    if kind is ClaimKind.ABLE and chance.random() < 0.6:
        pairs = tuple(product(_apart(source), _apart(target)))
    starts = random.Random(f"{number} {sorted(source.enclaves)} {sorted(target.enclaves)}")
    return ClaimAtom(
        id=f"claim-{number}",
        kind=kind,
        attacker=attacker,
        source=source,
        target=target,
        through=some(system.enclaves, 0.15) if flows else frozenset(),
        left_out=some(system.channels, 0.15) if flows else frozenset(),
        until=None,
        location=Location(path="keystore-audit.toml", line=1 + number),
        starts=frozenset(
            (enclave, domain)
            for enclave in sorted(source.enclaves | target.enclaves)
            for domain in range(len(system.domains))
            if kind is ClaimKind.SEPARATE_DOMAINS and starts.random() < 0.3
        ),
        pairs=tuple((one, other) for one, other in pairs if one != other),
    )


def _permitted(system: System, number: int) -> frozenset[int]:
    chance = random.Random(f"permitted {number} {len(system.certificates)}")
    return frozenset(each for each in range(len(system.certificates)) if chance.random() < 0.4)


def _apart(place: Place) -> list[Place]:
    """Its enclaves one by one, and of its channels those with an even number and the others."""
    parts = [Place(enclaves=frozenset({enclave})) for enclave in sorted(place.enclaves)]
    halves = (frozenset(channel for channel in place.channels if channel % 2 == odd) for odd in (0, 1))
    parts += [Place(channels=half) for half in halves if half]
    return parts or [place]
