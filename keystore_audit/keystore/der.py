"""DER structures: their parts byte for byte, where `cryptography` hands out only what they mean.

Names are compared as bytes before they are compared by meaning, and the two statements of a signature
algorithm have to be the same bytes. Nothing is validated here: `children` and `parts` are for structures that
`cryptography` has parsed, the others only tell where each of them ends.
"""

from __future__ import annotations

import re
from typing import Final

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm

IDENTIFIER: Final = 0x06
SEQUENCE: Final = 0x30

_LONG: Final = 0x1F
"""In the first byte of a tag: its number follows."""

_NUMBER: Final = re.compile(rb"\x80*([\x80-\xff]{0,4}[\x00-\x7f])")
"""The number of a tag, behind any zeros: OpenSSL reads none of more bytes."""
_MORE: Final = 0x80
"""Of a length: so many bytes have it, or none."""

MALFORMED: Final = (
    ValueError,
    UnsupportedAlgorithm,
    x509.DuplicateExtension,
    x509.InvalidVersion,
    x509.UnsupportedGeneralNameType,
    TypeError,  # a BIT STRING in a name, cryptography 50
    KeyError,  # the same, cryptography 47 to 49
)
"""What `cryptography` raises on structures that it refuses, at loading or when a part is first looked at."""


def parts(structure: bytes, count: int) -> list[bytes]:
    """Return the first `count` elements inside a constructed element, each with tag and length.

    Raises ValueError if there are fewer, or if one is cut off.
    """
    found = children(structure)[:count]
    if len(found) < count:
        raise ValueError("too few elements")
    return found


def children(element: bytes, begin: int = 0) -> list[bytes]:
    """The elements inside the constructed element at `begin`, each with tag and length."""
    found = []
    position, end = content_of(element, begin)
    while position < end:
        _, behind = content_of(element, position)
        found.append(element[position:behind])
        position = behind
    return found


def first_element(data: bytes) -> bytes | None:
    """The SEQUENCE that `data` begins with, as OpenSSL reads a file in DER; None where it is cut off or something else.

    All of `data` where the SEQUENCE does not say how long it is (BER).
    """
    try:
        tag, start, length = opening(data, 0)
    except ValueError:
        return None
    if tag != SEQUENCE or (length is not None and start + length > len(data)):
        return None
    return data if length is None else data[: start + length]


def opening(data: bytes, position: int) -> tuple[int, int, int | None]:
    """The tag of the element at `position`, where its content begins, and how long it is (None: it does not say so).

    BER may write the number of a tag behind it, with any number of leading zeros, and OpenSSL reads that. Returned is
    the short form, where there is one. Raises ValueError for a header that is cut off.
    """
    try:
        tag, at, length = data[position], position + 1, data[position + 1]
        if tag & _LONG != _LONG and length < _MORE:  # nearly always
            return tag, at + 1, length
        if tag & _LONG == _LONG:
            number = _NUMBER.match(data, at)
            if number is None:
                raise ValueError("cut off in a header")
            if number[1] < bytes([_LONG]):
                tag = tag & ~_LONG | number[1][0]
            at = number.end()
        length, at = data[at], at + 1
    except IndexError:
        raise ValueError("cut off in a header") from None
    if length == _MORE:
        return tag, at, None
    if length & _MORE:
        size = length & ~_MORE
        length = int.from_bytes(data[at : at + size], "big")
        at += size
    return tag, at, length


def content_of(structure: bytes, position: int) -> tuple[int, int]:
    """Return where the content of the element at `position` begins and ends; raise ValueError if it is cut off."""
    _tag, start, length = opening(structure, position)
    if length is None or start + length > len(structure):
        raise ValueError("cut off in an element")
    return start, start + length


# --- values of the universal types (X.690), where a structure leaves the type open (ANY). OpenSSL decodes such a value
# and encodes it again before it hashes or compares, and refuses a malformed one. `cryptography` hands it out unseen.

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
    """Whether every element is well-formed, at any depth; the content of octet strings is not looked at."""
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
