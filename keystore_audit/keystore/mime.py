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

_STOCK_HEADER: Final = re.compile(
    # Byte for byte what the two real writers emit: pyca/cryptography (sros2 since Iron) and OpenSSL.
    rb'MIME-Version: 1\.0(\r?\n)Content-Type: multipart/signed; protocol="application/(?:x-)?pkcs7-signature"; '
    rb'micalg="[a-z0-9-]{1,40}"; boundary="([-=0-9A-F]{8,70})"\1\1'
)
_STOCK_SIGNATURE_HEADER: Final = re.compile(
    rb'Content-Type: application/(?:x-)?pkcs7-signature; name="smime\.p7s"(\r?\n)Content-Transfer-Encoding: base64\1'
    rb'Content-Disposition: attachment; filename="smime\.p7s"\1\1'
)
_STOCK_TEXT_HEADER: Final = b"Content-Type: text/plain\r\n\r\n"

_SIGNED: Final = b"multipart/signed"
_OPAQUE: Final = (b"application/pkcs7-mime", b"application/x-pkcs7-mime")
_SIGNATURE: Final = (b"application/pkcs7-signature", b"application/x-pkcs7-signature")
_TEXT: Final = b"text/plain"

_TOP_HEADERS: Final = frozenset({b"mime-version", b"content-type"})
_PART_HEADERS: Final = frozenset({b"content-type", b"content-transfer-encoding", b"content-disposition"})

_BASE64_WIDTHS: Final = frozenset({64, 76})
"""Columns that PEM (RFC 7468) and MIME (RFC 2045) writers use; OpenSSL's reader is odd beyond 80."""

_SEVERAL_RETURNS: Final = re.compile(rb"\r{1,8}\n")
"""A line end with more CRs than one, which OpenSSL strips; a bound, since a thousand of them fill its buffer."""

_SPACE: Final = b" \t\n\v\f\r"
"""What `ossl_isspace` takes for white space."""


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


class _Header(Struct, frozen=True, kw_only=True):
    """A MIME header: fields by lower-case name, the offset after its blank line, and what is odd in it."""

    fields: dict[bytes, _Field]
    end: int
    odd: tuple[Unsigned, ...]


class _Field(Struct, frozen=True, kw_only=True):
    value: bytes | None
    parameters: dict[bytes, bytes | None]
    line: int


def read_message(data: bytes) -> Message:
    """Take a signed message apart; raise MimeError where OpenSSL would refuse it or where we do not follow it.

    `Kind.NOT_SMIME` is raised only where OpenSSL certainly refuses: no header says multipart/signed or pkcs7-mime.
    """
    stock = _STOCK_HEADER.match(data)
    if stock is not None and b"\0" not in data:
        return _read_multipart(data, stock.end(), stock[2], [])
    lowered = data.lower()
    if _SIGNED not in lowered and b"pkcs7-mime" not in lowered:
        raise MimeError(Kind.NOT_SMIME, 1, f"expected an S/MIME signed message, found {_describe(data)}")
    if b"\0" in data:
        raise MimeError(Kind.MIME_MALFORMED, _line(data, data.find(b"\0")), "a NUL byte ends the text for some readers")
    header = _read_header(data, 0, 1, _TOP_HEADERS | _PART_HEADERS)
    content_type = header.fields.get(b"content-type")
    value = content_type.value if content_type is not None else None
    if content_type is not None and value == _SIGNED:
        boundary = content_type.parameters.get(b"boundary")
        if boundary is None:
            raise MimeError(Kind.MIME_MALFORMED, content_type.line, "multipart/signed without a boundary")
        return _read_multipart(data, header.end, boundary, list(header.odd))
    if value in _OPAQUE:
        line = _line(data, header.end)
        signature = _decode_base64(data[header.end :], line)
        return Message(entity=None, entity_line=line, signature=signature, signature_line=line, unsigned=header.odd)
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
    preamble = data[start : delimiters[0][0]]
    if preamble.strip(b"\r\n") not in (b"", STOCK_PREAMBLE):
        unsigned.append(_foreign_text(data, start, preamble, "before the first part"))
    epilogue = data[delimiters[-1][1] :]
    if epilogue.strip(b"\r\n"):
        unsigned.append(_foreign_text(data, delimiters[-1][1], epilogue, "after the last part"))
    parts = []
    for (_, begin), (end, _) in pairwise(delimiters):
        if begin < end:
            parts.append((begin, end))
        else:  # OpenSSL does not see it
            unsigned.append(Unsigned(line=_line(data, begin), detail="two boundaries with nothing between them"))
    if len(parts) != 2:
        message = f"expected two parts, the text and its signature, found {len(parts)}"
        raise MimeError(Kind.MIME_MALFORMED, _line(data, delimiters[0][0]), message)
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
    hit, mentions = data.find(mark, start), 0
    while hit >= 0:
        if hit != start and data[hit - 1] != 0x0A:
            mentions += 1
            far = hit - start >= MAX_LINE and data.rfind(b"\n", max(start, hit - MAX_LINE), hit) < 0
            if far or mentions > MAX_MENTIONS:
                detail = f"a boundary behind {MAX_LINE} bytes of a line, or more than {MAX_MENTIONS} inside lines"
                raise MimeError(Kind.MIME_MALFORMED, _line(data, hit), detail)
            hit = data.find(mark, hit + 1)
            continue
        end = data.find(b"\n", hit) + 1 or len(data)
        if end - hit > MAX_LINE or len(found) == MAX_BOUNDARIES:
            detail = f"a boundary line of more than {MAX_LINE} bytes, or more than {MAX_BOUNDARIES} of them"
            raise MimeError(Kind.MIME_MALFORMED, _line(data, hit), detail)
        found.append((hit, end))
        rest = data[hit + len(mark) : end]
        final = rest.startswith(b"--")
        if rest[2 * final :].strip(_SPACE):
            unsigned.append(
                Unsigned(line=_line(data, hit), detail="text behind a boundary, which is compared by prefix")
            )
        if final:
            return found
        hit = data.find(mark, end)
    where = _line(data, found[-1][0]) if found else 1
    raise MimeError(Kind.MIME_MALFORMED, where, f"no final boundary for {_quoted(boundary)}")


def _foreign_text(data: bytes, offset: int, text: bytes, where: str) -> Unsigned:
    """The first unsigned line that no writer emits."""
    line = _line(data, offset)
    for number, content in enumerate(text.split(b"\n"), line):
        if content.strip(b"\r") not in (b"", STOCK_PREAMBLE):
            line = number
            break
    return Unsigned(line=line, detail=f"text {where}, which no signature covers and no DDS implementation reads")


def _canonical(part: bytes, line: int) -> bytes:
    """The lines of a part joined by CRLF, trailing CRs removed, without the end of the last line (`strip_eol`)."""
    returns, feeds, both = part.count(b"\r"), part.count(b"\n"), part.count(b"\r\n")
    if returns == feeds == both:
        return part[:-2]
    if returns == both:
        return part.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n")[:-2]
    lines = part.split(b"\n")
    for number, content in enumerate(lines, line):
        if len(content) >= MAX_LINE:
            detail = f"a line of more than {MAX_LINE} bytes in a text with lone carriage returns"
            raise MimeError(Kind.MIME_MALFORMED, number, detail)
    return b"\r\n".join([content.rstrip(b"\r") for content in lines])[:-2]


def _read_signature(data: bytes, begin: int, end: int, unsigned: list[Unsigned]) -> tuple[bytes, int]:
    """The decoded signature of the second part, and the line where its base64 text begins."""
    stock = _STOCK_SIGNATURE_HEADER.match(data, begin, end)
    if stock is not None:
        body = stock.end()
    else:
        header = _read_header(data[:end], begin, _line(data, begin), _PART_HEADERS)
        content_type = header.fields.get(b"content-type")
        if content_type is None or content_type.value not in _SIGNATURE:
            found = "no Content-Type" if content_type is None else _quoted(content_type.value)
            detail = f"expected a second part of type application/x-pkcs7-signature, found {found}"
            raise MimeError(Kind.MIME_MALFORMED, _line(data, begin), detail)
        unsigned += header.odd
        body = header.end
    line = _line(data, body)
    return _decode_base64(data[body:end], line), line


def _decode_base64(text: bytes, line: int) -> bytes:
    """Decode lines of 64 or 76 characters, blank lines only around them; the encoding has to be the canonical one."""
    regular_ends = text.count(b"\r") == text.count(b"\r\n")
    text = text.replace(b"\r\n", b"\n") if regular_ends else _SEVERAL_RETURNS.sub(b"\n", text)
    lines = text.strip(b"\n").split(b"\n")
    widths, last = set(map(len, lines[:-1])), len(lines[-1])
    joined = b"".join(lines)
    regular = (
        last <= max(_BASE64_WIDTHS)
        if not widths
        else len(widths) == 1 and widths <= _BASE64_WIDTHS and last <= max(widths)
    )
    try:
        decoded = binascii.a2b_base64(joined)
    except binascii.Error as error:
        raise MimeError(Kind.MIME_MALFORMED, line, f"the signature is no base64: {error}") from None
    if not regular or binascii.b2a_base64(decoded, newline=False) != joined:
        detail = "expected base64 in lines of 64 or 76 characters and nothing else, found other characters or lengths"
        raise MimeError(Kind.MIME_MALFORMED, line, detail)
    return decoded


# --- headers


def split_text(entity: bytes, line: int) -> tuple[bytes, int]:
    """Take the header off a signed entity that begins at `line`; return the text and its line (`SMIME_text`).

    Raises MimeError: `Kind.NO_TEXT_PLAIN` where OpenSSL certainly refuses since no header says text/plain.
    """
    if entity.startswith(_STOCK_TEXT_HEADER):
        return entity[len(_STOCK_TEXT_HEADER) :], line + 2
    expected = "expected the signed text to begin with Content-Type: text/plain (openssl: -text), found "
    if _TEXT not in entity.lower():
        raise MimeError(Kind.NO_TEXT_PLAIN, line, f"{expected}none")
    if b"\0" in entity:
        raise MimeError(Kind.MIME_MALFORMED, line, "a NUL byte ends the text for some readers")
    header = _read_header(entity, 0, line, frozenset())
    content_type = header.fields.get(b"content-type")
    if content_type is None or content_type.value != _TEXT:
        raise MimeError(
            Kind.NO_TEXT_PLAIN, line, f"{expected}{_quoted(content_type.value if content_type is not None else None)}"
        )
    return entity[header.end :], line + entity.count(b"\n", 0, header.end)


def _read_header(data: bytes, start: int, line: int, known: frozenset[bytes]) -> _Header:
    """Read header lines up to the first blank one (`mime_parse_hdr`)."""
    fields: dict[bytes, _Field] = {}
    odd: list[Unsigned] = []
    current: _Field | None = None
    offset, number = start, line
    while offset < len(data):
        end = data.find(b"\n", offset) + 1 or len(data)
        text = data[offset:end].rstrip(b"\r\n")
        if end - offset > MAX_LINE or number - line >= MAX_HEADER_LINES or b"\r" in text:
            detail = (
                f"a header of more than {MAX_HEADER_LINES} lines or {MAX_LINE} bytes a line, or a lone carriage return"
            )
            raise MimeError(Kind.MIME_MALFORMED, number, detail)
        offset = end
        if not text:
            break
        folded = current is not None and text[0] in _SPACE
        name, field_ = _read_header_line(text, number, current if folded else None)
        if field_ is not None and not folded:
            if name in fields:
                raise MimeError(Kind.MIME_MALFORMED, number, f"a second header {_quoted(name)}: readers take either")
            fields[name] = current = field_
        if (not folded and (field_ is None or name not in known)) or b"(" in text:
            odd.append(Unsigned(line=number, detail=f"header line {_quoted(text)}, which no DDS implementation reads"))
        number += 1
    return _Header(fields=fields, end=offset, odd=tuple(odd))


def _read_header_line(text: bytes, number: int, folded_into: _Field | None) -> tuple[bytes, _Field | None]:
    """Read one line, or add the parameters of a folded one; None where OpenSSL drops it (no colon, open quote)."""
    pieces = _tokens(text, named=folded_into is not None)
    name = b""
    field_ = folded_into
    if field_ is None:
        if not pieces or pieces[0][0] != ":":
            return name, None
        _, left, value = pieces.pop(0)
        name = (_strip(left) or b"").lower()
        stripped = _strip(value)
        field_ = _Field(value=None if stripped is None else stripped.lower(), parameters={}, line=number)
    for _, left, value in pieces:
        parameter = (_strip(left) or b"").lower()
        if parameter in field_.parameters:
            raise MimeError(
                Kind.MIME_MALFORMED, number, f"a second parameter {_quoted(parameter)}: readers take either"
            )
        field_.parameters[parameter] = _strip(value)
    return name, field_


def _tokens(text: bytes, *, named: bool) -> list[tuple[str, bytes, bytes]]:
    """OpenSSL's state machine over one line: `(":", name, value)` for the header, `("=", name, value)` for parameters.

    A name that is not ended by its sign, an open quote or an open comment at the end of the line drops the piece.
    """
    pieces: list[tuple[str, bytes, bytes]] = []
    state, outer = ("name" if named else "start"), ""
    begin, left = 0, b""
    for position, character in enumerate(text):
        sign = chr(character)
        if (state == "start" and sign == ":") or (state == "name" and sign == "="):
            left, begin = text[begin:position], position + 1
            state = "type" if state == "start" else "value"
        elif state in ("type", "value") and sign == ";":
            pieces.append((":" if state == "type" else "=", left, text[begin:position]))
            begin, state = position + 1, "name"
        elif state in ("type", "value") and sign == "(":
            state, outer = "comment", state
        elif state == "comment" and sign == ")":
            state = outer
        elif state in ("value", "quote") and sign == '"':
            state = "quote" if state == "value" else "value"
    if state in ("type", "value"):
        pieces.append((":" if state == "type" else "=", left, text[begin:]))
    return pieces


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
