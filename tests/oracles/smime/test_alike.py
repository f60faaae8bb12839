"""Certificates that are easily taken for one another, in any order, in file, message and keystore, beside OpenSSL."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.x509.name import _ASN1Type
from cryptography.x509.oid import NameOID
from msgspec.structs import replace

from keystore_audit.truth import Truth
from tests.keystore.builder import END, Signed, authority, certificate, rsa_key
from tests.keystore.messages import with_signature
from tests.oracles.smime.comparison import compare
from tests.oracles.smime.der import ECDSA_SHA256, NULL, RSA, algorithm, integer, tlv
from tests.oracles.smime.oracle import running
from tests.oracles.smime.signed_data import GOOD, MESSAGE, Info

POOLS, MESSAGES = 100, 4
"""Pools of certificates, and messages for each: 400 take ten seconds."""

KEYS = (*(ec.generate_private_key(ec.SECP256R1()) for _ in range(2)), rsa_key())
NUMBERS = (5, 5, 5, 6)
TYPES = (_ASN1Type.UTF8String, _ASN1Type.PrintableString, _ASN1Type.T61String)


def _name(rng: random.Random) -> x509.Name:
    text = rng.choice(("sros2CA", "sros2CA", "sros2CA", "SROS2CA", "sros2CA ", "other"))
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text, _type=rng.choice(TYPES))])


def _pool(rng: random.Random) -> list[Signed]:
    found = [
        authority(
            _name(rng),
            key=rng.choice(KEYS),
            serial=rng.choice(NUMBERS),
            end=END + timedelta(days=rng.choice((0, 0, 1, 2))),
        )
        for _ in range(rng.choice((1, 2, 3)))
    ]
    for _ in range(rng.choice((0, 1, 2))):
        below = certificate(
            "/a",
            rng.choice(found),
            key=rng.choice(KEYS),
            serial=rng.choice(NUMBERS),
            ca=rng.choice((False, True, None)),
            issuer_name=rng.choice((None, _name(rng))),
        )
        found.append(below)
    return found


def _message(rng: random.Random, pool: Sequence[Signed]) -> bytes:
    brought = [each.der for each in _some(rng, pool)]
    infos = sorted(_info(rng, pool) for _ in range(rng.choice((1, 1, 1, 2))))
    certificates = tlv(0xA0, *brought) if brought else b""
    return with_signature(MESSAGE, replace(GOOD, certificates=certificates, infos=tuple(infos)).der())


def _info(rng: random.Random, pool: Sequence[Signed]) -> bytes:
    signer, named = rng.choice(pool), rng.choice(pool)
    name = (signer if rng.random() < 0.8 else named).certificate
    label = algorithm(RSA, NULL) if isinstance(signer.key, rsa.RSAPrivateKey) else algorithm(ECDSA_SHA256)
    identifier = tlv(0x30, name.issuer.public_bytes(), integer(name.serial_number))
    return Info(signer=signer, label=label, identifier=identifier).der()


def _some(rng: random.Random, pool: Sequence[Signed]) -> list[Signed]:
    return rng.sample(pool, rng.randrange(len(pool) + 1))


def test_whoever_is_taken_for_whom(oracle: Callable[[str], str], tmp_path: Path) -> None:
    rng = random.Random(1)
    seen: Counter[tuple[Truth, Truth]] = Counter()
    with running(oracle, tmp_path) as answers:
        for pool in (_pool(rng) for _ in range(POOLS)):
            for _ in range(MESSAGES):
                trusted, known = _some(rng, pool), _some(rng, pool)
                found = compare(answers, _message(rng, pool), trusted, known)
                assert found.contradictions() == [], (pool, trusted, known, found.document)
                seen[found.pinned, found.chained] += 1
        assert answers.crashes == []
    assert seen[Truth.YES, Truth.YES] > 20, seen
    assert seen[Truth.YES, Truth.NO] > 20, seen
    assert seen[Truth.NO, Truth.YES] > 5, seen
