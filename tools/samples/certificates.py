"""Certificates, as regular or as irregular as a story needs them, the same bytes at every build."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from datetime import datetime, timezone

from asn1crypto import x509
from asn1crypto.algos import SignedDigestAlgorithm
from asn1crypto.core import OctetBitString, OctetString
from asn1crypto.keys import PublicKeyInfo
from asn1crypto.pem import armor
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec

from .keys import Key

START = datetime(2020, 1, 1, tzinfo=timezone.utc)
END = datetime(2100, 1, 1, tzinfo=timezone.utc)

_LAST_UTC_TIME = datetime(2050, 1, 1, tzinfo=timezone.utc)
"""RFC 5280, 4.1.2.5: UTCTime through 2049, GeneralizedTime from then on."""

DIGESTS: dict[str, hashes.HashAlgorithm] = {
    "sha1": hashes.SHA1(),
    "sha256": hashes.SHA256(),
    "sha384": hashes.SHA384(),
    "sha3_256": hashes.SHA3_256(),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Certificate:
    """A certificate to be issued. The defaults are those of an identity that sros2 issues.

    `subject` is the common name, `also` further (type, value) pairs behind it. `issuer` None: self-signed.
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
    serial: int | None = None
    digest: str = "sha256"

    def name(self) -> x509.Name:
        """The subject."""
        pairs = (("common_name", self.subject), *self.also)
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
        issuer = self.issuer or self
        signer = self.signed_by or issuer.key
        algorithm = SignedDigestAlgorithm({"algorithm": f"{self.digest}_ecdsa"})
        tbs = x509.TbsCertificate(
            {
                "version": "v3",
                "serial_number": self.serial_number(),
                "signature": algorithm,
                "issuer": issuer.name(),
                "validity": {"not_before": _time(self.not_before), "not_after": _time(self.not_after)},
                "subject": self.name(),
                "subject_public_key_info": PublicKeyInfo.load(self.key.public_der()),
                "extensions": self._extensions() or None,
            }
        )
        signature = sign(signer, tbs.dump(), self.digest)
        whole = x509.Certificate(
            {
                "tbs_certificate": tbs,
                "signature_algorithm": algorithm,
                "signature_value": OctetBitString(signature),
            }
        )
        return bytes(whole.dump())

    def pem(self) -> bytes:
        """The certificate in PEM."""
        return bytes(armor("CERTIFICATE", self.der()))

    def _extensions(self) -> list[x509.Extension]:
        found = []
        if self.ca is not None:
            constraints: dict[str, object] = {"ca": self.ca}
            if self.path_length is not None:
                constraints["path_len_constraint"] = self.path_length
            found.append(_extension("basic_constraints", x509.BasicConstraints(constraints), critical=self.ca))
        if self.key_usage:
            found.append(_extension("key_usage", x509.KeyUsage(set(self.key_usage)), critical=True))
        if self.unknown_critical_extension is not None:
            found.append(_extension(self.unknown_critical_extension, OctetString(b"sample").dump(), critical=True))
        return found


def sign(key: Key, data: bytes, digest: str = "sha256") -> bytes:
    """ECDSA with the nonce of RFC 6979: the same input gives the same signature."""
    return key.private().sign(data, ec.ECDSA(DIGESTS[digest], deterministic_signing=True))


def _extension(kind: str, value: object, *, critical: bool) -> x509.Extension:
    return x509.Extension({"extn_id": kind, "critical": critical, "extn_value": value})


def _time(instant: datetime) -> x509.Time:
    return x509.Time({"utc_time": instant} if instant < _LAST_UTC_TIME else {"general_time": instant})


def _utf8(value: str) -> x509.DirectoryString:
    return x509.DirectoryString(name="utf8_string", value=x509.UTF8String(value))
