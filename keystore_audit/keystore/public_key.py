"""Public keys as evidence: which key, of what kind, and whether it made a signature."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from typing import Final

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import dsa, ec, ed448, ed25519, padding, rsa, x448, x25519
from cryptography.hazmat.primitives.asymmetric.types import PublicKeyTypes
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

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


SignatureParameters = padding.PSS | padding.PKCS1v15 | ec.ECDSA | None
"""What `signature_algorithm_parameters` of a certificate or revocation list returns."""


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
    """Return the SHA-256 of the key's SubjectPublicKeyInfo, encoded anew so that one key has one identity."""
    encoded = key.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    return hashlib.sha256(encoded).hexdigest()


def kind(key: PublicKeyTypes) -> str:
    """Return algorithm and size, as in `EC secp256r1`, `RSA 2048`, `Ed25519`."""
    if isinstance(key, ec.EllipticCurvePublicKey):
        return f"EC {key.curve.name}"
    if isinstance(key, rsa.RSAPublicKey):
        return f"RSA {key.key_size}"
    if isinstance(key, dsa.DSAPublicKey):
        return f"DSA {key.key_size}"
    for kind_of_key, name in (
        (ed25519.Ed25519PublicKey, "Ed25519"),
        (ed448.Ed448PublicKey, "Ed448"),
        (x25519.X25519PublicKey, "X25519"),
        (x448.X448PublicKey, "X448"),
    ):
        if isinstance(key, kind_of_key):
            return name
    return type(key).__name__


def verifies(
    key: PublicKeyTypes,
    signature: bytes,
    data: bytes,
    *,
    algorithm: str,
    parameters: SignatureParameters,
    digest: hashes.HashAlgorithm | None,
) -> bool | None:
    """Whether `key` made `signature` over `data`, weak digests included; None where the library cannot tell.

    `algorithm` is the dotted identifier of the signature algorithm. One that belongs to another kind of key is a
    signature that this key did not make.
    """
    name = SIGNATURE_ALGORITHMS.get(algorithm)
    if name is None:
        return None
    try:
        if isinstance(key, rsa.RSAPublicKey) and "rsa" in name.lower():
            # The library hands out no parameters where it would not sign itself: MD5, SHA-1.
            pkcs1 = padding.PKCS1v15() if name != "rsassaPss" else None
            scheme = parameters if isinstance(parameters, padding.PSS) else pkcs1
            if scheme is None or digest is None:
                return None
            key.verify(signature, data, scheme, digest)
        elif isinstance(key, ec.EllipticCurvePublicKey) and name.startswith("ecdsa"):
            if digest is None or "SHA3-" in name:  # OpenSSL 3.0 finds no issuer for ECDSA with SHA-3 (measured)
                return None
            key.verify(signature, data, ec.ECDSA(digest))
        elif isinstance(key, ed25519.Ed25519PublicKey | ed448.Ed448PublicKey) and name == kind(key).upper():
            key.verify(signature, data)
        elif isinstance(key, _VERIFYING):
            return False
        else:  # DSA, and keys that make no signatures: no run time was measured with them
            return None
    except InvalidSignature:
        return False
    except (UnsupportedAlgorithm, ValueError):  # a digest that OpenSSL was built without, odd PSS parameters
        return None
    return True


_VERIFYING: Final = (
    rsa.RSAPublicKey,
    ec.EllipticCurvePublicKey,
    ed25519.Ed25519PublicKey,
    ed448.Ed448PublicKey,
)
