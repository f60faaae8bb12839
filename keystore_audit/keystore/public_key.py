"""Public keys as evidence: which key, of what kind, and whether it made a signature by which algorithm."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Final, NamedTuple

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat import asn1
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import dsa, ec, ed448, ed25519, padding, rsa, x448, x25519
from cryptography.hazmat.primitives.asymmetric.types import PublicKeyTypes
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
from cryptography.x509.oid import PublicKeyAlgorithmOID

from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.der import SEQUENCE, children
from keystore_audit.truth import Truth

SIGNATURE_ALGORITHMS: Final[Mapping[str, str]] = {
    # OpenSSL's names (crypto/objects/objects.txt), as `openssl x509 -text` prints them.
    "1.2.840.113549.1.1.2": "md2WithRSAEncryption",
    "1.2.840.113549.1.1.4": "md5WithRSAEncryption",
    "1.2.840.113549.1.1.5": "sha1WithRSAEncryption",
    "1.2.840.113549.1.1.10": "rsassaPss",
    "1.2.840.113549.1.1.11": "sha256WithRSAEncryption",
    "1.2.840.113549.1.1.12": "sha384WithRSAEncryption",
    "1.2.840.113549.1.1.13": "sha512WithRSAEncryption",
    "1.2.840.113549.1.1.14": "sha224WithRSAEncryption",
    "1.2.840.10045.4.1": "ecdsa-with-SHA1",
    "1.2.840.10045.4.3.1": "ecdsa-with-SHA224",
    "1.2.840.10045.4.3.2": "ecdsa-with-SHA256",
    "1.2.840.10045.4.3.3": "ecdsa-with-SHA384",
    "1.2.840.10045.4.3.4": "ecdsa-with-SHA512",
    "1.2.840.10040.4.3": "dsaWithSHA1",
    "2.16.840.1.101.3.4.3.1": "dsa_with_SHA224",
    "2.16.840.1.101.3.4.3.2": "dsa_with_SHA256",
    "2.16.840.1.101.3.4.3.9": "ecdsa_with_SHA3-224",
    "2.16.840.1.101.3.4.3.10": "ecdsa_with_SHA3-256",
    "2.16.840.1.101.3.4.3.11": "ecdsa_with_SHA3-384",
    "2.16.840.1.101.3.4.3.12": "ecdsa_with_SHA3-512",
    "2.16.840.1.101.3.4.3.13": "RSA-SHA3-224",
    "2.16.840.1.101.3.4.3.14": "RSA-SHA3-256",
    "2.16.840.1.101.3.4.3.15": "RSA-SHA3-384",
    "2.16.840.1.101.3.4.3.16": "RSA-SHA3-512",
    "1.3.101.112": "ED25519",
    "1.3.101.113": "ED448",
}

_SIGNING_KINDS: Final = {"ecdsa": "EC", "dsa": "DSA", "ed25519": "Ed25519", "ed448": "Ed448"}
"""By the beginning of an algorithm's name the kind of key that makes such signatures; all others are RSA's."""


def is_of_another_kind(algorithm: str, key_kind: str) -> bool:
    """Whether signatures of this algorithm are made by keys of another kind than this one, as `kind` names it."""
    made_by = next((k for name, k in _SIGNING_KINDS.items() if algorithm.lower().startswith(name)), "RSA")
    known = algorithm in SIGNATURE_ALGORITHMS.values() and key_kind.startswith(("RSA", *_SIGNING_KINDS.values()))
    return known and key_kind.partition(" ")[0] != made_by


def signature_algorithm(identifier: str) -> str:
    """Return OpenSSL's name of a signature algorithm, the dotted identifier where we know none."""
    return SIGNATURE_ALGORITHMS.get(identifier, identifier)


MINIMUM_BITS: Final[Mapping[str, int]] = {"RSA": 2048, "DSA": 2048, "EC": 256}
"""NIST SP 800-57 Part 1: 2,048 bits of RSA are the least, and DDS-Security has no curve below 256 bits."""

_WEAK_DIGEST: Final = re.compile(r"(md2|md4|md5|sha1)(?!\d)", re.IGNORECASE)


def is_weak_kind(key_kind: str) -> bool:
    """Whether keys of this kind, as `kind` names it, are shorter than the least."""
    name, _, rest = key_kind.partition(" ")
    digits = re.search(r"\d+", rest)
    return digits is not None and int(digits.group()) < MINIMUM_BITS.get(name, 0)


def is_weak_algorithm(algorithm: str) -> bool:
    """Whether signatures of this algorithm are over SHA-1 or MD5."""
    return _WEAK_DIGEST.search(algorithm) is not None


def identity(key: PublicKeyTypes) -> str:
    """Return the SHA-256 of the key's SubjectPublicKeyInfo, encoded again so that one key has one identity."""
    encoded = key.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    return hashlib.sha256(encoded).hexdigest()


_CURVELESS: Final[dict[type, str]] = {
    ed25519.Ed25519PublicKey: "Ed25519",
    ed448.Ed448PublicKey: "Ed448",
    x25519.X25519PublicKey: "X25519",
    x448.X448PublicKey: "X448",
}


def kind(key: PublicKeyTypes) -> str:
    """Return algorithm and size, as in `EC secp256r1`, `RSA 2048`, `Ed25519`."""
    if isinstance(key, ec.EllipticCurvePublicKey):
        return f"EC {key.curve.name}"
    if isinstance(key, rsa.RSAPublicKey | dsa.DSAPublicKey):
        return f"{'RSA' if isinstance(key, rsa.RSAPublicKey) else 'DSA'} {key.key_size}"
    return next((name for each, name in _CURVELESS.items() if isinstance(key, each)), type(key).__name__)


def public_half(parsed: x509.Certificate) -> PublicKeyTypes | None:
    """The public key in a certificate; None where the library does not know it."""
    try:
        return parsed.public_key()
    except (ValueError, UnsupportedAlgorithm):
        return None


def verifies(
    issuer: x509.Certificate, signed: bytes, parsed: x509.Certificate | x509.CertificateRevocationList
) -> Truth:
    """Whether the key of `issuer` made the signature of a certificate or revocation list over its part `signed`.

    Weak digests included; UNKNOWN where the library cannot tell. One by an algorithm that belongs to another kind of
    key is a signature that this key did not make.
    """
    key, name = public_half(issuer), SIGNATURE_ALGORITHMS.get(parsed.signature_algorithm_oid.dotted_string)
    if name is None or not isinstance(key, _VERIFYING):  # DSA, keys that sign nothing: no run time was measured
        return Truth.UNKNOWN
    if issuer.public_key_algorithm_oid == PublicKeyAlgorithmOID.RSASSA_PSS:  # such a key restricts what it signs
        return Truth.UNKNOWN
    try:
        parameters, digest = parsed.signature_algorithm_parameters, parsed.signature_hash_algorithm
    except (ValueError, UnsupportedAlgorithm):
        return Truth.UNKNOWN
    if is_of_another_kind(name, kind(key)):
        return Truth.NO
    if name.startswith("ecdsa") and "SHA3-" in name:  # OpenSSL 3.0 finds no issuer for ECDSA with SHA-3 (measured)
        return Truth.UNKNOWN
    # The library hands out no parameters where it would not sign itself: MD5, SHA-1.
    scheme = parameters if isinstance(parameters, padding.PSS) else padding.PKCS1v15()
    if name == "rsassaPss" and scheme is not parameters:
        return Truth.UNKNOWN
    return _made(key, parsed.signature, signed, scheme, digest)


def _made(
    key: PublicKeyTypes,
    signature: bytes,
    data: bytes,
    scheme: padding.PSS | padding.PKCS1v15 | None,
    digest: hashes.HashAlgorithm | None,
) -> Truth:
    """Whether `key` made `signature` over `data`, with this padding for RSA; UNKNOWN where that cannot be checked."""
    try:
        if isinstance(key, rsa.RSAPublicKey) and scheme is not None and digest is not None:
            key.verify(signature, data, scheme, digest)
        elif isinstance(key, ec.EllipticCurvePublicKey) and digest is not None:
            key.verify(signature, data, ec.ECDSA(digest))
        elif isinstance(key, ed25519.Ed25519PublicKey | ed448.Ed448PublicKey) and digest is None:
            key.verify(signature, data)
        else:
            return Truth.UNKNOWN
    except InvalidSignature:
        return Truth.NO
    except (UnsupportedAlgorithm, ValueError):  # a digest or curve that this build lacks, odd PSS parameters
        return Truth.UNKNOWN
    return Truth.YES


_VERIFYING: Final = (
    rsa.RSAPublicKey,
    ec.EllipticCurvePublicKey,
    ed25519.Ed25519PublicKey,
    ed448.Ed448PublicKey,
)


# --- algorithms of CMS (RFC 3370, 5754, 8419)

DIGESTS: Final[Mapping[str, hashes.HashAlgorithm]] = {
    "md5": hashes.MD5(),  # noqa: S303 - evidence, and a finding
    "sha1": hashes.SHA1(),  # noqa: S303 - evidence, and a finding
    "sha224": hashes.SHA224(),
    "sha256": hashes.SHA256(),
    "sha384": hashes.SHA384(),
    "sha512": hashes.SHA512(),
}
_DIGEST_NAMES: Final = {
    "1.2.840.113549.2.5": "md5",
    "1.3.14.3.2.26": "sha1",
    "2.16.840.1.101.3.4.2.4": "sha224",
    "2.16.840.1.101.3.4.2.1": "sha256",
    "2.16.840.1.101.3.4.2.2": "sha384",
    "2.16.840.1.101.3.4.2.3": "sha512",
}
_WITH_DIGEST: Final = re.compile(r"(?:ecdsa-with-)?(md5|sha\d+)(WithRSAEncryption)?", re.IGNORECASE)
_ED25519: Final = "1.3.101.112"
_ALONE: Final = {"1.2.840.113549.1.1.1": "RSA", _ED25519: "Ed25519"}
"""Signature algorithms that name no digest."""
_RSA_PSS: Final = "1.2.840.113549.1.1.10"
_NULL: Final = b"\x05\x00"

Problem = tuple[Kind, str]
"""What is out of order: a kind and a sentence."""


class Scheme(NamedTuple):
    """What a signature algorithm demands: the kind of key (None: we know no such algorithm), and the digest.

    `plain`: it does not contradict the digest that is used, and has no parameters.
    """

    family: str | None
    digest: hashes.HashAlgorithm | None
    problems: tuple[Problem, ...] = ()
    plain: bool = True

    def made_by(self, key: PublicKeyTypes, signature: bytes, data: bytes) -> Truth:
        """Whether `key` made `signature` over `data`; UNKNOWN where that cannot be checked here."""
        if self.family is None or not kind(key).startswith(self.family):
            return Truth.UNKNOWN
        return _made(key, signature, data, padding.PKCS1v15(), self.digest)


@lru_cache(maxsize=64)  # a keystore has two or three; bounded, since a hostile one may have any number
def read_digest(der: bytes) -> tuple[str, bool]:
    """The name of a digest, the dotted identifier of one that we do not know, and whether it has parameters.

    Raises ValueError if this is no AlgorithmIdentifier.
    """
    identifier, has_parameters = _read(der)
    return _DIGEST_NAMES.get(identifier, identifier), has_parameters


def digest_problems(name: str) -> tuple[Problem, ...]:
    """What signing over such a digest is worth."""
    if is_weak_algorithm(name):
        return ((Kind.WEAK_DIGEST, f"signed over a digest by {name}, for which collisions are known"),)
    unknown = (Kind.UNSUPPORTED_ALGORITHM, f"signed over a digest by {name}, which is not checked here")
    return () if name in DIGESTS else (unknown,)


@lru_cache(maxsize=64)
def read_scheme(der: bytes, digest: str) -> Scheme:
    """Read the AlgorithmIdentifier of a signature over `digest`; raise ValueError if it is none.

    OpenSSL ignores it and goes by key and digest, so one that contradicts them is a problem, no refusal.
    """
    identifier, has_parameters = _read(der)
    named = _WITH_DIGEST.fullmatch(SIGNATURE_ALGORITHMS.get(identifier, ""))
    family = ("RSA" if named[2] else "EC") if named else _ALONE.get(identifier)
    plain = not has_parameters and (named is None or named[1].lower() == digest)
    unverified = {
        # PKCS7_verify takes every signature by an RSA key for PKCS#1 v1.5 (measured, OpenSSL 3.0.19), and
        # EVP_VerifyFinal, which it calls, has no Ed25519.
        _RSA_PSS: "an RSA-PSS signature, which the PKCS#7 reader of OpenSSL does not verify",
        _ED25519: "an Ed25519 signature, which the PKCS#7 reader of OpenSSL does not verify",
    }.get(identifier, f"signature algorithm {identifier} is not checked here" if family is None else "")
    problems = ((Kind.UNSUPPORTED_ALGORITHM, unverified),) if unverified else ()
    known = None if identifier == _ED25519 or family is None else DIGESTS.get(digest)
    return Scheme(family, known, problems, plain or family is None)


def _read(der: bytes) -> tuple[str, bool]:
    """The identifier of an AlgorithmIdentifier, and whether it has parameters; absent ones and NULL say the same."""
    identifier, *parameters = children(der)
    if der[0] != SEQUENCE:
        raise ValueError("no sequence")
    return asn1.decode_der(x509.ObjectIdentifier, identifier).dotted_string, parameters not in ([], [_NULL])
