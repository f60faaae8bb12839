"""Certificate revocation lists as evidence (RFC 5280 section 5)."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime

from cryptography import x509

from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.files import File


@dataclass(frozen=True, slots=True, kw_only=True)
class RevocationList:
    """One CRL found at `line` of `path`; `revoked` holds serial numbers."""

    path: str
    line: int
    issuer: str
    issuer_der: bytes = field(repr=False)
    this_update: datetime
    next_update: datetime | None
    revoked: frozenset[int]
    signature_algorithm: str
    unknown_critical: tuple[str, ...]
    parsed: x509.CertificateRevocationList = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class CrlFile:
    """`crl.pem` of an enclave."""

    file: File
    revocation_lists: tuple[RevocationList, ...]
    defects: tuple[Defect, ...]
