"""Splits a file into PEM blocks (RFC 7468) so strictly that every reader of the file sees the same ones.

OpenSSL (crypto/pem/pem_lib.c) reads lines in pieces of 254 characters, ignores whatever is no block, and is
lenient inside one. Where its blocks and ours could differ, there is a `Problem` instead of a guess.
"""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Iterator
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.der import first_element

MAX_BLOCKS: Final = 1_000
"""Most blocks that are read of one file: a bundle of authorities has some hundred, an enclave's file one."""

MAX_DUMP_BYTES: Final = 256 * 1024
"""Longest text that is looked at line by line: the dump of a certificate has 2 to 20 kB."""

_BEGIN: Final = re.compile(rb"-----BEGIN ([A-Z0-9 ]{1,64})-----[\x00-\x20]*")
_LOOSE: Final = re.compile(rb"-----BEGIN ([A-Z0-9 #]{1,64})-----")
_ESCAPES: Final = (rb"\n", rb"\r", rb"\t")
_BASE64: Final = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/="
_NO_BASE64: Final = bytes(set(range(0x100)) - set(_BASE64))
"""With the escapes, what stands between the characters of a block in a quotation, a list or a JSON string."""
LINE: Final = re.compile(rb"(?<![A-Za-z0-9+/])[A-Za-z0-9+/]{48}")
"""What base64 has, and hardly any text about it. Asked once for each run of such characters: a file may have 4 MB."""

_BEGINNING: Final = 1024
"""Characters in which the first eight of base64 stand."""

_ENCRYPTED: Final = re.compile(rb"Proc-Type:[ \t]*4,[ \t]*ENCRYPTED")
"""The header of an encrypted traditional key (RFC 1421, 4.6.1.1), with the blanks that OpenSSL takes."""
_ENDS: Final = re.compile(rb"-----(?:BEGIN|END) ")
"""What ends a block: five hyphens alone may stand in its header, of which OpenSSL passes over short ones."""

BEGIN_CERTIFICATES: Final = frozenset({"CERTIFICATE", "X509 CERTIFICATE"})
"""Labels of a certificate: RFC 7468, and the old one that OpenSSL takes for the same."""

DUMP_OF_CERTIFICATE: Final = (b"Certificate:",)
DUMP_OF_REVOCATION_LIST: Final = (
    b"Certificate Revocation List (CRL):",
    b"Revoked Certificates:",
    b"No Revoked Certificates.",
)
"""Lines at the margin in what `openssl x509 -text` and `openssl crl -text` write before a block."""


class Block(Struct, frozen=True, kw_only=True):
    """A PEM block that begins at `line`; `der` is None for an encrypted traditional key."""

    label: str
    line: int
    der: bytes | None

    def __repr__(self) -> str:
        """Without the content, which may be a private key."""
        return f"Block({self.label!r}, line {self.line})"

    @property
    def is_private_key(self) -> bool:
        """Whether it holds, or says that it holds, a private key."""
        return self.label.endswith("PRIVATE KEY")

    @property
    def encrypted(self) -> bool:
        """Whether a password is needed."""
        return self.der is None or self.label == "ENCRYPTED PRIVATE KEY"


class Text(Struct, frozen=True, kw_only=True):
    """Text outside of blocks that begins at `line`."""

    line: int
    text: bytes

    def is_dump(self, margin: tuple[bytes, ...]) -> bool:
        """Whether it is openssl's readable form: the first of `margin`, then any of it or indented lines."""
        if len(self.text) > MAX_DUMP_BYTES:
            return False
        lines = [line.rstrip() for line in self.text.split(b"\n")]
        written = [line for line in lines if line]
        return written[:1] == [margin[0]] and all(line.startswith(b"    ") or line in margin for line in written)


class Problem(Struct, frozen=True, kw_only=True):
    """Why no block could be read at `line`, in words that quote nothing."""

    line: int
    detail: str


class Pem(Struct, frozen=True, kw_only=True):
    """A file's blocks and problems in file order, and the text outside of them."""

    parts: tuple[Block | Problem, ...]
    texts: tuple[Text, ...]


def read_pem(content: bytes) -> Pem:
    """Split `content`; never raises."""
    parts: list[Block | Problem] = []
    texts: list[Text] = []
    position = 0
    line = 1
    while True:
        begin = content.find(b"-----BEGIN", position)
        end_of_text = begin if begin >= 0 else len(content)
        if content[position:end_of_text].strip():
            texts.append(_text(content[position:end_of_text], line))
        if begin < 0:
            break
        line += content.count(b"\n", position, begin)
        if len(parts) >= MAX_BLOCKS:
            parts.append(Problem(line=line, detail=f"more than {MAX_BLOCKS} PEM blocks; the rest was not read"))
            break
        part, end = _block(content, begin, line)
        parts.append(part)
        position = end
        line += content.count(b"\n", begin, end)
    return Pem(parts=tuple(parts), texts=tuple(texts))


def loose_blocks(content: bytes, *labels: str) -> Iterator[Block]:
    """Every block whose label ends in one of these, wherever it stands: indented, quoted, within other text.

    No run time reads it there, but anybody can take it out. `der` is None where it is encrypted, or in a form from
    which nobody here takes it. It is b"" in a text about blocks: a placeholder, or one that is shortened.
    """
    line, before = 1, 0
    for opening in _LOOSE.finditer(content):
        label = opening[1].decode("ascii")
        if label.endswith(labels):
            line += content.count(b"\n", before, opening.start())
            before = opening.start()
            closing = _ENDS.search(content, opening.end())
            body = content[opening.end() : closing.start() if closing else len(content)]
            yield Block(label=label, line=line, der=_loosely_decoded(body))


def _loosely_decoded(body: bytes) -> bytes | None:
    if _ENCRYPTED.search(body):
        return None
    header = body.rfind(b":")  # of other fields, too
    text = body[_end_of_line(body, header) :] if header >= 0 else body
    der = _from_base64(base64_of(text))
    if der is None:
        der = _from_base64(base64_of(text.partition(b"-")[0]))  # OpenSSL's ends at the first hyphen
    der = der or b""
    if first_element(der) is not None:
        return der
    line = LINE.search(body)
    if line is None or _is_shortened(body[line.start() :]):
        return b""
    return der if der[:1] == b"0" else None


def _from_base64(characters: bytes) -> bytes | None:
    try:
        return binascii.a2b_base64(characters)
    except binascii.Error:
        return None


def base64_of(text: bytes) -> bytes:
    """The base64 characters of a text; the end of a line that is written as an escape is none."""
    for escape in _ESCAPES:
        text = text.replace(escape, b" ")
    return text.translate(None, _NO_BASE64)


def _is_shortened(text: bytes) -> bool:
    """Whether a structure begins in it that says that it is longer than the text, whatever this were decoded as.

    Somebody left the rest out. What only has more about it, as the lines of a patch or numbered ones, is long enough.
    """
    begin = _from_base64(base64_of(text[:_BEGINNING])[:8]) or b""  # or not even eight characters
    written = begin.ljust(len(text) * 3 // 4, b"\0")
    return begin[:1] == b"0" and begin[1:2] <= b"\x84" and first_element(written) is None


def _text(text: bytes, line: int) -> Text:
    blank = len(text) - len(text.lstrip())
    return Text(line=line + text.count(b"\n", 0, blank), text=text)


def _block(content: bytes, begin: int, line: int) -> tuple[Block | Problem, int]:
    """Read what begins with `-----BEGIN` at `begin`; also return where the rest of the file begins."""
    end_of_line = _end_of_line(content, begin)
    opening = _BEGIN.fullmatch(content, begin, end_of_line)
    if opening is None or (begin > 0 and content[begin - 1] != 0x0A):
        strange = "-----BEGIN that is not alone at the start of a line: parsers may differ here"
        return Problem(line=line, detail=strange), end_of_line
    closing = content.find(b"-----", end_of_line)
    end_of_block = _end_of_line(content, closing) if closing >= 0 else len(content)
    expected = b"-----END " + opening[1] + b"-----"
    if closing < 0 or content[closing:end_of_block].rstrip(_BLANK) != expected:
        return Problem(line=line, detail="a PEM block that does not end as it begins"), end_of_line
    label = opening[1].decode("ascii")
    body = content[end_of_line:closing]
    if label.endswith("PRIVATE KEY") and _ENCRYPTED.match(body.lstrip()):
        return Block(label=label, line=line, der=None), end_of_block
    der = _decoded(body)
    if der is None:
        return Problem(line=line, detail=f"a {label} block whose lines are not base64"), end_of_block
    return Block(label=label, line=line, der=der), end_of_block


_BLANK: Final = bytes(range(0x21))
"""What OpenSSL removes from the end of a line: space and all below."""


def _decoded(body: bytes) -> bytes | None:
    """Decode base64 lines that nothing but an end of line separates; blank lines would be a header's end."""
    *lines, rest = body.split(b"\n")
    lines = [line.rstrip(_BLANK) for line in lines]
    text = b"".join(lines)
    if rest or not all(lines) or len(text) % 4:  # the library takes padding behind groups that want none
        return None
    try:
        return base64.b64decode(text, validate=True)
    except binascii.Error:
        return None


def _end_of_line(content: bytes, position: int) -> int:
    """Return where the line at `position` ends, its newline included."""
    end = content.find(b"\n", position)
    return end + 1 if end >= 0 else len(content)
