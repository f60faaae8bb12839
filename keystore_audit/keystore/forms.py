"""Keys and certificates in other forms than PEM and DER: text in UTF-16, base64 of PEM (as Kubernetes keeps files), and
base64 of DER without the lines of PEM around it.
"""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Callable, Iterator
from typing import Final

from keystore_audit.keystore.der import elements
from keystore_audit.keystore.pem import base64_of

_BEGIN: Final = b"-----BEGIN "
_WIDE: Final = _BEGIN.decode().encode("utf-16-be")[1:]
"""The same in the other order of bytes, but for what is around it."""


def _in_base64(before: int) -> bytes:
    """The characters that are the same whatever stands around it, behind so many bytes of a group of three."""
    bits = 8 * (before + len(_BEGIN))
    return base64.b64encode(bytes(before) + _BEGIN)[_SKIPPED[before] : bits // 6]


_SKIPPED: Final = (0, 2, 3)
"""Characters of a group of four that bytes before it have a part in."""

_IN_BASE64: Final = tuple(_in_base64(before) for before in range(3))
_ANY_IN_BASE64: Final = re.compile(b"|".join(b"(%s)" % re.escape(each) for each in _IN_BASE64))

_BEGINNINGS: Final = (b"MII", b"MIG", b"MIH", b"MHcCAQEE", b"MHQCAQEE", b"MC4CAQAw", b"MEECAQAw")
"""How SEQUENCEs begin in base64: those of 128 bytes or more; private keys of less (EC, Ed25519)."""

_RUN: Final = re.compile(rb"(?:[A-Za-z0-9+/\s]|\\[nrt])+")
"""Base64, in one line or several."""

_LEAST: Final = 64
"""Characters of base64 that the lines around a block have, and nothing between them."""

_HEAD: Final = re.compile(rb"(?<![A-Za-z0-9+/])[A-Za-z0-9+/]{48}")
"""What tells what a structure is."""

_BLANK: Final = 64
"""Characters at the end of a line of PEM and at the beginning of the next that are looked at."""


def may_hold_text(data: bytes) -> bool:
    """Whether text in UTF-16 or in base64 stands in it that has a block of PEM."""
    return any(mark in data for mark in (_WIDE, *_IN_BASE64))


def texts(content: bytes) -> Iterator[bytes]:
    """The content, and text with blocks of PEM that stands in it in UTF-16 or in base64."""
    yield content
    if _WIDE in content:
        yield content.replace(b"\0", b"")  # what is left of ASCII
    if any(mark in content for mark in _IN_BASE64):
        position = 0
        while hit := _ANY_IN_BASE64.search(content, position):
            run = _RUN.match(content, hit.start())
            position = run.end() if run is not None else len(content)
            if position - hit.start() >= _LEAST:
                yield _decoded(b"A" * _SKIPPED[(hit.lastindex or 1) - 1] + content[hit.start() : position])


def structures_in_base64(content: bytes, wanted: Callable[[bytes], bool]) -> Iterator[bytes]:
    """Whole SEQUENCEs by whose beginning they are `wanted`; what is cut off is text about one.

    What stands between lines of PEM is read there.
    """
    for beginning in _BEGINNINGS:
        position = content.find(beginning)
        while position >= 0:
            end = position + 1
            head = _HEAD.match(content, position)
            if head is not None and wanted(_decoded(head[0])) and not _is_in_pem(content, position):
                run = _RUN.match(content, position)
                end = run.end() if run is not None else len(content)
                yield from elements(_decoded(content[position:end]))
            position = content.find(beginning, end)


def _is_in_pem(content: bytes, position: int) -> bool:
    return content[max(position - _BLANK, 0) : position].rstrip().endswith(b"-----")


def _decoded(text: bytes) -> bytes:
    """As much of it as is whole groups, and the last one of less."""
    characters = base64_of(text).rstrip(b"=")
    return binascii.a2b_base64(characters[: len(characters) - (len(characters) % 4 == 1)] + b"==")
