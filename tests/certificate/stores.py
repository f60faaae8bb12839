"""Random keystores in the small world of the checker: real directories with real signatures; one seed, one store.

A pool of authorities and identities is made once; documents are random, over a small alphabet, so that rules compete.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from random import Random
from typing import Final

from msgspec import Struct

from keystore_audit.certificate.checking import Encrypted, NoFlow, OnlyPublish, Property
from tests.keystore.builder import Signed, authority, certificate, enclave, signed_document, write
from tests.keystore.chance import Rules
from tests.keystore.documents import Domain, domain_rule, governance, grant, ids, permissions, topic_rule

PATHS: Final = ("/arm", "/arm/hand", "/cam", "/log", "/net")
_EXPRESSIONS: Final = ("*", "rt/*", "rt/a", "rt/b", "rt/ab", "rt/a*", "*b", "rt/c", "rt/rosout")
_DOMAINS: Final[tuple[Domain, ...]] = (0, 1, (0, 3), 7)
_KINDS: Final = ("NONE", "SIGN", "ENCRYPT", "ENCRYPT", "ENCRYPT_WITH_ORIGIN_AUTHENTICATION")
_PLACES: Final = (*PATHS, "topic:/a", "topic:/b", "dds:rt/c", "topic:/*b", "/arm*", "outsider")
_TOPICS: Final = ("/a", "/b", "dds:rt/c", "/*b", "dds:*")
_RULES: Final = Rules(
    expressions=lambda _random: _EXPRESSIONS,
    partitions=(),
    count=(None,),
    domains=lambda _random: _DOMAINS,
    relays=(0,),
    allows=0.75,
)


@cache
def _authority(name: str) -> Signed:
    return authority(name)


@cache
def _identity(path: str, by: str) -> Signed:
    return certificate(path, _authority(by))


class Asked(Struct, frozen=True):
    """A store and a question about it."""

    root: Path
    property: Property


def asked(seed: int, root: Path, *, of_rights: bool = False) -> Asked:
    """The store of a seed, below `root`, with a question about a flow, or about rights."""
    random = Random(seed)
    paths = sorted(random.sample(PATHS, random.choice((2, 3, 3, 4))))
    identity, rights = ("one", "one") if random.random() < 0.2 else ("identity", "rights")
    shared = _signed(_governance(random), rights, random, paths, identity)
    for path in paths:
        own, ca, signer = identity, rights, shared
        if of_rights and random.random() < 0.15:  # peers of another authority refuse its certificate
            own = "other"
        if random.random() < 0.15:
            ca = random.choice(("rights", "other"))
        if ca != rights or random.random() < 0.1:
            signer = signed_document(_governance(random), _authority(ca))
        document = _signed(_permissions(random, path, paths), ca, random, paths, identity, odd=0.05)
        files = enclave(_identity(path, own), _authority(own).pem, _authority(ca).pem, signer, document)
        write(root / "enclaves" / path[1:], files)
    return Asked(root, _right(random, paths) if of_rights else _flow(random, paths))


def _flow(random: Random, paths: list[str]) -> Property:
    attacker = random.choice(("honest", "source", "relays", "relays"))
    places = [place for place in _PLACES if not place.startswith("/") or place in paths]
    source, target = random.sample(places, 2)
    through = (random.choice(paths),) if random.random() < 0.2 else ()
    return NoFlow(source, target, attacker, through, random.random() < 0.3)


def _right(random: Random, paths: list[str]) -> Property:
    topic = random.choice(_TOPICS)
    if random.random() < 0.5:
        return Encrypted(topic, random.choice(("outsider", "insider", "insider")))
    return OnlyPublish(
        topic, tuple(random.sample((*paths, "/arm*") if "/arm" in paths else paths, random.choice((1, 2))))
    )


def _signed(content: bytes, by: str, random: Random, paths: list[str], identity: str, odd: float = 0.0) -> bytes:
    """By the authority; seldom by an enclave or another authority."""
    signer = _authority(by)
    if random.random() < odd:
        signer = random.choice([_authority(identity), *(_identity(path, identity) for path in paths)])
    return signed_document(content, signer)


def _governance(random: Random) -> bytes:
    def flag(often: float) -> bool:
        return random.random() < often

    rules = []
    for _ in range(random.choice((1, 1, 2))):
        topics = [
            topic_rule(
                random.choice(_EXPRESSIONS),
                read=flag(0.85),
                write=flag(0.85),
                metadata=random.choice(_KINDS),
                data=random.choice(("NONE", "SIGN", "ENCRYPT", "ENCRYPT")),
            )
            for _ in range(random.choice((0, 0, 1, 2)))
        ]
        topics.append(topic_rule("*", metadata=random.choice(_KINDS)))
        where = ids(*random.sample(_DOMAINS, random.choice((1, 1, 2))))
        kinds = {"rtps": random.choice(("NONE", "SIGN", "SIGN", "ENCRYPT")), "join": flag(0.8)}
        rules.append(domain_rule(*topics, domains=where, unauthenticated=flag(0.05), **kinds))
    return governance(*rules).encode()


def _permissions(random: Random, path: str, paths: list[str]) -> bytes:
    grants = []
    for _ in range(random.choice((1, 1, 1, 2))):
        whose = path if random.random() < 0.9 else random.choice((*paths, "/stranger"))
        over = {"end": "2025-01-01T00:00:00"} if random.random() < 0.05 else {}
        rules = [_RULES.rule(random) for _ in range(random.choice((1, 1, 2)))]
        grants.append(grant(whose, *rules, default=random.choice(("DENY",) * 12 + ("ALLOW",)), **over))
    return permissions(*grants).encode()
