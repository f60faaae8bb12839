"""Departures from the one form of CMS that we read."""

from __future__ import annotations

import hashlib

from cryptography.hazmat.primitives.serialization import Encoding
from msgspec.structs import replace

from keystore_audit.keystore.cms import MAX_EMBEDDED, MAX_SIGNERS
from tests.keystore.builder import crl
from tests.oracles.smime.der import (
    DATA,
    ECDSA_SHA256,
    ECDSA_SHA384,
    ED25519,
    NULL,
    RSA,
    SHA256,
    SHA512,
    algorithm,
    attribute,
    oid,
    parse,
    tlv,
)
from tests.oracles.smime.signed_data import (
    CA,
    CONTENT_TYPE,
    ENTITY,
    GOOD,
    LEAF,
    MESSAGE_DIGEST,
    OTHER_DIGEST,
    RSA_CA,
    SIGNING_TIME,
    Info,
    changed,
    indefinite,
    padded,
    sign,
)

KEY_IDENTIFIER = tlv(0x80, b"\x01" * 20)
BY_RSA = Info(signer=RSA_CA, label=algorithm(RSA, NULL))
TWO_INFOS = tuple(sorted((Info().der(), Info(signer=LEAF).der())))

VALUES = {
    # In an attribute of nobody's. Read as they stand, and written so:
    "boolean": tlv(1, b"\xff"),
    "text that is no UTF-8": tlv(0x0C, b"\xff\xfe"),
    "sequence of no elements": tlv(0x30, b"anything"),
    "octets with a context tag": tlv(0x85, b"anything"),
    "bit string with unused bits": tlv(3, b"\x03\xa8"),
    # OpenSSL refuses them, or hashes other bytes:
    "constructed time": tlv(0x37, tlv(0x17, b"240101000000Z")),
    "constructed octets": tlv(0x24, tlv(4, b"x")),
    "constructed boolean": tlv(0x21, b"\xff"),
    "boolean of two bytes": tlv(1, b"\x01\x02"),
    "empty integer": tlv(2),
    "padded integer": tlv(2, b"\x00\x01"),
    "NULL with content": tlv(5, b"x"),
    "malformed identifier": tlv(6, b"\x80\x01"),
    "bit string of nothing": tlv(3),
    "bit string with unused bits that are set": tlv(3, b"\x03\xac"),
    "BMPString of three bytes": tlv(0x1E, b"abc"),
    "primitive sequence": tlv(0x10, b"ab"),
}


def _odd_certificate() -> bytes:
    """A certificate whose signature algorithm has a malformed parameter."""
    (structure,) = parse(RSA_CA.der)
    identifier, parameter = structure.children[0].children[2].children
    identifier.octets, parameter.octets = b"\x2a\x03\x04", b"x"
    return structure.encode()


CRAFTED: dict[str, bytes] = {
    "good": GOOD.der(),
    "digest algorithm without NULL": replace(changed(digest=algorithm(SHA256)), digests=(algorithm(SHA256),)).der(),
    "one with NULL, one without": changed(digest=algorithm(SHA256)).der(),
    "more digest algorithms than needed": replace(
        GOOD, digests=tuple(sorted((algorithm(SHA256, NULL), algorithm(SHA512, NULL))))
    ).der(),
    "no signing time": changed(attributes=(CONTENT_TYPE, MESSAGE_DIGEST)).der(),
    "an attribute of nobody's": changed(attributes=(CONTENT_TYPE, MESSAGE_DIGEST, attribute("1.2.3.4", NULL))).der(),
    "signing time that is none": changed(
        attributes=(CONTENT_TYPE, MESSAGE_DIGEST, attribute("1.2.840.113549.1.9.5", NULL))
    ).der(),
    "no certificates": replace(GOOD, certificates=b"").der(),
    "two certificates out of order": replace(
        GOOD,
        certificates=tlv(160, *sorted((s.der for s in (CA, LEAF)), reverse=True)),
    ).der(),
    "no attributes": changed(attributes=None).der(),
    "other digest in the attributes": changed(attributes=(CONTENT_TYPE, OTHER_DIGEST)).der(),
    "two signers": replace(GOOD, infos=TWO_INFOS).der(),
    "signature of nobody": changed(signature=b"\x00" * 70).der(),
    "empty signature": changed(signature=b"").der(),
    "signed by another key": changed(make=lambda _, data: sign(LEAF, data)).der(),
    "other serial number": changed(identifier=tlv(48, CA.certificate.issuer.public_bytes(), b"\x02\x01\x05")).der(),
    "no attributes, signed another text": changed(attributes=None, make=lambda signer, _: sign(signer, b"x")).der(),
    "no signer": replace(GOOD, infos=()).der(),
    "certificates alone": replace(GOOD, infos=(), digests=()).der(),
    "data": tlv(48, oid(DATA), tlv(160, tlv(4, b"x"))),
    "enveloped data": replace(GOOD, type="1.2.840.113549.1.7.3").der(),
    "bytes behind": replace(GOOD, trailing=b"\x00").der(),
    "structure behind": replace(GOOD, trailing=GOOD.der()).der(),
    "indefinite length": indefinite(GOOD.der()),
    "length in more bytes than needed": padded(GOOD.der()),
    "short length in the long form": replace(GOOD, version=b"\x02\x81\x01\x01").der(),
    "text inside too": replace(GOOD, content=tlv(48, oid(DATA), tlv(160, tlv(4, b"evil")))).der(),
    "digest algorithms with one that is none": replace(
        GOOD, digests=tuple(sorted((algorithm(SHA256, NULL), algorithm("1.2.3.4"))))
    ).der(),
    "digest algorithms with MD4": replace(
        GOOD, digests=tuple(sorted((algorithm(SHA256, NULL), algorithm("1.2.840.113549.2.4"))))
    ).der(),
    "digest algorithms empty": replace(GOOD, digests=()).der(),
    "digest algorithms without the one": replace(GOOD, digests=(algorithm(SHA512, NULL),)).der(),
    "digest algorithms with parameters": replace(GOOD, digests=(algorithm(SHA256, tlv(4, b"x")),)).der(),
    "digest algorithm with parameters": changed(digest=algorithm(SHA256, tlv(4, b"x"))).der(),
    "digest algorithm is no algorithm": changed(digest=tlv(4, b"x")).der(),
    "version 3": replace(GOOD, version=tlv(2, b"\x03")).der(),
    "signer of version 3": changed(version=tlv(2, b"\x03")).der(),
    "signer by key identifier": changed(identifier=KEY_IDENTIFIER, version=tlv(2, b"\x03")).der(),
    "content of another type": replace(GOOD, content=tlv(48, oid("1.2.3.4"))).der(),
    "revocation lists": replace(GOOD, crls=tlv(161, crl(CA).public_bytes(Encoding.DER))).der(),
    "a certificate that is none": replace(GOOD, certificates=tlv(160, tlv(48, NULL))).der(),
    "a certificate whose algorithm nobody knows has a malformed parameter": replace(
        GOOD, certificates=tlv(0xA0, _odd_certificate())
    ).der(),
    "a certificate whose name is no string": replace(
        GOOD,
        certificates=tlv(160, CA.der.replace(b"\x0c\x07sros2CA", b"\x04\x07sros2CA")),
    ).der(),
    "no content type": changed(attributes=(MESSAGE_DIGEST,)).der(),
    "content type of another type": changed(
        attributes=(attribute("1.2.840.113549.1.9.3", oid("1.2.3.4")), MESSAGE_DIGEST)
    ).der(),
    "content type twice": changed(attributes=(CONTENT_TYPE, CONTENT_TYPE, MESSAGE_DIGEST)).der(),
    "no message digest": changed(attributes=(CONTENT_TYPE,)).der(),
    "message digest twice, the good one first": changed(
        attributes=(CONTENT_TYPE, MESSAGE_DIGEST, OTHER_DIGEST), sort=False
    ).der(),
    "message digest twice, the good one last": changed(
        attributes=(CONTENT_TYPE, OTHER_DIGEST, MESSAGE_DIGEST), sort=False
    ).der(),
    "message digest with two values": changed(
        attributes=(
            CONTENT_TYPE,
            attribute(
                "1.2.840.113549.1.9.4", *sorted(tlv(4, hashlib.sha256(text).digest()) for text in (ENTITY, b"evil"))
            ),
        )
    ).der(),
    "message digest that is no octet string": changed(
        attributes=(CONTENT_TYPE, attribute("1.2.840.113549.1.9.4", NULL))
    ).der(),
    "attributes out of order": changed(attributes=(MESSAGE_DIGEST, SIGNING_TIME, CONTENT_TYPE), sort=False).der(),
    "empty attributes": changed(attributes=(), make=lambda signer, _: sign(signer, ENTITY)).der(),
    "signers out of order": replace(GOOD, infos=tuple(sorted((Info().der(), BY_RSA.der()), reverse=True))).der(),
    "unsigned attributes": changed(unsigned=tlv(161, attribute("1.2.3.4", NULL))).der(),
    "label of another digest": changed(label=algorithm(ECDSA_SHA384)).der(),
    "label of another key": changed(label=algorithm(RSA, NULL)).der(),
    "label with parameters": changed(label=algorithm(ECDSA_SHA256, tlv(4, b"x"))).der(),
    "label of nothing known": changed(label=algorithm("1.2.3.4")).der(),
    "digest of nothing known": changed(digest=algorithm("1.2.3.4"), label=algorithm(ECDSA_SHA256)).der(),
    "label of Ed25519": changed(label=algorithm(ED25519)).der(),
    "too many signers": replace(GOOD, infos=tuple(sorted(Info().der() for _ in range(MAX_SIGNERS + 1)))).der(),
    "too many certificates": replace(GOOD, certificates=tlv(160, CA.der * (MAX_EMBEDDED + 1))).der(),
    "nothing": b"",
    "a sequence of nothing": b"0\x00",
    "cut off": GOOD.der()[:-1],
    "random": hashlib.sha512(b"random").digest(),
    **{
        f"value of an attribute: {title}": changed(
            attributes=(CONTENT_TYPE, MESSAGE_DIGEST, attribute("1.2.3.4", value))
        ).der()
        for title, value in VALUES.items()
    },
}
"""What each is worth stands in verdicts.tsv; the order of the groups is that of what it means."""
