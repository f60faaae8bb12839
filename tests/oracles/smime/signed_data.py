"""A CMS SignedData of a governance document by hand, so that any part of it can be another."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, padding, rsa
from msgspec import Struct, field
from msgspec.structs import replace

from tests.keystore.builder import GOVERNANCE, Signed, authority, certificate, rsa_key
from tests.keystore.messages import by_openssl
from tests.oracles.smime.der import (
    DATA,
    ECDSA_SHA256,
    NULL,
    SHA256,
    SIGNED_DATA,
    algorithm,
    attribute,
    integer,
    oid,
    tlv,
)

CA = authority()
RSA_CA = authority(key=rsa_key())
ED_CA = authority(key=ed25519.Ed25519PrivateKey.generate())
LEAF = certificate("/talker", CA)
ENTITY = b"Content-Type: text/plain\r\n\r\n" + GOVERNANCE.replace(b"\n", b"\r\n")
MESSAGE = by_openssl(("smime", "-text"), CA)

CONTENT_TYPE = attribute("1.2.840.113549.1.9.3", oid(DATA))
MESSAGE_DIGEST = attribute("1.2.840.113549.1.9.4", tlv(4, hashlib.sha256(ENTITY).digest()))
OTHER_DIGEST = attribute("1.2.840.113549.1.9.4", tlv(4, hashlib.sha256(b"evil").digest()))
SIGNING_TIME = attribute("1.2.840.113549.1.9.5", tlv(0x17, b"240101000000Z"))


def sign(signer: Signed, data: bytes) -> bytes:
    key = signer.key
    if isinstance(key, ec.EllipticCurvePrivateKey):
        return key.sign(data, ec.ECDSA(hashes.SHA256()))
    if isinstance(key, rsa.RSAPrivateKey):
        return key.sign(data, padding.PKCS1v15(), hashes.SHA256())
    return key.sign(data)


class Info(Struct, frozen=True, kw_only=True):
    """A SignerInfo; `attributes` as they stand in it, `order` as they are signed."""

    signer: Signed = CA
    version: bytes = tlv(2, b"\x01")
    identifier: bytes | None = None
    digest: bytes = algorithm(SHA256, NULL)
    attributes: tuple[bytes, ...] | None = (CONTENT_TYPE, SIGNING_TIME, MESSAGE_DIGEST)
    sort: bool = True
    label: bytes = algorithm(ECDSA_SHA256)
    signature: bytes | None = None
    make: Callable[[Signed, bytes], bytes] = sign
    unsigned: bytes = b""

    def der(self) -> bytes:
        certificate = self.signer.certificate
        name = tlv(0x30, certificate.issuer.public_bytes(), integer(certificate.serial_number))
        attributes = self.attributes
        if attributes is not None and self.sort:
            attributes = tuple(sorted(attributes))
        covered = ENTITY if attributes is None else tlv(0x31, *attributes)
        signature = self.signature if self.signature is not None else self.make(self.signer, covered)
        return tlv(
            0x30,
            self.version,
            self.identifier or name,
            self.digest,
            b"" if attributes is None else tlv(0xA0, *attributes),
            self.label,
            tlv(4, signature),
            self.unsigned,
        )


class Cms(Struct, frozen=True, kw_only=True):
    """A ContentInfo with a SignedData."""

    type: str = SIGNED_DATA
    version: bytes = tlv(2, b"\x01")
    digests: tuple[bytes, ...] = (algorithm(SHA256, NULL),)
    content: bytes = tlv(0x30, oid(DATA))
    certificates: bytes = field(default_factory=lambda: tlv(0xA0, CA.der))
    crls: bytes = b""
    infos: tuple[bytes | Info, ...] = (Info(),)
    trailing: bytes = b""

    def der(self) -> bytes:
        infos = [info.der() if isinstance(info, Info) else info for info in self.infos]
        data = tlv(
            0x30,
            self.version,
            tlv(0x31, *self.digests),
            self.content,
            self.certificates,
            self.crls,
            tlv(0x31, *infos),
        )
        return tlv(0x30, oid(self.type), tlv(0xA0, data)) + self.trailing


GOOD = Cms()


def changed(**info: object) -> Cms:
    """The good message with another SignerInfo."""
    return replace(GOOD, infos=(replace(Info(), **info),))  # type: ignore[arg-type]


def indefinite(der: bytes) -> bytes:
    """The outermost element with an indefinite length (BER)."""
    return b"\x30\x80" + der[4:] + b"\x00\x00"


def padded(der: bytes) -> bytes:
    """The outermost length in a byte more than needed (BER)."""
    return b"\x30\x83\x00" + der[2:]
