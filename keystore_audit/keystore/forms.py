"""Keys, certificates and messages in other forms: text in UTF-16, base64 of text (as Kubernetes keeps files), and
base64 of DER without the lines of PEM around it.
"""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Callable, Iterator
from typing import Final

from keystore_audit.dataclass import replace
from keystore_audit.keystore.der import elements
from keystore_audit.keystore.pem import Block, base64_of, loose_blocks

_SKIPPED: Final = (0, 2, 3)
"""Characters of a group of four that bytes before it have a part in."""


class Mark:
    """A word by which text is found in other forms. `wide`: in UTF-16, whichever its order of bytes; `encoded`: in
    base64, behind 0, 1 or 2 bytes of a group of three.
    """

    def __init__(self, word: bytes) -> None:
        self.wide = word.decode().encode("utf-16-be")[1:]
        self.encoded = tuple(_in_base64(word, before) for before in range(3))
        self.any_encoded = re.compile(b"|".join(b"(%s)" % re.escape(each) for each in self.encoded))


def _in_base64(word: bytes, before: int) -> bytes:
    """The characters that are the same whatever stands around it, behind so many bytes of a group of three."""
    bits = 8 * (before + len(word))
    return base64.b64encode(bytes(before) + word)[_SKIPPED[before] : bits // 6]


BLOCK: Final = Mark(b"-----BEGIN ")
"""Of text with blocks of PEM."""

_BEGINNINGS: Final = (b"MI", b"MHcCAQEE", b"MHQCAQEE", b"MC4CAQAw", b"MEECAQAw")
"""How SEQUENCEs begin in base64: those of 128 bytes or more; private keys of less (EC, Ed25519)."""

_RUN: Final = re.compile(rb"(?:[A-Za-z0-9+/\s]|\\[nrt])+")
"""Base64, in one line or several."""

_LEAST: Final = 64
"""Characters of base64 that the lines around a block have, and nothing between them."""

_LINE: Final = re.compile(rb"((?<![A-Za-z0-9+/])[A-Za-z0-9+/]{48})?[A-Za-z0-9+/]*")
"""One line of it. What tells what a structure is stands where the line begins, and nowhere behind."""

_BLANK: Final = 64
"""Characters at the end of a line of PEM and at the beginning of the next that are looked at."""


def may_hold_text(data: bytes, mark: Mark) -> bool:
    """Whether text with the word stands in it in UTF-16 or in base64."""
    return any(each in data for each in (mark.wide, *mark.encoded))


def texts(content: bytes, mark: Mark) -> Iterator[bytes]:
    """Text with the word that stands in it in UTF-16, or in base64: from the word on."""
    if mark.wide in content:
        yield content.replace(b"\0", b"")  # what is left of ASCII
    if any(each in content for each in mark.encoded):
        position = 0
        while hit := mark.any_encoded.search(content, position):
            run = _RUN.match(content, hit.start())
            position = run.end() if run is not None else len(content)
            if position - hit.start() >= _LEAST:
                yield _decoded(b"A" * _SKIPPED[(hit.lastindex or 1) - 1] + content[hit.start() : position])


def blocks_in(content: bytes, *labels: str) -> Iterator[Block]:
    """The blocks of PEM with these labels, in any form; lines of another form are not the file's."""
    yield from loose_blocks(content, *labels)
    for text in texts(content, BLOCK):
        for block in loose_blocks(text, *labels):
            yield replace(block, line=1)


def structures_in_base64(content: bytes, wanted: Callable[[bytes], bool]) -> Iterator[bytes]:
    """Whole SEQUENCEs by whose beginning they are `wanted`; what is cut off is text about one.

    What stands between lines of PEM is read there.
    """
    for run in _runs(content, wanted):
        yield from elements(_decoded(run))


def may_hold_structures(data: bytes, wanted: Callable[[bytes], bool]) -> bool:
    """Whether one begins in it, whole or not."""
    return any(True for _run in _runs(data, wanted))


def _runs(content: bytes, wanted: Callable[[bytes], bool]) -> Iterator[bytes]:
    """The base64 from the beginning of each on."""
    for beginning in _BEGINNINGS:
        position = content.find(beginning)
        while position >= 0:
            line = _LINE.match(content, position)
            head, end = (line[1], line.end()) if line else (None, len(content))
            if head is not None and not _is_in_pem(content, position) and wanted(binascii.a2b_base64(head)):
                run = _RUN.match(content, position)
                end = run.end() if run is not None else len(content)
                yield content[position:end]
            position = content.find(beginning, end)


def _is_in_pem(content: bytes, position: int) -> bool:
    return content[max(position - _BLANK, 0) : position].rstrip().endswith(b"-----")


def _decoded(text: bytes) -> bytes:
    """As much of it as is whole groups, and the last one of less."""
    characters = base64_of(text).rstrip(b"=")
    return binascii.a2b_base64(characters[: len(characters) - (len(characters) % 4 == 1)] + b"==")
