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

    BER may write the number of a tag behind it, with as many zeros before it as one likes, which OpenSSL reads: what
    is returned is the short form, where there is one. Raises ValueError for a header that is cut off.
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
