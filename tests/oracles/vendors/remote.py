"""Random permissions of a remote enclave, which may do what it likes at its own side: what does a correct peer accept?

Everything hangs on a seed. The CAs are split: under a shared one, vendors that do not pin the signer accept what the
enclave signs for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from random import Random

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.keystore.typed import Operation
from tests.keystore.documents import criterion, ids, rule, topic_rule
from tests.oracles.vendors.enclave import Endpoint
from tests.oracles.vendors.pairs import Meeting, Side
from tests.oracles.vendors.pairs_case import other_end
from tests.oracles.vendors.pairs_material import (
    EVERYTHING,
    FUTURE,
    LONG,
    PAST,
    Authorities,
    Enclave,
    governance,
    grant,
    permissions,
)

SUBJECT = "CN=/second"
ENDPOINTS_OF_A_PAIR = 40
CAS = Authorities.split()
IDENTITIES = {name: CAS.issue(f"/{name}") for name in ("first", "second")}
_ALL_ALLOWED = {name: CAS.sign(permissions(grant(f"CN=/{name}", EVERYTHING))) for name in IDENTITIES}

_EXPRESSIONS = ("*", "a*", "b*", "ab*", "[ab]*", "[!a]*", "?b*", "*1", "a?", "b2")
_PARTITIONS = ("p", "q", "*", "?", "p*", "[pq]")
_OPERATIONS = ("publish", "subscribe", "relay")


class Remote(Struct, frozen=True, kw_only=True):
    """What the second side presents, and the governance of both."""

    permissions: bytes
    governance: bytes
    domain: int
    endpoints: tuple[Endpoint, ...]

    def sides(self, directory: Path) -> tuple[Side, Side]:
        """Both; `directory` gets a keystore of them, in which /second has what it presents, and what it starts with."""
        governed = CAS.sign(self.governance)
        documents = {"first": _ALL_ALLOWED["first"], "second": CAS.sign(self.permissions)}
        enclaves = {
            name: Enclave(authorities=CAS, identity=identity, governance=governed, permissions=documents[name])
            for name, identity in IDENTITIES.items()
        }
        for name, enclave in enclaves.items():
            enclave.write(directory / "keystore/enclaves" / name)
        replace(enclaves["second"], permissions=_ALL_ALLOWED["second"]).write(directory / "started")
        return self._ready(directory)

    def without_document(self, directory: Path) -> tuple[Side, Side]:
        """The same sides where `sides` wrote them, the second with an empty document to present."""
        first, second = self._ready(directory)
        (directory / "empty").write_bytes(b"")
        return first, replace(second, presented=directory / "empty")

    def _ready(self, directory: Path) -> tuple[Side, Side]:
        first = Side(
            enclave=directory / "keystore/enclaves/first",
            endpoints=tuple(map(other_end, self.endpoints)),
            domain=self.domain,
        )
        second = Side(
            enclave=directory / "started",
            endpoints=self.endpoints,
            domain=self.domain,
            compromised=True,
            presented=directory / "keystore/enclaves/second/permissions.p7s",
        )
        return first, second

    def accepted(self, meeting: Meeting) -> tuple[bool, ...]:
        """For each endpoint of the second side, whether the first one matched it."""
        assert meeting.sides[0] is not None, meeting.complaints[0]
        return tuple(seen.matched > 0 for seen, _ in zip(meeting.sides[0], self.endpoints, strict=False))


def random_remote(seed: int) -> Remote:
    """The keystore of this seed."""
    random = Random(seed)
    grants = [_grant(random, SUBJECT, validity=random.choice((LONG, LONG, LONG, PAST, FUTURE)))]
    if random.random() < 0.6:
        grants.append(_grant(random, SUBJECT))
    if random.random() < 0.3:
        grants.insert(0, _grant(random, "CN=/other"))
    governed = [topic_rule("*", read=random.random() < 0.9, write=random.random() < 0.9)]
    if random.random() < 0.5:
        expression = random.choice(("a*", "[ab]b*"))
        governed.insert(0, topic_rule(expression, read=random.random() < 0.6, write=random.random() < 0.6))
    return Remote(
        permissions=permissions(*grants),
        governance=governance(*governed, join=random.random() < 0.7),
        domain=random.choice((0, 0, 1)),
        endpoints=tuple(_endpoint(random, number) for number in range(ENDPOINTS_OF_A_PAIR)),
    )


def _grant(random: Random, subject: str, validity: tuple[str, str] = LONG) -> str:
    rules = [_rule(random) for _ in range(random.randint(1, 4))]
    controls, default = random.random() < 0.9, "ALLOW" if random.random() < 0.3 else "DENY"
    return grant(subject, *rules, default=default, validity=validity, controls=controls)


def _rule(random: Random) -> str:
    low = random.choice((0, 0, 0, 1))
    domains = ((low, low + random.choice((0, 3))), (7, 7))[: random.randint(1, 2)]
    kinds = [random.choice(("publish", "subscribe", *_OPERATIONS)) for _ in range(random.randint(1, 3))]
    # Fast DDS reads them in any order, the schema wants all of one kind together.
    criteria = [_criterion(random, kind) for kind in sorted(kinds, key=_OPERATIONS.index)]
    return rule(*criteria, allow=random.random() < 0.65, domains=ids(*domains))


def _criterion(random: Random, kind: str) -> str:
    topics = _some(random, _EXPRESSIONS, 1, 2)
    return criterion(kind, *topics, partitions=_some(random, _PARTITIONS, 1, 2) if random.random() < 0.5 else ())


def _endpoint(random: Random, number: int) -> Endpoint:
    partitions = _some(random, ("p", "q", "*", "?", "p*"), 0, 2) if random.random() < 0.6 else ()
    operation = Operation.PUBLISH if number % 2 else Operation.SUBSCRIBE
    return Endpoint(
        operation=operation, topic=f"{random.choice(('a', 'b', 'ab'))}{number}", partitions=tuple(partitions)
    )


def _some(random: Random, of: Sequence[str], least: int, most: int) -> list[str]:
    return random.sample(list(of), random.randint(least, most))
