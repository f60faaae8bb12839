"""Verdicts on evidence: whether a signer may sign, and which certificates vouch for which.

The evidence comes from `keystore/`; what it means depends on the profile (DDS-Security 1.1, 9.4.1.1).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime
from functools import lru_cache
from typing import Any, Final, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.keystore.certificate import Certificate, CertificateFile
from keystore_audit.keystore.crl import same_name
from keystore_audit.keystore.defect import Kind, first_opaque
from keystore_audit.keystore.issuer import (
    Issue,
    fit_to_sign,
    issued_by,
    key_identifier_fits,
    lets_sign,
    may_issue,
    names_itself,
    suits_key,
)
from keystore_audit.keystore.smime import Signature, SignedDocument
from keystore_audit.model.validity import in_force
from keystore_audit.profiles import SPEC, Trust
from keystore_audit.truth import Truth

T = TypeVar("T")

MAX_AUTHORITIES: Final = 64
"""Certificates of one CA file that chains are looked for among; a file with more leaves its enclave unknown."""

_REFUSED_BY_ALL = frozenset({Kind.NOT_SMIME, Kind.NO_TEXT_PLAIN, Kind.NO_SIGNER, Kind.DIGEST_MISMATCH})
"""Forms that every measured implementation refuses (docs/security-model.md)."""

_ENVELOPE_UNKNOWN = frozenset(
    {Kind.MIME_MALFORMED, Kind.CMS_MALFORMED, Kind.CMS_NOT_DER, Kind.TWO_CONTENTS, Kind.UNSUPPORTED_ALGORITHM}
)
"""Forms that we refuse to interpret and that some implementation accepts."""


class Envelope(Struct, frozen=True, kw_only=True):
    """What the envelope of a document is worth, whoever signed it.

    `verdict`: whether every signature verifies under `signers`, whom the signer identifiers name.
    """

    verdict: Truth
    signers: tuple[Certificate, ...]


@lru_cache(maxsize=16_384)
def envelope(signed: SignedDocument) -> Envelope:
    """Whether the signatures hold, whoever made them."""
    kinds = {defect.kind for defect in signed.defects}
    if kinds & _REFUSED_BY_ALL:
        return Envelope(verdict=Truth.NO, signers=())
    if kinds & _ENVELOPE_UNKNOWN or signed.content is None:
        return Envelope(verdict=Truth.UNKNOWN, signers=())
    signers = [_signer(signature) for signature in signed.signatures]
    if not signers or None in signers:
        return Envelope(verdict=Truth.NO, signers=())
    return Envelope(verdict=Truth.YES, signers=tuple(signer for signer in signers if signer is not None))


def _signer(signature: Signature) -> Certificate | None:
    """The certificate that the signer identifier names and whose key made the signature."""
    if signature.digest_matches is False:
        return None
    verified = {certificate.sha256 for certificate in signature.verified_by}
    return next((certificate for certificate in signature.named if certificate.sha256 in verified), None)


@lru_cache(maxsize=65_536)
def _alike(*known: object) -> list[Any]:  # noqa: ARG001 - what the cache goes by
    """The place of the first value of which the same is known; empty at first."""
    return []


def first_alike(value: T, *known: object) -> T:
    """The first value of which the same is known."""
    alike: list[T] = _alike(*known)
    if not alike:
        alike.append(value)
    return alike[0]


@lru_cache(maxsize=65_536)
def document_alike(signed: SignedDocument) -> SignedDocument:
    """The first message with the same answers to all that is asked of it here: thousands have one signer."""
    return first_alike(signed, envelope(signed), signed.embedded)


@lru_cache(maxsize=65_536)
def certificate_alike(certificate: Certificate, file: CertificateFile) -> Certificate:
    """The first certificate with the same answers to all that chains over the file ask of it, except for dates."""
    if len(file.certificates) > MAX_AUTHORITIES:
        return certificate
    asked = [
        (
            a.sha256 == certificate.sha256,
            issue(a, certificate),
            suits_key(certificate, a),
            key_identifier_fits(certificate, a),
        )
        for a in file.certificates
    ]
    return first_alike(certificate, file, *asked)


def authorities_read(file: CertificateFile, trust: Trust) -> tuple[Certificate, ...]:
    """The certificates of a CA file that count: all, or the first alone.

    Fast DDS leaves out those before the first whose signature algorithm it knows, and takes whatever stands behind it
    (FileProvider.cpp; measured on 2.9.1).
    """
    if trust.first_authority_only:
        return file.certificates[:1]
    known = trust.ca_algorithms
    if known is None:
        return file.certificates[:MAX_AUTHORITIES]
    begins = (number for number, each in enumerate(file.certificates) if each.signature_algorithm in known)
    first = next(begins, 0)  # where none is known, the file is not loaded: `refusals.strict_refusal`
    return file.certificates[first : first + MAX_AUTHORITIES]


def not_read(place: str, trust: Trust) -> str:
    """Why a certificate of a CA file does not count (`authorities_read`)."""
    if trust.first_authority_only:
        return f"of {place} the first certificate alone is read"
    return f"of {place} nothing before the first certificate with a signature algorithm that it knows is read"


def signing_authorities(file: CertificateFile, trust: Trust) -> tuple[Certificate, ...]:
    """The certificates of a permissions CA file by which documents are judged; unless pinned, only roots end chains."""
    read = authorities_read(file, trust)
    return read if trust.pins_signer else tuple(authority for authority in read if is_root(authority))


@lru_cache(maxsize=65_536)
def file_alike(file: CertificateFile) -> CertificateFile:
    """The first file with the same bytes: if sros2's links are copied, there are as many files as enclaves."""
    return first_alike(file, file.file.sha256 or file)


@lru_cache(maxsize=4096)
def trusted_authorities(file: CertificateFile, trust: Trust, at: datetime | None = None) -> tuple[Certificate, ...]:
    """The authorities of an identity CA file that can vouch for an identity, in force at `at` with all above them.

    Where the chain has to end at a root (X509_verify_cert of OpenSSL), each is a root or was issued by another of them.
    Path lengths of those above must allow it (RFC 5280, 6.1.4 l and m). Otherwise every certificate of the file is an
    anchor. `at` None: whatever the dates.
    """
    pool = [
        authority
        for authority in authorities_read(file, trust)
        if is_authority(authority) and (at is None or in_force(authority, at))
    ]
    if not trust.needs_root:
        return tuple(pool)
    return _below(pool, [root for root in pool if is_root(root, signed=trust.checks_root_signature)])


def _below(pool: Sequence[Certificate], roots: Sequence[Certificate]) -> tuple[Certificate, ...]:
    """The authorities of the pool on some path from the roots, which are of the pool, within its path lengths."""
    # By certificate: how many more authorities that are not self-issued may follow below it.
    left: dict[Certificate, int] = {root: _allowance(root, len(pool)) for root in roots}
    pending = list(left)
    while pending:
        above = pending.pop()
        for below in pool:
            # The older forms of an authority count at the end of a chain alone (x509_vfy.c, check_extensions).
            if names_itself(below) or not below.is_ca or not may_have_issued(above, below):
                continue
            self_issued = below.subject_der == below.issuer_der
            allowed = min(left[above] - (not self_issued), _allowance(below, len(pool)))
            if allowed >= 0 and allowed > left.get(below, -1):
                left[below] = allowed
                pending.append(below)
    return tuple(authority for authority in pool if authority in left)


def _allowance(authority: Certificate, unlimited: int) -> int:
    return unlimited if authority.path_length is None else min(authority.path_length, unlimited)


def is_root(certificate: Certificate, *, signed: bool = False) -> bool:
    """Whether a chain can end there: it names itself and, if `signed` is looked at, made its own signature."""
    return names_itself(certificate) and (not signed or may_have_issued(certificate, certificate))


@lru_cache(maxsize=4096)  # asked for each enclave, under each row, of the few files that they share
def chaining(trust: Trust, file: CertificateFile) -> Trust:
    """One row for all that look for chains in the file alike: each chain is then searched once."""
    return _row(False, trust.needs_root, trust.checks_root_signature, *_reading(trust, file))


@lru_cache(maxsize=4096)
def _judging(trust: Trust, permissions_ca: CertificateFile | None) -> Trust:
    """The same for all that judge the signers of documents alike by the file."""
    return _row(trust.pins_signer, False, False, *_reading(trust, permissions_ca))


def _reading(trust: Trust, file: CertificateFile | None) -> tuple[bool, frozenset[str] | None]:
    """The part of a row that decides which certificates of the file count."""
    if file is None or file.first is None:
        return False, None
    algorithms = None if file.first.signature_algorithm in (trust.ca_algorithms or ()) else trust.ca_algorithms
    return trust.first_authority_only and len(file.certificates) > 1, algorithms


@lru_cache(maxsize=64)
def _row(pins: bool, needs_root: bool, checks_root: bool, first_only: bool, algorithms: frozenset[str] | None) -> Trust:
    return replace(
        SPEC.trust,
        pins_signer=pins,
        needs_root=needs_root,
        checks_root_signature=checks_root,
        first_authority_only=first_only,
        ca_algorithms=algorithms,
    )


def is_issued(file: CertificateFile, certificate: Certificate, trust: Trust, at: datetime | None = None) -> bool:
    """Whether one of the `trusted_authorities` of an identity CA file issued the certificate, or it is taken there."""
    first = file_alike(file)
    return _is_issued(first, certificate_alike(certificate, first), chaining(trust, first), at)


@lru_cache(maxsize=65_536)
def _is_issued(file: CertificateFile, certificate: Certificate, trust: Trust, at: datetime | None) -> bool:
    if any(may_have_issued(authority, certificate) for authority in trusted_authorities(file, trust, at)):
        return True
    return stands_alone(certificate, authorities_read(file, trust)) and (at is None or in_force(certificate, at))


def stands_alone(certificate: Certificate, authorities: Iterable[Certificate]) -> bool:
    """Whether OpenSSL finds a certificate that names itself among the trusted ones, and may ask nothing more of it. It
    is taken even if it is no authority, or did not sign itself. Measured on Cyclone DDS and Fast DDS, which asks for
    the signature.
    """
    if not names_itself(certificate) or not any(each.sha256 == certificate.sha256 for each in authorities):
        return False
    return not (is_authority(certificate) and may_have_issued(certificate, certificate))


def issuers_taken(
    certificate: Certificate, authorities: Sequence[Certificate], at: datetime | None = None
) -> tuple[Certificate, ...]:
    """The authorities that OpenSSL takes for the issuer: the first of those that fit and are in force.

    `at` None, or where none is in force: at some instant.

    Fitting are name, key identifier and kind of key (ossl_x509_likely_issued); signature and keyUsage come later, and
    no second one is tried (X509_STORE_CTX_get1_issuer; measured with 3.0.19).
    """
    fitting = [
        each
        for each in authorities
        if issue(each, certificate) in (Issue.ISSUED, Issue.UNSUPPORTED, Issue.SIGNATURE_INVALID)
        and suits_key(certificate, each)
        and key_identifier_fits(certificate, each)
    ]
    present = next((each for each in fitting if at is not None and in_force(each, at)), None)
    if present is not None:
        return (present,)
    return tuple(
        each
        for number, each in enumerate(fitting)
        if not any(e.not_before <= each.not_before and each.not_after <= e.not_after for e in fitting[:number])
    )


def may_sign(
    signer: Certificate,
    signed: SignedDocument,
    permissions_ca: CertificateFile,
    trust: Trust,
    at: datetime | None = None,
) -> bool:
    """Whether an enclave with this permissions CA file takes `signer` as a signer of the document.

    Pinned: it has the key of the file's first certificate of its issuer and serial number, whatever else those have.
    Otherwise it must be in the message, the first there of its issuer and serial number, and fit for S/MIME signing. It
    must chain to a root of the file over authorities of file and message (CVE-2023-24010, CVE-2023-24011,
    CVE-2023-24012). This is PKCS7_verify with a store and PKCS7_TEXT, measured against libcrypto. The whole chain is in
    force `at` an instant; None: dates are not looked at.
    """
    read = authorities_read(permissions_ca, trust)
    if trust.pins_signer:
        return is_pinned(signer, read)
    if not is_first_embedded(signer, signed) or not fit_to_sign(signer) or signer.unknown_critical:
        return False
    if at is not None and not in_force(signer, at):
        return False
    roots = [root for root in read if is_root(root) and (at is None or in_force(root, at))]
    if any(signer.sha256 == root.sha256 for root in roots):
        return True
    # Of one that stands in the file and in the message, the file's: certificates are compared by identity.
    above_it = (c for c in (*signed.embedded, *read) if is_authority(c) and lets_sign(c))
    pool = {c.sha256: c for c in above_it if at is None or in_force(c, at)}
    above = _below(list(pool.values()), [root for root in roots if root.sha256 in pool])
    return any(may_have_issued(authority, signer) for authority in above)


def is_pinned(signer: Certificate, authorities: Iterable[Certificate]) -> bool:
    """Whether OpenSSL, which knows a signer by issuer and serial number, finds its key among the authorities."""
    first = first_of_number(signer, authorities)
    return first is not None and first.key == signer.key


def signers_taken(signed: SignedDocument, trust: Trust) -> tuple[Certificate, ...]:
    """The signers as the implementation finds them: in the message, where it does not pin.

    An authority that was made again from its old certificate keeps issuer, serial number and key.
    """
    signers = envelope(signed).signers
    if trust.pins_signer:
        return signers
    found = [(signer, first_of_number(signer, signed.embedded)) for signer in signers]
    return tuple([first if first is not None and first.key == signer.key else signer for signer, first in found])


def is_first_embedded(signer: Certificate, signed: SignedDocument) -> bool:
    """Whether it is the first certificate in the message of its issuer and serial number: the one OpenSSL takes."""
    first = first_of_number(signer, signed.embedded)
    return first is not None and first.sha256 == signer.sha256


def first_of_number(signer: Certificate, among: Iterable[Certificate]) -> Certificate | None:
    """The first of its issuer, by meaning (X509_NAME_cmp), and serial number: the one OpenSSL takes for the signer."""
    alike = (each for each in among if each.serial == signer.serial)
    return next((each for each in alike if same_name(each.issuer_name, signer.issuer_name)), None)


def document_verdict(signed: SignedDocument, permissions_ca: CertificateFile | None, trust: Trust) -> Truth:
    """Whether an enclave with this permissions CA file takes the document's signatures."""
    return _document_verdict(document_alike(signed), permissions_ca, _judging(trust, permissions_ca))


@lru_cache(maxsize=65_536)
def _document_verdict(signed: SignedDocument, permissions_ca: CertificateFile | None, trust: Trust) -> Truth:
    judged = envelope(signed)
    if judged.verdict is not Truth.YES:
        return judged.verdict
    if permissions_ca is None:
        return Truth.NO
    if all(may_sign(signer, signed, permissions_ca, trust) for signer in signers_taken(signed, trust)):
        return Truth.YES
    # What we do not read in the file, implementations may: OpenSSL's own form of certificates, for one.
    return Truth.UNKNOWN if first_opaque(permissions_ca.defects) is not None else Truth.NO


def may_take(signed: SignedDocument, files: Iterable[CertificateFile | None], trust: Trust) -> bool:
    """Whether an enclave with one of these permissions CA files may take the document."""
    return any(document_verdict(signed, file, trust).may for file in files)


def is_authority(certificate: Certificate) -> bool:
    """Whether it may issue certificates: `may_issue`, and no critical extension that nobody processes."""
    return may_issue(certificate) and not certificate.unknown_critical


@lru_cache(maxsize=65_536)  # asked by usability, doubt, the systems and the rules, under every trust row
def issue(authority: Certificate, certificate: Certificate) -> Issue:
    """Whether `authority` issued the certificate: names and signature, not dates. UNSUPPORTED: it cannot be told.

    A self-signed certificate is issued by itself alone, even where an older one has the same name and key. OpenSSL, and
    so every measured implementation, refuses one that is not among the trusted ones.
    """
    if certificate.sha256 != authority.sha256 and names_itself(certificate):
        return Issue.NAME_DIFFERS
    return issued_by(certificate, authority)


def may_have_issued(authority: Certificate, certificate: Certificate) -> bool:
    """Whether `authority` issued the certificate, or an implementation may think so where we cannot tell."""
    return issue(authority, certificate) in (Issue.ISSUED, Issue.UNSUPPORTED)


def vouches(authority: Certificate, certificate: Certificate) -> bool:
    """Whether `authority` may issue certificates and issued this one: names and signature, not dates."""
    return is_authority(authority) and issue(authority, certificate) is Issue.ISSUED
