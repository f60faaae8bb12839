"""Finds the lines of a keystore that a counterexample rests on: which rule decides, which grant gives.

This explains verdicts and makes none: an engine has decided, and here we look for what to show. Where nothing is found
the explanation is poorer, the verdict the same.
"""

from __future__ import annotations

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.formal.system import (
    CertificateAtom,
    DocumentAtom,
    DomainRuleAtom,
    GrantAtom,
    System,
    TopicRuleAtom,
)


class Right(Struct, frozen=True, kw_only=True):
    """A right that `document` gives; `location`: the rule that allows it, or the grant that does by default.

    `by_pattern`: it is one to be in a partition that is a pattern, which the channel's matches.
    """

    document: DocumentAtom
    location: Location
    by_pattern: bool = False


def governance(system: System, realm: int) -> DocumentAtom | None:
    """Return the governance document of a realm."""
    index = system.realms[realm].governance
    return None if index is None else system.documents[index]


def is_open(system: System, realm: int) -> bool:
    """Whether the governance of a realm could not be read, so that it may allow everything."""
    document = governance(system, realm)
    return document is not None and document.opaque


def domain_rule(system: System, realm: int, domain: int) -> DomainRuleAtom | None:
    """Return the domain rule that decides about a domain: the first that covers it."""
    document = system.realms[realm].governance
    covering = (rule for rule in system.domain_rules if rule.document == document and domain in rule.domains)
    return next(covering, None)


def topic_rule(system: System, realm: int, channel: int) -> TopicRuleAtom | None:
    """Return the topic rule that decides about a channel: the first that matches, of the deciding domain rule."""
    parent = domain_rule(system, realm, system.channels[channel].domain)
    if parent is None:
        return None
    index = system.domain_rules.index(parent)
    return next((rule for rule in system.topic_rules if rule.domain_rule == index and channel in rule.channels), None)


def rights(system: System, enclave: int, operation: Operation, channel: int) -> tuple[Right, ...]:
    """Return every right of an enclave to do `operation` on a channel, whoever signed the document that gives it.

    Rights about the channel itself come first, those to be in a partition that is a pattern for it last.
    """
    identity = system.enclaves[enclave].identity
    return () if identity is None else rights_by(system, identity, operation, channel)


def rights_by(system: System, identity: int, operation: Operation, channel: int) -> tuple[Right, ...]:
    """As `rights`, of whoever has the certificate."""
    meeting = [number for number, others in enumerate(system.meets) if channel in others]
    found = []
    chosen = _chosen(system, identity)
    for number, document in enumerate(system.documents):
        grant = chosen.get(number)
        if grant is None:
            continue
        for each in (channel, *meeting):
            location = _allowing(system, grant, operation, each)
            if location is not None:
                found.append(Right(document=document, location=location, by_pattern=each != channel))
                break
    return tuple(sorted(found, key=lambda right: right.by_pattern))


def lone_right(system: System, enclave: int, operation: Operation, channel: int) -> Location | None:
    """Return the line by which an enclave's own implementation lets it do what honest peers may refuse."""
    atom = system.enclaves[enclave]
    alone = {Operation.PUBLISH: atom.writes_alone, Operation.SUBSCRIBE: atom.reads_alone}.get(operation, frozenset())
    if channel not in alone:
        return None
    meeting = (number for number, others in enumerate(system.meets) if channel in others)
    for each in (channel, *meeting):
        for rule in system.rules:
            if rule.allow and each in rule.named(operation) and system.grants[rule.grant].document == atom.permissions:
                return system.place(rule, operation, each)
    return atom.location if atom.permissions is None else system.documents[atom.permissions].location


def signed_by_ca(system: System, realm: int, document: DocumentAtom) -> bool:
    """Whether the permissions CA of a realm, and nobody else, signed a document."""
    signers = document.signers
    return document.intact and not document.opaque and bool(signers) and signers <= system.realms[realm].permissions_ca


def opaque_document(system: System) -> DocumentAtom | None:
    """Return a document that could not be read, which may grant anything: one that governs nothing, if there is one."""
    governing = {realm.governance for realm in system.realms}
    opaque = [(number in governing, number) for number, document in enumerate(system.documents) if document.opaque]
    return system.documents[min(opaque)[1]] if opaque else None


def is_unread(system: System, authorities: frozenset[int]) -> bool:
    """Whether these authorities of a realm stand for whatever is in a CA file that could not be read."""
    return any(system.certificates[number].opaque for number in authorities)


def has_authority_key(system: System, realm: int, certificate: int | None) -> bool:
    """Whether the key of a certificate is that of a permissions CA of a realm."""
    keys = {system.certificates[each].key for each in system.realms[realm].permissions_ca}
    return certificate is not None and system.certificates[certificate].key in keys


def in_force(system: System, dated: CertificateAtom | GrantAtom) -> bool:
    """Whether the audit instant lies within the validity of a certificate or grant."""
    return dated.not_before <= system.now <= dated.not_after


def _chosen(system: System, certificate: int) -> dict[int, int | None]:
    """By document: the grant that decides about the certificate, None where that is one out of date."""
    chosen: dict[int, int | None] = {}
    for number, grant in enumerate(system.grants):
        counts = in_force(system, grant)
        if certificate in grant.names and (counts or not system.skips_grants_out_of_date):
            chosen.setdefault(grant.document, number if counts else None)
    return chosen


def _allowing(system: System, grant: int, operation: Operation, channel: int) -> Location | None:
    domain = system.channels[channel].domain
    for rule in system.rules:
        if rule.grant == grant and domain in rule.domains and channel in rule.named(operation):
            return system.place(rule, operation, channel) if rule.allow else None
    return system.grants[grant].location if system.grants[grant].default_allow else None
