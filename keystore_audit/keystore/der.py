"""DER structures: their parts byte for byte, where `cryptography` hands out only what they mean.

Names are compared as bytes before they are compared by meaning, and the two statements of a signature
algorithm have to be the same bytes. Nothing is validated here: `children` and `parts` are for structures that
`cryptography` has parsed, the others only tell where each of them ends.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Final

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm

MAX_ELEMENTS: Final = 10_000
"""Structures, one behind the other in one file, that are looked at; what stands behind them may be anything."""

INTEGER: Final = 0x02
OCTET_STRING: Final = 0x04
IDENTIFIER: Final = 0x06
SEQUENCE: Final = 0x30

CONSTRUCTED: Final = 0x20
"""In the first byte of a tag: the element consists of others."""
_LONG: Final = 0x1F
"""In the first byte of a tag: its number follows."""

_SEQUENCES: Final = (bytes([SEQUENCE]), bytes([SEQUENCE | _LONG]))
"""How one begins: with the tag itself, or with its number behind it (`opening`)."""

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
    return next(elements(data), None)


def elements(data: bytes) -> Iterator[bytes]:
    """The SEQUENCEs that `data` begins with, one behind the other, at most MAX_ELEMENTS."""
    position = 0
    for _each in range(MAX_ELEMENTS):
        try:
            tag, start, length = opening(data, position)
        except ValueError:
            return
        if tag != SEQUENCE or (length is not None and start + length > len(data)):
            return
        end = len(data) if length is None else start + length
        yield data[position:end]
        position = end


def structures(data: bytes) -> Iterator[bytes]:
    """What begins in the first byte, cut off or not, and the whole SEQUENCEs behind it: key and certificate, say."""
    yield data
    yield from islice(elements(data), 1, None)


def any_structure(test: Callable[[bytes], bool], data: bytes) -> bool:
    """Whether some of the structures is the kind of SEQUENCE that `test` asks for, or there are too many to look at."""
    if data[:1] not in _SEQUENCES:  # nearly every file
        return False
    found = list(structures(data))
    return len(found) == MAX_ELEMENTS or any(map(test, found))


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


def inside(data: bytes, *tags: int) -> bytes | None:
    """What follows the header of the last of these, each of which begins with the next, in BER; None where one does
    not. Whether they are whole is not asked.
    """
    position = 0
    for tag in tags:
        first = data[position] if position < len(data) else 0
        if first != tag and first & _LONG != _LONG:  # nearly always: it is something else
            return None
        try:
            found, position, _length = opening(data, position)
        except ValueError:
            return None
        if found != tag:
            return None
    return data[position:]


def content_of(structure: bytes, position: int) -> tuple[int, int]:
    """Return where the content of the element at `position` begins and ends; raise ValueError if it is cut off."""
    _tag, start, length = opening(structure, position)
    if length is None or start + length > len(structure):
        raise ValueError("cut off in an element")
    return start, start + length
