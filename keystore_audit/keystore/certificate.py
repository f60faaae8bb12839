"""X.509 certificates as evidence."""

from __future__ import annotations

import hashlib
import warnings
from datetime import datetime
from typing import Final, TypeGuard

from cryptography import x509
from msgspec import Struct

from keystore_audit.keystore import public_key
from keystore_audit.keystore.attribute_types import written
from keystore_audit.keystore.crl import (
    REVOCATION_LIST_LABEL,
    RevocationList,
    extension_of,
    read_revocation_list,
    unknown_critical,
)
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.der import MALFORMED, parts, well_formed_throughout
from keystore_audit.keystore.files import File
from keystore_audit.keystore.pem import BEGIN_CERTIFICATES, DUMP_OF_CERTIFICATE, Block, Pem, Problem, read_pem

MAX_CERTIFICATE_BYTES: Final = 64 * 1024
"""Longest certificate that is parsed: one of sros2 has 400 bytes, one with a 16,384-bit RSA key has 5,000."""

IN_DER: Final = "a certificate in DER"
"""What is found in a file that openssl can put into PEM."""

_PROCESSED: Final = frozenset(
    # Critical extensions that `openssl verify` 3.0 takes as understood (measured in test_certificate.py);
    # a proxyCertInfo is understood and then refused, so it is not among them.
    {
        "2.5.29.15",  # keyUsage
        "2.5.29.17",  # subjectAltName
        "2.5.29.19",  # basicConstraints
        "2.5.29.30",  # nameConstraints
        "2.5.29.31",  # cRLDistributionPoints
        "2.5.29.32",  # certificatePolicies
        "2.5.29.33",  # policyMappings
        "2.5.29.36",  # policyConstraints
        "2.5.29.37",  # extKeyUsage
        "2.5.29.54",  # inhibitAnyPolicy
        "1.3.6.1.5.5.7.1.7",  # id-pe-ipAddrBlocks
        "1.3.6.1.5.5.7.1.8",  # id-pe-autonomousSysIds
        "1.3.6.1.5.5.7.48.1.5",  # id-pkix-ocsp-nocheck
        "2.16.840.1.113730.1.1",  # Netscape certificate type
    }
)
NARROWING: Final = frozenset(
    # nameConstraints, policyMappings, policyConstraints, inhibitAnyPolicy, ipAddrBlocks, autonomousSysIds.
    {"2.5.29.30", "2.5.29.33", "2.5.29.36", "2.5.29.54", "1.3.6.1.5.5.7.1.7", "1.3.6.1.5.5.7.1.8"}
)
"""Extensions for which a verifier refuses paths that it takes without them, and takes no other (RFC 5280, 6.1)."""

_CONSTRAINTS: Final = NARROWING | {"1.3.6.1.5.5.7.1.14"}
"""And proxyCertInfo: no sros2 certificate has one of these."""


_NETSCAPE_TYPE: Final = x509.ObjectIdentifier("2.16.840.1.113730.1.1")

_KEY_USAGES: Final = (
    ("digital_signature", "digitalSignature"),
    ("content_commitment", "nonRepudiation"),
    ("key_encipherment", "keyEncipherment"),
    ("data_encipherment", "dataEncipherment"),
    ("key_agreement", "keyAgreement"),
    ("key_cert_sign", "keyCertSign"),
    ("crl_sign", "cRLSign"),
)


class Certificate(Struct, frozen=True, kw_only=True, eq=False):
    """One certificate of a PEM file (RFC 7468), found at `line` of `path`; `sha256` says whether two are the same.

    `subject` and `issuer` are RFC 4514 strings as untrusted text, `issuer_der`/`subject_der` the DER names
    that a CMS signer identifier is compared with. `key` identifies the public key: SHA-256 of its
    SubjectPublicKeyInfo, hexadecimal. Dates are aware UTC.
    """

    path: str
    line: int
    sha256: str
    subject: str
    issuer: str
    subject_name: x509.Name
    issuer_name: x509.Name
    subject_der: bytes
    issuer_der: bytes
    serial: int
    not_before: datetime
    not_after: datetime
    key: str
    key_kind: str
    """`EC secp256r1`, `RSA 2048`, `Ed25519`, …"""
    signature_algorithm: str
    """As OpenSSL names it: `ecdsa-with-SHA256`, `sha256WithRSAEncryption`, …"""
    is_ca: bool | None
    """BasicConstraints CA, None where the extension is absent."""
    path_length: int | None
    key_usage: frozenset[str] | None
    """RFC 5280 names (`digitalSignature`, `keyCertSign`, …), None where the extension is absent."""
    extended_key_usage: frozenset[str] | None
    """Dotted object identifiers, None where the extension is absent."""
    unknown_critical: tuple[str, ...]
    """Object identifiers of critical extensions that X.509 verifiers do not process (RFC 5280 4.2)."""
    constraints: tuple[str, ...]
    """Object identifiers of extensions, critical or not, whose consequences are not worked out here. These constrain
    names, policies and resources, or OpenSSL calls their content invalid."""
    algorithms_agree: bool
    """Whether both statements of the signature algorithm are the same bytes (RFC 5280, 4.1.1.2)."""
    parsed: x509.Certificate


class CertificateFile(Struct, frozen=True, kw_only=True, eq=False):
    """A file of certificates in file order, with revocation lists that stand in it (Fast DDS reads both).

    Compared by identity, as all files: one that several enclaves share is read once.
    """

    file: File
    certificates: tuple[Certificate, ...]
    revocation_lists: tuple[RevocationList, ...]
    defects: tuple[Defect, ...]

    @property
    def first(self) -> Certificate | None:
        """The certificate that every run time reads."""
        return self.certificates[0] if self.certificates else None


def read_certificates(file: File) -> CertificateFile:
    """Read a PEM file of certificates; what cannot be read, and whatever else stands in it, is a defect.

    Never raises. Several certificates are no defect as such. Where the first one cannot be read, the others
    are not handed out: `first` must not be another one than a run time's.
    """
    certificates: list[Certificate] = []
    revocation_lists: list[RevocationList] = []
    defects: list[Defect] = []
    pem = read_pem(file.content if file.content is not None else b"")
    for part in pem.parts:
        read = _read(part, file.place)
        if isinstance(read, Certificate):
            certificates.append(read)
        elif isinstance(read, RevocationList):
            revocation_lists.append(read)
        else:
            defects.append(read)
            if not certificates and read.kind is Kind.CERTIFICATE_UNREADABLE:
                break
    for text in pem.texts:
        if certificates and not text.is_dump(DUMP_OF_CERTIFICATE):
            extra = "expected certificates alone, found other text"
            defects.append(_defect(file.place, Kind.CERTIFICATE_FILE_EXTRA, text.line, extra))
    unreadable = any(defect.kind is Kind.CERTIFICATE_UNREADABLE for defect in defects)
    if file.content is not None and not certificates and not unreadable:
        nothing = f"expected a PEM block CERTIFICATE, found {_instead(file.content, pem)}"
        defects.append(_defect(file.place, Kind.CERTIFICATE_UNREADABLE, None, nothing))
    return CertificateFile(
        file=file,
        certificates=tuple(certificates),
        revocation_lists=tuple(revocation_lists),
        defects=tuple(defects),
    )


def _instead(content: bytes, pem: Pem) -> str:
    """What stands in a file without a block of a certificate."""
    if isinstance(read_certificate(content, 1, ""), Certificate):
        return IN_DER
    other = next((part for part in pem.parts if isinstance(part, Block)), None)
    if other is not None:
        return _block(other)
    return "none" if content.strip() else "nothing"


def _block(part: Block) -> str:
    what = "a private key" if part.is_private_key else "a block"
    return f"{what} ({part.label})"


def _read(part: Block | Problem, path: str) -> Certificate | RevocationList | Defect:
    if isinstance(part, Problem):
        found = f"expected a certificate, found {part.detail}"
        return _defect(path, Kind.CERTIFICATE_UNREADABLE, part.line, found)
    if part.label == REVOCATION_LIST_LABEL:
        read = read_revocation_list(part, path)
        if isinstance(read, RevocationList):
            return read
        found = f"expected a revocation list, found {read.detail}"
        return _defect(path, Kind.CRL_UNREADABLE, read.line, found)
    if part.label == "TRUSTED CERTIFICATE":
        trusted = "expected CERTIFICATE, found TRUSTED CERTIFICATE, OpenSSL's own form that not all readers take"
        return _defect(path, Kind.CERTIFICATE_UNREADABLE, part.line, trusted)
    if part.label not in BEGIN_CERTIFICATES or part.der is None:
        extra = f"expected certificates alone, found {_block(part)}"
        return _defect(path, Kind.CERTIFICATE_FILE_EXTRA, part.line, extra)
    return read_certificate(part.der, part.line, path)


def read_certificate(der: bytes, line: int, path: str) -> Certificate | Defect:
    """Read one certificate, which stands at `line` of the file at `path`. Never raises."""
    if len(der) > MAX_CERTIFICATE_BYTES:
        long = f"a certificate of {len(der)} bytes, more than the limit of {MAX_CERTIFICATE_BYTES}"
        return _defect(path, Kind.CERTIFICATE_UNREADABLE, line, long)
    try:
        with warnings.catch_warnings():
            # A serial number that is not positive warns, and so does a name of no or more than 64 characters. Both are
            # evidence and no news for stderr.
            warnings.simplefilter("ignore", UserWarning)
            return _evidence(x509.load_der_x509_certificate(der), der, line, path)
    except MALFORMED:
        malformed = "expected an X.509 certificate in DER (RFC 5280, 4.1), found a malformed one or other bytes"
        return _defect(path, Kind.CERTIFICATE_UNREADABLE, line, malformed)


def _evidence(parsed: x509.Certificate, der: bytes, line: int, path: str) -> Certificate:
    """Look at every part, so that whatever is malformed raises here and not in a rule."""
    signed = parts(parsed.tbs_certificate_bytes, 7 if parsed.version is x509.Version.v3 else 6)
    signed = signed[1:] if signed[0][:1] == b"\xa0" else signed  # behind the version: RFC 5280, 4.1
    _serial, algorithm, issuer_der, _validity, subject_der, encoded_key = signed[:6]
    subject, issuer = parsed.subject, parsed.issuer  # the library reads them again each time, and warns each time
    key, key_kind = _key(parsed, encoded_key)
    extensions = parsed.extensions
    basic = extension_of(extensions, x509.BasicConstraints)
    usage, extended = extension_of(extensions, x509.KeyUsage), extension_of(extensions, x509.ExtendedKeyUsage)
    return Certificate(
        path=path,
        line=line,
        sha256=hashlib.sha256(der).hexdigest(),
        subject=written(subject),
        issuer=written(issuer),
        subject_name=subject,
        issuer_name=issuer,
        subject_der=subject_der,
        issuer_der=issuer_der,
        serial=parsed.serial_number,
        not_before=parsed.not_valid_before_utc,
        not_after=parsed.not_valid_after_utc,
        key=key,
        key_kind=key_kind,
        signature_algorithm=public_key.signature_algorithm(parsed.signature_algorithm_oid.dotted_string),
        is_ca=None if basic is None else basic.ca,
        path_length=None if basic is None else basic.path_length,
        key_usage=None if usage is None else _usages(usage),
        extended_key_usage=None if extended is None else frozenset(purpose.dotted_string for purpose in extended),
        unknown_critical=unknown_critical(extensions, _PROCESSED),
        constraints=tuple(
            each.oid.dotted_string
            for each in extensions
            if each.oid.dotted_string in _CONSTRAINTS or _is_odd(each.value)
        ),
        algorithms_agree=algorithm == parts(der, 2)[1],
        parsed=parsed,
    )


def _is_odd(value: x509.ExtensionType) -> bool:
    """Whether OpenSSL calls the whole certificate invalid for it, or reads it otherwise (EXFLAG_INVALID; measured)."""
    if isinstance(value, x509.KeyUsage):
        return not _usages(value)
    if isinstance(value, x509.CertificatePolicies):
        named = [policy.policy_identifier for policy in value]
        return len(named) != len(set(named))
    if is_netscape_type(value):
        bits = value.value  # a BIT STRING: tag, length, unused bits, bits
        return len(bits) < 4 or bits[0] != 0x03 or bits[1] != len(bits) - 2
    return False


def is_netscape_type(value: x509.ExtensionType) -> TypeGuard[x509.UnrecognizedExtension]:
    """Whether an extension is the Netscape certificate type, which the library hands out as it stands."""
    return isinstance(value, x509.UnrecognizedExtension) and value.oid == _NETSCAPE_TYPE


def _key(parsed: x509.Certificate, encoded: bytes) -> tuple[str, str]:
    """Return identity and kind of the public key; hash and algorithm if the library does not know it.

    Raises ValueError where OpenSSL refuses the certificate for the parameters of an algorithm that nobody knows.
    """
    key = public_key.public_half(parsed)
    if key is not None:
        return public_key.identity(key), public_key.kind(key)
    if not well_formed_throughout(encoded):
        raise ValueError("a public key that is malformed")
    return hashlib.sha256(encoded).hexdigest(), f"unsupported ({parsed.public_key_algorithm_oid.dotted_string})"


def _usages(usage: x509.KeyUsage) -> frozenset[str]:
    names = {name for attribute, name in _KEY_USAGES if getattr(usage, attribute)}
    if usage.key_agreement:  # the library lets nobody ask otherwise
        names |= {"encipherOnly"} if usage.encipher_only else set()
        names |= {"decipherOnly"} if usage.decipher_only else set()
    return frozenset(names)


def _defect(path: str, kind: Kind, line: int | None, detail: str) -> Defect:
    return Defect(kind=kind, path=path, line=line, detail=detail)
