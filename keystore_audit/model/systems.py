"""Builds the `System`s of a keystore.

Evidence in, normalised facts out, one for each kind of implementation and reading.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import cached_property

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.governance import TopicRule
from keystore_audit.keystore.issuer import fit_to_sign
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.channels import Channels, RuleMatches, build_channels, covers_of, domain_classes
from keystore_audit.model.domains import Interval, contains, covered
from keystore_audit.model.doubt import identity_doubt, realm_doubt
from keystore_audit.model.inventory import (
    Document,
    certificates_of,
    dates_of,
    documents_of,
    embedded_authorities,
    instants_of,
)
from keystore_audit.model.profiles import Profile, Trust
from keystore_audit.model.system import (
    CertificateAtom,
    DocumentAtom,
    DomainRuleAtom,
    EnclaveAtom,
    GrantAtom,
    Reading,
    RealmAtom,
    RuleAtom,
    System,
    TopicRuleAtom,
)
from keystore_audit.model.trust import is_authority, may_have_issued
from keystore_audit.model.trust_view import TrustFiles, TrustViews, trust_files

MAX_ISSUER_CHECKS = 50_000
"""Pairs of certificate and authority whose signature is verified: five seconds at worst; 10,000 enclaves of one
keystore need 20,000."""


class SystemBuilder:
    """Everything about a keystore that does not depend on the kind of implementation, worked out once.

    Raises errors.BudgetExceeded where the topic classes are too many.
    """

    def __init__(self, keystore: Keystore, at: datetime) -> None:
        self._keystore = keystore
        self._at = at
        self._documents = documents_of(keystore)
        self._certificates = certificates_of(keystore, self._documents)
        self._number = {certificate.sha256: n for n, certificate in enumerate(self._certificates)}
        self._instants = instants_of(self._certificates, self._documents, at)
        self._topic_matches: dict[int, frozenset[int]] = {}
        self._rule_matches: dict[int, RuleMatches] = {}
        self._channels = self._classes()
        self._issuers = self._issue()
        self._typed: dict[object, _Typed] = {}
        self._doubts = [(identity_doubt(enclave) is not None, realm_doubt(enclave)) for enclave in keystore.enclaves]
        self._keys = {key: n for n, key in enumerate(dict.fromkeys(c.key for c in self._certificates))}
        self._views = TrustViews(keystore, self._documents, self._certificates)

    def _classes(self) -> Channels:
        """Domain classes and channels over all readable documents."""
        domain_rules = [
            rule for document in self._documents if document.governance for rule in document.governance.domain_rules
        ]
        topic_rules = [topic for rule in domain_rules for topic in rule.topic_rules]
        rules = [
            rule
            for document in self._documents
            if document.permissions
            for grant in document.permissions.grants
            for rule in grant.rules
        ]
        governed = [covered(rule.domains) for rule in domain_rules]
        domains = domain_classes([*governed, *covers_of(rules)])
        channels = build_channels(
            domains,
            [any(contains(cover, domain.intervals[0][0]) for cover in governed) for domain in domains],
            topic_rules,
            rules,
        )
        self._topic_matches = {id(rule): found for rule, found in zip(topic_rules, channels.topic_rules, strict=True)}
        self._rule_matches = {id(rule): found for rule, found in zip(rules, channels.rules, strict=True)}
        return channels

    def _issue(self) -> tuple[frozenset[int], ...]:
        """For each certificate, those of CA files and messages that issued it: names and signature, not dates."""
        authorities = {
            certificate.sha256
            for enclave in self._keystore.enclaves
            for file in (enclave.identity_ca, enclave.permissions_ca)
            if file is not None
            for certificate in file.certificates
        } | {certificate.sha256 for certificate in embedded_authorities(self._documents)}
        pool = [(n, c) for n, c in enumerate(self._certificates) if c.sha256 in authorities]
        if len(pool) * len(self._certificates) > MAX_ISSUER_CHECKS:
            raise BudgetExceeded(
                f"{len(self._certificates)} certificates under {len(pool)} authorities are more chains than can be "
                f"checked (limit {MAX_ISSUER_CHECKS})."
            )
        return tuple(
            frozenset(n for n, authority in pool if may_have_issued(authority, certificate))
            for certificate in self._certificates
        )

    def kinds(self, profiles: Sequence[Profile]) -> dict[Trust, tuple[str, ...]]:
        """The names of the profiles that read this keystore alike, under one of their trust rows."""
        return self._views.kinds(profiles)

    def build(self, trust: Trust, *, profiles: tuple[str, ...], reading: Reading) -> System:
        """The system as implementations with this trust row read it."""
        may = reading is Reading.MAY
        opaque = self._views.opaque(trust)
        documents = [d for d in self._documents if may or d.place not in opaque]
        number = {document.place: n for n, document in enumerate(documents)}
        atoms = [self._document_atom(document, trust, opaque=document.place in opaque) for document in documents]
        realms: dict[RealmAtom, int] = {}
        trusts: dict[TrustFiles, RealmAtom] = {}
        enclaves: list[EnclaveAtom] = []
        for enclave, (unknown, doubt) in zip(self._keystore.enclaves, self._doubts, strict=True):
            if unknown and not may:
                continue
            if doubt is not None:
                realm = _open_realm(atoms, doubt.location.path) if may else _CLOSED
            else:
                files = trust_files(enclave)
                realm = trusts.get(files) or trusts.setdefault(files, self._realm(enclave, number, trust))
            enclaves.append(
                EnclaveAtom(
                    label=enclave.path,
                    location=_place(enclave),
                    realm=realms.setdefault(realm, len(realms)),
                    identity=None if unknown else self._identity(enclave),
                    permissions=number.get(enclave.permissions.signed.file.place) if enclave.permissions else None,
                    opaque=unknown,
                )
            )
        if may:
            for place in unread_places(self._keystore):
                realm = _open_realm(atoms, place)
                enclaves.append(
                    EnclaveAtom(
                        label=f"whatever is behind {place}",
                        location=Location(path=place),
                        realm=realms.setdefault(realm, len(realms)),
                        identity=None,
                        permissions=None,
                        opaque=True,
                    )
                )
        domain_rules, topic_rules, grants, rules = self._typed_atoms(documents, trust)
        return System(
            profiles=profiles,
            pins_signer=trust.pins_signer,
            reading=reading,
            instants=self._instants,
            now=self._instants.index(self._at),
            certificates=self._certificate_atoms,
            documents=tuple(atoms),
            realms=tuple(realms),
            enclaves=tuple(enclaves),
            domains=self._channels.domains,
            channels=self._channels.channels,
            domain_rules=domain_rules,
            topic_rules=topic_rules,
            grants=grants,
            rules=rules,
        )

    def _document_atom(self, document: Document, trust: Trust, *, opaque: bool) -> DocumentAtom:
        signers = self._views.signers(document, trust) if not opaque else frozenset()
        return DocumentAtom(
            label=document.place,
            location=Location(path=document.place),
            intact=bool(signers),
            signers=signers,
            opaque=opaque,
        )

    def _realm(self, enclave: Enclave, number: dict[str, int], trust: Trust) -> RealmAtom:
        """What the enclave's verdict on peers depends on."""
        place = enclave.governance.signed.file.place if enclave.governance else None
        identity_ca, permissions_ca, revoked = self._views.authorities(enclave, trust)
        return RealmAtom(
            identity_ca=identity_ca,
            permissions_ca=permissions_ca,
            governance=number.get(place) if place else None,
            revoked=revoked,
        )

    def _identity(self, enclave: Enclave) -> int | None:
        first = enclave.certificate.first if enclave.certificate else None
        return None if first is None else self._number[first.sha256]

    @cached_property
    def _certificate_atoms(self) -> tuple[CertificateAtom, ...]:
        index = {instant: n for n, instant in enumerate(self._instants)}
        return tuple(
            CertificateAtom(
                label=certificate.subject,
                location=Location(path=certificate.path, line=certificate.line),
                issuers=self._issuers[n],
                authority=is_authority(certificate),
                fit_to_sign=fit_to_sign(certificate),
                key=self._keys[certificate.key],
                not_before=index[certificate.not_before],
                not_after=index[certificate.not_after],
            )
            for n, certificate in enumerate(self._certificates)
        )

    def _typed_atoms(self, documents: Sequence[Document], trust: Trust) -> _Typed:
        """What the documents say, the same objects for every kind of implementation that reads the same there."""
        names = self._views.names(trust)
        key = (tuple(document.place for document in documents), tuple(names.items()))
        if key not in self._typed:
            self._typed[key] = (*self._governance_atoms(documents), *self._permission_atoms(documents, names))
        return self._typed[key]

    def _governance_atoms(
        self, documents: Sequence[Document]
    ) -> tuple[tuple[DomainRuleAtom, ...], tuple[TopicRuleAtom, ...]]:
        domain_rules: list[DomainRuleAtom] = []
        topic_rules: list[TopicRuleAtom] = []
        for number, document in enumerate(documents):
            for rule in document.governance.domain_rules if document.governance else ():
                topic_rules += [self._topic_atom(topic, len(domain_rules), document) for topic in rule.topic_rules]
                domain_rules.append(
                    DomainRuleAtom(
                        document=number,
                        domains=self._covered_classes(covered(rule.domains)),
                        allow_unauthenticated_participants=rule.allow_unauthenticated_participants,
                        enable_join_access_control=rule.enable_join_access_control,
                        discovery_protection_kind=rule.discovery_protection_kind,
                        liveliness_protection_kind=rule.liveliness_protection_kind,
                        rtps_protection_kind=rule.rtps_protection_kind,
                        location=Location(path=document.place, line=rule.line),
                    )
                )
        return tuple(domain_rules), tuple(topic_rules)

    def _topic_atom(self, topic: TopicRule, domain_rule: int, document: Document) -> TopicRuleAtom:
        return TopicRuleAtom(
            domain_rule=domain_rule,
            channels=self._topic_matches[id(topic)],
            enable_discovery_protection=topic.enable_discovery_protection,
            enable_liveliness_protection=topic.enable_liveliness_protection,
            enable_read_access_control=topic.enable_read_access_control,
            enable_write_access_control=topic.enable_write_access_control,
            metadata_protection_kind=topic.metadata_protection_kind,
            data_protection_kind=topic.data_protection_kind,
            location=Location(path=document.place, line=topic.line),
        )

    def _permission_atoms(
        self, documents: Sequence[Document], names: Mapping[str, frozenset[int]]
    ) -> tuple[tuple[GrantAtom, ...], tuple[RuleAtom, ...]]:
        index = {instant: n for n, instant in enumerate(self._instants)}
        grants: list[GrantAtom] = []
        rules: list[RuleAtom] = []
        for number, document in enumerate(documents):
            for grant in document.permissions.grants if document.permissions else ():
                for rule in grant.rules:
                    found = self._rule_matches[id(rule)]
                    rules.append(
                        RuleAtom(
                            grant=len(grants),
                            allow=rule.allow,
                            domains=self._covered_classes(covered(rule.domains)),
                            publish=found.publish,
                            subscribe=found.subscribe,
                            relay=found.relay,
                            location=Location(path=document.place, line=rule.line),
                        )
                    )
                not_before, not_after = dates_of(grant)
                grants.append(
                    GrantAtom(
                        document=number,
                        names=names[grant.subject_name.text],
                        not_before=index[not_before],
                        not_after=index[not_after],
                        default_allow=grant.default_allow,
                        location=Location(path=document.place, line=grant.line),
                    )
                )
        return tuple(grants), tuple(rules)

    def _covered_classes(self, cover: tuple[Interval, ...]) -> frozenset[int]:
        return frozenset(
            n for n, domain in enumerate(self._channels.domains) if contains(cover, domain.intervals[0][0])
        )


_Typed = tuple[tuple[DomainRuleAtom, ...], tuple[TopicRuleAtom, ...], tuple[GrantAtom, ...], tuple[RuleAtom, ...]]
_CLOSED = RealmAtom(identity_ca=frozenset(), permissions_ca=frozenset(), governance=None, revoked=frozenset())
"""(MUST) The realm of an enclave whose trust could not be read: it accepts nobody."""


def unread_places(keystore: Keystore) -> tuple[str, ...]:
    """Places behind which whole enclaves may lie that were not read."""
    layout = keystore.layout
    return tuple(file.path for file in (*layout.directory_links, *layout.unreadable_directories))


def _open_realm(atoms: list[DocumentAtom], place: str) -> RealmAtom:
    """(MAY) The realm of an enclave whose trust could not be read.

    An opaque governance, so it accepts everything.
    """
    atoms.append(
        DocumentAtom(label=place, location=Location(path=place), intact=False, signers=frozenset(), opaque=True)
    )
    return RealmAtom(
        identity_ca=frozenset(), permissions_ca=frozenset(), governance=len(atoms) - 1, revoked=frozenset()
    )


def _place(enclave: Enclave) -> Location:
    """Where the enclave is introduced: its certificate, else its directory."""
    if enclave.certificate is not None:
        return Location(path=enclave.certificate.file.place, line=1)
    return Location(path=enclave.files.directory)
