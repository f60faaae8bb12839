"""Whether a participant of an enclave would be created, and every reason why not (design section 3, usable)."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.governance import DomainRule, GovernanceFile
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.permissions import Grant, PermissionsFile
from keystore_audit.model.domains import Interval, contains, covered, elementary
from keystore_audit.model.doubt import enclave_doubts
from keystore_audit.model.meaning import Usability
from keystore_audit.model.revocation import revoked_serials
from keystore_audit.model.trust import Verdict, document_verdict, vouches
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


class Usabilities:
    """Answers for every enclave of one keystore at one instant; what enclaves share is worked out once."""

    def __init__(self, at: datetime, domain: int | None) -> None:
        self._at = at
        self._domain = domain
        self._governed: dict[str, tuple[tuple[Interval, DomainRule], ...]] = {}

    def of(self, enclave: Enclave, *, pins_signer: bool) -> Usability:
        """Whether a participant of the enclave is created, in `domain` or (None) in some domain of 0..232.

        `usable` is None where something could not be read and nothing else already rules it out.
        """
        reasons = tuple(self._refusals(enclave, pins_signer=pins_signer))
        if reasons:
            return Usability(usable=False, reasons=reasons)
        doubts = tuple(doubt.reason for doubt in enclave_doubts(enclave, pins_signer=pins_signer))
        return Usability(usable=None if doubts else True, reasons=doubts)

    def _refusals(self, enclave: Enclave, *, pins_signer: bool) -> Iterator[str]:
        for role in REQUIRED:
            file = enclave.files.files[role]
            absent = file.status is not Status.PRESENT and not file.status.unknown
            if absent and role not in enclave.files.pkcs11:
                yield f"{role.value}: {file.detail or file.status.value}"
        yield from self._identity_refusals(enclave)
        for role, read in ((Role.GOVERNANCE, enclave.governance), (Role.PERMISSIONS, enclave.permissions)):
            if read is not None and enclave.permissions_ca is not None:
                verdict = document_verdict(read.signed, enclave.permissions_ca, pins_signer=pins_signer)
                if verdict is Verdict.REFUSED:
                    whom = "the permissions CA" if pins_signer else "anybody whom the permissions CA vouches for"
                    yield f"{role.value}.p7s is not validly signed by {whom}"
        yield from self._permission_refusals(enclave)

    def _identity_refusals(self, enclave: Enclave) -> Iterator[str]:
        certificate = enclave.certificate.first if enclave.certificate else None
        if certificate is None:
            return
        if enclave.key is not None:
            if enclave.key.encrypted:
                yield "the private key is encrypted, and no password is passed"
            elif enclave.key.key is not None and enclave.key.key != certificate.key:
                yield "the private key does not belong to the certificate"
        if enclave.identity_ca is not None and not _has_doubt(enclave.identity_ca):
            yield from self._chain_refusals(certificate, enclave.identity_ca)
        if (certificate.issuer_der, certificate.serial) in revoked_serials(enclave):
            yield "the identity certificate is revoked"
        for revocations in enclave.crl.revocation_lists if enclave.crl else ():
            if revocations.next_update is not None and revocations.next_update < self._at:
                yield "the revocation list is stale, so every identity is refused"

    def _chain_refusals(self, certificate: Certificate, identity_ca: CertificateFile) -> Iterator[str]:
        if not certificate.not_before <= self._at <= certificate.not_after:
            yield "the identity certificate is outside its validity"
        issuers = [authority for authority in identity_ca.certificates if vouches(authority, certificate)]
        if not issuers:
            yield "the identity CA did not issue the identity certificate"
        elif not any(issuer.not_before <= self._at <= issuer.not_after for issuer in issuers):
            yield "the identity CA certificate is outside its validity"

    def _permission_refusals(self, enclave: Enclave) -> Iterator[str]:
        """What the enclave's own documents say against it: no grant, no domain, no right to join."""
        certificate = enclave.certificate.first if enclave.certificate else None
        grant: Grant | None = None
        if certificate is not None and enclave.permissions is not None and enclave.permissions.permissions:
            grant = self._own_grant(enclave.permissions, certificate)
            if grant is None:
                yield f"no grant in force names {certificate.subject}"
        if enclave.governance is None or enclave.governance.governance is None:
            return
        governed = self._governed_domains(enclave.governance)
        if not governed:
            which = "no domain" if self._domain is None else f"not domain {self._domain}"
            yield f"the governance covers {which}"
        elif grant is not None and not _joins(governed, grant):
            yield "the grant allows no domain that the governance covers"

    def _own_grant(self, file: PermissionsFile, certificate: Certificate) -> Grant | None:
        """The first grant in force of the enclave's own document that names its certificate."""
        for grant in file.permissions.grants if file.permissions else ():
            if grant.subject_name.text != certificate.subject:
                continue
            not_before, not_after = parse_instant(grant.not_before.text), parse_instant(grant.not_after.text)
            if not_before is not None and not_after is not None and not_before <= self._at <= not_after:
                return grant
        return None

    def _governed_domains(self, file: GovernanceFile) -> tuple[tuple[Interval, DomainRule], ...]:
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


def _has_doubt(file: CertificateFile) -> bool:
    return any(defect.kind.opaque for defect in file.defects)


def _joins(governed: tuple[tuple[Interval, DomainRule], ...], grant: Grant) -> bool:
    """Join control as `spec` has it, save that Table 63 taken to the letter would refuse every stock enclave."""
    if grant.default_allow:
        return True
    allowed = [interval for rule in grant.rules if rule.allow for interval in covered(rule.domains)]
    return any(
        not rule.enable_join_access_control or any(low <= upper and lower <= high for lower, upper in allowed)
        for (low, high), rule in governed
    )
