"""Private keys, certificates and signed messages in files that nobody parses: what their bytes tell, whatever they are
called.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from keystore_audit.keystore.der import (
    CONSTRUCTED,
    IDENTIFIER,
    INTEGER,
    OCTET_STRING,
    SEQUENCE,
    any_structure,
    inside,
    opening,
)
from keystore_audit.keystore.forms import BLOCK, may_hold_structures, may_hold_text, structures_in_base64, texts
from keystore_audit.keystore.message import (
    ARMOUR,
    FIELD,
    TYPES,
    concealed,
    ends_header,
    is_signed_data,
    may_be_message,
)

MAX_SEARCHED: Final = 16 * 1024 * 1024
"""Bytes of files too large to be read that are searched and hashed, all files of a keystore together: a tenth of a
second, and half a second whatever stands there.
"""

LEAST: Final = 4096
"""Bytes that are searched of each of them at least: the header of a real message has 250."""

_PIECE: Final = 1024 * 1024
_OVERLAP: Final = 64
"""More than any of the words that are looked for has."""

_KEY: Final = b"PRIVATE KEY-----"
"""How the first line of a private key in PEM ends (RFC 7468, 10 and 11; OpenSSL's older forms)."""

_CERTIFICATE: Final = b"CERTIFICATE-----"
"""How the first line of a certificate in PEM ends (RFC 7468, 5.1), and of its older and OpenSSL's own form."""

_ARMOUR: Final = tuple(f"{label}-----".encode() for label in ARMOUR)
"""The same of all that certificates may stand in: messages may carry some and no signature."""

_VERSION: Final = 0xA0
"""The tag of a certificate's version, which only version 1 leaves out."""

_BEHIND_VERSION: Final = (INTEGER, OCTET_STRING, OCTET_STRING | CONSTRUCTED)
"""What follows the version of a key that does not say its algorithm; the last: a string in pieces (BER)."""

_MICROSOFT: Final = re.compile(rb"\x07\x02.{6}(?:RSA2|DSS2)|\x1e\xf1\xb5\xb0", re.DOTALL)
"""How private keys begin in a blob and in a PVK file of Microsoft's, both of which OpenSSL reads."""

_MAX_VERSION: Final = 4
"""Bytes that OpenSSL reads of the version of a key: what begins with a longer number is a public key, say."""

_PASSWORDS: Final = (bytes.fromhex("2a864886f70d0105"), bytes.fromhex("2a864886f70d010c01"))
"""PKCS #5 and PKCS #12: how a private key is encrypted with a password (RFC 8018, RFC 7292)."""

_CONTENT: Final = bytes.fromhex("2a864886f70d0107")
"""The content types of PKCS #7, up to the last number; one stands near the beginning of every PKCS #12 file."""


class Traces(NamedTuple):
    """What a file may hold. `sha256`: of all of it, in hexadecimal; None where the search ended before the file did.

    `certificate`: also where it did. `concealed`: how a message stands in it (`message.concealed`), if it was read.
    """

    private_key: bool
    certificate: bool
    message: bool
    sha256: str | None
    concealed: str = ""


def look(content: bytes) -> Traces:
    """What a file that was read may hold: in PEM, in DER or in other forms (`forms`).

    PKCS #12 files and Microsoft's two kinds are made for a key; messages and PKCS #12 files may carry certificates.
    """
    is_message = may_be_message(content)
    others = [*texts(content, BLOCK)]
    # The signature within a message is base64, too.
    encoded = [*(structures_in_base64(content, _is_key_or_certificate) if is_message else in_base64(content))]
    # By itself: in a list of names and values, a certificate may be read on into what stands behind it.
    signed = () if is_message else structures_in_base64(content, is_signed_data)
    how = concealed(content, others, signed)
    written = b"\n".join((content, *others))
    secret = _KEY in written or _MICROSOFT.match(content) is not None
    certified = any(word in written for word in _ARMOUR)
    return Traces(
        private_key=secret or any(map(is_key_in_der, encoded)) or any_structure(is_key_in_der, content),
        certificate=certified
        or any(map(_may_hold_certificates, encoded))
        or any_structure(_may_hold_certificates, content),
        message=is_message or how != "",
        sha256=hashlib.sha256(content).hexdigest(),
        concealed=how,
    )


def in_base64(data: bytes) -> Iterator[bytes]:
    """Keys, certificates and signed data in DER that stand in it in base64 alone."""
    return structures_in_base64(data, _is_looked_for)


def _is_key_or_certificate(head: bytes) -> bool:
    return has_certificate_version(head) or is_key_in_der(head)


def _is_looked_for(head: bytes) -> bool:
    return _is_key_or_certificate(head) or is_signed_data(head)


def _may_hold_certificates(der: bytes) -> bool:
    return is_certificate_in_der(der) or is_signed_data(der) or is_pkcs12(der)


def is_certificate_in_der(data: bytes) -> bool:
    """By the first elements (RFC 5280, 4.1): the version, or the serial number of one of version 1."""
    return has_certificate_version(data) or inside(data, SEQUENCE, SEQUENCE, INTEGER) is not None


def has_certificate_version(data: bytes) -> bool:
    """By the first elements: what else begins with a number, as revocation lists and requests do, has no such field."""
    return inside(data, SEQUENCE, SEQUENCE, _VERSION) is not None


def is_pkcs12(data: bytes) -> bool:
    """By the first elements (RFC 7292, 4); OpenSSL looks at no version."""
    _length, rest = _numbered(data)
    kind = inside(rest, SEQUENCE, IDENTIFIER)
    return kind is not None and kind.startswith(_CONTENT)


def is_key_in_der(data: bytes) -> bool:
    """By the first elements: PKCS #8 (RFC 5958), encrypted or not; RSA, DSA and EC keys (RFC 8017, RFC 5915);
    PKCS #12 (RFC 7292). OpenSSL takes other versions than there are.
    """
    algorithm = inside(data, SEQUENCE, SEQUENCE, IDENTIFIER)
    if algorithm is not None:
        return algorithm.startswith(_PASSWORDS)
    length, rest = _numbered(data)
    if inside(rest, SEQUENCE, IDENTIFIER) is not None:
        return True
    return rest != b"" and length <= _MAX_VERSION and any(inside(rest, tag) is not None for tag in _BEHIND_VERSION)


def _numbered(data: bytes) -> tuple[int, bytes]:
    """Of a SEQUENCE that begins with a number: how long that is, and what follows it; b"" where it does not."""
    body = inside(data, SEQUENCE) or b""
    if inside(body, INTEGER) is None:
        return 0, b""
    _tag, start, length = opening(body, 0)
    return length or 0, body[start + (length or 0) :]


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
        text = before + piece
        if at == 0:
            key, certificate, message = look(piece)[:3]
        armour = {word for word in _ARMOUR if word in text}
        key = key or _KEY in text
        encoded = may_hold_structures(text, _is_looked_for)
        certificate = certificate or bool(armour) or encoded or may_hold_text(text, BLOCK)
        message = message or not armour <= {_CERTIFICATE} or may_hold_text(text, FIELD)
        message = message or (encoded and may_hold_structures(text, is_signed_data))
        lowered = text.lower()
        message = message or any(word in lowered for word in TYPES)
        ended = ended or ends_header(text)
        if len(piece) < min(left, _PIECE):
            return Traces(key, certificate, message, digest.hexdigest()), at + len(piece)
        at += len(piece)
        left -= len(piece)
        before = text[-_OVERLAP:]
    whole = not os.pread(descriptor, 1, at)
    sha256 = digest.hexdigest() if whole else None
    return Traces(key, certificate or not whole, message or not (ended or whole), sha256), at
