"""Values of the universal types of ASN.1 in DER (X.690), where a structure leaves the type open (ANY).

OpenSSL decodes such a value and encodes it again before it hashes or compares: it refuses what is malformed.
`cryptography` hands it out unseen.
"""

from __future__ import annotations

import re
from typing import Final

from keystore_audit.keystore.der import content_of

MAX_ELEMENTS: Final = 10_000
"""Elements of one structure that are looked at: a certificate has about 60."""

_AS_THEY_STAND: Final = frozenset({0x04, 0x0C, 0x12, 0x13, 0x14, 0x16, 0x17, 0x18, 0x19, 0x1A, 0x1B})
"""Tags of octet strings, times and strings of single bytes, any content of which is kept (measured, OpenSSL 3.0.19)."""

_PADDED: Final = re.compile(rb"(?:\A|[\x00-\x7f])\x80")
"""A subidentifier that begins with a zero: it begins where the byte before has no continuation bit."""

_BOOLEAN, _INTEGER, _BIT_STRING, _NULL, _IDENTIFIER, _ENUMERATED, _UNIVERSAL_STRING, _BMP_STRING = (
    *(0x01, 0x02, 0x03, 0x05, 0x06, 0x0A, 0x1C, 0x1E),
)
_SEQUENCE, _SET = 0x30, 0x31


def well_formed(tag: int, content: bytes | memoryview) -> bool:
    """Whether OpenSSL would write a value of this tag octet as it reads it; constructed ones are not looked into."""
    if tag in _AS_THEY_STAND or tag in (_SEQUENCE, _SET) or tag & 0xC0:
        return True
    if tag in (_INTEGER, _ENUMERATED):
        padded = len(content) > 1 and content[0] in (0, 0xFF) and content[0] >> 7 == content[1] >> 7
        return bool(content) and not padded
    if tag == _IDENTIFIER:
        return bool(content) and content[-1] < 0x80 and _PADDED.search(content) is None
    if tag == _BIT_STRING:
        unused = content[0] if content else 8
        return unused < 8 and (not content[-1] & ((1 << unused) - 1) if len(content) > 1 else unused == 0)
    if tag == _BOOLEAN:
        return content in (b"\x00", b"\xff")
    if tag == _NULL:
        return not content
    return (tag == _BMP_STRING and len(content) % 2 == 0) or (tag == _UNIVERSAL_STRING and len(content) % 4 == 0)


def well_formed_throughout(der: bytes) -> bool:
    """Whether every element is, at any depth; nothing is said of what octet strings hold."""
    pending = [(0, len(der))]
    looked_at = 0
    try:
        while pending:
            position, end = pending.pop()
            while position < end:
                start, behind = content_of(der, position)
                tag = der[position]
                looked_at += 1
                if behind > end or looked_at > MAX_ELEMENTS or not well_formed(tag, der[start:behind]):
                    return False
                if tag & 0x20:
                    pending.append((start, behind))
                position = behind
    except ValueError:  # cut off
        return False
    return True
