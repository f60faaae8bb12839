"""What is published and read by who is no enclave here, from the definitions (docs/model.md, Claims)."""

from __future__ import annotations

from collections.abc import Iterator

from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.attacker import TrustDomainView
from keystore_audit.model.formal.bit_sets import members, union
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System


def unread(s: System) -> bool:
    return any(document.opaque for document in s.documents)


def let_in(
    s: System, view: TrustDomainView, permissions: Permissions, trust_domain: int
) -> Iterator[tuple[int, int, dict[Operation, int]]]:
    """Who is no enclave here and is let in: certificate, domains that it joins, and rights, by its grants."""
    here, trust = {enclave.identity for enclave in s.enclaves}, s.trust_domains[trust_domain]
    for number, certificate in enumerate(s.certificates):
        vouching = (s.certificates[issuer] for issuer in certificate.issuers & trust.identity_ca)
        known = view.open or (number not in trust.revoked and any(issuer.authority for issuer in vouching))
        grants, admitting = permissions.chosen(number, view.accepted), permissions.admitting(number, view.accepted)
        if number in here or not known or not (admitting or unread(s)):
            continue
        joined = union(permissions.joins(grant) for grant in admitting)
        allowed = {each: [permissions.met(permissions.allowed(grant, each)) for grant in grants] for each in Operation}
        yield number, joined | ~view.protection.join_controlled, {each: union(sets) for each, sets in allowed.items()}


def signs_itself(s: System, trust_domain: int) -> bool:
    """Whether whoever has an identity of the CA signs permissions that peers take."""
    trust, below = s.trust_domains[trust_domain], set[int]()
    trusted = set(trust.permissions_ca)
    while not trusted <= below:
        below |= trusted
        issuing = {number for number in trusted if s.certificates[number].authority}
        trusted = {number for number, each in enumerate(s.certificates) if each.issuers & issuing}
    shared = (s.certificates[number] for number in trust.identity_ca & below)
    return not s.readings[trust.reading].pins_signer and any(each.authority for each in shared)


def published_elsewhere(
    s: System, view: TrustDomainView, permissions: Permissions, trust_domain: int, permitted: frozenset[int]
) -> set[int]:
    """What is published in the trust domain by who is no enclave here, with a grant or where none is asked
    for, and by anybody without an identity.

    `permitted`: certificates that do not count.
    """
    p, trust = view.protection, s.trust_domains[trust_domain]
    others = [each for each in let_in(s, view, permissions, trust_domain) if each[0] not in permitted]
    found = {*members(p.governed)} if signs_itself(s, trust_domain) else set()
    for channel in members(p.governed):
        domain = s.channels[channel].domain
        guards = p.metadata_authenticates | p.data_authenticates
        if p.unauthenticated >> domain & 1 and not guards >> channel & 1:
            found.add(channel)
        issuing = view.open or any(s.certificates[number].authority for number in trust.identity_ca)
        if issuing and not p.join_controlled >> domain & 1 and not p.write_controlled >> channel & 1:
            found.add(channel)
        for _number, domains, rights in others:
            writes = rights[Operation.PUBLISH] | ~p.write_controlled
            if unread(s) or (domains >> domain & 1 and writes >> channel & 1):
                found.add(channel)
    return found


def read_elsewhere(s: System, view: TrustDomainView, permissions: Permissions, trust_domain: int) -> set[int]:
    """What who is no enclave here reads without a grant to: with another grant, or with none."""
    p, doubt, trust = view.protection, unread(s), s.trust_domains[trust_domain]
    sealed = p.metadata_encrypts | p.data_encrypts
    issuing = view.open or any(s.certificates[number].authority for number in trust.identity_ca)
    found = {*members(p.governed)} if signs_itself(s, trust_domain) else set()
    for channel in members(p.governed):
        known = issuing and not p.join_controlled >> s.channels[channel].domain & 1
        if not (sealed | p.rtps_encrypts) >> channel & 1 or (known and not (p.read_controlled & sealed) >> channel & 1):
            found.add(channel)
    for number, domains, rights in let_in(s, view, permissions, trust_domain):
        genuine = permissions.chosen(number, view.genuine)
        entitled = union(permissions.met(permissions.allowed(grant, Operation.SUBSCRIBE)) for grant in genuine)
        for channel in members(p.governed):
            domain, bit = s.channels[channel].domain, 1 << channel
            joins = doubt or domains >> domain & 1
            bare = not bit & p.data_encrypts and (doubt or bit & (rights[Operation.RELAY] | ~p.metadata_encrypts))
            reader = not bit & p.read_controlled or (not doubt and bit & rights[Operation.SUBSCRIBE])
            if joins and (bare or reader) and (doubt or not bit & entitled):
                found.add(channel)
    return found
