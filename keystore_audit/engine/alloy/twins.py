"""Enclaves that are alike but for what is theirs alone: to exchange two of them, with what is theirs, changes no fact.

*Theirs* are the identity certificate and its key, the permissions document with grants and rules, and the channels that
belong to one of them. Each enclave gets a signature: all facts in which something of its own occurs, with its own
things called by their part in it, and everything else by its index. Equal signatures cannot speak of each other's own
things (each calls its own by a part), so exchanging two such enclaves is an automorphism of the system.
Which channels count as whose is a guess; a wrong one makes signatures differ that might be equal, nothing else.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.engine.alloy.mentions import Order, Said, surroundings
from keystore_audit.model.formal.system import EnclaveAtom, System

MAX_SHARERS: Final = 4
"""Enclaves that may have rules about a channel that still counts as one's own: itself and a few hubs."""

OWN: Final = -1
"""Stands for one's own certificate."""


class Twins(Struct, frozen=True, kw_only=True):
    """`classes`: enclaves that are alike, by index, each class in order. `own_channels`: by enclave."""

    classes: Sequence[Sequence[int]]
    own_channels: Mapping[int, Sequence[int]]


def find_twins(system: System, said: Sequence[Said]) -> Twins:
    """Return which enclaves are alike; those that share a certificate, a key or a document are like no other."""
    return _Twins(system, said).found()


class _Twins:
    def __init__(self, system: System, said: Sequence[Said]) -> None:
        self._system = system
        self._said = said
        self._around = surroundings(system)
        self._grants: dict[int | None, list[int]] = {}
        for number, grant in enumerate(system.grants):
            self._grants.setdefault(grant.document, []).append(number)
        self._joined: list[frozenset[int]] = [frozenset() for _ in system.grants]
        for rule in system.rules:
            if rule.allow:
                self._joined[rule.grant] |= rule.domains
        self._candidates = self._independent()
        self._owner = {
            grant: enclave
            for enclave in self._candidates
            for grant in self._grants.get(system.enclaves[enclave].permissions, ())
            if system.enclaves[enclave].permissions is not None
        }

    def found(self) -> Twins:
        """All classes, of one enclave or more."""
        mentioned: dict[int, list[int]] = {enclave: [] for enclave in self._candidates}
        sharers: list[set[int]] = []
        for channel, said in enumerate(self._said):
            about = {self._owner[grant] for part in said for grant in part if grant in self._owner}
            sharers.append(about)
            for enclave in about:
                mentioned[enclave].append(channel)
        own: dict[int, list[int]] = {enclave: [] for enclave in self._candidates}
        related = {channel for one, others in enumerate(self._system.meets) if others for channel in (one, *others)}
        for channel, about in enumerate(sharers):
            if about and len(about) <= MAX_SHARERS and channel not in related:
                first, *others = sorted(about, key=lambda enclave: len(mentioned[enclave]))
                if not others or len(mentioned[first]) < len(mentioned[others[0]]):
                    own[first].append(channel)
        naming = self._naming()
        classes: dict[Hashable, list[int]] = {}
        for enclave in self._candidates:
            signature = (
                self._trust(enclave, naming),
                self._documents(enclave),
                self._shared(enclave, mentioned[enclave], set(own[enclave])),
                frozenset(self._owned(enclave, channel) for channel in own[enclave]),
                tuple(
                    (enclave in claim.source.enclaves, enclave in claim.target.enclaves, enclave in claim.through)
                    for claim in self._system.claims
                ),
                tuple(
                    frozenset(domain for each, domain in claim.starts if each == enclave)
                    for claim in self._system.claims
                    if claim.starts
                ),
            )
            classes.setdefault(signature, []).append(enclave)
        return Twins(classes=tuple(classes.values()), own_channels=own)

    def _independent(self) -> dict[int, int]:
        """Enclaves whose certificate, key and document serve nobody and nothing else, with the certificate."""
        system = self._system
        identities = Counter(enclave.identity for enclave in system.enclaves)
        carried = Counter(enclave.permissions for enclave in system.enclaves)
        keys = Counter(certificate.key for certificate in system.certificates)
        bound = {c for realm in system.realms for c in (*realm.identity_ca, *realm.permissions_ca)}
        bound |= {c for document in system.documents for c in document.signers}
        bound |= {i for n, certificate in enumerate(system.certificates) for i in certificate.issuers if i != n}
        governing = {realm.governance for realm in system.realms} | {rule.document for rule in system.domain_rules}

        def independent(enclave: EnclaveAtom, identity: int) -> bool:
            if enclave.opaque or identity in bound or identities[identity] > 1:
                return False
            if keys[system.certificates[identity].key] > 1:
                return False
            permissions = enclave.permissions
            if permissions is None:
                return True
            alone = carried[permissions] == 1 and permissions not in governing
            return alone and not system.documents[permissions].opaque

        return {
            number: enclave.identity
            for number, enclave in enumerate(system.enclaves)
            if enclave.identity is not None and independent(enclave, enclave.identity)
        }

    def _naming(self) -> dict[int, list[int]]:
        """By certificate: the grants that name it."""
        naming: dict[int, list[int]] = {}
        for number, grant in enumerate(self._system.grants):
            for certificate in grant.names:
                naming.setdefault(certificate, []).append(number)
        return naming

    def _trust(self, enclave: int, naming: Mapping[int, Sequence[int]]) -> Hashable:
        """What is known of its certificate."""
        identity = self._candidates[enclave]
        certificate = self._system.certificates[identity]
        return (
            (self._system.enclaves[enclave].realm, self._system.enclaves[enclave].at_large),
            frozenset(OWN if issuer == identity else issuer for issuer in certificate.issuers),
            (certificate.authority, certificate.fit_to_sign, certificate.not_before, certificate.not_after),
            tuple((identity in realm.revoked, identity in realm.refuses) for realm in self._system.realms),
            frozenset(grant for grant in naming.get(identity, ()) if self._owner.get(grant) != enclave),
        )

    def _documents(self, enclave: int) -> Hashable:
        """Its document and its grants, apart from what these say of channels."""
        atom = self._system.enclaves[enclave]
        if atom.permissions is None:
            return None
        document = self._system.documents[atom.permissions]
        grants = [self._system.grants[number] for number in self._grants.get(atom.permissions, ())]
        joined = [self._joined[number] for number in self._grants.get(atom.permissions, ())]
        return (
            document.intact,
            document.signers,
            tuple(
                (
                    frozenset(OWN if name == atom.identity else name for name in grant.names),
                    (grant.not_before, grant.not_after, grant.default_allow),
                    domains,
                )
                for grant, domains in zip(grants, joined, strict=True)
            ),
        )

    def _shared(self, enclave: int, mentioned: Sequence[int], own: set[int]) -> Hashable:
        """What its grants say of channels that are not its own."""
        return frozenset((channel, self._own_words(enclave, channel)) for channel in mentioned if channel not in own)

    def _owned(self, enclave: int, channel: int) -> Hashable:
        """All that is known of a channel of its own."""
        grants = set(self._grants.get(self._system.enclaves[enclave].permissions, ()))
        others = tuple(
            frozenset((grant, order) for grant, order in part.items() if grant not in grants)
            for part in self._said[channel]
        )
        return self._around[channel], self._own_words(enclave, channel), others

    def _own_words(self, enclave: int, channel: int) -> tuple[tuple[Order | None, ...], ...]:
        """What its own grants say of a channel, by operation and in the order of its document."""
        grants = self._grants.get(self._system.enclaves[enclave].permissions, ())
        return tuple(tuple(part.get(grant) for grant in grants) for part in self._said[channel])
