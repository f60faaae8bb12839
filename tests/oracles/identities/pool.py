"""Authorities, identities and revocation lists that fit together in some combinations and in others do not."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import timedelta
from random import Random
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.name import _ASN1Type
from cryptography.x509.oid import NameOID
from msgspec import Struct

from tests.keystore.builder import START, Extension, Signed, certificate, crl, usage


def _subject_key(signed: Signed) -> Extension:
    return x509.SubjectKeyIdentifier.from_public_key(signed.key.public_key()), False


def _authority_key(issuer: Signed) -> Extension:
    return x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer.key.public_key()), False


def _authority(
    subject: str | x509.Name,
    issuer: Signed | None = None,
    *extensions: Extension,
    length: int | None = None,
    **how: Any,
) -> Signed:
    return certificate(subject, issuer, ca=True, length=length, extensions=extensions, **how)


def _printable(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text, _ASN1Type.PrintableString)])


class Pool(Struct, frozen=True):
    """Everything by name; the lists are DER."""

    authorities: dict[str, Signed]
    identities: dict[str, Signed]
    lists: dict[str, bytes]


def pool() -> Pool:
    root = _authority("root")
    short = _authority("short", length=0)
    below = _authority("below", root)
    unknown = x509.UnrecognizedExtension(x509.ObjectIdentifier("1.2.3.4"), b"\x05\x00"), True
    authorities = {
        "root": root,
        "renewed root": _authority("root", key=root.key, serial=7),
        "other root": _authority("root"),
        "next root": _authority("root", start=START + timedelta(days=300), end=START + timedelta(days=5000)),
        "expired root": _authority("root", key=root.key, end=START + timedelta(days=30)),
        "printable root": _authority(_printable("root"), key=root.key),
        "no authority": certificate("root", key=root.key, ca=False),
        "may not sign": _authority("root", None, usage("digital_signature", "crl_sign"), key=root.key),
        "may not revoke": _authority("root", None, usage("key_cert_sign"), key=root.key),
        "may not revoke, expired": _authority(
            "root", None, usage("key_cert_sign"), key=root.key, end=START + timedelta(days=30)
        ),
        "unknown extension": _authority("root", None, unknown, key=root.key),
        "below": below,
        "below below": _authority("below below", below),
        "expired below": _authority("below", root, key=below.key, end=START + timedelta(days=30)),
        "forged below": _authority("below", _authority("root"), key=below.key),
        "old root": certificate("old root", ca=None, extensions=[usage("key_cert_sign", "crl_sign")]),
        "old below": certificate("old below", root, ca=None, extensions=[usage("key_cert_sign", "crl_sign")]),
        "short root": short,
        "below short": _authority("below short", short),
    }
    authorities["below below short"] = _authority("below below short", authorities["below short"])
    # A new key of the root, signed with the old one, as RFC 4210 4.4 has it; with key identifiers and without.
    plain = _authority("root", root)
    marked_key = certificate("root")
    authorities["new with old"] = plain
    authorities["new with old, marked"] = _authority(
        "root", root, _subject_key(marked_key), _authority_key(root), key=marked_key.key
    )
    identities = {f"of {name}": certificate("/talker", issuer) for name, issuer in authorities.items()}
    identities["printable issuer"] = certificate("/talker", root, issuer_name=_printable("ROOT"))
    identities["expired"] = certificate("/talker", root, end=START + timedelta(days=30))
    identities["marked"] = certificate("/talker", root, extensions=[_authority_key(root)])
    identities["marked otherwise"] = certificate("/talker", root, extensions=[_authority_key(below)])
    identities["root itself"] = root
    identities["below itself"] = below
    identities["no authority itself"] = authorities["no authority"]
    identities["new with old itself"] = authorities["new with old"]
    serials = [each.certificate.serial_number for each in identities.values()]
    point = x509.IssuingDistributionPoint(None, None, False, True, None, False, False)
    made = {
        "unknown list extension": crl(root, extensions=[unknown]),
        "of authorities alone": crl(root, extensions=[(point, True)]),
        "empty": crl(root),
        "all of root": crl(root, serials),
        "stale": crl(root, end=START + timedelta(days=30)),
        "not yet": crl(root, days=3000),
        "of below": crl(below, serials[::2]),
        "of next root": crl(authorities["next root"]),
        "of other root": crl(authorities["other root"]),
        "of printable root": crl(authorities["printable root"], serials),
    }
    lists = {name: each.public_bytes(Encoding.DER) for name, each in made.items()}
    return Pool(authorities, identities, lists)


class Combination(Struct, frozen=True):
    """An identity CA file, an identity, and a list or none, by name."""

    authorities: tuple[str, ...]
    identity: str
    revocations: str | None


def combinations(pool: Pool, number: int, seed: int) -> Iterator[Combination]:
    """Each identity under the certificate that issued it, alone and below the root, then random ones."""
    for identity in pool.identities:
        issuer = identity.removeprefix("of ")
        alone = (issuer if issuer in pool.authorities else "root",)
        yield Combination(alone, identity, None)
        if issuer != "root":
            yield Combination(("root", *alone), identity, None)
        yield from (Combination(alone, identity, revocations) for revocations in pool.lists)
    for before in ("may not sign", "no authority", "expired root"):  # not the first, which Fast DDS looks at by itself
        yield Combination(("short root", before, "root"), "of root", None)
    for both in (("root", "other root"), ("other root", "root"), ("expired root", "root"), ("root", "expired root")):
        yield Combination(both, "root itself", None)
    for alone in ("no authority", "new with old"):
        for both in ((alone,), ("short root", alone), (alone, "short root"), ("root", alone)):
            yield Combination(both, f"{alone} itself", None)
    for revocations in ("empty", "of next root"):
        yield Combination(("root", "next root"), "of root", revocations)
        yield Combination(("next root", "root"), "of next root", revocations)
    random = Random(seed)
    for _ in range(number):
        identity = random.choice(list(pool.identities))
        issuer = identity.removeprefix("of ")
        chosen = random.sample(list(pool.authorities), random.choice((1, 1, 2, 2, 3, 4)))
        if issuer in pool.authorities and issuer not in chosen and random.random() < 0.7:
            chosen.insert(random.randrange(len(chosen) + 1), issuer)
        yield Combination(tuple(chosen), identity, random.choice((None, None, *pool.lists)))
