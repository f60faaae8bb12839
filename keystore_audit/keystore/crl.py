"""Certificate revocation lists as evidence (RFC 5280 section 5)."""

from __future__ import annotations

import re
import warnings
from datetime import datetime
from functools import lru_cache
from typing import Final, TypeVar

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec import Struct

from keystore_audit.keystore.attribute_types import written
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.der import MALFORMED, parts
from keystore_audit.keystore.files import File
from keystore_audit.keystore.pem import DUMP_OF_REVOCATION_LIST, Block, Problem, read_pem
from keystore_audit.keystore.public_key import signature_algorithm

# Compares distinguished names of certificates as X.509 verifiers do.


_BLANKS: Final = re.compile(r"[ \t\n\v\f\r]+")
_LOWER: Final = {upper: upper + 0x20 for upper in range(ord("A"), ord("Z") + 1)}


def same_name(first: x509.Name, second: x509.Name) -> bool:
    """Whether OpenSSL's X509_NAME_cmp finds the names equal (crypto/x509/x_name.c, x509_name_canon).

    Neither the case of ASCII letters, nor blanks around or their number between words, nor the type of
    string counts.
    """
    return _canonical(first) == _canonical(second)


@lru_cache(maxsize=4096)
def _canonical(name: x509.Name) -> tuple[frozenset[tuple[str, str | bytes]], ...]:
    return tuple(
        frozenset((attribute.oid.dotted_string, _canonical_value(attribute.value)) for attribute in rdn)
        for rdn in name.rdns
    )


def _canonical_value(value: str | bytes) -> str | bytes:
    if isinstance(value, bytes):
        return value
    return _BLANKS.sub(" ", value).strip(" ").translate(_LOWER)


REVOCATION_LIST_LABEL: Final = "X509 CRL"

_PROCESSED: Final = frozenset(
    # Taken as understood when critical by OpenSSL 3 (crypto/x509/x_crl.c, crl_cb): issuingDistributionPoint,
    # authorityKeyIdentifier, deltaCRLIndicator.
    {"2.5.29.28", "2.5.29.35", "2.5.29.27"}
)
_PROCESSED_IN_ENTRY: Final = frozenset({"2.5.29.29"})  # certificateIssuer (x_crl.c, crl_set_issuers)


_Extension = TypeVar("_Extension", bound=x509.ExtensionType)


class RevocationList(Struct, frozen=True, kw_only=True, eq=False):
    """One CRL found at `line` of `path`; `revoked` holds serial numbers of its own issuer. Compared by identity.

    `unknown_critical`: critical extensions, of the list or of an entry, that OpenSSL does not process.
    `signed_part` is kept, since the library encodes a list again whenever it is asked (20 ms for a megabyte).
    `algorithms_agree`: whether the signature algorithm inside it is the one outside (RFC 5280, 5.1.1.2).
    """

    path: str
    line: int
    issuer: str
    issuer_name: x509.Name
    issuer_der: bytes
    this_update: datetime
    next_update: datetime | None
    revoked: frozenset[int]
    passed_over: frozenset[int]
    """Serial numbers of entries without effect: of another issuer, or behind one that takes the number back."""
    signature_algorithm: str
    unknown_critical: tuple[str, ...]
    scope: frozenset[str]
    """Fields of issuingDistributionPoint that narrow the list (RFC 5280, 5.2.5), by their names there."""
    delta: bool
    """Whether it tells changes alone, of a list that is elsewhere (RFC 5280, 5.2.4)."""
    algorithms_agree: bool
    signed_part: bytes
    parsed: x509.CertificateRevocationList


class CrlFile(Struct, frozen=True, kw_only=True, eq=False):
    """`crl.pem` of an enclave."""

    file: File
    revocation_lists: tuple[RevocationList, ...]
    defects: tuple[Defect, ...]


def read_crl(file: File) -> CrlFile:
    """Read every revocation list of a PEM file; whatever else stands there is a defect.

    Never raises. OpenSSL reads the first list of `crl.pem`; the others are evidence all the same.
    """
    if file.content is None:
        return CrlFile(file=file, revocation_lists=(), defects=())
    pem = read_pem(file.content)
    lists: list[RevocationList] = []
    defects: list[Defect] = []
    for part in pem.parts:
        if isinstance(part, Block) and part.label != REVOCATION_LIST_LABEL:
            defects.append(_defect(file, Kind.CERTIFICATE_FILE_EXTRA, part.line, f"found a block {part.label}"))
            continue
        read = read_revocation_list(part, file.place) if isinstance(part, Block) else part
        if isinstance(read, RevocationList):
            lists.append(read)
        else:
            defects.append(_defect(file, Kind.CRL_UNREADABLE, read.line, f"found {read.detail}"))
    defects.extend(
        _defect(file, Kind.CERTIFICATE_FILE_EXTRA, text.line, "found other text")
        for text in pem.texts
        if lists and not text.is_dump(DUMP_OF_REVOCATION_LIST)
    )
    if not lists and not any(defect.kind is Kind.CRL_UNREADABLE for defect in defects):
        defects.append(_defect(file, Kind.CRL_UNREADABLE, None, "found none"))
    return CrlFile(file=file, revocation_lists=tuple(lists), defects=tuple(defects))


def _defect(file: File, kind: Kind, line: int | None, found: str) -> Defect:
    return Defect(kind=kind, path=file.place, line=line, detail=f"expected PEM blocks X509 CRL alone, {found}")


def read_revocation_list(block: Block, path: str) -> RevocationList | Problem:
    """Read an `X509 CRL` block of any file, or say what is there instead. Never raises."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # odd names and numbers are evidence, no news for stderr
            return _parsed(x509.load_der_x509_crl(block.der or b""), block.line, path)
    except MALFORMED:
        return Problem(line=block.line, detail="bytes that are no revocation list (RFC 5280, 5.1)")


def _parsed(parsed: x509.CertificateRevocationList, line: int, path: str) -> RevocationList:
    """Look at every part, so that whatever is malformed raises here and not in a rule."""
    issuer = parsed.issuer  # the library reads it again each time, and warns each time
    critical = set(unknown_critical(parsed.extensions, _PROCESSED))
    entries: dict[int, bool] = {}  # by serial number; of several entries the first decides (x_crl.c, def_crl_lookup)
    listed: set[int] = set()
    about_own = True  # an entry's certificateIssuer holds for those behind it too (RFC 5280, 5.3.3), in any list
    for entry in parsed:
        extensions, removed = entry.extensions, False
        if len(extensions):
            critical.update(unknown_critical(extensions, _PROCESSED_IN_ENTRY))
            if (issuers := extension_of(extensions, x509.CertificateIssuer)) is not None:
                about_own = any(same_name(each, issuer) for each in issuers.get_values_for_type(x509.DirectoryName))
            reason = extension_of(extensions, x509.CRLReason)  # one takes off the list again (RFC 5280, 5.3.1)
            removed = reason is not None and reason.reason is x509.ReasonFlags.remove_from_crl
        serial = entry.serial_number
        if not removed:
            listed.add(serial)
        if about_own:
            entries.setdefault(serial, not removed)
    revoked = frozenset(serial for serial, is_revoked in entries.items() if is_revoked)
    signed = parsed.tbs_certlist_bytes
    first, second, third = parts(
        signed, 3
    )  # signature algorithm and issuer, maybe behind the version (RFC 5280, 5.1.2)
    algorithm, issuer_der = (second, third) if first[:1] == b"\x02" else (first, second)
    return RevocationList(
        path=path,
        line=line,
        issuer=written(issuer),
        issuer_name=issuer,
        issuer_der=issuer_der,
        this_update=parsed.last_update_utc,
        next_update=parsed.next_update_utc,
        revoked=revoked,
        passed_over=frozenset(listed - revoked),
        signature_algorithm=signature_algorithm(parsed.signature_algorithm_oid.dotted_string),
        unknown_critical=tuple(sorted(critical)),
        scope=_scope(parsed.extensions),
        delta=extension_of(parsed.extensions, x509.DeltaCRLIndicator) is not None,
        algorithms_agree=parts(parsed.public_bytes(Encoding.DER), 2)[1] == algorithm,
        signed_part=signed,
        parsed=parsed,
    )


def unknown_critical(extensions: x509.Extensions, processed: frozenset[str]) -> tuple[str, ...]:
    """Object identifiers of the critical extensions that are not processed."""
    identifiers = (each.oid.dotted_string for each in extensions if each.critical)
    return tuple(identifier for identifier in identifiers if identifier not in processed)


_SCOPES: Final = (
    ("full_name", "distributionPoint"),
    ("relative_name", "distributionPoint"),
    ("only_contains_user_certs", "onlyContainsUserCerts"),
    ("only_contains_ca_certs", "onlyContainsCACerts"),
    ("only_contains_attribute_certs", "onlyContainsAttributeCerts"),
    ("only_some_reasons", "onlySomeReasons"),
    ("indirect_crl", "indirectCRL"),
)


def _scope(extensions: x509.Extensions) -> frozenset[str]:
    point = extension_of(extensions, x509.IssuingDistributionPoint)
    return frozenset(name for attribute, name in _SCOPES if getattr(point, attribute, None))


def extension_of(extensions: x509.Extensions, kind: type[_Extension]) -> _Extension | None:
    """The extension of this kind, if there is one."""
    return next((each.value for each in extensions if isinstance(each.value, kind)), None)
