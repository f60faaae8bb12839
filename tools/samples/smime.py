"""S/MIME messages in the shape that sros2 (pyca's PKCS7SignatureBuilder) writes."""

from __future__ import annotations

import base64
import hashlib

from msgspec import Struct

from .certificates import Certificate
from .cms import SignedData, Signer

PREAMBLE = b"This is an S/MIME signed message"
TEXT_PLAIN = b"Content-Type: text/plain\r\n\r\n"


class Message(Struct, frozen=True, kw_only=True):
    """How a document becomes a `.p7s`.

    `text` False leaves out the inner `Content-Type: text/plain` header, as `openssl smime -sign` without
    `-text` does.
    """

    signature: SignedData
    text: bool = True
    epilogue: bytes = b""

    def entity(self, document: bytes) -> bytes:
        """The signed MIME entity: RFC 8551, 3.1.1 wants CRLF line ends."""
        return (TEXT_PLAIN if self.text else b"") + document.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n")

    def smime(self, document: bytes) -> bytes:
        """`multipart/signed` (RFC 8551, 3.5.3), all lines CRLF."""
        entity = self.entity(document)
        # A boundary from the content: no random, and no document can hold it by chance.
        boundary = b"===============" + str(int(hashlib.sha256(entity).hexdigest()[:16], 16)).encode() + b"=="
        top = (
            b"MIME-Version: 1.0\r\n"
            b'Content-Type: multipart/signed; protocol="application/x-pkcs7-signature"; '
            b'micalg="sha-256"; boundary="' + boundary + b'"\r\n\r\n' + PREAMBLE + b"\r\n\r\n"
        )
        signature = (
            b'Content-Type: application/x-pkcs7-signature; name="smime.p7s"\r\n'
            b"Content-Transfer-Encoding: base64\r\n"
            b'Content-Disposition: attachment; filename="smime.p7s"\r\n\r\n' + _base64(self.signature.der(entity))
        )
        rule = b"--" + boundary
        parts = (top, rule, b"\r\n", entity, b"\r\n", rule, b"\r\n", signature, b"\r\n", rule, b"--\r\n")
        return b"".join(parts) + self.epilogue

    def opaque(self, document: bytes) -> bytes:
        """`application/pkcs7-mime` (RFC 8551, 3.5.2), as `openssl smime -sign -nodetach` writes it."""
        entity = self.entity(document)
        inside = SignedData(
            signers=self.signature.signers,
            digest=self.signature.digest,
            attributes=self.signature.attributes,
            content=entity,
        )
        return (
            b"MIME-Version: 1.0\r\n"
            b'Content-Disposition: attachment; filename="smime.p7m"\r\n'
            b'Content-Type: application/x-pkcs7-mime; smime-type=signed-data; name="smime.p7m"\r\n'
            b"Content-Transfer-Encoding: base64\r\n\r\n" + _base64(inside.der(entity))
        )


def signed_by(*certificates: Certificate) -> Message:
    """A message signed the usual way by the keys of `certificates`."""
    return Message(signature=SignedData(signers=tuple(Signer(certificate=c) for c in certificates)))


def _base64(data: bytes) -> bytes:
    return base64.encodebytes(data).replace(b"\n", b"\r\n")
