"""S/MIME messages taken apart: those that openssl and pyca write, and people who edit what these wrote.

Every DDS implementation reads with OpenSSL (crypto/asn1/asn_mime.c): lines in pieces of 1,023 bytes, boundaries by
prefix, transfer encodings and whatever stands around the parts ignored. Read here is what has one meaning whoever reads
it; all else is `Kind.MIME_MALFORMED`, one "cannot tell".
"""

from __future__ import annotations

import base64
import binascii
import re
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.defect import Kind

MAX_HEADER: Final = 1023
"""Bytes of a header, those of one piece of OpenSSL's: real ones have 200."""

TYPES: Final = (b"multipart/signed", b"pkcs7-mime")
"""What the header of a signed message has to say somewhere, in any case of letters."""

_BLANK_LINE: Final = re.compile(rb"^[\n\r\0]", re.MULTILINE)
"""What ends a header: OpenSSL ends lines at LF, and one that begins with CR, LF or NUL is blank."""

_NAMED: Final = re.compile(rb"""^[\s"]*content-type|\(|[^\n]{1023}""", re.MULTILINE | re.IGNORECASE)
"""A line that names the content type, or that OpenSSL may read as one: behind a comment, or behind its buffer."""

_KNOWN: Final = frozenset(
    {b"mime-version", b"content-type", b"content-transfer-encoding", b"content-disposition"},
)
_FIELD: Final = re.compile(rb"([A-Za-z0-9-]+):[ \t]*([^\n(]*(?:\n[ \t][^\n(]*)*)\n")
"""A header line, with those that it is folded into; a comment in it is not read."""
_CONTENT_TYPE: Final = re.compile(rb"""([\w/.+-]+)((?:;\s*[\w-]+=("?)[^\s";]{2,}\3)*);?\s*""")
"""With parameters; OpenSSL does not see a value of one character between quotes."""
_PARAMETER: Final = re.compile(rb"""([\w-]+)="?([^\s";]+)""")

_ODD_HEADER: Final = "a header that writers of signed messages do not make, and that readers interpret differently"

_TEXT: Final = b"content-type: text/plain\r\n\r\n"
"""What the signed text begins with (openssl: -text), in any case of letters."""

_STRANGE_LINE: Final = re.compile(rb"^(?!(?:This is an S/MIME signed message)?$)", re.MULTILINE)
"""A line around the parts other than the unsigned one that every writer puts before the first."""

_BASE64_WIDTHS: Final = (64, 76)
"""Columns that PEM (RFC 7468) and MIME (RFC 2045) writers use; OpenSSL's reader is odd beyond 80."""


class MimeError(ValueError):
    """Why a message could not be taken apart: `kind`, `line` of the file and `detail` make a defect."""

    def __init__(self, kind: Kind, line: int, detail: str) -> None:
        super().__init__(detail)
        self.kind = kind
        self.line = line
        self.detail = detail


class Message(Struct, frozen=True, kw_only=True):
    """A signed message: `entity` is what a detached signature covers, in canonical form (None: opaque message).

    `entity_line` and `signature_line` are lines of the file, `signature` is the decoded CMS structure. `unsigned`:
    lines with text that no signature covers and that the writers of real messages do not write, and what it is.
    """

    entity: bytes | None
    entity_line: int
    signature: bytes
    signature_line: int
    unsigned: tuple[tuple[int, str], ...]


def header_end(data: bytes) -> int:
    """Where OpenSSL no longer reads header lines. Other text may stand among them, before the type too."""
    blank = _BLANK_LINE.search(data)
    return len(data) if blank is None else blank.start()


def names_type(data: bytes) -> bool:
    """Whether a type of signed messages is named."""
    lowered = data.lower()
    return any(kind in lowered for kind in TYPES)


def may_be_message(data: bytes) -> bool:
    """Whether OpenSSL may take it for a signed message; False: it certainly does not."""
    head = data[: header_end(data)]
    return names_type(head) and _NAMED.search(head) is not None


def read_message(data: bytes) -> Message:
    """Take a signed message apart; raise MimeError for any other, `Kind.NOT_SMIME` where OpenSSL certainly refuses."""
    if not may_be_message(data):
        raise MimeError(Kind.NOT_SMIME, 1, f"expected an S/MIME signed message, found {_describe(data)}")
    # OpenSSL takes off every CR before an LF (strip_eol); a document among the tests of Fast DDS has CR CR LF.
    text = data.replace(b"\r\r\n", b"\n").replace(b"\r\n", b"\n")
    odd = max(text.find(b"\r"), text.find(b"\0"))
    if odd >= 0:
        raise _malformed(text, odd, "a lone carriage return or a NUL byte, which ends the text for some readers")
    unsigned: list[tuple[int, str]] = []
    kind, boundary, start = _read_header(text, 0, unsigned)
    if kind in (b"application/pkcs7-mime", b"application/x-pkcs7-mime"):
        entity, entity_at, signature_at = None, start, start
        signature = _decode_base64(text, start, len(text))
    elif kind == b"multipart/signed" and boundary:
        entity, entity_at, signature, signature_at = _read_parts(text, start, boundary, unsigned)
    else:
        raise _malformed(text, 0, _ODD_HEADER)
    return Message(
        entity=entity,
        entity_line=_line(text, entity_at),
        signature=signature,
        signature_line=_line(text, signature_at),
        unsigned=tuple(sorted(unsigned)),
    )


def _describe(data: bytes) -> str:
    start = data.removeprefix(b"\xef\xbb\xbf").lstrip()[:16]
    if start.startswith(b"-----BEGIN"):
        return "a PEM file"
    if start.startswith(b"<"):
        return "XML without a signature"
    if start.startswith((b"\x30\x80", b"\x30\x82", b"\x30\x83")):
        return "binary DER or BER"
    return "neither of its header types" if start else "nothing"


def _malformed(text: bytes, place: int, detail: str) -> MimeError:
    return MimeError(Kind.MIME_MALFORMED, _line(text, place), detail)


def _line(text: bytes, place: int) -> int:
    return text.count(b"\n", 0, place) + 1


def _read_header(text: bytes, start: int, unsigned: list[tuple[int, str]]) -> tuple[bytes, bytes | None, int]:
    """The content type and the boundary that it names, and where the body begins."""
    fields: dict[bytes, bytes] = {}
    at = start
    while (found := _FIELD.match(text, at, start + MAX_HEADER)) is not None:
        name = found[1].lower()
        if name in fields:
            raise _malformed(text, at, _ODD_HEADER)
        if name not in _KNOWN:
            unsigned.append((_line(text, at), "a header line that no DDS implementation reads"))
        fields[name] = found[2]
        at = found.end()
    content_type = _CONTENT_TYPE.fullmatch(fields.get(b"content-type", b""))
    parameters = _PARAMETER.findall(content_type[2]) if content_type is not None else []
    values = {name.lower(): value for name, value in parameters}
    if content_type is None or text[at : at + 1] != b"\n" or len(values) < len(parameters):
        raise _malformed(text, at, _ODD_HEADER)
    return content_type[1].lower(), values.get(b"boundary"), at + 1


def _read_parts(
    text: bytes, start: int, boundary: bytes, unsigned: list[tuple[int, str]]
) -> tuple[bytes, int, bytes, int]:
    """The text and its place, the decoded signature and its place: two parts, between boundaries on lines of their own.

    A boundary inside a line is text, but for OpenSSL where one of its pieces begins.
    """
    mark = b"\n--" + boundary
    before, *parts = text[start - 1 :].split(mark)
    mentions = text.count(mark[1:], start)
    if not parts or not (parts[-1] + b"\n").startswith(b"--\n") or mentions != len(parts):
        shown = boundary[:80].decode("ascii", "backslashreplace")
        raise _malformed(text, max(text.rfind(mark), 0) + 1, f'the closing boundary "{shown}" is missing')
    if len(parts) != 3 or not all(part.startswith(b"\n") for part in parts[:2]):
        found = "expected two parts, the text and its signature, between boundaries on lines of their own"
        raise _malformed(text, start + len(before), found)
    text_at = start + len(before) + len(mark)
    signature_at = text_at + len(parts[0]) + len(mark)
    end = signature_at + len(parts[1]) - 1
    for begin, until, where in (
        (start, start + len(before), "before the first"),
        (end + len(mark) + len(b"--\n"), len(text), "after the last"),
    ):
        if (strange := _STRANGE_LINE.search(text, begin, until)) is not None:
            detail = f"text {where} part, which no signature covers and no DDS implementation reads"
            unsigned.append((_line(text, strange.start()), detail))
    kind, _boundary, at = _read_header(text[:end], signature_at, unsigned)
    if kind not in (b"application/pkcs7-signature", b"application/x-pkcs7-signature"):
        raise _malformed(text, signature_at, "expected a second part of type application/x-pkcs7-signature")
    return parts[0][1:].replace(b"\n", b"\r\n"), text_at, _decode_base64(text, at, end), at


def _decode_base64(text: bytes, at: int, end: int) -> bytes:
    """Decode lines of 64 or 76 characters, blank lines only around them; the encoding has to be the canonical one."""
    written = text[at:end].strip(b"\n")
    try:
        decoded = binascii.a2b_base64(written)
    except binascii.Error:
        decoded = b""
    encoded = base64.b64encode(decoded)
    for width in _BASE64_WIDTHS:
        if written == b"\n".join(encoded[place : place + width] for place in range(0, len(encoded), width)):
            return decoded
    raise _malformed(text, at, "expected base64 in lines of 64 or 76 characters, and nothing else")


def split_text(entity: bytes, line: int) -> tuple[bytes, int]:
    """Take the header off a signed entity that begins at `line`; return the text and its line (`SMIME_text`).

    Raises MimeError: `Kind.NO_TEXT_PLAIN` where OpenSSL certainly refuses since no header says text/plain.
    """
    if entity[: len(_TEXT)].lower() == _TEXT:
        return entity[len(_TEXT) :], line + _TEXT.count(b"\n")
    if b"text/plain" in entity[: header_end(entity)].lower():
        raise MimeError(Kind.MIME_MALFORMED, line, "the signed text begins with other headers than its Content-Type")
    detail = "expected the signed text to begin with Content-Type: text/plain (openssl: -text), found none"
    raise MimeError(Kind.NO_TEXT_PLAIN, line, detail)
