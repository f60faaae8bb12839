"""Certificates, as regular or as irregular as a story needs them, the same bytes at every build."""

from __future__ import annotations

import hashlib
from datetime import datetime, timezone
from functools import cache

from asn1crypto import x509  # type: ignore[import-untyped]
from asn1crypto.algos import SignedDigestAlgorithm  # type: ignore[import-untyped]
from asn1crypto.core import OctetBitString, OctetString  # type: ignore[import-untyped]
from asn1crypto.keys import PublicKeyInfo  # type: ignore[import-untyped]
from asn1crypto.pem import armor  # type: ignore[import-untyped]
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from msgspec import Struct

from .keys import Key


def day(year: int, month: int, day: int) -> datetime:
    """Its first instant, UTC."""
    return datetime(year, month, day, tzinfo=timezone.utc)


START = day(2020, 1, 1)
END = day(2100, 1, 1)

_LAST_UTC_TIME = day(2050, 1, 1)
"""RFC 5280, 4.1.2.5: UTCTime through 2049, GeneralizedTime from then on."""

DIGESTS: dict[str, hashes.HashAlgorithm] = {
    "sha1": hashes.SHA1(),
    "sha256": hashes.SHA256(),
    "sha384": hashes.SHA384(),
    "sha3_256": hashes.SHA3_256(),
}


class Certificate(Struct, frozen=True, kw_only=True):
    """A certificate to be issued. The defaults are those of an identity that sros2 issues.

    `subject` is the common name (empty: none), `also` further (type, value) pairs. `issuer` None: self-signed.
    `signed_by`: the key that really signs, where that is not the issuer's. `ca`: BasicConstraints' cA, None
    for no such extension. `serial` None: 20 octets derived from the content.
    """

    key: Key
    subject: str
    also: tuple[tuple[str, str], ...] = ()
    issuer: Certificate | None = None
    signed_by: Key | None = None
    not_before: datetime = START
    not_after: datetime = END
    ca: bool | None = False
    path_length: int | None = None
    key_usage: frozenset[str] = frozenset()
    unknown_critical_extension: str | None = None
    host: str | None = None
    """A DNS name that it is for (subject alternative name)."""
    serial: int | None = None
    digest: str = "sha256"

    def name(self) -> x509.Name:
        """The subject."""
        pairs = (*((("common_name", self.subject),) if self.subject else ()), *self.also)
        # Lists of pairs, not a dict: the order of a name is part of it.
        sets = [
            x509.RelativeDistinguishedName([x509.NameTypeAndValue({"type": kind, "value": _utf8(value)})])
            for kind, value in pairs
        ]
        return x509.Name(name="", value=x509.RDNSequence(sets))

    def serial_number(self) -> int:
        """Positive and of at most 20 octets (RFC 5280, 4.1.2.2) unless a story says otherwise."""
        if self.serial is not None:
            return self.serial
        issuer = self.issuer or self
        dates = f"{self.not_before} {self.not_after}"
        text = f"serial {self.key.label} {self.subject} {issuer.key.label} {dates}"
        return int.from_bytes(hashlib.sha256(text.encode()).digest()[:20], "big") >> 1

    def der(self) -> bytes:
        """The certificate in DER."""
        return _issued(self)

    def pem(self) -> bytes:
        """The certificate in PEM."""
        return bytes(armor("CERTIFICATE", self.der()))


def sign(key: Key, data: bytes, digest: str = "sha256") -> bytes:
    """ECDSA with the nonce of RFC 6979: the same input gives the same signature."""
    return key.private().sign(data, ec.ECDSA(DIGESTS[digest], deterministic_signing=True))


@cache
def _issued(certificate: Certificate) -> bytes:
    issuer = certificate.issuer or certificate
    signer = certificate.signed_by or issuer.key
    algorithm = SignedDigestAlgorithm({"algorithm": f"{certificate.digest}_ecdsa"})
    tbs = x509.TbsCertificate(
        {
            "version": "v3",
            "serial_number": certificate.serial_number(),
            "signature": algorithm,
            "issuer": issuer.name(),
            "validity": {"not_before": _time(certificate.not_before), "not_after": _time(certificate.not_after)},
            "subject": certificate.name(),
            "subject_public_key_info": PublicKeyInfo.load(certificate.key.public_der()),
            "extensions": _extensions(certificate) or None,
        }
    )
    signature = sign(signer, tbs.dump(), certificate.digest)
    whole = x509.Certificate(
        {
            "tbs_certificate": tbs,
            "signature_algorithm": algorithm,
            "signature_value": OctetBitString(signature),
        }
    )
    return bytes(whole.dump())


def _extensions(certificate: Certificate) -> list[x509.Extension]:
    found = []
    if certificate.ca is not None:
        constraints: dict[str, object] = {"ca": certificate.ca}
        if certificate.path_length is not None:
            constraints["path_len_constraint"] = certificate.path_length
        found.append(_extension("basic_constraints", x509.BasicConstraints(constraints), critical=certificate.ca))
    if certificate.key_usage:
        found.append(_extension("key_usage", x509.KeyUsage(set(certificate.key_usage)), critical=True))
    if certificate.host is not None:
        names = x509.GeneralNames([x509.GeneralName(name="dns_name", value=certificate.host)])
        found.append(_extension("subject_alt_name", names, critical=False))
    if certificate.unknown_critical_extension is not None:
        found.append(_extension(certificate.unknown_critical_extension, OctetString(b"sample").dump(), critical=True))
    return found


def _extension(kind: str, value: object, *, critical: bool) -> x509.Extension:
    return x509.Extension({"extn_id": kind, "critical": critical, "extn_value": value})


def _time(instant: datetime) -> x509.Time:
    return x509.Time({"utc_time": instant} if instant < _LAST_UTC_TIME else {"general_time": instant})


def _utf8(value: str) -> x509.DirectoryString:
    return x509.DirectoryString(name="utf8_string", value=x509.UTF8String(value))
