"""Messages changed behind the signature and signed again: what only whoever holds the key can make.

Nothing else looks behind the signature: a change of what is signed only makes it invalid.
"""

from __future__ import annotations

import hashlib
import random
import re
from collections.abc import Mapping

from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, padding, rsa

from tests.keystore.builder import Signed
from tests.keystore.messages import put_together, taken_apart
from tests.oracles.smime.der import SHA1, SHA256, SHA512, Element, oid, parse, tlv

DIGESTS = {
    oid("1.2.840.113549.2.5"): hashes.MD5(),
    oid(SHA1): hashes.SHA1(),
    oid("2.16.840.1.101.3.4.2.4"): hashes.SHA224(),
    oid(SHA256): hashes.SHA256(),
    oid("2.16.840.1.101.3.4.2.2"): hashes.SHA384(),
    oid(SHA512): hashes.SHA512(),
}
_MESSAGE_DIGEST = oid("1.2.840.113549.1.9.4")
_ENTITY = re.compile(rb'(?s)\A(.*boundary="([^"\n]*)".*?\n--\2\r?\n)(.*?)(\r?\n--\2\r?\n.*)\Z')

Signers = Mapping[int, Signed]
"""Whoever can sign, by serial number of the certificate."""


def entity_of(message: bytes) -> tuple[bytes, bytes, bytes]:
    """What stands before the signed text, the signed text, and what stands behind it; ValueError for other messages."""
    match = _ENTITY.match(message)
    if match is None:
        raise ValueError(message)
    return match[1], match[3], match[4]


def covered_by(structure: Element, message: bytes) -> bytes:
    """What a signature has to cover: the text outside the structure or, in an opaque message, the one inside."""
    if _ENTITY.match(message) is not None:
        return canonical(entity_of(message)[1])
    try:
        return structure.children[1].children[0].children[2].children[1].children[0].octets
    except IndexError:
        raise ValueError(message) from None


def canonical(entity: bytes) -> bytes:
    """What is signed of a text: its lines without their ends, joined by CRLF."""
    return b"\r\n".join(line.rstrip(b"\r") for line in entity.split(b"\n"))


def signed_again(message: bytes, signers: Signers) -> bytes:
    """The message with digests and signatures for the text that it has now."""
    before, der, behind = taken_apart(message)
    (structure,) = parse(der)
    sign(structure, canonical(entity_of(message)[1]), signers, digest=True)
    return put_together(before, structure.encode(), behind)


def sign(structure: Element, entity: bytes, signers: Signers, *, digest: bool) -> None:
    """Sign every SignerInfo of a ContentInfo again, as far as it still has the form of one; ValueError if it has not.

    `digest`: give the signed attributes the digest of `entity` first.
    """
    try:
        infos = structure.children[1].children[0].children[-1].children
        for info in infos:
            _sign_one(info, entity, signers, digest=digest)
    except IndexError:
        raise ValueError(structure) from None


def _sign_one(info: Element, entity: bytes, signers: Signers, *, digest: bool) -> None:
    serial = int.from_bytes(info.children[1].children[1].octets, "big")
    algorithm = DIGESTS.get(info.children[2].children[0].encode(), hashes.SHA256())
    attributes = next((child for child in info.children if child.tag == 0xA0), None)
    covered = entity
    if attributes is not None:
        for attribute in attributes.children if digest else ():
            if attribute.children and attribute.children[0].encode() == _MESSAGE_DIGEST:
                for value in attribute.children[1].children:
                    value.octets = hashlib.new(algorithm.name, entity).digest()
        covered = tlv(0x31, *(child.encode() for child in attributes.children))
    signature = next((child for child in reversed(info.children) if child.tag == 4), None)
    if signature is None or serial not in signers:
        raise ValueError(serial)
    key = signers[serial].key
    if isinstance(key, ec.EllipticCurvePrivateKey):
        signature.octets = key.sign(covered, ec.ECDSA(algorithm))
    elif isinstance(key, rsa.RSAPrivateKey):
        signature.octets = key.sign(covered, padding.PKCS1v15(), algorithm)


# --- the header of what is signed

_HEADERS = (
    *(b"content-type: TEXT/PLAIN", b"Content-Type:text/plain", b"Content-Type : text/plain"),
    b" Content-Type: text/plain",
    *(b'Content-Type: "text/plain"', b'Content-Type: text/plain"', b'Content-Type: "text/plain', b'Content-Type: "t"'),
    *(b"Content-Type: text/plain;", b"Content-Type: text/plain; charset=utf-8", b'Content-Type: text/plain; a="b;c"'),
    *(b"Content-Type: text/plain (note)", b"Content-Type: (note) text/plain", b"Content-Type: text/pl(x)ain"),
    *(b"Content-Type: text/plain\r\n ; a=b", b"Content-Type:\r\n text/plain", b"Content-Type: text/plain\r\n\tx=y"),
    *(b"X: y\r\nContent-Type: text/plain", b"Content-Type: text/plain\r\nX: y", b"x\r\nContent-Type: text/plain"),
    *(b"Content-Type: text/html\r\nContent-Type: text/plain", b"Content-Type: text/plain\r\nContent-Type: text/html"),
    *(b"Content-Type: text/plain; a=1; a=2", b"Content-Type: text/plain; a=(1); b", b"Content-Type: text/plain; (a=b"),
    *(b"Content-Type: text/plain\rX: y", b"Content-Type: text/plain\x00", b"Content-Type: text/plain\x0b"),
    *(b"Content-Type: text/plain" + b" " * 1000, b"X: " + b"y" * 1030 + b"\r\nContent-Type: text/plain"),
    *(b"Content-Type: text/plain;" + b"x" * 1000, b"\xef\xbb\xbfContent-Type: text/plain", b"Content-Type"),
    *(b"X: y\r\n" * 70 + b"Content-Type: text/plain", b"\r\nContent-Type: text/plain", b"text/plain"),
    *(b"Content-Type: text/plainx", b"Content-Type: text/plain\r\n"),
    *(b"Content-Type: text/plain\r\n  \r\nX: y", b"Content-Type: text/plain\r\n="),
    b"Content-Type: text/plain\r\n y: z",
)  # fmt: skip
_SIGNS = b'\r\n\t :;="()\x00\x0b\x0c<>-tx/A\xff'


def other_header(message: bytes, rng: random.Random, signers: Signers) -> bytes:
    """Another header of the signed text, or other characters in it; signed again."""
    before, entity, behind = entity_of(message)
    header, blank, text = entity.partition(b"\r\n\r\n")
    if rng.random() < 0.5:
        header = rng.choice(_HEADERS)
    else:
        for _ in range(rng.choice((1, 1, 2, 3))):
            at = rng.randrange(len(header) + 1)
            header = header[:at] + bytes([rng.choice(_SIGNS)]) + header[at + rng.randrange(2) :]
    return signed_again(before + header + blank + text + behind, signers)


_ENDS = (
    b"\r",
    b"\r\r",
    b" ",
    b"\t",
    b"\n",
    b"\r\n",
    b"\x00",
    b"\x1a",
    b"--",
    b"x" * 1022,
    b"\r" * 1023,
    b"x" * 1021 + b"\r",
)


def other_text(message: bytes, rng: random.Random, signers: Signers) -> bytes:
    """Another signed text, with odd line ends and long lines; signed again."""
    before, entity, behind = entity_of(message)
    for _ in range(rng.choice((1, 2, 3))):
        at = rng.choice(
            (rng.randrange(len(entity) + 1), rng.choice([m.start() for m in re.finditer(rb"\r?\n", entity)] or [0]))
        )
        entity = entity[:at] + rng.choice(_ENDS) + entity[at:]
    return signed_again(before + entity + behind, signers)
