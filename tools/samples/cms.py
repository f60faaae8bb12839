"""CMS SignedData (RFC 5652), the same bytes at every build: fixed signing time, deterministic signatures."""

from __future__ import annotations

import hashlib
from datetime import datetime, timezone
from functools import cache

from asn1crypto import cms, x509  # type: ignore[import-untyped]
from asn1crypto.algos import DigestAlgorithm, SignedDigestAlgorithm  # type: ignore[import-untyped]
from msgspec import Struct

from .certificates import Certificate, sign
from .keys import Key

SIGNED_AT = datetime(2020, 1, 1, tzinfo=timezone.utc)


class Signer(Struct, frozen=True, kw_only=True):
    """Who signs: `certificate` is named; `key` signs, where that is not the certificate's."""

    certificate: Certificate
    key: Key | None = None


class SignedData(Struct, frozen=True, kw_only=True):
    """How a message is signed.

    The defaults are sros2's: one signer, its certificate embedded, signed attributes.
    """

    signers: tuple[Signer, ...]
    digest: str = "sha256"
    attributes: bool = True
    embed_certificates: bool = True
    content: bytes | None = None
    """The content inside the message; None for a detached signature."""

    signed_at: datetime = SIGNED_AT
    """The signingTime attribute."""

    trailing: bytes = b""
    """What follows the structure, which then is no longer strict DER."""

    @cache  # noqa: B019 - a few hundred, all of one short run
    def der(self, signed: bytes) -> bytes:
        """The ContentInfo for the MIME entity `signed`, in DER; many samples share a document."""
        embedded = self.embed_certificates and self.signers
        data = cms.SignedData(
            {
                "version": "v1",
                "digest_algorithms": [DigestAlgorithm({"algorithm": self.digest})],
                "encap_content_info": {"content_type": "data", "content": self.content},
                "certificates": [x509.Certificate.load(s.certificate.der()) for s in self.signers]
                if embedded
                else None,
                "signer_infos": [self._signer_info(signer, signed) for signer in self.signers],
            }
        )
        return bytes(cms.ContentInfo({"content_type": "signed_data", "content": data}).dump()) + self.trailing

    def _signer_info(self, signer: Signer, signed: bytes) -> cms.SignerInfo:
        issuer = signer.certificate.issuer or signer.certificate
        attributes = self._attributes(signed) if self.attributes else None
        # RFC 5652, 5.4: with attributes, the signature covers them as a SET OF, not as the [0] they stand in.
        covered = attributes.dump() if attributes is not None else signed
        return cms.SignerInfo(
            {
                "version": "v1",
                "sid": cms.SignerIdentifier(
                    name="issuer_and_serial_number",
                    value=cms.IssuerAndSerialNumber(
                        {"issuer": issuer.name(), "serial_number": signer.certificate.serial_number()}
                    ),
                ),
                "digest_algorithm": DigestAlgorithm({"algorithm": self.digest}),
                "signed_attrs": attributes,
                "signature_algorithm": SignedDigestAlgorithm({"algorithm": f"{self.digest}_ecdsa"}),
                "signature": sign(signer.key or signer.certificate.key, covered, self.digest),
            }
        )

    def _attributes(self, signed: bytes) -> cms.CMSAttributes:
        values: dict[str, object] = {
            "content_type": "data",
            "signing_time": cms.Time({"utc_time": self.signed_at}),
            "message_digest": hashlib.new(self.digest, signed).digest(),
        }
        return cms.CMSAttributes([cms.CMSAttribute({"type": kind, "values": [v]}) for kind, v in values.items()])
