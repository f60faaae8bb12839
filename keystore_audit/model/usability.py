"""Whether a participant of an enclave would be created, and every reason why not (design section 3, usable)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.governance import DomainRule, GovernanceFile
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.layout import Role
from keystore_audit.keystore.permissions import Grant
from keystore_audit.model.domains import Interval, contains, covered, elementary
from keystore_audit.model.doubt import enclave_doubts
from keystore_audit.model.meaning import Usability
from keystore_audit.model.revocation import revoked_serials
from keystore_audit.model.trust import Verdict, document_verdict, is_authority, may_have_issued, vouches
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
    issuers: tuple[Certificate, ...]
    grants: tuple[tuple[datetime, datetime, bool], ...] | None
    """not_before, not_after and whether it lets the enclave join; None where the document has no meaning."""
    stale_after: tuple[datetime, ...]


class Usabilities:
    """Answers for the enclaves of one keystore; what does not depend on the instant is worked out once.

    `domain`: the domain that a participant is wanted in; None: some domain of 0..232.
    """

    def __init__(self, domain: int | None) -> None:
        self._domain = domain
        self._governed: dict[str, _Governed] = {}
        self._standing: dict[tuple[str, bool], tuple[tuple[str, ...], tuple[str, ...]]] = {}
        self._dated: dict[str, _Dated] = {}

    def of(self, enclave: Enclave, at: datetime, *, pins_signer: bool) -> Usability:
        """Whether a participant of the enclave is created at `at` (aware UTC).

        `usable` is None where something could not be read and nothing else already rules it out.
        """
        directory = enclave.files.directory
        key = (directory, pins_signer)
        if key not in self._standing:
            self._standing[key] = (
                tuple(self._refusals(enclave, pins_signer=pins_signer)),
                tuple(doubt.reason for doubt in enclave_doubts(enclave, pins_signer=pins_signer)),
            )
        if directory not in self._dated:
            self._dated[directory] = self._dates(enclave)
        refusals, doubts = self._standing[key]
        reasons = (*refusals, *_refusals_at(self._dated[directory], at))
        if reasons:
            return Usability(usable=False, reasons=reasons)
        return Usability(usable=None if doubts else True, reasons=doubts)

    def _refusals(self, enclave: Enclave, *, pins_signer: bool) -> Iterator[str]:
        """Reasons that hold at every instant."""
        for role in REQUIRED:
            file = enclave.files.files[role]
            absent = file.status is not Status.PRESENT and not file.status.unknown
            if absent and role not in enclave.files.pkcs11:
                yield f"{role.value}: {file.detail or file.status.value}"
        certificate = enclave.certificate.first if enclave.certificate else None
        if certificate is not None:
            yield from _identity_refusals(enclave, certificate)
        for role, read in ((Role.GOVERNANCE, enclave.governance), (Role.PERMISSIONS, enclave.permissions)):
            if read is not None and enclave.permissions_ca is not None:
                verdict = document_verdict(read.signed, enclave.permissions_ca, pins_signer=pins_signer)
                if verdict is Verdict.REFUSED:
                    whom = "the permissions CA" if pins_signer else "anybody whom the permissions CA vouches for"
                    yield f"{role.value}.p7s is not validly signed by {whom}"
        governance = enclave.governance
        readable = governance is not None and governance.governance is not None
        if governance is not None and readable and not self._governed_domains(governance):
            yield "the governance covers " + ("no domain" if self._domain is None else f"not domain {self._domain}")

    def _dates(self, enclave: Enclave) -> _Dated:
        certificate = enclave.certificate.first if enclave.certificate else None
        authorities = enclave.identity_ca.certificates if enclave.identity_ca else ()
        revocations = enclave.crl.revocation_lists if enclave.crl else ()
        return _Dated(
            certificate=certificate,
            issuers=tuple(a for a in authorities if certificate is not None and vouches(a, certificate)),
            grants=self._own_grants(enclave, certificate),
            stale_after=tuple(r.next_update for r in revocations if r.next_update is not None),
        )

    def _own_grants(
        self, enclave: Enclave, certificate: Certificate | None
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
            if grant.subject_name.text == certificate.subject and not_before is not None and not_after is not None:
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


def _identity_refusals(enclave: Enclave, certificate: Certificate) -> Iterator[str]:
    if enclave.key is not None:
        if enclave.key.encrypted:
            yield "the private key is encrypted, and no password is passed"
        elif enclave.key.key is not None and enclave.key.key != certificate.key:
            yield "the private key does not belong to the certificate"
    authorities = enclave.identity_ca
    readable = authorities is not None and not any(defect.kind.opaque for defect in authorities.defects)
    issuing = authorities.certificates if authorities is not None else ()
    if readable and not any(is_authority(a) and may_have_issued(a, certificate) for a in issuing):
        yield "the identity CA did not issue the identity certificate"
    if certificate.unknown_critical:
        yield "the identity certificate has a critical extension that no implementation knows"
    if (certificate.issuer_der, certificate.serial) in revoked_serials(enclave):
        yield "the identity certificate is revoked"


def _refusals_at(dated: _Dated, at: datetime) -> Iterator[str]:
    """Reasons that hold at `at`."""
    certificate = dated.certificate
    if certificate is not None and not certificate.not_before <= at <= certificate.not_after:
        yield "the identity certificate is outside its validity"
    if dated.issuers and not any(issuer.not_before <= at <= issuer.not_after for issuer in dated.issuers):
        yield "the identity CA certificate is outside its validity"
    if any(end < at for end in dated.stale_after):
        yield "the revocation list is stale, so every identity is refused"
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
