"""Verdicts on evidence: whether a signer may sign, and which certificates vouch for which.

The evidence comes from `keystore/`; what it means depends on the profile (DDS-Security 1.1, 9.4.1.1).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

from keystore_audit.keystore.certificate import Certificate, CertificateFile, Issue, fit_to_sign, issued_by
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.smime import Signature, SignedDocument

_REFUSED_BY_ALL = frozenset({Kind.NOT_SMIME, Kind.NO_TEXT_PLAIN, Kind.NO_SIGNER, Kind.DIGEST_MISMATCH})
"""Forms that every measured implementation refuses (docs/security-model.md)."""

_ENVELOPE_UNKNOWN = frozenset(
    {Kind.MIME_MALFORMED, Kind.CMS_MALFORMED, Kind.CMS_NOT_DER, Kind.TWO_CONTENTS, Kind.UNSUPPORTED_ALGORITHM}
)
"""Forms that we refuse to interpret and that some implementation accepts."""


class Verdict(str, Enum):
    """What an implementation does with a document. UNKNOWN: we cannot tell, so it may be accepted."""

    ACCEPTED = "accepted"
    REFUSED = "refused"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """What the envelope of a document is worth before anybody asks who signed it.

    `verdict`: ACCEPTED where every signature verifies under `signers`, certificates that the signer
    identifiers name.
    """

    verdict: Verdict
    signers: tuple[Certificate, ...]


@lru_cache(maxsize=16_384)
def envelope(signed: SignedDocument) -> Envelope:
    """Whether the signatures hold, apart from who made them."""
    kinds = {defect.kind for defect in signed.defects}
    if kinds & _REFUSED_BY_ALL:
        return Envelope(verdict=Verdict.REFUSED, signers=())
    if kinds & _ENVELOPE_UNKNOWN or signed.content is None:
        return Envelope(verdict=Verdict.UNKNOWN, signers=())
    signers = [_signer(signature) for signature in signed.signatures]
    if not signers or None in signers:
        return Envelope(verdict=Verdict.REFUSED, signers=())
    return Envelope(verdict=Verdict.ACCEPTED, signers=tuple(signer for signer in signers if signer is not None))


def _signer(signature: Signature) -> Certificate | None:
    """The certificate that the signer identifier names and whose key made the signature."""
    if signature.digest_matches is False:
        return None
    verified = {certificate.sha256 for certificate in signature.verified_by}
    return next((certificate for certificate in signature.named if certificate.sha256 in verified), None)


def may_sign(signer: Certificate, permissions_ca: CertificateFile, *, pins_signer: bool) -> bool:
    """Whether `signer` may sign documents for an enclave with this permissions CA file.

    Pinned: it is one of the file's certificates (issuer, serial number and key: here, the same bytes).
    Otherwise any certificate that one of them issued and that is fit for S/MIME signing will do too:
    CVE-2023-24010, CVE-2023-24011, CVE-2023-24012.
    """
    if any(signer.sha256 == authority.sha256 for authority in permissions_ca.certificates):
        return True
    return (
        not pins_signer
        and fit_to_sign(signer)
        and any(is_authority(a) and may_have_issued(a, signer) for a in permissions_ca.certificates)
    )


@lru_cache(maxsize=32_768)
def document_verdict(signed: SignedDocument, permissions_ca: CertificateFile | None, *, pins_signer: bool) -> Verdict:
    """What an enclave with this permissions CA file does with the document's signatures."""
    judged = envelope(signed)
    if judged.verdict is not Verdict.ACCEPTED:
        return judged.verdict
    if permissions_ca is None:
        return Verdict.REFUSED
    if all(may_sign(signer, permissions_ca, pins_signer=pins_signer) for signer in judged.signers):
        return Verdict.ACCEPTED
    return Verdict.REFUSED


def is_authority(certificate: Certificate) -> bool:
    """Whether it may issue certificates.

    CA:TRUE and, where keyUsage is present, keyCertSign (RFC 5280, 4.2.1.3, 4.2.1.9).
    """
    return bool(certificate.is_ca) and (certificate.key_usage is None or "keyCertSign" in certificate.key_usage)


def issue(authority: Certificate, certificate: Certificate) -> Issue:
    """Whether `authority` issued the certificate: names and signature, not dates. UNSUPPORTED: it cannot be told.

    A self-issued certificate is nobody's but its own, even where an older one has the same name and key: OpenSSL, and
    with it every measured implementation, refuses a self-signed certificate that is not among the trusted ones.
    """
    if certificate.subject_der == certificate.issuer_der and certificate.sha256 != authority.sha256:
        return Issue.NAME_DIFFERS
    return issued_by(certificate, authority)


def may_have_issued(authority: Certificate, certificate: Certificate) -> bool:
    """Whether `authority` issued the certificate, or an implementation may think so where we cannot tell."""
    return issue(authority, certificate) in (Issue.ISSUED, Issue.UNSUPPORTED)


def vouches(authority: Certificate, certificate: Certificate) -> bool:
    """Whether `authority` may issue certificates and issued this one: names and signature, not dates."""
    return is_authority(authority) and issue(authority, certificate) is Issue.ISSUED
