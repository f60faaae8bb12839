"""CMS SignedData (RFC 5652) as DDS documents carry it: strict DER, one reading, or an error.

The subset is that of PKCS#7 1.5, which DDS implementations read: signers named by issuer and serial number, content
of type id-data. What some run time may accept beyond it is refused here and becomes an opaque defect.
"""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Annotated, Final

from cryptography import x509
from cryptography.hazmat import asn1
from cryptography.hazmat.asn1 import TLV, Explicit, GeneralizedTime, Implicit, SetOf, UTCTime
from msgspec import Struct

from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.der import children, well_formed
from keystore_audit.keystore.public_key import DIGESTS, Digest, Problem, Scheme, read_digest, read_scheme

MAX_SIGNERS: Final = 16
"""SignerInfos whose signatures are checked: a real document has one, each costs a public-key operation per key."""

MAX_EMBEDDED: Final = 64
"""Certificates of a message that are read: real ones have at most a chain."""

MAX_ELEMENTS: Final = 10_000
"""Elements that are looked through for the reason of a failure: the signature of a DDS document has about 100."""

_SIGNED_DATA: Final = x509.ObjectIdentifier("1.2.840.113549.1.7.2")
_DATA: Final = x509.ObjectIdentifier("1.2.840.113549.1.7.1")
_DATA_DER: Final = asn1.encode_der(_DATA)
_IDENTIFIER: Final = b"\x06"
_OCTET_STRING: Final = b"\x04"
_UTC_TIME: Final = b"\x17"
_STRINGS: Final = frozenset({b"\x0c", b"\x12", b"\x13", b"\x14", b"\x16", b"\x1c", b"\x1e"})
"""Tags of UTF8String, NumericString, PrintableString, TeletexString, IA5String, UniversalString, BMPString."""

_CONTENT_TYPE: Final = x509.ObjectIdentifier("1.2.840.113549.1.9.3")
_MESSAGE_DIGEST: Final = x509.ObjectIdentifier("1.2.840.113549.1.9.4")
_SIGNING_TIME: Final = x509.ObjectIdentifier("1.2.840.113549.1.9.5")


class CmsError(ValueError):
    """Why a structure has no single reading: `kind` and `detail` make a defect."""

    def __init__(self, kind: Kind, detail: str) -> None:
        super().__init__(detail)
        self.kind = kind
        self.detail = detail


class SignerInfo(Struct, frozen=True, kw_only=True):
    """One SignerInfo (RFC 5652, 5.3).

    `digest` as in `smime.Signature`. `message_digest` and `signed` (the DER of the signed attributes) are None where
    there are no signed attributes: the signature then covers the content.
    """

    issuer_der: bytes
    serial: int
    digest: str
    message_digest: bytes | None
    signed: bytes | None
    signing_time: datetime | None
    scheme: Scheme
    signature: bytes


class SignedData(Struct, frozen=True, kw_only=True):
    """A SignedData: the content inside it if any, the certificates in it as DER, and what is out of order."""

    content: bytes | None
    certificates: tuple[bytes, ...]
    signers: tuple[SignerInfo, ...]
    problems: tuple[Problem, ...]


# --- the structures. Three hints for `hazmat.asn1`: an optional TLV is refused, so an AlgorithmIdentifier is a TLV that
# is read afterwards; OpenSSL does not sort the certificates, so they are a list although the standard says SET; what
# counts byte for byte (names, signed attributes, certificates) is cut out of the structure once it has been parsed,
# since cryptography before 50 cannot encode a TLV again.


@asn1.sequence
class _ContentInfo:
    content_type: x509.ObjectIdentifier
    content: Annotated[TLV, Explicit(0)]


@asn1.sequence
class _EncapsulatedContent:
    content_type: x509.ObjectIdentifier
    content: Annotated[bytes | None, Explicit(0)]


@asn1.sequence
class _Attribute:
    type: x509.ObjectIdentifier
    values: SetOf[TLV]


@asn1.sequence
class _IssuerAndSerial:
    issuer: TLV
    serial: int


@asn1.sequence
class _SignerInfo:
    version: int
    identifier: _IssuerAndSerial
    digest_algorithm: TLV
    signed_attributes: Annotated[SetOf[_Attribute] | None, Implicit(0)]
    signature_algorithm: TLV
    signature: bytes
    unsigned_attributes: Annotated[list[TLV] | None, Implicit(1)]


@asn1.sequence
class _SignedData:
    version: int
    digest_algorithms: SetOf[TLV]
    content: _EncapsulatedContent
    certificates: Annotated[list[TLV] | None, Implicit(0)]
    revocation_lists: Annotated[list[TLV] | None, Implicit(1)]
    signer_infos: SetOf[_SignerInfo]


# --- reading


def read_signed_data(der: bytes) -> SignedData:
    """Read a ContentInfo that holds a SignedData; raise CmsError where it is not, or not strictly DER.

    The kinds raised: NO_SIGNER (another content type, which every run time refuses), CMS_NOT_DER (BER, bytes behind
    the structure: run times accept them), CMS_MALFORMED.
    """
    data = _parse(der)
    fields = children(children(children(der)[1])[0])
    infos = data.signer_infos.as_list()
    certificates = [] if data.certificates is None else children(fields[3])
    found = "expected plain signed data, found"  # what one of PKCS#7 1.5 has not, run times read in their own ways
    problems = _malformed(
        (data.version != 1, f"{found} version {data.version} (RFC 5652, 5.1: 1)"),
        (
            data.content.content_type != _DATA,
            f"{found} content of type {data.content.content_type.dotted_string} (id-data is 1.2.840.113549.1.7.1)",
        ),
        (data.revocation_lists is not None, f"{found} revocation lists, which no DDS implementation reads here"),
    )
    if not infos:
        problems.append((Kind.NO_SIGNER, "the message carries no signature at all"))
    few = len(infos) <= MAX_SIGNERS
    problems += _malformed((not few, f"{len(infos)} signatures, at most {MAX_SIGNERS} are checked"))
    try:
        listed = [read_digest(digest) for digest in children(fields[1])]
        signers = [
            _signer(info, children(element), listed, problems)
            for info, element in zip(infos, children(fields[-1]), strict=True)
            if few
        ]
    except ValueError as error:
        raise CmsError(Kind.CMS_MALFORMED, f"an algorithm identifier cannot be read: {error}") from None
    problems += [
        (Kind.UNSUPPORTED_ALGORITHM, f"the digest algorithm {digest.name} is listed, and run times may not know it")
        for digest in listed
        if digest.name not in DIGESTS
    ]
    many = len(certificates) > MAX_EMBEDDED
    problems += _malformed(
        (
            any(digest.has_parameters for digest in listed),
            "a digest algorithm that the message lists has parameters",
        ),
        (many, f"{len(certificates)} certificates, at most {MAX_EMBEDDED} are read"),
    )
    return SignedData(
        content=data.content.content,
        certificates=() if many else tuple(certificates),
        signers=tuple(signers),
        problems=tuple(problems),
    )


def _malformed(*said: tuple[bool, str]) -> list[Problem]:
    """What is so."""
    return [(Kind.CMS_MALFORMED, detail) for is_so, detail in said if is_so]


def has_string_values(name_der: bytes) -> bool:
    """Whether every attribute of a distinguished name is a string: else OpenSSL refuses the message around it.

    The name is that of a certificate which has been parsed.
    """
    attributes = [attribute for relative in children(name_der) for attribute in children(relative)]
    return all(children(attribute)[1][:1] in _STRINGS for attribute in attributes)


def _parse(der: bytes) -> _SignedData:
    try:
        outer = asn1.decode_der(_ContentInfo, der)
        data: _SignedData | None = outer.content.parse(_SignedData) if outer.content_type == _SIGNED_DATA else None
    except ValueError as error:
        departure = _departure_from_der(der)
        if departure is not None:
            raise CmsError(Kind.CMS_NOT_DER, f"expected strict DER, found {departure}; run times accept it") from None
        raise CmsError(Kind.CMS_MALFORMED, f"the signature cannot be read as CMS signed data: {error}") from None
    if data is None:
        found = outer.content_type.dotted_string
        raise CmsError(Kind.NO_SIGNER, f"expected signed data ({_SIGNED_DATA.dotted_string}), found type {found}")
    return data


def _signer(info: _SignerInfo, fields: list[bytes], listed: list[Digest], problems: list[Problem]) -> SignerInfo:
    """Read one SignerInfo, whose `fields` are its elements as they stand, and append what is out of order in it."""
    attributes = info.signed_attributes
    signed = None if attributes is None else b"\x31" + fields[3][1:]  # RFC 5652, 5.4: as a SET OF
    digest = read_digest(fields[2])
    scheme = read_scheme(fields[3 if signed is None else 4], digest.name)
    problems += _malformed(
        (info.version != 1, f"a SignerInfo of version {info.version} (RFC 5652, 5.3: 1)"),
        (info.unsigned_attributes is not None, "unsigned attributes, which anybody can add or change"),
    )
    problems += digest.problems + scheme.problems
    problems += _malformed(
        (
            digest not in listed,
            f"the digest algorithm {digest.name} of a signature is not among those that the message lists",
        )
    )
    message_digest, time = None, None
    if attributes is None:
        detail = "the signature covers the text itself, there are no signed attributes"
        problems.append((Kind.NO_SIGNED_ATTRIBUTES, detail))
    else:
        message_digest, time = _attributes(attributes.as_list(), problems)
    return SignerInfo(
        issuer_der=children(fields[1])[0],
        serial=info.identifier.serial,
        digest=digest.name,
        message_digest=message_digest,
        signed=signed,
        signing_time=time,
        scheme=scheme,
        signature=info.signature,
    )


def _attributes(attributes: list[_Attribute], problems: list[Problem]) -> tuple[bytes | None, datetime | None]:
    """The message digest (None where it is not there exactly once) and the signing time of signed attributes."""
    values: dict[x509.ObjectIdentifier, TLV | None] = {}
    for attribute in attributes:
        kind, alternatives = attribute.type, attribute.values.as_list()
        single = alternatives[0] if len(alternatives) == 1 and kind not in values else None
        values[kind] = single
        named = f"the signed attribute {kind.dotted_string}"
        problems += _malformed(
            (single is None, f"{named} is there twice or has not one value"),
            (
                single is not None and not well_formed(single.tag_bytes[0], single.data),
                f"{named} has a malformed value",
            ),
        )
    content_type, digest, time = values.get(_CONTENT_TYPE), values.get(_MESSAGE_DIGEST), values.get(_SIGNING_TIME)
    if digest is not None and digest.tag_bytes != _OCTET_STRING:
        digest = None
    problems += _malformed(
        (
            content_type is None or content_type.tag_bytes != _IDENTIFIER or content_type.data != _DATA_DER[2:],
            "the signed attribute contentType does not say id-data once (RFC 5652, 11.1)",
        ),
        (digest is None, "the signed attribute messageDigest is not one octet string (RFC 5652, 11.2)"),
    )
    return None if digest is None else bytes(digest.data), None if time is None else _time(time)


def _time(value: TLV) -> datetime | None:
    """The UTCTime or GeneralizedTime, aware UTC; None for anything else, since nothing rests on it."""
    kind: type[UTCTime] | type[GeneralizedTime] = UTCTime if value.tag_bytes == _UTC_TIME else GeneralizedTime
    try:
        time: datetime = value.parse(kind).as_datetime()
    except ValueError:
        return None
    return time.replace(tzinfo=timezone.utc)


# --- why it could not be read


def _departure_from_der(data: bytes) -> str | None:
    """The first length that is not DER (X.690, 10.1) in reading order, or bytes behind the outermost element."""
    if not data.startswith(b"\x30"):
        return None
    position, outer_end = 0, len(data)
    for _ in range(MAX_ELEMENTS):
        if position + 2 >= len(data):
            break
        tag, first = data[position], data[position + 1]
        size = first & 0x7F if first & 0x80 else 0
        if first == 0x80:
            return f"an indefinite length at byte {position} of the signature (BER)"
        start = position + 2 + size
        length = int.from_bytes(data[position + 2 : start], "big") if size else first
        if size and (length < 0x80 or data[position + 2] == 0):
            return f"a length in more bytes than needed at byte {position} of the signature (BER)"
        if position == 0:
            outer_end = start + length
        position = start if tag & 0x20 else start + length
    return f"{len(data) - outer_end} bytes behind the signature" if outer_end < len(data) else None
