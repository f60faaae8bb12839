"""Random systems in which enclaves have twins, and some of the twins are slightly different after all."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import TypeVar

from msgspec.structs import replace

from keystore_audit.model.formal.asked import ClaimAtom, Place
from keystore_audit.model.formal.system import ParticipantKind, RuleAtom, System, TrustDomainAtom
from tests.engine.systems import (
    CHATTER,
    GOVERNANCE,
    LISTENER_IDENTITY,
    PERMISSIONS_CA,
    TALKER_IDENTITY,
    healthy_builder,
    lively,
    random_system,
    with_claims,
)

Atom = TypeVar("Atom")

Change = Callable[[frozenset[int]], frozenset[int]]


def system_with_twins(seed: int) -> System:
    """A system drawn from `seed`, with claims, and with four or five copies of some of its enclaves.

    With an enclave go its certificate, key, document, grants and rules, and some of the channels about which it has
    rules. In most systems one fact is then changed about the last copy, which would be the first to be left out.
    """
    chance = random.Random(f"twins {seed}")
    system = random_system(seed) if chance.random() < 0.5 else _sound(chance)
    if chance.random() < 0.5:
        system = lively(system, seed)
    system = with_claims(system, seed)
    able = [n for n, atom in enumerate(system.enclaves) if atom.identity is not None and atom.permissions]
    for enclave in able:
        if chance.random() < 0.7:
            own = frozenset(c for c in _mentioned(system, enclave) if chance.random() < 0.6)
            for _ in range(chance.randint(4, 5)):
                system = _with_copy(system, enclave, own)
    return _otherwise(system, chance) if able and chance.random() < 0.8 else system


def _sound(chance: random.Random) -> System:
    """A system in which most properties hold, so that what is changed shows."""
    b = healthy_builder()
    b.pins_signer = chance.random() < 0.6
    b.skips_grants_out_of_date = chance.random() < 0.5
    b.requires_grant = chance.random() < 0.5
    b.domain(1, 1)
    b.channel(1, "rt/elsewhere")
    b.domain_rule(GOVERNANCE, [1])
    b.topic_rule(1, [2])
    b.rule(1, [0], publish=[CHATTER], allow=False)
    b.rule(0, [1], subscribe=[2] if chance.random() < 0.5 else [])
    stray = b.document([PERMISSIONS_CA])
    b.grant(stray, [chance.choice([TALKER_IDENTITY, LISTENER_IDENTITY])])
    b.rule(2, [0], subscribe=[CHATTER])
    return b.system()


def _mentioned(system: System, enclave: int) -> list[int]:
    """Channels about which its document has rules."""
    document = system.enclaves[enclave].document
    grants = {number for number, grant in enumerate(system.grants) if grant.document == document}
    rules = [rule for rule in system.rules if rule.grant in grants]
    return sorted({c for rule in rules for c in rule.publish | rule.subscribe | rule.relay})


def _with_copy(system: System, enclave: int, own: frozenset[int]) -> System:
    """The system with one more enclave like this one, with copies of the channels `own`."""
    atom = system.enclaves[enclave]
    if atom.identity is None or atom.document is None:
        return replace(system, enclaves=(*system.enclaves, atom))
    certificate, document = len(system.certificates), len(system.documents)
    theirs = system.certificates[atom.identity]
    issuers = frozenset(certificate if issuer == atom.identity else issuer for issuer in theirs.issuers)
    key = 1 + max(each.key for each in system.certificates)
    copies = {channel: len(system.channels) + place for place, channel in enumerate(sorted(own))}

    def also(members: frozenset[int]) -> frozenset[int]:
        return members | {copies[channel] for channel in members if channel in copies}

    grants = [number for number, grant in enumerate(system.grants) if grant.document == atom.document]
    numbers = {old: len(system.grants) + place for place, old in enumerate(grants)}
    named = [replace(g, names=g.names | {certificate} if atom.identity in g.names else g.names) for g in system.grants]
    copied = [
        replace(system.grants[g], document=document, names=_moved(system.grants[g].names, {atom.identity: certificate}))
        for g in grants
    ]
    for number in grants:
        named[number] = system.grants[number]
    return replace(
        system,
        certificates=(*system.certificates, replace(theirs, issuers=issuers, key=key)),
        documents=(*system.documents, system.documents[atom.document]),
        trust_domains=tuple(
            _revoking(trust_domain, atom.identity, certificate) for trust_domain in system.trust_domains
        ),
        enclaves=(*system.enclaves, replace(atom, identity=certificate, permissions=frozenset({document}))),
        channels=(*system.channels, *(system.channels[channel] for channel in sorted(own))),
        topic_rules=tuple(replace(rule, channels=also(rule.channels)) for rule in system.topic_rules),
        grants=(*named, *copied),
        rules=(
            *(rule if rule.grant in grants else _rule(rule, also) for rule in system.rules),
            *(
                replace(_rule(rule, lambda members: _moved(members, copies)), grant=numbers[rule.grant])
                for rule in system.rules
                if rule.grant in numbers
            ),
        ),
        claims=tuple(_claim(claim, enclave, len(system.enclaves), also) for claim in system.claims),
    )


def _moved(members: frozenset[int], copies: dict[int, int]) -> frozenset[int]:
    return frozenset(copies.get(member, member) for member in members)


def _rule(rule: RuleAtom, change: Change) -> RuleAtom:
    return replace(rule, publish=change(rule.publish), subscribe=change(rule.subscribe), relay=change(rule.relay))


def _revoking(trust_domain: TrustDomainAtom, certificate: int, copy: int) -> TrustDomainAtom:
    return (
        replace(trust_domain, revoked=trust_domain.revoked | {copy})
        if certificate in trust_domain.revoked
        else trust_domain
    )


def _claim(claim: ClaimAtom, enclave: int, copy: int, also: Change) -> ClaimAtom:
    def place(old: Place) -> Place:
        more = {copy} if enclave in old.enclaves else set()
        return replace(old, enclaves=old.enclaves | more, channels=also(old.channels))

    through = claim.through | {copy} if enclave in claim.through else claim.through
    return replace(
        claim, source=place(claim.source), target=place(claim.target), through=through, left_out=also(claim.left_out)
    )


def _otherwise(system: System, chance: random.Random) -> System:
    """The system with one fact changed about its last enclave, or about what is its own."""
    last = system.enclaves[-1]
    if last.identity is None or last.document is None:
        return system
    change = chance.choice(
        [_about_enclave, _about_certificate, _about_document, _about_grant, _about_rule, _about_place]
    )
    return change(system, chance, last.identity, last.document)


def _last(atoms: Sequence[Atom], **fields: object) -> tuple[Atom, ...]:
    return (*atoms[:-1], replace(atoms[-1], **fields))  # type: ignore[type-var]


def _at(atoms: Sequence[Atom], number: int, **fields: object) -> tuple[Atom, ...]:
    return tuple(replace(a, **fields) if n == number else a for n, a in enumerate(atoms))  # type: ignore[type-var]


def _about_enclave(system: System, chance: random.Random, identity: int, permissions: int) -> System:
    del identity, permissions
    kind = chance.randrange(5)
    if kind == 0:
        trust_domain = len(system.trust_domains)
        other = replace(system.trust_domains[0], governance=None)
        return replace(
            system,
            trust_domains=(*system.trust_domains, other),
            enclaves=_last(system.enclaves, trust_domain=trust_domain),
        )
    if kind == 1:
        return replace(system, may=True, enclaves=_last(system.enclaves, kind=ParticipantKind.UNREAD))
    if kind == 2:
        return replace(system, enclaves=_last(system.enclaves, permissions=frozenset()))
    field = chance.choice(["identity", "permissions"])
    return replace(system, enclaves=_last(system.enclaves, **{field: getattr(system.enclaves[0], field)}))


def _about_certificate(system: System, chance: random.Random, identity: int, permissions: int) -> System:
    del permissions
    kind = chance.randrange(7)
    if kind == 0:
        revoked = [
            replace(trust_domain, revoked=trust_domain.revoked ^ {identity}) for trust_domain in system.trust_domains
        ]
        return replace(system, trust_domains=tuple(revoked))
    if kind == 1:
        trusting = [
            replace(trust_domain, permissions_ca=trust_domain.permissions_ca | {identity})
            for trust_domain in system.trust_domains
        ]
        return replace(system, trust_domains=tuple(trusting))
    if kind == 2:
        number = chance.randrange(len(system.grants)) if system.grants else 0
        grants = _at(system.grants, number, names=frozenset({identity, system.enclaves[0].identity or 0}))
        return replace(system, grants=grants)
    fields: dict[str, object] = chance.choice(
        [
            {"key": system.certificates[system.enclaves[0].identity or 0].key},
            {"issuers": frozenset()},
            {"issuers": frozenset({system.enclaves[0].identity or 0})},
            {"issuers": frozenset(range(len(system.certificates)))},
            {"not_after": 0},
            {"authority": True, "fit_to_sign": True, "issuers": frozenset(range(3))},
            {"fit_to_sign": True, "issuers": frozenset(range(3))},
        ]
    )
    return replace(system, certificates=_at(system.certificates, identity, **fields))


def _about_document(system: System, chance: random.Random, identity: int, permissions: int) -> System:
    fields: dict[str, object] = chance.choice(
        [
            {"intact": False},
            {"signers": frozenset()},
            {"signers": frozenset({identity})},
            {"signers": frozenset({0})},
            {"opaque": True},
        ]
    )
    may = system.may or "opaque" in fields
    return replace(system, may=may, documents=_at(system.documents, permissions, **fields))


def _about_grant(system: System, chance: random.Random, identity: int, permissions: int) -> System:
    theirs = [number for number, grant in enumerate(system.grants) if grant.document == permissions]
    if not theirs:
        return system
    fields: dict[str, object] = chance.choice(
        [
            {"default_allow": True},
            {"default_allow": False},
            {"not_after": 0},
            {"not_before": 0, "not_after": 4},
            {"names": frozenset()},
            {"names": frozenset(range(len(system.certificates)))},
            {"names": frozenset({identity, 0})},
        ]
    )
    return replace(system, grants=_at(system.grants, chance.choice(theirs), **fields))


def _about_rule(system: System, chance: random.Random, identity: int, permissions: int) -> System:
    del identity
    theirs = [n for n, rule in enumerate(system.rules) if system.grants[rule.grant].document == permissions]
    if not theirs:
        return system
    number = chance.choice(theirs)
    channels = frozenset(c for c in range(len(system.channels)) if chance.random() < 0.4)
    fields: dict[str, object] = chance.choice(
        [
            {"publish": channels},
            {"subscribe": channels},
            {"relay": channels},
            {"allow": not system.rules[number].allow},
            {"allow": not system.rules[number].allow},
            {"allow": not system.rules[number].allow},
            {"publish": system.rules[number].subscribe, "subscribe": system.rules[number].publish},
            {"domains": frozenset()},
            {"domains": frozenset(range(len(system.domains)))},
        ]
    )
    return replace(system, rules=_at(system.rules, number, **fields))


def _about_place(system: System, chance: random.Random, identity: int, permissions: int) -> System:
    """A claim that names the last enclave alone, a domain or rule of governance that the last channel alone has."""
    del identity, permissions
    last = len(system.enclaves) - 1
    kind = chance.randrange(5)
    if kind == 0:
        *others, channel = system.channels
        return replace(system, channels=(*others, channel._replace(domain=chance.randrange(len(system.domains)))))
    if kind == 1 and system.topic_rules:
        number = chance.randrange(len(system.topic_rules))
        channels = system.topic_rules[number].channels ^ {len(system.channels) - 1}
        return replace(system, topic_rules=_at(system.topic_rules, number, channels=channels))
    place = Place(enclaves=frozenset({last})) if kind < 4 else Place(channels=frozenset({len(system.channels) - 1}))
    fields: dict[str, object] = chance.choice([{"source": place}, {"target": place}, {"through": frozenset({last})}])
    return replace(system, claims=_at(system.claims, chance.randrange(len(system.claims)), **fields))
