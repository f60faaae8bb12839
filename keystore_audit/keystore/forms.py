"""Keys, certificates and messages in other forms: text in UTF-16, base64 of text (as Kubernetes keeps files), and
base64 of DER without the lines of PEM around it.
"""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Callable, Iterator
from itertools import islice
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

    def is_encoded_in(self, data: bytes) -> bool:
        """Whether it stands there in base64."""
        first, second, third = self.encoded
        return first in data or second in data or third in data


def _in_base64(word: bytes, before: int) -> bytes:
    """The characters that are the same whatever stands around it, behind so many bytes of a group of three."""
    bits = 8 * (before + len(word))
    return base64.b64encode(bytes(before) + word)[_SKIPPED[before] : bits // 6]


BLOCK: Final = Mark(b"-----BEGIN ")
"""Of text with blocks of PEM."""

_HEAD: Final = re.compile(
    rb"M(?<![A-Za-z0-9+/]M)(?=(I|HcCAQEE|HQCAQEE|C4CAQAw|EECAQAw))[A-Za-z0-9+/]{47}"  # the lone M is searched for fast
)
"""How SEQUENCEs begin in base64, those of 128 bytes or more and private keys of less (EC, Ed25519): what tells what a
structure is stands where the line begins, and nowhere behind.
"""

MAX_HEADS: Final = 1_000
"""Such beginnings in a piece of a file that are looked at; of logs and bags of data hardly any line has one."""

_RUN: Final = re.compile(rb"(?:[A-Za-z0-9+/\s]|\\[nrt])+")
"""Base64, in one line or several."""

_LEAST: Final = 64
"""Characters of base64 that the lines around a block have, and nothing between them."""

_BLANK: Final = 64
"""Characters at the end of a line of PEM and at the beginning of the next that are looked at."""


def may_hold_text(data: bytes, mark: Mark) -> bool:
    """Whether text with the word stands in it in UTF-16 or in base64."""
    return mark.wide in data or mark.is_encoded_in(data)


def texts(content: bytes, mark: Mark) -> Iterator[bytes]:
    """Text with the word that stands in it in UTF-16, or in base64: from the word on."""
    if mark.wide in content:
        yield content.replace(b"\0", b"")  # what is left of ASCII
    if mark.is_encoded_in(content):
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
    """Whether one begins in it, whole or not, or more begin there than are looked at."""
    heads = list(islice(_heads(data), MAX_HEADS))
    return len(heads) == MAX_HEADS or any(wanted(binascii.a2b_base64(head[0])) for head in heads)


def _runs(content: bytes, wanted: Callable[[bytes], bool]) -> Iterator[bytes]:
    """The base64 from the beginning of each on, for each way to begin once: it may be read on into one of another."""
    ends: dict[bytes, int] = {}
    for head in _heads(content):
        begin, kind = head.start(), head[1]
        if begin >= ends.get(kind, 0) and wanted(binascii.a2b_base64(head[0])):
            run = _RUN.match(content, begin)
            ends[kind] = run.end() if run is not None else len(content)
            yield content[begin : ends[kind]]


def _heads(content: bytes) -> Iterator[re.Match[bytes]]:
    return (head for head in _HEAD.finditer(content) if not _is_in_pem(content, head.start()))


def _is_in_pem(content: bytes, position: int) -> bool:
    return content[max(position - _BLANK, 0) : position].rstrip().endswith(b"-----")


def _decoded(text: bytes) -> bytes:
    """As much of it as is whole groups, and the last one of less."""
    characters = base64_of(text).rstrip(b"=")
    return binascii.a2b_base64(characters[: len(characters) - (len(characters) % 4 == 1)] + b"==")
