"""S/MIME signed documents, read by OpenSSL's MIME algorithm (crypto/asn1/asn_mime.c)."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.files import File


@dataclass(frozen=True, slots=True, kw_only=True)
class Signature:
    """One SignerInfo of a CMS SignedData (RFC 5652 5.3), and whose key made it.

    `named`: candidates whose issuer and serial number the signer identifier names.
    `verified_by`: candidates whose key verifies the signature over this content (a renewed CA with the same key is
    in `verified_by` but not in `named`). `digest_matches`: the messageDigest attribute equals the
    digest of the content; None where there are no signed attributes (the signature covers the content itself).
    """

    issuer_der: bytes = field(repr=False)
    serial: int
    digest: str
    """`sha256`, `sha1`, … or the dotted identifier of an unknown one."""
    digest_matches: bool | None
    named: tuple[Certificate, ...]
    verified_by: tuple[Certificate, ...]
    signing_time: datetime | None
    """Asserted by the signer (RFC 5652 11.3): a hint, never trusted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SignedDocument:
    """`governance.p7s` or `permissions.p7s` as read.

    `content` is the signed XML as OpenSSL hands it to a DDS implementation: canonical CRLF line ends, without the
    `Content-Type: text/plain` header; None where it could not be separated. `first_line` is
    the line of the file at which `content` begins, None for an opaque message (its XML has no line of its own there).
    `embedded` are the certificates inside the message.
    """

    file: File
    content: bytes | None = field(repr=False)
    first_line: int | None
    embedded: tuple[Certificate, ...]
    signatures: tuple[Signature, ...]
    defects: tuple[Defect, ...]

    def line(self, content_line: int | None) -> int | None:
        """The line of the file for line `content_line` (from 1) of the signed XML."""
        if self.first_line is None or content_line is None:
            return None
        return self.first_line + content_line - 1
