"""Digest and signature algorithms of CMS (RFC 3370, 4056, 5754, 8419): which we check, and as what."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat import asn1
from cryptography.hazmat.asn1 import TLV, Explicit
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, padding, rsa
from cryptography.hazmat.primitives.asymmetric.types import PublicKeyTypes
from msgspec import Struct

from keystore_audit.keystore.defect import Kind

DIGESTS: Final[Mapping[str, hashes.HashAlgorithm]] = {
    "md5": hashes.MD5(),  # noqa: S303 - evidence, and a finding
    "sha1": hashes.SHA1(),  # noqa: S303 - evidence, and a finding
    "sha224": hashes.SHA224(),
    "sha256": hashes.SHA256(),
    "sha384": hashes.SHA384(),
    "sha512": hashes.SHA512(),
}
WEAK_DIGESTS: Final = frozenset({"md5", "sha1"})
"""Collisions are known: a document and another with the same signature can be made together."""

_DIGEST_NAMES: Final = {
    "1.2.840.113549.2.5": "md5",
    "1.3.14.3.2.26": "sha1",
    "2.16.840.1.101.3.4.2.4": "sha224",
    "2.16.840.1.101.3.4.2.1": "sha256",
    "2.16.840.1.101.3.4.2.2": "sha384",
    "2.16.840.1.101.3.4.2.3": "sha512",
}
_SIGNATURES: Final[Mapping[str, tuple[str, str | None]]] = {
    # signatureAlgorithm: kind of key and, where it names one, digest (RFC 3370, 5754, 8419).
    "1.2.840.113549.1.1.1": ("RSA", None),
    "1.2.840.113549.1.1.4": ("RSA", "md5"),
    "1.2.840.113549.1.1.5": ("RSA", "sha1"),
    "1.2.840.113549.1.1.14": ("RSA", "sha224"),
    "1.2.840.113549.1.1.11": ("RSA", "sha256"),
    "1.2.840.113549.1.1.12": ("RSA", "sha384"),
    "1.2.840.113549.1.1.13": ("RSA", "sha512"),
    "1.2.840.10045.4.1": ("EC", "sha1"),
    "1.2.840.10045.4.3.1": ("EC", "sha224"),
    "1.2.840.10045.4.3.2": ("EC", "sha256"),
    "1.2.840.10045.4.3.3": ("EC", "sha384"),
    "1.2.840.10045.4.3.4": ("EC", "sha512"),
    "1.3.101.112": ("Ed25519", None),
}
_RSA_PSS: Final = "1.2.840.113549.1.1.10"
_MGF1: Final = "1.2.840.113549.1.1.8"
_NULL: Final = b"\x05"


@asn1.sequence
class _Algorithm:
    identifier: x509.ObjectIdentifier


@asn1.sequence
class _AlgorithmWithParameters:
    identifier: x509.ObjectIdentifier
    parameters: TLV


@asn1.sequence
class _PssParameters:
    digest: Annotated[_AlgorithmWithParameters | None, Explicit(0)]
    mask: Annotated[_AlgorithmWithParameters | None, Explicit(1)]
    salt_length: Annotated[int | None, Explicit(2)]


Problems = tuple[tuple[Kind, str], ...]
"""What is out of order: a kind and a sentence each."""


class Digest(Struct, frozen=True, kw_only=True):
    """A digest algorithm: its name, the dotted identifier of one that we do not know."""

    name: str
    has_parameters: bool
    problems: Problems


class Scheme(Struct, frozen=True, kw_only=True):
    """What a signature algorithm demands: the kind of key (None: we know no such algorithm), padding and digest."""

    family: str | None
    padding: padding.PSS | padding.PKCS1v15 | None
    digest: hashes.HashAlgorithm | None
    problems: Problems

    def made_by(self, key: PublicKeyTypes, signature: bytes, data: bytes) -> bool | None:
        """Whether `key` made `signature` over `data`; None where that cannot be checked here."""
        try:
            if isinstance(key, ec.EllipticCurvePublicKey):
                if self.family != "EC" or self.digest is None:
                    return None
                key.verify(signature, data, ec.ECDSA(self.digest))
            elif isinstance(key, rsa.RSAPublicKey):
                if self.padding is None or self.digest is None:
                    return None
                key.verify(signature, data, self.padding, self.digest)
            elif isinstance(key, ed25519.Ed25519PublicKey) and self.family == "Ed25519":
                key.verify(signature, data)
            else:
                return None
        except InvalidSignature:
            return False
        except (UnsupportedAlgorithm, ValueError):  # a digest or curve that this build lacks, odd PSS parameters
            return None
        return True


@lru_cache(maxsize=64)  # a keystore has two or three; bounded, since a hostile one may have any number
def read_digest(der: bytes) -> Digest:
    """Read the AlgorithmIdentifier of a digest; raise ValueError if it is none."""
    identifier, parameters = _read(der)
    name = _DIGEST_NAMES.get(identifier, identifier)
    problems = []
    if parameters is not None:
        problems.append((Kind.CMS_MALFORMED, f"the digest algorithm {name} has parameters"))
    if name in WEAK_DIGESTS:
        problems.append((Kind.WEAK_DIGEST, f"signed over a digest by {name}, for which collisions are known"))
    elif name not in DIGESTS:
        problems.append((Kind.UNSUPPORTED_ALGORITHM, f"signed over a digest by {name}, which is not checked here"))
    return Digest(name=name, has_parameters=parameters is not None, problems=tuple(problems))


@lru_cache(maxsize=64)
def read_scheme(der: bytes, digest: str) -> Scheme:
    """Read the AlgorithmIdentifier of a signature over `digest`; raise ValueError if it is none.

    OpenSSL ignores it and goes by key and digest, so one that contradicts them is a problem, no refusal.
    """
    identifier, parameters = _read(der)
    if identifier == _RSA_PSS:
        # PKCS7_verify takes every signature by an RSA key for PKCS#1 v1.5 (measured, OpenSSL 3.0.19).
        unverified = "an RSA-PSS signature, which the PKCS#7 reader of OpenSSL does not verify"
        return _scheme("RSA", digest, _pss(parameters, digest), (Kind.UNSUPPORTED_ALGORITHM, unverified))
    if identifier not in _SIGNATURES:
        return _scheme(
            None, digest, None, (Kind.UNSUPPORTED_ALGORITHM, f"signature algorithm {identifier} is not checked here")
        )
    family, named = _SIGNATURES[identifier]
    problems = []
    if parameters is not None:
        problems.append((Kind.CMS_MALFORMED, f"the signature algorithm {identifier} has parameters"))
    if named is not None and named != digest:
        detail = f"the signature algorithm {identifier} means {named}, the digest algorithm is {digest}"
        problems.append((Kind.CMS_MALFORMED, detail))
    if family == "Ed25519":  # EVP_VerifyFinal, which PKCS7_verify calls, has no Ed25519
        unverified = "an Ed25519 signature, which the PKCS#7 reader of OpenSSL does not verify"
        problems.append((Kind.UNSUPPORTED_ALGORITHM, unverified))
    return _scheme(family, digest, padding.PKCS1v15() if family == "RSA" else None, *problems)


def _scheme(
    family: str | None, digest: str, rsa_padding: padding.PSS | padding.PKCS1v15 | None, *problems: tuple[Kind, str]
) -> Scheme:
    return Scheme(family=family, padding=rsa_padding, digest=DIGESTS.get(digest), problems=problems)


def _read(der: bytes) -> tuple[str, TLV | None]:
    """Identifier and parameters of an AlgorithmIdentifier; None for absent ones and NULL, which say the same."""
    try:
        return asn1.decode_der(_Algorithm, der).identifier.dotted_string, None
    except ValueError:  # it has parameters, which cannot be declared optional: see cms.py
        algorithm = asn1.decode_der(_AlgorithmWithParameters, der)
    parameters = algorithm.parameters
    absent = parameters.tag_bytes == _NULL and not bytes(parameters.data)
    return algorithm.identifier.dotted_string, None if absent else parameters


def _pss(parameters: TLV | None, digest: str) -> padding.PSS | None:
    """Read RSASSA-PSS-params (RFC 4055, 3.1); None where the digests differ, are implied or the mask is not MGF1."""
    if parameters is None:
        return None
    try:
        pss = parameters.parse(_PssParameters)
        if pss.digest is None or pss.mask is None or pss.salt_length is None:
            return None  # the implied digest is SHA-1
        mask_digest = pss.mask.parameters.parse(_AlgorithmWithParameters)
    except ValueError:
        return None
    named = {_DIGEST_NAMES.get(algorithm.identifier.dotted_string) for algorithm in (pss.digest, mask_digest)}
    if pss.mask.identifier.dotted_string != _MGF1 or named != {digest}:
        return None
    return padding.PSS(mgf=padding.MGF1(DIGESTS[digest]), salt_length=pss.salt_length)
