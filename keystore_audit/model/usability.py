"""Whether a participant of an enclave would be created, and every reason why not (design section 3, usable)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.crl import RevocationList
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.governance import DomainRule, GovernanceFile
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.permissions import Grant
from keystore_audit.model.domains import Interval, contains, covered, elementary
from keystore_audit.model.doubt import enclave_doubts
from keystore_audit.model.meaning import Usability
from keystore_audit.model.profiles import Trust
from keystore_audit.model.revocation import list_missing, lists_read, revoked
from keystore_audit.model.subject import names
from keystore_audit.model.trust import (
    Verdict,
    authorities_read,
    chain_refusal,
    document_verdict,
    is_issued,
    is_root,
    strict_refusal,
)
from keystore_audit.model.validity import parse_instant

REQUIRED = (
    Role.IDENTITY_CA,
    Role.CERTIFICATE,
    Role.KEY,
    Role.PERMISSIONS_CA,
    Role.GOVERNANCE,
    Role.PERMISSIONS,
)
"""Files without which rmw_dds_common hands no security to the implementation (its security.cpp)."""

_Governed = tuple[tuple[Interval, DomainRule], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Dated:
    """What depends on the instant: the identity, its issuers, and the enclave's own grants with their dates."""

    certificate: Certificate | None
    identity_ca: CertificateFile | None
    """None where no authority of the file issued the identity: that is a reason of its own."""
    permissions_ca: Certificate | None
    """None where its dates do not count."""
    grants: tuple[tuple[datetime, datetime, bool], ...] | None
    """not_before, not_after and whether it lets the enclave join; None where the document has no meaning."""
    lists: tuple[RevocationList, ...]


class Usabilities:
    """Answers for the enclaves of one keystore; what does not depend on the instant is worked out once.

    `domain`: the domain that a participant is wanted in; None: some domain of 0..232.
    """

    def __init__(self, domain: int | None) -> None:
        self._domain = domain
        self._governed: dict[str, _Governed] = {}
        self._standing: dict[tuple[str, Trust], tuple[tuple[str, ...], tuple[str, ...]]] = {}
        self._dated: dict[tuple[str, Trust], _Dated] = {}

    def of(self, enclave: Enclave, at: datetime, trust: Trust) -> Usability:
        """Whether a participant of the enclave is created at `at` (aware UTC).

        `usable` is None where something could not be read and nothing else already rules it out.
        """
        key = (enclave.files.directory, trust)
        if key not in self._standing:
            self._standing[key] = (
                tuple(self._refusals(enclave, trust)),
                tuple(doubt.reason for doubt in enclave_doubts(enclave, trust)),
            )
            self._dated[key] = self._dates(enclave, trust)
        refusals, doubts = self._standing[key]
        reasons = (*refusals, *_refusals_at(self._dated[key], trust, at))
        if reasons:
            return Usability(usable=False, reasons=reasons)
        return Usability(usable=None if doubts else True, reasons=doubts)

    def _refusals(self, enclave: Enclave, trust: Trust) -> Iterator[str]:
        """Reasons that hold at every instant."""
        for role in REQUIRED:
            file = enclave.files.files[role]
            absent = file.status is not Status.PRESENT and not file.status.unknown
            if absent and role not in enclave.files.pkcs11:
                yield f"{role.value}: {file.detail or file.status.value}"
        certificate = enclave.certificate.first if enclave.certificate else None
        if certificate is not None:
            yield from _identity_refusals(enclave, certificate, trust)
        yield from _authority_refusals(enclave, trust)
        for role, read in ((Role.GOVERNANCE, enclave.governance), (Role.PERMISSIONS, enclave.permissions)):
            if read is None or enclave.permissions_ca is None:
                continue
            if document_verdict(read.signed, enclave.permissions_ca, trust) is Verdict.REFUSED:
                whom = "the permissions CA" if trust.pins_signer else "anybody whom the permissions CA vouches for"
                yield f"{role.value}.p7s is not validly signed by {whom}"
        governance = enclave.governance
        readable = governance is not None and governance.governance is not None
        if governance is not None and readable and not self._governed_domains(governance):
            yield "the governance covers " + ("no domain" if self._domain is None else f"not domain {self._domain}")

    def _dates(self, enclave: Enclave, trust: Trust) -> _Dated:
        certificate = enclave.certificate.first if enclave.certificate else None
        file = enclave.identity_ca
        issued = file is not None and certificate is not None and is_issued(file, certificate, trust, None)
        authority = enclave.permissions_ca.first if enclave.permissions_ca else None
        return _Dated(
            certificate=certificate,
            identity_ca=file if issued else None,
            permissions_ca=authority if trust.checks_permissions_ca else None,
            grants=self._own_grants(enclave, certificate, trust),
            lists=lists_read(enclave, trust),
        )

    def _own_grants(
        self, enclave: Enclave, certificate: Certificate | None, trust: Trust
    ) -> tuple[tuple[datetime, datetime, bool], ...] | None:
        """The grants of the enclave's own document that name its certificate."""
        permissions = enclave.permissions.permissions if enclave.permissions else None
        if certificate is None or permissions is None:
            return None
        governance = enclave.governance
        readable = governance is not None and governance.governance is not None
        governed = self._governed_domains(governance) if governance is not None and readable else None
        found = []
        for grant in permissions.grants:
            not_before, not_after = parse_instant(grant.not_before.text), parse_instant(grant.not_after.text)
            named = names(grant.subject_name.text, certificate, trust.subjects)
            overflows = trust.latest_date is not None and not_after is not None and not_after > trust.latest_date
            if named and not_before is not None and not_after is not None and not overflows:
                found.append((not_before, not_after, governed is None or not governed or _joins(governed, grant)))
        return tuple(found)

    def _governed_domains(self, file: GovernanceFile) -> _Governed:
        """The domains in question with the first domain rule that covers each."""
        place = file.signed.file.place
        if place not in self._governed:
            rules = [
                (covered(rule.domains), rule) for rule in (file.governance.domain_rules if file.governance else ())
            ]
            found = []
            for low, high in elementary(cover for cover, _rule in rules):
                if self._domain is not None and not low <= self._domain <= high:
                    continue
                decides = next((rule for cover, rule in rules if contains(cover, low)), None)
                if decides is not None:
                    interval = (low, high) if self._domain is None else (self._domain, self._domain)
                    found.append((interval, decides))
            self._governed[place] = tuple(found)
        return self._governed[place]


def _identity_refusals(enclave: Enclave, certificate: Certificate, trust: Trust) -> Iterator[str]:
    if enclave.key is not None:
        if enclave.key.encrypted:
            yield "the private key is encrypted, and no password is passed"
        elif trust.compares_key and enclave.key.key is not None and enclave.key.key != certificate.key:
            yield "the private key does not belong to the certificate"
    file = enclave.identity_ca
    if file is not None and not any(defect.kind.opaque for defect in file.defects):
        refusal = chain_refusal(certificate, file, trust)
        if refusal is not None:
            yield f"the identity CA did not issue the identity certificate: {refusal}"
        elif list_missing(enclave, certificate, trust):
            yield "no revocation list that it carries can be used for the identity, so every identity is refused"
    if certificate.unknown_critical:
        yield "the identity certificate has a critical extension that no implementation knows"
    authority = file.first if file is not None else None
    for kind in dict.fromkeys(c.key_kind for c in (certificate, authority) if c is not None):
        if trust.identity_keys is not None and kind not in trust.identity_keys:
            yield f"it takes no identity, and no identity CA, with a key of kind {kind}"
    if trust.identity_algorithms is not None and certificate.signature_algorithm not in trust.identity_algorithms:
        yield f"it takes no identity signed with {certificate.signature_algorithm}"
    if revoked(enclave, (certificate,), trust):
        yield "the identity certificate is revoked"


def _authority_refusals(enclave: Enclave, trust: Trust) -> Iterator[str]:
    """Reasons in the CA files."""
    for file in dict.fromkeys((enclave.identity_ca, enclave.permissions_ca)):
        if file is None or file.first is None:
            continue
        if trust.ca_algorithms is not None and file.first.signature_algorithm not in trust.ca_algorithms:
            yield f"it loads no CA signed with {file.first.signature_algorithm} ({file.file.place})"
        refusal = strict_refusal(file.first) if trust.strict_authorities else None
        if refusal is not None:
            yield f"it does not load {file.file.place}: {refusal}"
    file = enclave.permissions_ca
    if file is None or file.first is None:
        return
    if trust.checks_permissions_ca and not any(is_root(authority) for authority in authorities_read(file, trust)):
        yield f"no certificate that counts in {file.file.place} is self-signed, so the permissions CA is refused"


def _refusals_at(dated: _Dated, trust: Trust, at: datetime) -> Iterator[str]:
    """Reasons that hold at `at`."""
    certificate = dated.certificate
    if certificate is not None and not certificate.not_before <= at <= certificate.not_after:
        yield "the identity certificate is outside its validity"
    file = dated.identity_ca
    if certificate is not None and file is not None and not is_issued(file, certificate, trust, at):
        yield "the identity CA certificate is outside its validity"
    authority = dated.permissions_ca
    if authority is not None and not authority.not_before <= at <= authority.not_after:
        yield "the permissions CA certificate is outside its validity"
    if any(revocations.next_update is not None and revocations.next_update < at for revocations in dated.lists):
        yield "the revocation list is stale, so every identity is refused"
    if any(revocations.this_update > at for revocations in dated.lists):
        yield "the revocation list is not yet valid, so every identity is refused"
    if certificate is not None and dated.grants is not None:
        own = next((joins for start, end, joins in dated.grants if start <= at <= end), None)
        if own is None:
            yield f"no grant in force names {certificate.subject}"
        elif not own:
            yield "the grant allows no domain that the governance covers"


def _joins(governed: _Governed, grant: Grant) -> bool:
    """Join control as `spec` has it, save that Table 63 taken to the letter would refuse every stock enclave."""
    if grant.default_allow:
        return True
    allowed = [interval for rule in grant.rules if rule.allow for interval in covered(rule.domains)]
    return any(
        not rule.enable_join_access_control or any(low <= upper and lower <= high for lower, upper in allowed)
        for (low, high), rule in governed
    )
