"""Ways from a signer over authorities of few names and keys, of the CA file and of the message, beside OpenSSL."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID

from keystore_audit.keystore.smime import Candidates, read_signed
from keystore_audit.model.trust.chain import path_refusal
from keystore_audit.model.trust.verdicts import document_verdict, may_sign, signers_taken
from keystore_audit.model.validity import in_force
from keystore_audit.truth import Truth
from tests.keystore.builder import Extension, PrivateKey, Signed, certificate, present, read, signed_document
from tests.oracles.smime.comparison import CHAINED, INSTANT
from tests.oracles.smime.oracle import running

POOLS, MESSAGES = 120, 5
"""Pools of certificates, and messages for each: 600 take ten seconds."""

KEYS = tuple(ec.generate_private_key(ec.SECP256R1()) for _ in range(6))
_DAY = timedelta(days=1)
_LONG: dict[str, Any] = {"start": INSTANT - 900 * _DAY, "end": INSTANT + 900 * _DAY}
_DATES: tuple[dict[str, Any], ...] = (
    *(_LONG,) * 6,
    {"start": INSTANT - 900 * _DAY, "end": INSTANT - _DAY},
    {"start": INSTANT + _DAY, "end": INSTANT + 900 * _DAY},
)


def _authority(rng: random.Random, before: Sequence[Signed]) -> Signed:
    """Perhaps below one of those before, or made anew from it."""
    issuer = rng.choice(before) if before and rng.random() < 0.6 else None
    old = rng.choice(before) if before and rng.random() < 0.4 else None
    key: PrivateKey = old.key if old is not None else rng.choice(KEYS)
    name: Any = old.certificate.subject if old is not None and rng.random() < 0.7 else rng.choice("abc")
    length = rng.choice((None, None, None, 2, 1, 0))
    extensions: list[Extension] = []
    if rng.random() < 0.25:
        extensions.append((x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False))
    if rng.random() < 0.15:
        signing = issuer.key if issuer is not None else key
        extensions.append((x509.AuthorityKeyIdentifier.from_issuer_public_key(signing.public_key()), False))
    elif before and rng.random() < 0.15:
        named = (issuer or rng.choice(before)).certificate
        numbered = x509.AuthorityKeyIdentifier(None, [x509.DirectoryName(named.issuer)], named.serial_number)
        extensions.append((numbered, False))
    if rng.random() < 0.1:
        purpose = rng.choice((ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.EMAIL_PROTECTION))
        extensions.append((x509.ExtendedKeyUsage([purpose]), False))
    return certificate(name, issuer, key=key, ca=True, length=length, extensions=extensions, **rng.choice(_DATES))


def _accepted(message: bytes, authorities: bytes) -> bool:
    """As `model/participants/usability.py` decides at an instant."""
    file = read(authorities)
    document = read_signed(present(message), Candidates(file.certificates))
    if document_verdict(document, file, CHAINED) is not Truth.YES:
        return False
    if any(path_refusal(document, file, CHAINED, at) is not None for at in (None, INSTANT)):
        return False
    signers = signers_taken(document, CHAINED)
    return all(in_force(each, INSTANT) and may_sign(each, document, file, CHAINED, INSTANT) for each in signers)


def test_the_way_that_openssl_takes_decides(oracle: Callable[[str], str], tmp_path: Path) -> None:
    rng = random.Random(20261123)
    seen: Counter[bool] = Counter()
    with running(oracle, tmp_path) as answers:
        for pool in range(POOLS):
            authorities: list[Signed] = []
            for _ in range(rng.choice((3, 4, 5, 6))):
                authorities.append(_authority(rng, authorities))
            leaves = [certificate("/a", rng.choice(authorities), **_LONG) for _ in range(2)]
            for _ in range(MESSAGES):
                pem = b"".join(each.pem for each in rng.sample(authorities, rng.choice((1, 2, 3))))
                brought = rng.sample(authorities, rng.choice((0, 0, 1, 2, 3)))
                message = signed_document(b"<dds></dds>\n", rng.choice((*authorities, *leaves, *leaves)), *brought)
                answers.trust(pem)
                accepted = answers.ask(message).chained is not None
                assert _accepted(message, pem) == accepted, f"pool {pool}:\n{pem.decode()}\n{message.decode()}"
                seen[accepted] += 1
    assert min(seen[True], seen[False]) > 100
