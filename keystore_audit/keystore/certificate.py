"""X.509 certificates as evidence."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime

from cryptography import x509

from keystore_audit.keystore.crl import RevocationList
from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.files import File


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """One certificate of a PEM file (RFC 7468), found at `line` of `path`.

    `subject` and `issuer` are RFC 4514 strings as untrusted text, `issuer_der`/`subject_der` the DER names that
    a CMS signer identifier is compared with. `key` identifies the public key: SHA-256 of its
    SubjectPublicKeyInfo, hexadecimal. Dates are aware UTC.
    """

    path: str
    line: int
    sha256: str
    subject: str
    issuer: str
    subject_der: bytes = field(repr=False)
    issuer_der: bytes = field(repr=False)
    serial: int
    not_before: datetime
    not_after: datetime
    key: str
    key_kind: str
    """`EC secp256r1`, `RSA 2048`, `Ed25519`, …"""
    signature_algorithm: str
    """As OpenSSL names it: `ecdsa-with-SHA256`, `sha256WithRSAEncryption`, …"""
    is_ca: bool | None
    """BasicConstraints CA, None where the extension is absent."""
    path_length: int | None
    key_usage: frozenset[str] | None
    """RFC 5280 names (`digitalSignature`, `keyCertSign`, …), None where the extension is absent."""
    extended_key_usage: frozenset[str] | None
    """Dotted object identifiers, None where the extension is absent."""
    unknown_critical: tuple[str, ...]
    """Object identifiers of critical extensions that X.509 verifiers do not process (RFC 5280 4.2)."""
    parsed: x509.Certificate = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class CertificateFile:
    """A file of certificates in file order, with revocation lists that stand in it (Fast DDS reads both)."""

    file: File
    certificates: tuple[Certificate, ...]
    revocation_lists: tuple[RevocationList, ...]
    defects: tuple[Defect, ...]

    @property
    def first(self) -> Certificate | None:
        """The certificate that every run time reads."""
        return self.certificates[0] if self.certificates else None
