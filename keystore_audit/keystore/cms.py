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
from keystore_audit.keystore.der import children, first_element, well_formed
from keystore_audit.keystore.public_key import DIGESTS, Problem, Scheme, digest_problems, read_digest, read_scheme

MAX_SIGNERS: Final = 16
"""SignerInfos whose signatures are checked: a real document has one, each costs a public-key operation per key."""

MAX_EMBEDDED: Final = 64
"""Certificates of a message that are read: real ones have at most a chain."""

_SIGNED_DATA: Final = x509.ObjectIdentifier("1.2.840.113549.1.7.2")
_DATA: Final = x509.ObjectIdentifier("1.2.840.113549.1.7.1")
_DATA_DER: Final = asn1.encode_der(_DATA)
_OCTET_STRING: Final = b"\x04"
_UTC_TIME: Final = b"\x17"
_STRINGS: Final = frozenset({b"\x0c", b"\x12", b"\x13", b"\x14", b"\x16", b"\x1c", b"\x1e"})
"""Tags of UTF8String, NumericString, PrintableString, TeletexString, IA5String, UniversalString, BMPString."""

_CONTENT_TYPE: Final = x509.ObjectIdentifier("1.2.840.113549.1.9.3")
_MESSAGE_DIGEST: Final = x509.ObjectIdentifier("1.2.840.113549.1.9.4")
_SIGNING_TIME: Final = x509.ObjectIdentifier("1.2.840.113549.1.9.5")


_OTHER: Final[Problem] = (
    Kind.CMS_MALFORMED,
    "expected signed data as openssl writes it, found other versions, types, parameters or attributes (RFC 5652)",
)
"""What run times interpret differently, and no writer of documents makes."""


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
    problems: tuple[Problem, ...] = ()


class SignedData(Struct, frozen=True, kw_only=True):
    """A SignedData: the content inside it if any, the certificates in it as DER, and what is out of order."""

    content: bytes | None
    certificates: tuple[bytes, ...]
    signers: tuple[SignerInfo, ...]
    problems: tuple[Problem, ...]


# --- the structures. Three hints for `hazmat.asn1`. An optional TLV is refused, so an AlgorithmIdentifier is a TLV that
# is read afterwards. OpenSSL does not sort the certificates, so they are a list although the standard says SET. Names,
# signed attributes and certificates count byte for byte. They are cut out of the parsed structure, since cryptography
# before 50 cannot encode a TLV again.


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
    if len(infos) > MAX_SIGNERS or len(certificates) > MAX_EMBEDDED:
        found = f"{len(infos)} signatures and {len(certificates)} certificates"
        raise CmsError(Kind.CMS_MALFORMED, f"{found}, of which at most {MAX_SIGNERS} and {MAX_EMBEDDED} are read")
    try:
        listed = [read_digest(digest) for digest in children(fields[1])]
        signers = [_signer(*each, listed) for each in zip(infos, map(children, children(fields[-1])), strict=True)]
    except ValueError as error:
        raise CmsError(Kind.CMS_MALFORMED, f"an algorithm identifier cannot be read: {error}") from None
    problems = [problem for signer in signers for problem in signer.problems]
    if not infos:
        problems.append((Kind.NO_SIGNER, "the message carries no signature at all"))
    problems += [
        (Kind.UNSUPPORTED_ALGORITHM, f"the digest algorithm {name} is listed, and run times may not know it")
        for name, _ in listed
        if name not in DIGESTS
    ]
    plain = data.version == 1 and data.content.content_type == _DATA and data.revocation_lists is None
    if not plain or any(has_parameters for _, has_parameters in listed):
        problems.append(_OTHER)
    return SignedData(
        content=data.content.content,
        certificates=tuple(certificates),
        signers=tuple(signers),
        problems=tuple(dict.fromkeys(problems)),
    )


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


def _signer(info: _SignerInfo, fields: list[bytes], listed: list[tuple[str, bool]]) -> SignerInfo:
    """Read one SignerInfo, whose `fields` are its elements as they stand."""
    attributes = info.signed_attributes
    signed = None if attributes is None else b"\x31" + fields[3][1:]  # RFC 5652, 5.4: as a SET OF
    digest = read_digest(fields[2])
    scheme = read_scheme(fields[3 if signed is None else 4], digest[0])
    message_digest, time = None, None
    plain = info.version == 1 and info.unsigned_attributes is None and digest in listed and scheme.plain
    problems = [*digest_problems(digest[0]), *scheme.problems]
    if attributes is None:
        detail = "the signature covers the text itself, there are no signed attributes"
        problems.append((Kind.NO_SIGNED_ATTRIBUTES, detail))
    else:
        message_digest, time = _attributes(attributes.as_list())
    if not plain or (signed is not None and message_digest is None):
        problems.append(_OTHER)
    return SignerInfo(
        issuer_der=children(fields[1])[0],
        serial=info.identifier.serial,
        digest=digest[0],
        message_digest=message_digest,
        signed=signed,
        signing_time=time,
        scheme=scheme,
        signature=info.signature,
        problems=tuple(problems),
    )


def _attributes(attributes: list[_Attribute]) -> tuple[bytes | None, datetime | None]:
    """The message digest and the signing time of signed attributes; no digest where they are not as they have to be.

    Each is there once and has one value, which is well-formed (RFC 5652, 11), the content type among them.
    """
    values = {each.type: each.values.as_list() for each in attributes}
    first = {kind: alternatives[0] for kind, alternatives in values.items() if len(alternatives) == 1}
    content_type, digest, time = first.get(_CONTENT_TYPE), first.get(_MESSAGE_DIGEST), first.get(_SIGNING_TIME)
    plain = len(first) == len(attributes) and all(well_formed(each.tag_bytes[0], each.data) for each in first.values())
    is_data = (
        content_type is not None and content_type.tag_bytes == _DATA_DER[:1] and content_type.data == _DATA_DER[2:]
    )
    known = plain and is_data and digest is not None and digest.tag_bytes == _OCTET_STRING
    return bytes(digest.data) if known and digest is not None else None, None if time is None else _time(time)


def _time(value: TLV) -> datetime | None:
    """The UTCTime or GeneralizedTime, aware UTC; None for anything else, since nothing depends on it."""
    kind: type[UTCTime] | type[GeneralizedTime] = UTCTime if value.tag_bytes == _UTC_TIME else GeneralizedTime
    try:
        time: datetime = value.parse(kind).as_datetime()
    except ValueError:
        return None
    return time.replace(tzinfo=timezone.utc)


# --- why it could not be read


def _departure_from_der(data: bytes) -> str | None:
    """What run times pass over: the form that `openssl -stream` writes, or bytes behind the structure."""
    if data[:2] == b"\x30\x80":
        return "an indefinite length (BER)"
    element = first_element(data)
    behind = len(data) - len(element) if element is not None else 0
    return f"{behind} bytes behind the signature" if behind else None
