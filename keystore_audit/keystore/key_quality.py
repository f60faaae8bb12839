"""Which public keys of a run give their private ones away, by themselves, beside each other or by what they signed.

The numbers are in `weak_numbers`. What is compared here comes from one keystore, from both sides of a comparison, or
from all keystores of a fleet.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Final

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.asymmetric.utils import Prehashed, decode_dss_signature, encode_dss_signature
from msgspec import Struct

from keystore_audit.keystore import weak_numbers
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.crl import RevocationList
from keystore_audit.keystore.keystore import Keystore, every_certificate
from keystore_audit.keystore.smime import SignedDocument

LEAST_EXPONENT: Final = 65537

MAX_VERIFIED: Final = 10_000
"""Verifications for signatures that share r, a second: beyond it is open whether one key made them."""

_DIGESTS: Final[dict[int, hashes.HashAlgorithm]] = {
    # By size: of what was hashed already, nothing else counts.
    20: hashes.SHA1(),  # noqa: S303 - evidence
    28: hashes.SHA224(),
    32: hashes.SHA256(),
    48: hashes.SHA384(),
    64: hashes.SHA512(),
}


class Place(Struct, frozen=True, kw_only=True):
    """Where a key or signature stands; `root`: the keystore, as the user gave it."""

    root: str
    path: str
    line: int | None


class PublicKey(Struct, frozen=True, kw_only=True):
    """A public key: `key` as `Certificate.key`; a modulus and an exponent, or a curve's name and two coordinates."""

    key: str
    curve: str
    numbers: tuple[int, int]
    place: Place


class Signed(Struct, frozen=True, kw_only=True):
    """An ECDSA signature over what has the digest `hashed`; whether anybody's key made it is not said."""

    r: int
    s: int
    hashed: bytes
    place: Place


class Material(Struct, frozen=True, kw_only=True):
    """Public keys and ECDSA signatures, each once: the same key in several certificates, the same signature copied."""

    keys: tuple[PublicKey, ...] = ()
    signed: tuple[Signed, ...] = ()

    def __add__(self, other: Material) -> Material:
        """Both, what stands in either."""
        return Material(keys=self.keys + other.keys, signed=self.signed + other.signed)


class Weakness(Struct, frozen=True, kw_only=True):
    """A fact of one key, or of several: what makes them weak, in words behind "The key", and where they stand."""

    fact: str
    keys: tuple[str, ...]
    places: tuple[Place, ...]
    undecided: bool = False


def material_of(
    root: str,
    certificates: Iterable[Certificate],
    documents: Iterable[SignedDocument],
    lists: Iterable[RevocationList] = (),
) -> Material:
    """The keys and signatures in these, at the first place of each."""
    keys: dict[str, PublicKey] = {}
    signed: dict[tuple[int, int, bytes], Signed] = {}

    def take(value: bytes, hashed: bytes, path: str, line: int | None) -> None:
        try:
            r, s = decode_dss_signature(value)
        except ValueError:  # of RSA, say
            return
        if hashed:
            place = Place(root=root, path=path, line=line)
            signed.setdefault((r, s, hashed), Signed(r=r, s=s, hashed=hashed, place=place))

    seen: set[str] = set()
    for certificate in certificates:
        if certificate.sha256 in seen:
            continue
        seen.add(certificate.sha256)
        if certificate.key not in keys and (public := _public(certificate, root)) is not None:
            keys[certificate.key] = public
        parsed = certificate.parsed
        take(parsed.signature, _digest(parsed, parsed.tbs_certificate_bytes), certificate.path, certificate.line)
    for crl in lists:
        take(crl.parsed.signature, _digest(crl.parsed, crl.signed_part), crl.path, crl.line)
    for document in documents:
        for signature in document.signatures:
            take(signature.value, signature.hashed, document.file.place, None)
    return Material(keys=tuple(keys.values()), signed=tuple(signed.values()))


def material_of_keystore(keystore: Keystore) -> Material:
    """All that was read of it: in files of their own, inside messages, beside the enclaves."""
    certificates = every_certificate(keystore.enclaves, keystore.authorities, keystore.unmanaged)
    beside = (*keystore.identities.keyless, *(each.certificate for each in keystore.identities.found))
    documents = [each.signed for own in keystore.enclaves for each in (own.governance, own.permissions) if each]
    documents += [each.document.signed for each in keystore.unmanaged if each.document is not None]
    files = (
        file for enclave in keystore.enclaves for file in (enclave.identity_ca, enclave.permissions_ca, enclave.crl)
    )
    lists = (crl for file in dict.fromkeys(files) if file is not None for crl in file.revocation_lists)
    return material_of(keystore.root, (*certificates, *beside), documents, lists)


@cache
def published_keys() -> frozenset[str]:
    """SHA-256 of keys whose private halves anybody can have: those of our samples (tools/published_keys.py)."""
    return frozenset(Path(__file__).with_name("published_keys.txt").read_text("ascii").split())


def _digest(parsed: object, content: bytes) -> bytes:
    try:
        algorithm: hashes.HashAlgorithm | None = parsed.signature_hash_algorithm  # type: ignore[attr-defined]
        if algorithm is None:
            return b""
        hashing = hashes.Hash(algorithm)
    except UnsupportedAlgorithm:
        return b""
    hashing.update(content)
    return hashing.finalize()


def _public(certificate: Certificate, root: str) -> PublicKey | None:
    """Its key; None for kinds that nothing is looked for in."""
    try:
        key = certificate.parsed.public_key()
    except (ValueError, UnsupportedAlgorithm):
        return None
    place = Place(root=root, path=certificate.path, line=certificate.line)
    if isinstance(key, rsa.RSAPublicKey):
        modulus = key.public_numbers()
        return PublicKey(key=certificate.key, curve="", numbers=(modulus.n, modulus.e), place=place)
    if isinstance(key, ec.EllipticCurvePublicKey):
        point = key.public_numbers()
        return PublicKey(key=certificate.key, curve=key.curve.name, numbers=(point.x, point.y), place=place)
    return None


def weaknesses(material: Material) -> Iterator[Weakness]:
    """All that is wrong with the keys. The same key in two keystores counts once."""
    keys = list({each.key: each for each in reversed(material.keys)}.values())
    points: defaultdict[str, dict[tuple[int, int], PublicKey]] = defaultdict(dict)
    for each in keys:
        if each.curve:
            points[each.curve][each.numbers] = each
        else:
            yield from _of_rsa(each)
    for curve, found in points.items():
        small = weak_numbers.small_points(_CURVES[curve]) if curve in _CURVES else frozenset()
        for point in sorted(found):
            if point[0] in small:
                near = f"has a private scalar within {weak_numbers.SMALL_SCALAR} of zero: anybody can find it"
                yield _of(near, [found[point]])
    for group in related_keys(keys):
        both = (
            "is the negative of another of this run: one private key gives both"
            if group[0].curve
            else "is RSA and shares a prime factor with another of this run: anybody can compute both"
        )
        yield _of(both, group)
    yield from _repeated(keys, material.signed)


def related_keys(keys: Iterable[PublicKey]) -> Iterator[list[PublicKey]]:
    """Different keys that tell of each other: moduli with a common factor, points that are negatives."""
    moduli: defaultdict[int, list[PublicKey]] = defaultdict(list)
    by_x: defaultdict[tuple[str, int], dict[int, PublicKey]] = defaultdict(dict)
    for each in keys:
        if each.curve:
            by_x[each.curve, each.numbers[0]].setdefault(each.numbers[1], each)
        else:
            moduli[each.numbers[0]].append(each)
    for group in weak_numbers.with_common_factors(moduli):
        yield [key for modulus in group for key in moduli[modulus]]
    yield from (list(alike.values()) for alike in by_x.values() if len(alike) > 1)


def _of(fact: str, keys: Sequence[PublicKey]) -> Weakness:
    return Weakness(fact=fact, keys=tuple(each.key for each in keys), places=tuple(each.place for each in keys))


def _of_rsa(each: PublicKey) -> Iterator[Weakness]:
    modulus, exponent = each.numbers
    if exponent < LEAST_EXPONENT:
        yield _of(f"is RSA with the exponent {exponent}, expected {LEAST_EXPONENT} or more", [each])
    if weak_numbers.has_small_factor(modulus):
        yield _of(f"is RSA, and a prime below {weak_numbers.SMALL_FACTOR:,} divides its modulus", [each])
    elif weak_numbers.has_close_primes(modulus):
        yield _of("is RSA of two primes so close to each other that Fermat's method finds them", [each])
    if weak_numbers.has_roca_fingerprint(modulus):
        yield _of("is RSA with the fingerprint of Infineon's faulty library (ROCA, CVE-2017-15361)", [each])


def shared_nonces(signed: Iterable[Signed]) -> list[list[Signed]]:
    """Signatures over different content that have r in common, which one key should never make."""
    by_r: defaultdict[int, dict[bytes, Signed]] = defaultdict(dict)
    for each in signed:
        by_r[each.r].setdefault(each.hashed, each)
    return [list(found.values()) for found in by_r.values() if len(found) > 1]


def _repeated(keys: Sequence[PublicKey], signed: Iterable[Signed]) -> Iterator[Weakness]:
    """Those of them that one key made. That key is tried first on what follows: a signer that repeats goes on so."""
    groups = shared_nonces(signed)
    curves = {name for name in (each.curve for each in keys) if name} if groups else set()
    tried = [each for each in keys if each.curve in curves]
    left = MAX_VERIFIED
    for group in groups:
        made: defaultdict[str, list[Signed]] = defaultdict(list)
        for each in group:
            for number, key in enumerate(tried):
                left -= 1
                if left < 0:
                    fact = "that made these signatures, which share r, is not known: there are too many to try"
                    yield Weakness(fact=fact, keys=(), places=tuple(each.place for each in group), undecided=True)
                    return
                if _made(key, each):
                    made[key.key].append(each)
                    tried.insert(0, tried.pop(number))
                    break
        for key_id, by_one in made.items():
            if len(by_one) > 1:
                fact = "made ECDSA signatures over different content with one nonce: anybody can compute it from them"
                yield Weakness(fact=fact, keys=(key_id,), places=tuple(each.place for each in by_one))


def _made(key: PublicKey, signed: Signed) -> bool:
    digest = _DIGESTS.get(len(signed.hashed))
    curve = _CURVES.get(key.curve)
    if digest is None or curve is None:
        return False
    try:
        public = ec.EllipticCurvePublicNumbers(*key.numbers, curve()).public_key()
        public.verify(encode_dss_signature(signed.r, signed.s), signed.hashed, ec.ECDSA(Prehashed(digest)))
    except (InvalidSignature, UnsupportedAlgorithm, ValueError):
        return False
    return True


_CURVES: Final = {
    curve.name: curve
    for curve in (
        *(ec.SECP224R1, ec.SECP256R1, ec.SECP384R1, ec.SECP521R1, ec.SECP256K1),
        *(ec.BrainpoolP256R1, ec.BrainpoolP384R1, ec.BrainpoolP512R1),
    )
}
