"""Builds the `System`s of a keystore.

Evidence in, normalised facts out, one for each kind of implementation and reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from functools import cached_property

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.certificate import CertificateFile, fit_to_sign
from keystore_audit.keystore.crl import CrlFile
from keystore_audit.keystore.governance import GovernanceFile, TopicRule
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.channels import Channels, RuleMatches, build_channels, covers_of, domain_classes
from keystore_audit.model.domains import Interval, contains, covered
from keystore_audit.model.doubt import identity_doubt, realm_doubt
from keystore_audit.model.inventory import Document, certificates_of, dates_of, documents_of, instants_of
from keystore_audit.model.revocation import revoked_serials
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
from keystore_audit.model.trust import Verdict, envelope, is_authority, may_have_issued, may_sign

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
        self._certificates = certificates_of(keystore)
        self._number = {certificate.sha256: n for n, certificate in enumerate(self._certificates)}
        self._instants = instants_of(self._certificates, self._documents, at)
        self._topic_matches: dict[int, frozenset[int]] = {}
        self._rule_matches: dict[int, RuleMatches] = {}
        self._channels = self._classes()
        self._issuers = self._issue()
        self._typed: dict[tuple[str, ...], _Typed] = {}
        self._doubts = [(identity_doubt(enclave) is not None, realm_doubt(enclave)) for enclave in keystore.enclaves]
        self._keys = {key: n for n, key in enumerate(dict.fromkeys(c.key for c in self._certificates))}
        self._envelopes = {
            document.place: envelope(document.file.signed) for document in self._documents if document.file
        }

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
        """For each certificate, those of CA files that issued it: names and signature, not dates."""
        authorities = {
            certificate.sha256
            for enclave in self._keystore.enclaves
            for file in (enclave.identity_ca, enclave.permissions_ca)
            if file is not None
            for certificate in file.certificates
        }
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

    def build(self, *, pins_signer: bool, profiles: tuple[str, ...], reading: Reading) -> System:
        """The system as implementations read it that do, or do not, pin the signer."""
        may = reading is Reading.MAY
        opaque = {d.place for d in self._documents if self._opaque(d, pins_signer=pins_signer)}
        documents = [d for d in self._documents if may or d.place not in opaque]
        number = {document.place: n for n, document in enumerate(documents)}
        atoms = [self._document_atom(document, opaque=document.place in opaque) for document in documents]
        realms: dict[RealmAtom, int] = {}
        trusts: dict[_Trust, RealmAtom] = {}
        enclaves: list[EnclaveAtom] = []
        for enclave, (unknown, doubt) in zip(self._keystore.enclaves, self._doubts, strict=True):
            if unknown and not may:
                continue
            if doubt is not None:
                realm = _open_realm(atoms, doubt.location.path) if may else _CLOSED
            else:
                trust = _trust(enclave)
                realm = trusts.get(trust) or trusts.setdefault(trust, self._realm(enclave, number))
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
        domain_rules, topic_rules, grants, rules = self._typed_atoms(documents)
        return System(
            profiles=profiles,
            pins_signer=pins_signer,
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

    def _opaque(self, document: Document, *, pins_signer: bool) -> bool:
        """Whether some enclave may accept the document although we do not know what it says."""
        if document.file is None:
            return True
        judged = self._envelopes[document.place]
        if judged.verdict is Verdict.UNKNOWN:
            return True
        if judged.verdict is Verdict.REFUSED or document.readable:
            return False
        return any(
            all(may_sign(signer, enclave.permissions_ca, pins_signer=pins_signer) for signer in judged.signers)
            for enclave in self._keystore.enclaves
            if enclave.permissions_ca is not None
        )

    def _document_atom(self, document: Document, *, opaque: bool) -> DocumentAtom:
        judged = self._envelopes.get(document.place)
        intact = judged is not None and judged.verdict is Verdict.ACCEPTED and not opaque
        return DocumentAtom(
            label=document.place,
            location=Location(path=document.place),
            intact=intact,
            signers=frozenset(self._number[s.sha256] for s in judged.signers) if intact and judged else frozenset(),
            opaque=opaque,
        )

    def _realm(self, enclave: Enclave, number: dict[str, int]) -> RealmAtom:
        """What the enclave's verdict on peers depends on."""
        place = enclave.governance.signed.file.place if enclave.governance else None
        identity_ca = enclave.identity_ca.certificates if enclave.identity_ca else ()
        permissions_ca = enclave.permissions_ca.certificates if enclave.permissions_ca else ()
        revoked = revoked_serials(enclave)
        return RealmAtom(
            identity_ca=frozenset(self._number[c.sha256] for c in identity_ca),
            permissions_ca=frozenset(self._number[c.sha256] for c in permissions_ca),
            governance=number.get(place) if place else None,
            revoked=(
                frozenset(n for n, c in enumerate(self._certificates) if (c.issuer_der, c.serial) in revoked)
                if revoked
                else frozenset()
            ),
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

    def _typed_atoms(self, documents: Sequence[Document]) -> _Typed:
        """What the documents say, the same objects for every kind of implementation that reads the same ones."""
        places = tuple(document.place for document in documents)
        if places not in self._typed:
            self._typed[places] = (*self._governance_atoms(documents), *self._permission_atoms(documents))
        return self._typed[places]

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

    def _permission_atoms(self, documents: Sequence[Document]) -> tuple[tuple[GrantAtom, ...], tuple[RuleAtom, ...]]:
        by_subject: dict[str, set[int]] = {}
        for n, certificate in enumerate(self._certificates):
            by_subject.setdefault(certificate.subject, set()).add(n)
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
                        names=frozenset(by_subject.get(grant.subject_name.text, ())),
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
_Trust = tuple[CertificateFile | None, CertificateFile | None, GovernanceFile | None, CrlFile | None]


def _trust(enclave: Enclave) -> _Trust:
    """What the realm of an enclave is made of: files, each one object however many enclaves share it."""
    return enclave.identity_ca, enclave.permissions_ca, enclave.governance, enclave.crl


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
