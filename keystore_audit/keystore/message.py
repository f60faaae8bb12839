"""Whether a file may be an S/MIME message at all, or hold one, whatever its name: asked of every file of a keystore."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import chain, islice
from typing import Final

from keystore_audit.keystore.cms import CmsError, read_signed_data
from keystore_audit.keystore.der import IDENTIFIER, SEQUENCE, any_structure, inside
from keystore_audit.keystore.forms import Mark, texts
from keystore_audit.keystore.pem import loose_blocks

_BLANK_LINE: Final = re.compile(rb"\n[\n\r\0]")
"""What ends a header: OpenSSL ends lines at LF, and one that begins with CR, LF or NUL is blank (asn_mime.c)."""

TYPES: Final = (b"multipart/signed", b"pkcs7-mime")
"""What the header of a signed message has to say somewhere, in any case of letters."""

_TYPE_FIELD: Final = b"content-type"

FIELD: Final = Mark(b"Content-Type:")
"""The same as everybody writes it, in other forms."""

_MAX_FIELD: Final = 1024
"""How far before the type its field begins: OpenSSL reads no longer line at once (`mime.MAX_LINE`)."""

MAX_MENTIONS: Final = 1000
"""Mentions of a type below the first header that are looked at."""

_SIGNED_DATA: Final = bytes.fromhex("2a864886f70d010702")
"""The identifier of signed data (RFC 5652, 5.1)."""

ARMOUR: Final = ("CERTIFICATE", "PKCS7", "CMS", "SIGNED DATA")
"""How the labels end of PEM in which messages are, and certificates: OpenSSL takes the first for a message, too, knows
`TRUSTED CERTIFICATE`, and writes `PKCS #7 SIGNED DATA` itself.
"""

MAX_ARMOURED: Final = 10_000
"""Blocks of one file that are looked at."""


def ends_header(data: bytes) -> bool:
    """Whether a blank line is in it."""
    return _BLANK_LINE.search(data) is not None


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


def concealed(data: bytes, written: Iterable[bytes], encoded: Iterable[bytes]) -> str:
    """How `data` holds a signed message that OpenSSL does not read in this form, words; "" if it holds none.

    `written`: the texts with PEM that stand in it in other forms. `encoded`: signed data that does in base64, but for
    the signature within a message. Anybody can give a message another form, since the signature is not over the form:
    below other text it only has to be cut out, and what is in PEM or DER needs a header. Certificates in such a form,
    which nobody signed, are none.
    """
    if _further(data):
        return "a signed message stands in it below other text"
    if _is_signed(data):
        return "it is a signature in DER, without the S/MIME around it"
    if any_structure(_is_signed, data):
        return "a signature in DER may stand in it, without the S/MIME around it"
    if _signed_in_pem(data):
        return "a signature in PEM stands in it, without the S/MIME around it"
    others = chain(texts(data, FIELD), written)
    if any(may_be_message(text) or _further(text) or _signed_in_pem(text) for text in others):
        return "a signed message stands in it in base64 or in UTF-16"
    if any(map(_is_signed, encoded)):
        return "a signature in base64 stands in it, without the S/MIME around it"
    return ""


def _signed_in_pem(data: bytes) -> bool:
    blocks = islice(loose_blocks(data, *ARMOUR), MAX_ARMOURED)
    return any(_is_signed(block.der or b"") for block in blocks)


def _further(data: bytes) -> bool:
    """Whether a line below the first header gives the type of a signed message."""
    lowered = data.lower()
    if not any(kind in lowered for kind in TYPES):
        return False
    end = _BLANK_LINE.search(data)
    begin = 0 if data[:1] in (b"\n", b"\r") else end.start() if end is not None else len(data)
    for kind in TYPES:
        found = begin - 1
        for _mention in range(MAX_MENTIONS):
            found = lowered.find(kind, found + 1)
            if found < 0:
                break
            line = lowered.rfind(b"\n", max(found - _MAX_FIELD, 0), found) + 1
            if lowered[line : line + 1] in (b" ", b"\t"):  # folded
                line = lowered.rfind(b"\n", max(line - _MAX_FIELD, 0), max(line - 1, 0)) + 1
            if lowered.startswith(_TYPE_FIELD, line):
                return True
        else:
            return True  # nobody writes so many; what stands there is not known
    return False


def is_signed_data(data: bytes) -> bool:
    """Whether it begins as a signed message in DER or BER does."""
    kind = inside(data, SEQUENCE, IDENTIFIER)
    return kind is not None and kind.startswith(_SIGNED_DATA)


def _is_signed(der: bytes) -> bool:
    """Whether it is signed data that has a signature, or cannot be read; what carries certificates alone has none."""
    try:
        return is_signed_data(der) and bool(read_signed_data(der).signers)
    except CmsError:
        return True
