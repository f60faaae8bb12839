"""Private keys, certificates and signed messages in files that nobody parses: what their bytes tell, whatever they are
called.
"""

from __future__ import annotations

import hashlib
import os
from typing import Final, NamedTuple

from keystore_audit.keystore.message import SIGNED_DATA, TYPES, ends_header

MAX_SEARCHED: Final = 64 * 1024 * 1024
"""Bytes of files too large to be read that are searched and hashed, all files of a keystore together: a fifth of a
second.
"""

LEAST: Final = 4096
"""Bytes that are searched of each of them at least: the header of a real message has 250."""

_PIECE: Final = 1024 * 1024
_OVERLAP: Final = 64
"""More than any of the words that are looked for has."""

_KEY: Final = b"private key-----"
"""How the first line of a private key in PEM ends (RFC 7468, 10 and 11; OpenSSL's older forms), in small letters."""

_CERTIFICATE: Final = b"CERTIFICATE-----"
"""How the first line of a certificate in PEM ends (RFC 7468, 5.1), and of its older and OpenSSL's own form."""

_ARMOUR: Final = (b"-----begin pkcs7-----", b"-----begin cms-----", b"-----begin pkcs #7 signed data-----")

_BAGS: Final = (b"-----BEGIN PKCS", b"-----BEGIN CMS-")
"""How messages in PEM begin, which may carry certificates and no signature."""

_VERSION: Final = b"\x02\x01"
_SEQUENCE: Final = b"\x30"
_PASSWORDS: Final = (bytes.fromhex("2a864886f70d0105"), bytes.fromhex("2a864886f70d010c01"))
"""PKCS #5 and PKCS #12: how a private key is encrypted with a password (RFC 8018, RFC 7292)."""

_CONTENT: Final = bytes.fromhex("06092a864886f70d0107")
"""The content types of PKCS #7, up to the last number; one stands near the beginning of every PKCS #12 file."""


class Traces(NamedTuple):
    """What a file may hold. `sha256`: of all of it, in hexadecimal; None where the search ended before the file did.

    `certificate`: also where it did.
    """

    private_key: bool
    certificate: bool
    message: bool
    sha256: str | None


def holds_private_key(content: bytes) -> bool:
    """Whether a private key in PEM stands in it, or it is one in DER, or a PKCS #12 file, which is made for one."""
    return b"PRIVATE KEY-----" in content or is_key_in_der(content[:64])


def holds_certificates(content: bytes) -> bool:
    """Whether a certificate in PEM may stand in it, or it is one in DER, or a message that may carry some."""
    if any(word in content for word in (_CERTIFICATE, *_BAGS)) or is_certificate_in_der(content[:64]):
        return True
    return content[:1] == _SEQUENCE and SIGNED_DATA in content[:32]


def is_certificate_in_der(beginning: bytes) -> bool:
    """By the first elements (RFC 5280, 4.1): the version, or the serial number of one of version 1."""
    body = _inside(beginning)
    signed = None if body is None else _inside(body)
    return signed is not None and signed[:1] in (b"\xa0", b"\x02")


def is_pkcs12(beginning: bytes) -> bool:
    """By the first elements (RFC 7292, 4)."""
    body = _inside(beginning)
    return body is not None and body[:3] == _VERSION + b"\x03" and _CONTENT in body[3:27]


def is_key_in_der(beginning: bytes) -> bool:
    """By the first elements: PKCS #8 (RFC 5958), encrypted or not; RSA, DSA and EC keys (RFC 8017, RFC 5915);
    PKCS #12 (RFC 7292).
    """
    body = _inside(beginning)
    if body is None or is_pkcs12(beginning):
        return body is not None
    if body[:2] != _VERSION:
        algorithm = _inside(body)
        return algorithm is not None and any(algorithm[2:].startswith(each) for each in _PASSWORDS)
    version, rest = body[2:3], body[3:]
    algorithm = _inside(rest)
    if algorithm is not None:
        return version in (b"\0", b"\x01") and algorithm[:1] == b"\x06"
    return (version, rest[:1]) in ((b"\0", b"\x02"), (b"\x01", b"\x04"))


def _inside(data: bytes) -> bytes | None:
    """What follows tag and length of a SEQUENCE; None where there is none."""
    if data[:1] != _SEQUENCE or len(data) < 2:
        return None
    return data[2:] if data[1] < 0x80 else data[2 + (data[1] & 0x7F) :]


def search(descriptor: int, most: int) -> tuple[Traces, int]:
    """What the first bytes of an open file tell, `most` or LEAST of them, and how many were looked at.

    A file whose header does not end there may be a message. Raises OSError.
    """
    left = max(most, LEAST)
    at = 0
    key = certificate = message = ended = False
    before = b""
    digest = hashlib.sha256()
    while left > 0:
        piece = os.pread(descriptor, min(left, _PIECE), at)
        digest.update(piece)
        text = (before + piece).lower()
        if at == 0:
            message = piece[:1] == b"0" and SIGNED_DATA in piece[:32]
            key, certificate = is_key_in_der(piece[:64]), is_certificate_in_der(piece[:64])
        key = key or _KEY in text
        certificate = certificate or _CERTIFICATE.lower() in text
        message = message or any(word in text for word in (*TYPES, *_ARMOUR))
        ended = ended or ends_header(text)
        if len(piece) < min(left, _PIECE):
            return Traces(key, certificate, message, digest.hexdigest()), at + len(piece)
        at += len(piece)
        left -= len(piece)
        before = text[-_OVERLAP:]
    whole = not os.pread(descriptor, 1, at)
    sha256 = digest.hexdigest() if whole else None
    return Traces(key, certificate or not whole, message or not (ended or whole), sha256), at
