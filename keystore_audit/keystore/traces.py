"""What the bytes of any file tell, whatever it is called: read as OpenSSL's own parsers read them, and searched for
nothing else.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from itertools import islice
from sys import intern
from typing import Final, NamedTuple

from keystore_audit.keystore.certificate import Certificate, read_certificate
from keystore_audit.keystore.cms import CmsError, read_signed_data
from keystore_audit.keystore.der import IDENTIFIER, first_element, opening
from keystore_audit.keystore.mime import TYPES, header_end, may_be_message, names_type
from keystore_audit.keystore.pem import LINE, base64_of, loose_blocks
from keystore_audit.keystore.private_key import holds_key

# --- messages, or the marks of one: asked of every file of a keystore

_SIGNED_DATA: Final = bytes.fromhex("2a864886f70d010702")
"""The identifier of signed data (RFC 5652, 5.1)."""

_ENCODED: Final = (b"YJKoZIhvcNAQcC", b"BgkqhkiG9w0BBwI", b"GCSqGSIb3DQEHAq")
"""The same in base64, behind 1, 0 or 2 bytes of a group of three: what every signature has near its beginning."""

ARMOUR: Final = ("CERTIFICATE", "PKCS7", "CMS", "SIGNED DATA")
"""How PEM labels of messages and certificates end. OpenSSL takes the first for a message, too, knows
`TRUSTED CERTIFICATE`, and writes `PKCS #7 SIGNED DATA` itself.
"""

MAX_ARMOURED: Final = 10_000
"""Blocks of one file that are looked at."""


def concealed(data: bytes) -> str:
    """How `data` carries the mark of a signed message that OpenSSL does not read there, in words; "" if it does not.

    Anybody can bring such a message into a form that is read, since the signature is not over the form. In a text that
    only speaks of messages no signature follows the mark. Certificates in PEM, which nobody signed, are none.
    """
    if names_type(data[header_end(data) :]) and any(mark in base64_of(data) for mark in _ENCODED):
        return "a signed message stands in it below other text"
    blocks = islice(loose_blocks(data, *ARMOUR), MAX_ARMOURED) if b"-----BEGIN " in data else ()
    if any(_is_signed(block.der or b"") for block in blocks):
        return "a signature in PEM stands in it, without the S/MIME around it"
    return ""


def is_signed_data(data: bytes) -> bool:
    """Whether it begins as a signed message in DER or BER does."""
    try:
        _tag, inner, _length = opening(data, 0)
        tag, content, _length = opening(data, inner)
    except ValueError:
        return False
    return tag == IDENTIFIER and data.startswith(_SIGNED_DATA, content)


def _is_signed(der: bytes) -> bool:
    """Whether it is signed data that has a signature, or cannot be read; what carries certificates alone has none."""
    try:
        return is_signed_data(der) and bool(read_signed_data(der).signers)
    except CmsError:
        return True


# --- any file

MAX_HASHED: Final = 64 * 1024 * 1024
"""Bytes of files too large to be read that are hashed, all files of a keystore together: a fifth of a second."""

_PIECE: Final = 1024 * 1024
_OVERLAP: Final = 64
"""More than any of the marks has."""

_MARKS: Final = tuple(f"{label}-----".lower().encode() for label in (*ARMOUR, "PRIVATE KEY"))
_OF_MESSAGES: Final = _MARKS[1:-1]
"""Those of certificates and private keys apart."""

_PLAIN: Final = (b"CERTIFICATE", b"CERTIFICATE REQUEST", b"X509 CRL", b"KEY", b"PARAMETERS")
"""How the labels end of PEM that says what it holds."""

_DIGEST: Final = re.compile(rb"\b[0-9a-fA-F]{40,128}\b")
"""Of a list of digests."""


class Traces(NamedTuple):
    """What a file may hold, as `File` has it. `sha256`: of all of it; None where it was too large for that."""

    holds_private_key: bool
    holds_certificates: bool
    may_be_message: bool
    sha256: str | None
    concealed: str = ""
    opaque: str = ""


def look(content: bytes) -> Traces:
    """What a file may hold of which every byte is here."""
    message, how = may_be_message(content), concealed(content)
    key = certificate = False
    if b"-----BEGIN " in content:
        blocks = islice(loose_blocks(content, *ARMOUR, "PRIVATE KEY"), MAX_ARMOURED)
        labels = [block.label for block in blocks if block.der != b""]
        key = any(label.endswith("PRIVATE KEY") for label in labels)
        certificate = any(label.endswith(ARMOUR) for label in labels)
    element = first_element(content) if content[:1] == b"0" else None
    if element is not None:
        key = key or holds_key(element)
        certificate = certificate or isinstance(read_certificate(element, 1, ""), Certificate)
    known = message or (element == content and (key or certificate))
    return Traces(
        holds_private_key=key,
        holds_certificates=certificate,
        may_be_message=message or how != "",
        sha256=intern(hashlib.sha256(content).hexdigest()),
        concealed=how,
        opaque="" if known else _unread(content),
    )


def _unread(content: bytes) -> str:
    if b"\0" in content or not _is_utf8(content):
        return "is no text, message, certificate or key"
    if any(LINE.search(_DIGEST.sub(b"", text)) for text in _outside_blocks(content)):
        return "holds base64 that was not decoded"
    return ""


def _is_utf8(content: bytes) -> bool:
    try:
        content.decode()
    except UnicodeDecodeError:
        return False
    return True


def _outside_blocks(content: bytes) -> Iterator[bytes]:
    first, *pieces = content.split(b"-----BEGIN ")
    yield first
    for piece in pieces:
        label, _hyphens, body = piece.partition(b"-----")
        _block, end, behind = body.partition(b"-----END ")
        yield behind if label.endswith(_PLAIN) and end else body


def search(descriptor: int, most: int) -> tuple[Traces, int]:
    """What marks stand in a file too large to be read, and how many bytes of it were looked at.

    None are looked for where it has more than `most`: it is not known what that holds. Raises OSError.
    """
    digest = hashlib.sha256()
    found: set[bytes] = set()
    at, before = 0, b""
    if os.fstat(descriptor).st_size > most:
        return Traces(False, False, False, None), 0
    while piece := os.pread(descriptor, _PIECE, at):
        at += len(piece)
        if at > most:  # what a file says of its size need not be true
            return Traces(False, False, False, None), at
        digest.update(piece)
        text = (before + piece).lower()
        found.update(mark for mark in (*_MARKS, *TYPES) if mark in text)
        before = text[-_OVERLAP:]
    message = not found.isdisjoint((*TYPES, *_OF_MESSAGES))
    return Traces(False, not found.isdisjoint(_MARKS), message, digest.hexdigest()), at
