"""Keys, certificates and signed documents that random stores are put together from: made once in a process.

Authorities that are renewed, cross certified, expired or of one name; identities with second certificates of their
keys; documents by everybody who has a key. Nothing is made for one store alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from functools import lru_cache, partial
from random import Random

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    PrivateFormat,
)

from tests.keystore import documents as d
from tests.keystore.builder import Signed, certificate, crl, signed_document
from tests.keystore.chance import Rules
from tests.oracles.vendors import recipe as r

AT = datetime(2026, 11, 23, tzinfo=timezone.utc)
"""The instant at which random stores are asked about."""

NAMES = ("/a", "/b", "/c", "/ns/d", "/ns/d/e")
_LATER = AT + timedelta(days=900)
_EXPIRED = AT - timedelta(days=30)

_EXPRESSIONS = ("rt/a", "rt/b", "rt/*", "*", "rt/[ab]", "r?/a", "rt/[!a]", "rt/c*", "rt/a*", "rq/aRequest")
_PARTITIONS = ("", "p", "p*", "*", "[pq]")
_IDS: tuple[d.Domain, ...] = (0, 0, 0, 1, (0, 1), (1, 5), (0, 230), (1, None), (0, None), (231, 232))
_KINDS = ("NONE", "SIGN", "ENCRYPT", "SIGN_WITH_ORIGIN_AUTHENTICATION", "ENCRYPT_WITH_ORIGIN_AUTHENTICATION")


_ca = partial(certificate, ca=True, length=None)


@lru_cache(maxsize=1)
def authorities() -> dict[str, Signed]:
    """By what they are. `cross`: what one authority certified over the key of another."""
    shared, identity, other = _ca("sros2CA"), _ca("identity CA"), _ca("identity CA")
    permissions, foreign = _ca("permissions CA"), _ca("permissions CA")
    between = _ca("between", identity)
    return {
        "shared": shared,
        "identity": identity,
        "identity renewed": _ca("identity CA", key=identity.key, serial=77, end=_LATER),
        "identity of the same name": other,
        "identity expired": _ca("old CA", end=_EXPIRED),
        "identity between": between,
        "permissions": permissions,
        "permissions renewed": _ca("permissions CA", key=permissions.key, serial=78, end=_LATER),
        "permissions of the same name": foreign,
        "permissions expired": _ca("permissions CA", key=permissions.key, serial=79, end=_EXPIRED),
        "cross identity by permissions": _ca("identity CA", permissions, key=identity.key),
        "cross shared by permissions": _ca("sros2CA", permissions, key=shared.key),
        "cross permissions by shared": _ca("permissions CA", shared, key=permissions.key),
        "cross foreign by permissions": _ca("foreign", permissions, key=foreign.key),
        "no authority": certificate("permissions CA", key=foreign.key, ca=False),
    }


IDENTITY_CAS = ("shared", "identity", "identity renewed", "identity of the same name", "identity expired")
PERMISSIONS_CAS = ("shared", "permissions", "permissions renewed", "permissions of the same name", "identity")
CROSS = (
    "cross identity by permissions",
    "cross shared by permissions",
    "cross permissions by shared",
    "cross foreign by permissions",
)


@lru_cache(maxsize=1)
def identities() -> dict[str, dict[str, Signed]]:
    """By name of an enclave, by how its certificate came to be; all of a name but `twin` and `self` have one key."""
    known, found = authorities(), {}
    clients = x509.ExtendedKeyUsage([x509.oid.ExtendedKeyUsageOID.CLIENT_AUTH]), False
    for number, name in enumerate(NAMES):
        key = ec.generate_private_key(ec.SECP256R1())
        own = {
            by: certificate(name, known[by], key=key)
            for by in ("shared", "identity", "identity of the same name", "identity expired", "identity between")
        }
        own["identity again"] = certificate(name, known["identity"], key=key, end=_LATER)
        own["shared again"] = certificate(name, known["shared"], key=key, end=_LATER)
        own["another subject"] = certificate(f"/other{number}", known["identity"], key=key)
        own["expired"] = certificate(name, known["identity"], key=key, end=_EXPIRED)
        own["not to sign"] = certificate(name, known["shared"], key=key, extensions=[clients])
        own["by permissions"] = certificate(name, known["permissions"], key=key)
        own["twin"] = certificate(name, known["identity"])
        own["self"] = certificate(name)
        found[name] = own
    stranger = ec.generate_private_key(ec.SECP256R1())
    found["/stranger"] = {by: certificate("/stranger", known[by], key=stranger) for by in ("shared", "identity")}
    found["/stranger"]["by permissions"] = certificate("/stranger", known["permissions"], key=stranger)
    return found


@lru_cache(maxsize=1)
def locked_key() -> bytes:
    """A private key with a password."""
    key = ec.generate_private_key(ec.SECP256R1())
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"secret"))


@lru_cache(maxsize=1)
def lists() -> dict[str, bytes]:
    """Revocation lists, PEM."""
    known = authorities()
    revoked = [identities()[name]["identity"].certificate.serial_number for name in NAMES[:2]]
    made = {"empty": crl(known["identity"]), "some": crl(known["identity"], revoked), "shared": crl(known["shared"])}
    return {name: each.public_bytes(Encoding.PEM) for name, each in made.items()}


def sign(text: str, signer: Signed, *embedded: Signed) -> bytes:
    """As sros2 signs, with more certificates in the message."""
    return signed_document(text.encode(), signer, *embedded)


_RULES = Rules(
    expressions=lambda _random: _EXPRESSIONS,
    partitions=_PARTITIONS,
    count=(None, None, None, None, None, 1, 2),
    domains=lambda random: _IDS[:-1] if random.random() < 0.97 else _IDS,
)


def _grant(random: Random, subject: str) -> str:
    begin = AT + timedelta(days=random.choice((-900, -900, -900, -20, 20)))
    end = AT + timedelta(days=random.choice((900, 900, 900, 40, -10)))
    return r.grant(
        *(_RULES.rule(random) for _ in range(random.choice((1, 2, 2, 3, 4)))),
        subject=f"CN={subject}",
        start=begin.strftime("%Y-%m-%dT%H:%M:%S"),
        end=max(begin + timedelta(days=1), end).strftime("%Y-%m-%dT%H:%M:%S"),
        default=random.choice(("ALLOW", "DENY", "DENY", "DENY")),
        name=f"grant {random.randrange(10**6)}",
    )


def _permissions(random: Random, name: str) -> str:
    others = (*NAMES, "/stranger", "/other0", "/other1")
    subjects = [name, *random.sample(others, random.choice((0, 0, 0, 1, 2)))]
    random.shuffle(subjects)
    return d.permissions(*(_grant(random, subject) for subject in subjects))


def _governance(random: Random) -> str:
    def domain_rule() -> str:
        rules = [
            d.topic_rule(
                random.choice((*_EXPRESSIONS, "*", "*")),
                read=random.random() < 0.75,
                write=random.random() < 0.75,
                discovery=random.random() < 0.75,
                liveliness=random.random() < 0.75,
                metadata=random.choice(_KINDS),
                data=random.choice(_KINDS[:3]),
            )
            for _ in range(random.choice((1, 1, 2, 3)))
        ]
        return d.domain_rule(
            *rules,
            domains=_RULES.where(random),
            join=random.random() < 0.6,
            unauthenticated=random.random() < 0.15,
            rtps=random.choice(_KINDS),
            discovery=random.choice(_KINDS),
            liveliness=random.choice(_KINDS),
        )

    return d.governance(*(domain_rule() for _ in range(random.choice((1, 2, 3)))))


def _signers(random: Random, name: str | None) -> Iterator[tuple[str, Signed, tuple[Signed, ...]]]:
    known = authorities()
    yield from ((by, known[by], ()) for by in ("shared", "permissions", "permissions renewed", "identity"))
    yield "permissions of the same name", known["permissions of the same name"], ()
    yield "two", known["permissions"], (known["permissions renewed"], known["identity"])
    own = identities()[name or random.choice(NAMES)]
    yield "own shared", own["shared"], ()
    yield "own by permissions", own["by permissions"], ()
    yield "own not to sign", own["not to sign"], ()
    yield "own over a cross certificate", own["identity"], (known["cross identity by permissions"],)
    yield "own between", own["identity between"], (known["identity between"], known["cross identity by permissions"])


Documents = dict[str, list[bytes]]
"""By who signed."""


@lru_cache(maxsize=1)
def permissions(seed: int = 1) -> dict[str, Documents]:
    """By name of the enclave."""
    random, found = Random(seed), {}
    for name in NAMES:
        texts = [_permissions(random, name) for _ in range(16)]
        found[name] = {
            by: [sign(text, signer, *more) for text in (texts if by in ("shared", "permissions") else texts[:3])]
            for by, signer, more in _signers(random, name)
        }
    return found


@lru_cache(maxsize=1)
def governances(seed: int = 2) -> Documents:
    """Those of everybody."""
    random = Random(seed)
    texts = [d.governance(), *(_governance(random) for _ in range(24))]
    return {
        by: [sign(text, signer, *more) for text in (texts if by in ("shared", "permissions") else texts[:4])]
        for by, signer, more in _signers(random, None)
    }
