"""S/MIME messages taken apart by OpenSSL's algorithm (crypto/asn1/asn_mime.c), which every DDS implementation uses.

OpenSSL reads lines into a buffer of 1,024 bytes, ends them at LF only, compares boundaries by prefix, ignores
transfer encodings and whatever stands before the first and after the last boundary. This reader follows it where it
is unambiguous and refuses the rest as `Kind.MIME_MALFORMED`: stricter never means that we read other bytes.
"""

from __future__ import annotations

import binascii
import re
from itertools import pairwise
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.defect import Kind

MAX_LINE: Final = 1023
"""Bytes that OpenSSL reads at once (MAX_SMLEN less the NUL): longer lines fall into pieces that count as lines."""

MAX_HEADER_LINES: Final = 64
"""Lines of one header that are read: real ones have at most 4, and 250,000 cost seconds."""

MAX_BOUNDARIES: Final = 8
"""Boundary lines that are looked at: a signed message has 3, and 300,000 cost seconds."""

MAX_MENTIONS: Final = 1000
"""Boundaries inside lines, where they are text, that are looked at: real messages have none."""

STOCK_PREAMBLE: Final = b"This is an S/MIME signed message"
"""The unsigned line that every writer puts before the first part (SMIME_write_ASN1, pyca's `smime_sign_encode`)."""

_SIGNED: Final = b"multipart/signed"
_OPAQUE: Final = (b"application/pkcs7-mime", b"application/x-pkcs7-mime")
_SIGNATURE: Final = (b"application/pkcs7-signature", b"application/x-pkcs7-signature")
_TEXT: Final = b"text/plain"

_TOP_HEADERS: Final = frozenset({b"mime-version", b"content-type"})
_PART_HEADERS: Final = frozenset({b"content-type", b"content-transfer-encoding", b"content-disposition"})

_BASE64_WIDTHS: Final = (64, 76)
"""Columns that PEM (RFC 7468) and MIME (RFC 2045) writers use; OpenSSL's reader is odd beyond 80."""

_SEVERAL_RETURNS: Final = re.compile(rb"\r{1,8}\n")
"""A line end with more CRs than one, which OpenSSL strips; a bound, since a thousand of them fill its buffer."""

_STRANGE_LINE: Final = re.compile(rb"^(?!\r*(?:%b\r*)?$)" % STOCK_PREAMBLE, re.MULTILINE)
"""A line outside of the parts that no writer emits."""

_SPACE: Final = b" \t\n\v\f\r"
"""What `ossl_isspace` takes for white space."""

_FIELD: Final = re.compile(rb"([^:]*):((?:\([^)]*\)|[^;(])*)(?:;|\Z)")
_PARAMETER: Final = re.compile(rb"""([^=]*)=((?:"[^"]*"|\([^)]*\)|[^;"(])*)(?:;|\Z)""")
"""OpenSSL's state machine over a header line: what its sign, a quote or a comment does not end is dropped."""

_Field = tuple[int, dict[bytes | None, bytes | None]]
"""The line of a header field, its value (by None) and its parameters by lower-case name."""


_NO_FIELD: Final[_Field] = (1, {})


class MimeError(ValueError):
    """Why a message could not be taken apart: `kind`, `line` of the file and `detail` make a defect."""

    def __init__(self, kind: Kind, line: int, detail: str) -> None:
        super().__init__(detail)
        self.kind = kind
        self.line = line
        self.detail = detail


class Unsigned(Struct, frozen=True, kw_only=True):
    """Text that no signature covers and that the writers of real messages do not write."""

    line: int
    detail: str


class Message(Struct, frozen=True, kw_only=True):
    """A signed message: `entity` is what a detached signature covers, in canonical form (None: opaque message).

    `entity_line` and `signature_line` are lines of the file, `signature` is the decoded CMS structure.
    """

    entity: bytes | None
    entity_line: int
    signature: bytes
    signature_line: int
    unsigned: tuple[Unsigned, ...]


def _malformed(line: int, detail: str) -> MimeError:
    return MimeError(Kind.MIME_MALFORMED, line, detail)


def read_message(data: bytes) -> Message:
    """Take a signed message apart; raise MimeError where OpenSSL would refuse it or where we do not follow it.

    `Kind.NOT_SMIME` is raised only where OpenSSL certainly refuses: no header says multipart/signed or pkcs7-mime.
    """
    lowered = data.lower()
    if _SIGNED not in lowered and b"pkcs7-mime" not in lowered:
        raise MimeError(Kind.NOT_SMIME, 1, f"expected an S/MIME signed message, found {_describe(data)}")
    if b"\0" in data:
        raise _malformed(_line(data, data.find(b"\0")), "a NUL byte ends the text for some readers")
    fields, end, unsigned = _read_header(data, 0, 1, _TOP_HEADERS | _PART_HEADERS)
    number, content_type = fields.get(b"content-type", _NO_FIELD)
    value = content_type.get(None)
    if value == _SIGNED:
        boundary = content_type.get(b"boundary")
        if boundary is None:
            raise _malformed(number, "multipart/signed without a boundary")
        return _read_multipart(data, end, boundary, unsigned)
    if value in _OPAQUE:
        line = _line(data, end)
        signature = _decode_base64(data[end:], line)
        return Message(
            entity=None, entity_line=line, signature=signature, signature_line=line, unsigned=tuple(unsigned)
        )
    found = "no Content-Type before the first blank line" if value is None else f"Content-Type {_quoted(value)}"
    raise MimeError(Kind.NOT_SMIME, 1, f"expected Content-Type multipart/signed at the top, found {found}")


def _describe(data: bytes) -> str:
    start = data.lstrip(b"\xef\xbb\xbf" + _SPACE)[:16]
    if start.startswith(b"-----BEGIN"):
        return "a PEM file"
    if start.startswith(b"<"):
        return "XML without a signature"
    if start.startswith((b"\x30\x80", b"\x30\x82", b"\x30\x83")):
        return "binary DER or BER"
    return "neither of its header types" if start else "nothing"


def _quoted(text: bytes | None) -> str:
    return "none" if text is None else '"' + text[:80].decode("ascii", "backslashreplace") + '"'


def _line(data: bytes, offset: int) -> int:
    return data.count(b"\n", 0, offset) + 1


# --- the parts


def _read_multipart(data: bytes, start: int, boundary: bytes, unsigned: list[Unsigned]) -> Message:
    """Split the body at its boundaries into exactly two parts (`multi_split`)."""
    delimiters = _delimiters(data, start, boundary, unsigned)
    for begin, end, where in (
        (start, delimiters[0][0], "before the first"),
        (delimiters[-1][1], len(data), "after the last"),
    ):
        if (strange := _STRANGE_LINE.search(data, begin, end)) is not None:
            detail = f"text {where} part, which no signature covers and no DDS implementation reads"
            unsigned.append(Unsigned(line=_line(data, strange.start()), detail=detail))
    pieces = [(begin, end) for (_, begin), (end, _) in pairwise(delimiters)]
    parts = [piece for piece in pieces if piece[0] < piece[1]]  # OpenSSL does not see empty ones
    nothing = "two boundaries with nothing between them"
    unsigned += [Unsigned(line=_line(data, begin), detail=nothing) for begin, end in pieces if begin >= end]
    if len(parts) != 2:
        message = f"expected two parts, the text and its signature, found {len(parts)}"
        raise _malformed(_line(data, delimiters[0][0]), message)
    (text_begin, text_end), (signature_begin, signature_end) = parts
    signature, signature_line = _read_signature(data, signature_begin, signature_end, unsigned)
    entity_line = _line(data, text_begin)
    return Message(
        entity=_canonical(data[text_begin:text_end], entity_line),
        entity_line=entity_line,
        signature=signature,
        signature_line=signature_line,
        unsigned=tuple(sorted(unsigned, key=lambda text: text.line)),
    )


def _delimiters(data: bytes, start: int, boundary: bytes, unsigned: list[Unsigned]) -> list[tuple[int, int]]:
    """The boundary lines up to the final one, each with where it begins and where the next line begins."""
    mark = b"--" + boundary
    found: list[tuple[int, int]] = []
    final, end = False, start
    while not final and (hit := data.find(b"\n" + mark, end - 1) + 1):
        _refuse_mentions(data, end, hit, mark)
        end = data.find(b"\n", hit) + 1 or len(data)
        if end - hit > MAX_LINE or len(found) == MAX_BOUNDARIES:
            detail = f"a boundary line of more than {MAX_LINE} bytes, or more than {MAX_BOUNDARIES} of them"
            raise _malformed(_line(data, hit), detail)
        found.append((hit, end))
        rest = data[hit + len(mark) : end]
        final = rest.startswith(b"--")
        if rest[2 * final :].strip(_SPACE):
            detail = "text behind a boundary, which is compared by prefix"
            unsigned.append(Unsigned(line=_line(data, hit), detail=detail))
    if final:
        return found
    _refuse_mentions(data, end, len(data), mark)
    raise _malformed(_line(data, found[-1][0]) if found else 1, f"no final boundary for {_quoted(boundary)}")


def _refuse_mentions(data: bytes, begin: int, end: int, mark: bytes) -> None:
    """Refuse boundaries inside lines where OpenSSL's buffer may begin, or more of them than are looked at."""
    mentions = data.count(mark, begin, end)
    many = mentions > MAX_MENTIONS
    for number, text in enumerate(data[begin:end].split(b"\n") if mentions else ()):
        if mark in (text if many else text[MAX_LINE:]):
            detail = f"a boundary behind {MAX_LINE} bytes of a line, or more than {MAX_MENTIONS} inside lines"
            raise _malformed(_line(data, begin) + number, detail)


def _canonical(part: bytes, line: int) -> bytes:
    """The lines of a part joined by CRLF, trailing CRs removed, without the end of the last line (`strip_eol`)."""
    if part.count(b"\r") == part.count(b"\r\n"):
        return part.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n")[:-2]
    lines = part.split(b"\n")
    for number, content in enumerate(lines, line):
        if len(content) >= MAX_LINE:
            raise _malformed(number, f"a line of more than {MAX_LINE} bytes in a text with lone carriage returns")
    return b"\r\n".join([content.rstrip(b"\r") for content in lines])[:-2]


def _read_signature(data: bytes, begin: int, end: int, unsigned: list[Unsigned]) -> tuple[bytes, int]:
    """The decoded signature of the second part, and the line where its base64 text begins."""
    fields, body, odd = _read_header(data[:end], begin, _line(data, begin), _PART_HEADERS)
    if fields.get(b"content-type", _NO_FIELD)[1].get(None) not in _SIGNATURE:
        found = _quoted(fields[b"content-type"][1][None]) if b"content-type" in fields else "no Content-Type"
        detail = f"expected a second part of type application/x-pkcs7-signature, found {found}"
        raise _malformed(_line(data, begin), detail)
    unsigned += odd
    line = _line(data, body)
    return _decode_base64(data[body:end], line), line


def _decode_base64(text: bytes, line: int) -> bytes:
    """Decode lines of 64 or 76 characters, blank lines only around them; the encoding has to be the canonical one."""
    text = _SEVERAL_RETURNS.sub(b"\n", text).strip(b"\n")
    try:
        decoded = binascii.a2b_base64(text.replace(b"\n", b""))
    except binascii.Error as error:
        raise _malformed(line, f"the signature is no base64: {error}") from None
    encoded = binascii.b2a_base64(decoded, newline=False)
    places = {width: range(0, len(encoded), width) for width in _BASE64_WIDTHS}
    if not any(text == b"\n".join([encoded[at : at + width] for at in places[width]]) for width in places):
        detail = "expected base64 in lines of 64 or 76 characters and nothing else, found other characters or lengths"
        raise _malformed(line, detail)
    return decoded


# --- headers


def split_text(entity: bytes, line: int) -> tuple[bytes, int]:
    """Take the header off a signed entity that begins at `line`; return the text and its line (`SMIME_text`).

    Raises MimeError: `Kind.NO_TEXT_PLAIN` where OpenSSL certainly refuses since no header says text/plain.
    """
    expected = "expected the signed text to begin with Content-Type: text/plain (openssl: -text), found "
    if _TEXT not in entity.lower():
        raise MimeError(Kind.NO_TEXT_PLAIN, line, f"{expected}none")
    if b"\0" in entity:
        raise _malformed(line, "a NUL byte ends the text for some readers")
    fields, end, _odd = _read_header(entity, 0, line, frozenset())
    value = fields.get(b"content-type", _NO_FIELD)[1].get(None)
    if value != _TEXT:
        raise MimeError(Kind.NO_TEXT_PLAIN, line, f"{expected}{_quoted(value)}")
    return entity[end:], line + entity.count(b"\n", 0, end)


def _read_header(
    data: bytes, start: int, line: int, known: frozenset[bytes]
) -> tuple[dict[bytes, _Field], int, list[Unsigned]]:
    """Fields up to the first blank line (`mime_parse_hdr`), the offset behind it, and lines that nobody reads."""
    fields: dict[bytes, _Field] = {}
    odd: list[Unsigned] = []
    last: _Field | None = None
    offset, number = start, line
    while offset < len(data):
        end = data.find(b"\n", offset) + 1 or len(data)
        text = data[offset:end].rstrip(b"\r\n")
        if end - offset > MAX_LINE or number - line >= MAX_HEADER_LINES or b"\r" in text:
            limits = f"more than {MAX_HEADER_LINES} lines or {MAX_LINE} bytes a line"
            raise _malformed(number, f"a header of {limits}, or a lone carriage return")
        offset = end
        if not text:
            break
        known_line = last is not None and text[0] in _SPACE  # a folded one
        if last is None or not known_line:
            opening = _FIELD.match(text)
            name = (_strip(opening[1]) or b"").lower() if opening else b""
            if name in fields and opening:
                raise _malformed(number, f"a second header {_quoted(name)}: readers take either")
            if opening:
                value = _strip(opening[2])
                last = fields[name] = number, {None: None if value is None else value.lower()}
                _read_parameters(last[1], text, opening.end(), number)
            known_line = opening is not None and name in known
        else:
            _read_parameters(last[1], text, 0, number)
        if not known_line or b"(" in text:
            odd.append(Unsigned(line=number, detail=f"header line {_quoted(text)}, which no DDS implementation reads"))
        number += 1
    return fields, offset, odd


def _read_parameters(field_: dict[bytes | None, bytes | None], text: bytes, position: int, number: int) -> None:
    while piece := _PARAMETER.match(text, position):
        name = (_strip(piece[1]) or b"").lower()
        if name in field_:
            raise _malformed(number, f"a second parameter {_quoted(name)}: readers take either")
        field_[name] = _strip(piece[2])
        position = piece.end()


def _strip(text: bytes) -> bytes | None:
    """Strip white space and one quote at each end as OpenSSL does (`strip_ends`); None for nothing."""
    text = text.lstrip(_SPACE)
    if text.startswith(b'"'):
        text = text[1:]
    if not text:
        return None
    text = text.rstrip(_SPACE)
    if text.endswith(b'"'):
        return None if len(text) == 2 else text[:-1]  # one character between quotes: `p - 1 == name`
    return text or None
