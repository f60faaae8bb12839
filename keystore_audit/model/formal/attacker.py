"""What peers accept from an enclave, and what its keys let it do beyond its rights (docs/model.md).

Every question is about one trust domain: a peer's verdict depends on nothing else.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import cached_property

from keystore_audit.assumptions import Assumption
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.bit_sets import Abilities, bits, members, union
from keystore_audit.model.formal.permission import Permissions, Protection, open_protection, protection
from keystore_audit.model.formal.system import System


class TrustDomainView:
    """How the peers of one trust domain see every enclave. Sets of channels and domains are bit sets."""

    def __init__(self, system: System, trust_domain: int, permissions: Permissions) -> None:
        self._system, self._number = system, trust_domain
        self._trust_domain = system.trust_domains[trust_domain].at(permissions.moment)
        self._permissions, self.moment = permissions, permissions.moment
        self.reading = system.readings[self._trust_domain.reading]
        self.documents = permissions.documents.get(self._trust_domain.reading, {})
        self.refuses, governance = self._trust_domain.refuses, self._trust_domain.governance
        unread = governance is not None and system.documents[governance].opaque
        self.open = unread or Assumption.ROBOTS_ENFORCE not in system.assumed
        self._any_opaque = system.anything_granted
        self._rights: dict[tuple[int | None, Operation, bool], int] = {}
        self._self_granting: dict[int, bool] = {}
        self._abilities: dict[int, Abilities] = {}
        self._honest: dict[int, Abilities] = {}

    def vouched(self, pool: frozenset[int], certificate: int, *, in_force: bool) -> bool:
        """Whether an authority among `pool` issued the certificate, each within its validity if `in_force`."""
        subject = self._system.certificates[certificate]
        if in_force and not self._permissions.in_force(subject.not_before, subject.not_after):
            return False
        issuers = (self._system.certificates[number] for number in subject.issuers & pool)
        holds = self._permissions.in_force
        return any(i.authority and (not in_force or holds(i.not_before, i.not_after)) for i in issuers)

    def authenticated(self, enclave: int) -> bool:
        """Whether peers accept the enclave as one of their trust domain."""
        return self.open or self._system.anybody(enclave) or self.introduced(enclave)

    def introduced(self, enclave: int, *, in_force: bool = False) -> bool:
        """Whether the identity CA vouches for the enclave's identity."""
        identity = self._system.enclaves[enclave].identity
        return identity is not None and self._known(identity, in_force=in_force)

    def _known(self, certificate: int, *, in_force: bool = False) -> bool:
        pool = self._trust_domain.identity_ca
        return certificate not in self._trust_domain.revoked and self.vouched(pool, certificate, in_force=in_force)

    @cached_property
    def genuine(self) -> frozenset[int]:
        """Documents that the permissions CA itself signed."""
        documents, trusted = self.documents.items(), self._trust_domain.permissions_ca
        return frozenset(n for n, d in documents if d.intact and not d.opaque and d.signers and d.signers <= trusted)

    @cached_property
    def accepted(self) -> frozenset[int]:
        """Documents that peers take, opaque ones among them."""
        return frozenset(
            number
            for number, document in self.documents.items()
            if document.opaque
            or (document.intact and document.signers and all(self._may_sign(s) for s in document.signers))
        )

    def _may_sign(self, certificate: int) -> bool:
        if self.reading.pins_signer:
            return certificate in self._trust_domain.permissions_ca
        fit = self._system.certificates[certificate].fit_to_sign
        return fit and (certificate in self._trust_domain.permissions_ca or certificate in self._chained)

    @cached_property
    def _chained(self) -> frozenset[int]:
        """Certificates below the permissions CAs, over authorities that any document may bring along."""
        certificates = self._system.certificates
        found: set[int] = set()
        pending = set(self._trust_domain.permissions_ca)
        while pending:
            trusted = {number for number in pending if certificates[number].authority}
            issued = {number for number, c in enumerate(certificates) if c.issuers & trusted}
            pending = issued - found
            found |= pending
        return frozenset(found)

    def self_granting(self, enclave: int) -> bool:
        """Whether the enclave can sign itself permissions that peers take: with the CA's key, or one it vouches for."""
        if enclave not in self._self_granting:
            self._self_granting[enclave] = self._signs_for_itself(enclave)
        return self._self_granting[enclave]

    def _signs_for_itself(self, enclave: int) -> bool:
        if not (self.issuing(enclave) or self.authenticated(enclave)):
            return False
        unread = any(self._system.certificates[number].opaque for number in self._trust_domain.permissions_ca)
        if unread or self._system.anybody(enclave) or self._signed_elsewhere:
            return True
        key = self._system.key_of(enclave)
        return key in self.authority_keys or key in self.signing_keys

    @cached_property
    def signing_below(self) -> frozenset[int]:
        """Certificates below the permissions CAs whose keys sign what peers take, or certify one that does."""
        if self.reading.pins_signer:
            return frozenset()
        certificates = self._system.certificates
        return frozenset(n for n in self._chained if certificates[n].fit_to_sign or certificates[n].authority)

    @cached_property
    def signing_keys(self) -> frozenset[int]:
        """The keys of these certificates: any certificate of a key can be in the message."""
        return frozenset(self._system.certificates[number].key for number in self.signing_below)

    @cached_property
    def _signed_elsewhere(self) -> bool:
        """Whether somebody elsewhere signs for any enclave: some key is neither a permissions CA's nor an enclave's."""
        return bool(self.signing_keys - self.authority_keys - self._system.holders().keys())

    def issuing(self, enclave: int) -> bool:
        """Whether the enclave can issue itself any identity: its key is that of an identity CA."""
        return self._system.key_of(enclave) in self._issuing_keys

    @cached_property
    def _issuing_keys(self) -> frozenset[int]:
        certificates = self._system.certificates
        return frozenset(
            certificates[each].key for each in self._trust_domain.identity_ca if certificates[each].authority
        )

    @cached_property
    def authority_keys(self) -> frozenset[int]:
        """The keys of the permissions CAs."""
        return frozenset(self._system.certificates[authority].key for authority in self._trust_domain.permissions_ca)

    @cached_property
    def protection(self) -> Protection:
        """What the trust domain's governance protects."""
        if self.open:
            return open_protection(self._permissions)
        governance = self._trust_domain.governance
        applies = governance is not None and governance in self.accepted
        return protection(governance if applies else None, self._permissions)

    @cached_property
    def unauthenticated(self) -> int:
        """Governed channels on which readers accept whole messages that anybody can make."""
        p = self.protection
        # Those of unauthenticated participants are in the clear, whatever protects those of the others.
        return p.governed & (self._permissions.within(members(p.unauthenticated)) | ~p.rtps_authenticates)

    @cached_property
    def injectable(self) -> int:
        """Channels on which readers take samples made without any key."""
        p = self.protection
        return self.unauthenticated & ~(p.metadata_authenticates | p.data_authenticates)

    @cached_property
    def readable(self) -> int:
        """Channels whose payload is readable without any key."""
        p = self.protection
        return p.governed & ~(p.rtps_encrypts | p.metadata_encrypts | p.data_encrypts)

    def granted(self, enclave: int, operation: Operation) -> int:
        """Channels for which the permissions CA granted the enclave the right, or which meet such a channel."""
        return self._right(self._system.enclaves[enclave].identity, operation, genuine=True)

    def may_be_granted(self, enclave: int, operation: Operation) -> int:
        """Channels for which the permissions CA may have given the enclave the right.

        An opaque document may say so, and any grant may name an opaque enclave.
        """
        return self._held(enclave, operation, genuine=True)

    def presentable(self, enclave: int, operation: Operation) -> int:
        """Channels for which the enclave can present a document that peers take."""
        if self.self_granting(enclave):
            return self._permissions.all_channels
        rights = self._held(enclave, operation)
        return rights | self._anybodys(operation) if self.issuing(enclave) else rights

    def _anybodys(self, operation: Operation) -> int:
        """Channels for which some document that peers take grants the right to anybody."""
        grants = self._permissions.granting(self.accepted)
        return self._permissions.met(union(self._permissions.allowed(grant, operation) for grant in grants))

    def _unbounded(self, enclave: int) -> bool:
        """Whether it may have any right: by a document that it signs itself, or by an unread one."""
        return self._any_opaque or self._system.anybody(enclave) or self.self_granting(enclave)

    def _right(self, identity: int | None, operation: Operation, *, genuine: bool) -> int:
        key = (identity, operation, genuine)
        if key not in self._rights:
            documents = self.genuine if genuine else self.accepted
            grants = self._permissions.chosen(identity, documents)
            allowed = union(self._permissions.allowed(grant, operation) for grant in grants)
            self._rights[key] = self._permissions.shared(self._permissions.met(allowed))
        return self._rights[key]

    def joined(self, enclave: int) -> int:
        """Domains that the enclave can join."""
        anything, issuing = self._unbounded(enclave), self.issuing(enclave)
        return self._joined_with(enclave, self.accepted, anything=anything, issuing=issuing)

    def _joined_with(self, enclave: int, documents: frozenset[int], *, anything: bool, issuing: bool) -> int:
        """Domains that it can join with the grants of these documents alone, or with any (`anything`).

        `issuing`: with the grants of any identity that it can issue itself.
        """
        if self.open:
            return self._permissions.all_domains
        p = self.protection
        if not (issuing or self.authenticated(enclave)):
            return 0
        if anything:
            return p.ruled
        if issuing:
            return self._joined_by(self._permissions.granting(documents, admitting=True))
        return self._joined_by(self._permissions.admitting(self._system.enclaves[enclave].identity, documents))

    def _joined_by(self, grants: Collection[int]) -> int:
        """Domains that somebody of a known identity joins with these grants."""
        p = self.protection
        joined = ~p.join_controlled if grants or not self.reading.requires_grant else 0
        return p.ruled & (joined | union(map(self._permissions.joins, grants)))

    def abilities(self, enclave: int) -> Abilities:
        """What the enclave can do to the trust domain's channels; computed once."""
        if enclave not in self._abilities:
            rights = [self.presentable(enclave, operation) for operation in Operation]
            self._abilities[enclave] = self._able(self.joined(enclave), rights, *self._alone(enclave))
        return self._abilities[enclave]

    def honest(self, enclave: int) -> Abilities:
        """What it can do without an attack: as itself, and with documents that it did not sign for this purpose."""
        if not (self.self_granting(enclave) or self.issuing(enclave)):
            return self.abilities(enclave)
        if enclave not in self._honest:
            anything = self._any_opaque or self._system.anybody(enclave)
            rights = [self._held(enclave, operation) for operation in Operation]
            joined = self._joined_with(enclave, self.accepted, anything=anything, issuing=False)
            self._honest[enclave] = self._able(joined, rights, *self._alone(enclave))
        return self._honest[enclave]

    def _held(self, enclave: int, operation: Operation, *, genuine: bool = False) -> int:
        """Channels for which documents that are there give it the right, or may."""
        if self._any_opaque or self._system.anybody(enclave):
            return self._permissions.all_channels
        return self._right(self._system.enclaves[enclave].identity, operation, genuine=genuine)

    def written_as_itself(self, member: int) -> int:
        """What its own implementation may let an honest member write, whoever vouches for it."""
        free = self.protection.governed & ~self.protection.write_controlled
        return free | self._held(member, Operation.PUBLISH) | self._alone(member)[0]

    def _alone(self, enclave: int) -> tuple[int, int]:
        """What its own implementation lets a member write, and read."""
        atom = self._system.enclaves[enclave].at(self.moment)
        return (bits(atom.writes_alone), bits(atom.reads_alone)) if atom.trust_domain == self._number else (0, 0)

    def everybody(self) -> Iterator[Abilities]:
        """What each enclave can do."""
        return map(self.abilities, range(len(self._system.enclaves)))

    @cached_property
    def elsewhere(self) -> Mapping[int, Abilities]:
        """By certificate that no enclave here has: what its holder can do with the grants that name it."""
        here = {enclave.identity for enclave in self._system.enclaves}
        found = {}
        for number in range(len(self._system.certificates)):
            if number in here or not (self.open or self._known(number)):
                continue
            if self._any_opaque:
                found[number] = self._able(self.protection.ruled, [self._permissions.all_channels] * len(Operation))
            elif admitting := self._permissions.admitting(number, self.accepted):
                rights = [self._right(number, operation, genuine=False) for operation in Operation]
                found[number] = self._able(self._joined_by(admitting), rights)
        return found

    @cached_property
    def learnt_elsewhere(self) -> Mapping[int, int]:
        """By certificate that no enclave here has: channels that its holder learns without a grant to read.

        An unread document that lets it in may grant it only to join, or to relay, and nothing to read.
        """
        if self._any_opaque:
            free = ~self.protection.read_controlled
            return {number: able.overhears | able.may_read & free for number, able in self.elsewhere.items()}
        return {
            number: able.knows & ~(able.may_read & self._right(number, Operation.SUBSCRIBE, genuine=True))
            for number, able in self.elsewhere.items()
        }

    def entitled(self, enclave: int) -> int:
        """Channels that the enclave reads by a grant of the permissions CA, as far as is known."""
        return self.abilities(enclave).may_read & self.may_be_granted(enclave, Operation.SUBSCRIBE)

    @cached_property
    def joining_anybody(self) -> int:
        """Channels on which readers take samples from participants without any identity, who join their domain."""
        return self._permissions.within(members(self.protection.unauthenticated)) & self.injectable

    @cached_property
    def joining_known(self) -> int:
        """Channels on which readers take samples from any holder of an identity of the CA, whatever its grants."""
        free = self._unasked | ~self.protection.write_controlled
        return self._open_to_known & free | self.granted_by_known

    @cached_property
    def learnt_known(self) -> int:
        """Channels that anybody learns, or any holder of an identity of the CA, whatever its grants."""
        p = self.protection
        hidden = p.read_controlled & (p.data_encrypts | p.metadata_encrypts) & ~self._unasked
        return self._open_to_known & ~hidden | self.readable | self.granted_by_known

    @cached_property
    def granted_by_known(self) -> int:
        """Channels to which any holder of an identity of the CA can sign itself a right: that CA has both roles."""
        return self.protection.governed if self.issuing_signers else 0

    @cached_property
    def issuing_signers(self) -> frozenset[int]:
        """Identity CAs that are permissions CAs too, or chain to one, where signers are not pinned."""
        if self.reading.pins_signer:
            return frozenset()
        shared = self._trust_domain.identity_ca & (self._trust_domain.permissions_ca | self._chained)
        return frozenset(number for number in shared if self._system.certificates[number].authority)

    @cached_property
    def _open_to_known(self) -> int:
        """Channels of domains that holders of an identity of the CA can join: there are others than those here."""
        p, certificates = self.protection, self._system.certificates
        if not self.open and not any(certificates[number].authority for number in self._trust_domain.identity_ca):
            return 0
        return self._reach(p.ruled & ~p.join_controlled)

    def _able(self, joined: int, rights: Sequence[int], writes_alone: int = 0, reads_alone: int = 0) -> Abilities:
        """What somebody can do in these domains with these rights, by operation, and what its implementation adds."""
        published, subscribed, relayed = rights
        p = self.protection
        reach = self._reach(joined)
        writes = reach & (~p.write_controlled | published)
        reads = reach & (~p.read_controlled | subscribed)
        relays = reach & relayed
        unannounced = reach & self._unasked
        return Abilities(
            may_write=writes,
            may_read=reads,
            may_relay=relays,
            overhears=reach & ~p.data_encrypts & (~p.metadata_encrypts | relays) | unannounced,
            forges=reach
            & ~p.metadata_authenticates_origin
            & (~p.metadata_authenticates | reads | relays)
            & (~p.data_authenticates | reads)
            | unannounced,
            unannounced=unannounced,
            writes_at_all=writes | writes_alone,
            reads_at_all=reads | reads_alone,
        ).with_sets(self._permissions.shared)

    @cached_property
    def _unasked(self) -> int:
        """All channels, where permissions are asked only for what is announced as under access control."""
        truthful = Assumption.TRUTHFUL_ANNOUNCEMENTS in self._system.assumed
        return 0 if truthful or not self.reading.asks_announced_only else self._permissions.all_channels

    def _reach(self, joined: int) -> int:
        """The governed channels of these domains."""
        return self._permissions.within(members(joined)) & self.protection.governed

    def rights_with(self, enclave: int, documents: frozenset[int], *, anything: bool) -> tuple[int, int]:
        """What the enclave may write and read with the grants of these documents alone, or with any (`anything`).

        Only as itself: to issue itself another's identity is an attack.
        """
        p = self.protection
        published, subscribed = (self._permissions.all_channels,) * 2 if anything else (0, 0)
        for grant in self._permissions.chosen(self._system.enclaves[enclave].identity, documents):
            published |= self._permissions.allowed(grant, Operation.PUBLISH)
            subscribed |= self._permissions.allowed(grant, Operation.SUBSCRIBE)
        reach = self._reach(self._joined_with(enclave, documents, anything=anything, issuing=False))
        return reach & (~p.write_controlled | published), reach & (~p.read_controlled | subscribed)


def trust_domain_views(system: System, permissions: Permissions | None = None) -> list[TrustDomainView]:
    """How peers in each trust domain see every enclave. `permissions`: of another moment than the audit's."""
    permissions = permissions or Permissions(system)
    return [TrustDomainView(system, trust_domain, permissions) for trust_domain in range(len(system.trust_domains))]


def enclaves_views(system: System, permissions: Permissions | None = None) -> list[TrustDomainView]:
    """The same of the trust domains that have enclaves: how the keystore is meant to be used."""
    views = trust_domain_views(system, permissions)
    return [views[trust_domain] for trust_domain in system.trust_domains_of_enclaves()]
