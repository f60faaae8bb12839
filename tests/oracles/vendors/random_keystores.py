"""Keystores with random rules over a small alphabet, so that rules compete, and what to ask of each.

Reproducible: the same seed gives the same keystore, dates apart.
"""

from __future__ import annotations

from functools import lru_cache
from random import Random

from cryptography import x509

from keystore_audit.keystore.attribute_types import SHORT_NAMES
from keystore_audit.keystore.typed import Operation
from tests.keystore import documents as d
from tests.keystore.builder import Signed, certificate
from tests.keystore.chance import Rules
from tests.oracles.vendors import recipe as r
from tests.oracles.vendors.enclave import Endpoint
from tests.oracles.vendors.recipe import Recipe
from tests.oracles.vendors.recipes_subjects import MAIN, MEMBER, MUELLER, ORGANISED, TALKER, Parts

_EXPRESSIONS = ("rt/a", "rt/b", "rt/*", "*", "rt/[ab]", "r?/a", "rt/[!a]", "rt/c*", "rt/a*")
_TOPICS = ("rt/a", "rt/b", "rt/c", "rt/ab")
_PARTITIONS = ((), ("p",), ("q",), ("",), ("p", "q"), ("*",), ("pq",), ("p", "z"), ("p*",), ("", "p"), ("z", "q", "pq"))
_IDS: tuple[d.Domain, ...] = (0, 1, 2, (0, 1), (1, 5), (0, 230), (1, None), (0, None), (2, 9))
_RULES = Rules(
    expressions=lambda _random: _EXPRESSIONS,
    partitions=("", "p", "q", "p*", "*", "[pq]", "?"),
    count=(None, None, None, 1, 1, 2),
    domains=lambda _random: _IDS,
)
_SUBJECTS: tuple[Parts, ...] = (TALKER, TALKER, TALKER, ORGANISED, MEMBER, MAIN, MUELLER)


@lru_cache
def _identity(parts: Parts) -> Signed:
    return certificate(x509.Name([x509.NameAttribute(*each) for each in parts]), r.common_authority())


def _notation(random: Random, parts: Parts) -> str:
    """The subject, or one of nearly its attributes, as somebody may write it."""
    beyond = random.choice(("ü", "\\C3\\BC"))
    written = [(SHORT_NAMES[kind.dotted_string], value.replace("ü", beyond)) for kind, value in parts]
    pieces = ["=".join(each) for each in written]
    if random.random() < 0.9:
        return ",".join(reversed(pieces))
    if random.random() < 0.2:
        changed = random.choice((f"{parts[0][0].dotted_string}={written[0][1]}", "OU=x", "CN=/talker", "CN=/", "x"))
        pieces[random.randrange(len(pieces))] = changed
    if random.random() < 0.3:
        random.shuffle(pieces)
    between = random.choice((",", ", ", " ,", "/", "/"))
    text = "/" + "/".join(pieces) if between == "/" else between.join(reversed(pieces))
    return text + random.choice(("",) * 4 + (",", ",O=More", "/x"))


def _grant(random: Random, parts: Parts) -> str:
    rules = [_RULES.rule(random) for _ in range(random.choice((1, 2, 2, 3, 4)))]
    if random.random() < 0.7:
        rules.insert(random.randrange(len(rules) + 1), d.allow(d.pub("rt/z"), domains=d.ids((0, 9))))
    return r.grant(
        *rules,
        subject=_notation(random, parts) if random.random() < 0.92 else "CN=/other",
        start=r.date(hours=24) if random.random() < 0.1 else r.LAST_YEAR,
        end=r.date(hours=-24) if random.random() < 0.1 else r.NEXT_YEAR,
        default=random.choice(("ALLOW", "DENY", "DENY")),
        name=f"grant {random.randrange(10**6)}",
    )


def _topic_rule(random: Random) -> str:
    read, write = (random.random() < 0.75 for _ in range(2))
    return d.topic_rule(random.choice((*_EXPRESSIONS, "*")), read=read, write=write)


def _domain_rule(random: Random) -> str:
    rules = [_topic_rule(random) for _ in range(random.choice((1, 1, 2, 3)))]
    return d.domain_rule(*rules, domains=_RULES.where(random), join=random.random() < 0.6)


def endpoints(random: Random, count: int = 8) -> tuple[Endpoint, ...]:
    """Distinct endpoints that are worth asking about."""
    operations = (Operation.PUBLISH, Operation.SUBSCRIBE)
    every = [
        Endpoint(operation=operation, topic=topic, partitions=partitions)
        for operation in operations
        for topic in _TOPICS
        for partitions in _PARTITIONS
    ]
    return tuple(random.sample(every, count))


def keystore(seed: int) -> Recipe:
    """One keystore and its questions."""
    random = Random(seed)
    domain_rules = [_domain_rule(random) for _ in range(random.choice((1, 2, 3)))]
    parts = random.choice(_SUBJECTS)
    grants = [_grant(random, parts) for _ in range(random.choice((1, 1, 2, 3)))]
    return Recipe(
        title=f"seed {seed}",
        governance=d.governance(*domain_rules),
        permissions=d.permissions(*grants),
        identity=_identity(parts),
        domain=random.choice((0, 0, 1, 2)),
        endpoints=endpoints(random),
    )
