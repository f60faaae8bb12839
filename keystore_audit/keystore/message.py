"""Whether a file may be an S/MIME message, or carries the marks of one: asked of every file of a keystore."""

from __future__ import annotations

import re
from itertools import islice
from typing import Final

from keystore_audit.keystore.cms import CmsError, read_signed_data
from keystore_audit.keystore.der import IDENTIFIER, opening
from keystore_audit.keystore.pem import base64_of, loose_blocks

_BLANK_LINE: Final = re.compile(rb"\n[\n\r\0]")
"""What ends a header: OpenSSL ends lines at LF, and one that begins with CR, LF or NUL is blank (asn_mime.c)."""

TYPES: Final = (b"multipart/signed", b"pkcs7-mime")
"""What the header of a signed message has to say somewhere, in any case of letters."""

_SIGNED_DATA: Final = bytes.fromhex("2a864886f70d010702")
"""The identifier of signed data (RFC 5652, 5.1)."""

_ENCODED: Final = (b"YJKoZIhvcNAQcC", b"BgkqhkiG9w0BBwI", b"GCSqGSIb3DQEHAq")
"""The same in base64, behind 1, 0 or 2 bytes of a group of three: what every signature has near its beginning."""

ARMOUR: Final = ("CERTIFICATE", "PKCS7", "CMS", "SIGNED DATA")
"""How the labels end of PEM in which messages are, and certificates: OpenSSL takes the first for a message, too, knows
`TRUSTED CERTIFICATE`, and writes `PKCS #7 SIGNED DATA` itself.
"""

MAX_ARMOURED: Final = 10_000
"""Blocks of one file that are looked at."""


def may_be_message(data: bytes) -> bool:
    """Whether OpenSSL may take `data` for a signed message; False: it certainly does not (`mime.read_message`).

    It reads header lines up to the first blank one, and refuses what names neither type there. Other text may stand in
    the header, before the type too.
    """
    lowered = data.lower()
    for kind in TYPES:
        found = lowered.find(kind)
        if found >= 0 and _BLANK_LINE.search(data, 0, found) is None:
            return True
    return False


def concealed(data: bytes) -> str:
    """How `data` carries the mark of a signed message that OpenSSL does not read there, in words; "" if it does not.

    Anybody can bring such a message into a form that is read, since the signature is not over the form. In a text that
    only speaks of messages no signature follows the mark. Certificates in PEM, which nobody signed, are none.
    """
    if _further(data) and any(mark in base64_of(data) for mark in _ENCODED):
        return "a signed message stands in it below other text"
    blocks = islice(loose_blocks(data, *ARMOUR), MAX_ARMOURED) if b"-----BEGIN " in data else ()
    if any(_is_signed(block.der or b"") for block in blocks):
        return "a signature in PEM stands in it, without the S/MIME around it"
    return ""


def _further(data: bytes) -> bool:
    """Whether the type of a signed message is named below the first header."""
    end = _BLANK_LINE.search(data)
    begin = 0 if data[:1] in (b"\n", b"\r") else end.start() if end is not None else len(data)
    below = data[begin:].lower()
    return any(kind in below for kind in TYPES)


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
