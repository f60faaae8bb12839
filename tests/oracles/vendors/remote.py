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

from keystore_audit.keystore.permissions import Operation
from tests.keystore.documents import allow, deny, ids, topic_rule
from tests.keystore.documents import criterion as criterion_element
from tests.oracles.vendors.enclave import Endpoint
from tests.oracles.vendors.pairs import Meeting, Side
from tests.oracles.vendors.pairs_case import other_end
from tests.oracles.vendors.pairs_material import (
    CONTROL_TOPICS,
    EVERYTHING,
    FUTURE,
    LONG,
    PAST,
    Authorities,
    Enclave,
    governance,
    permissions,
)
from tests.oracles.vendors.pairs_material import grant as grant_element

SUBJECT = "CN=/second"
ENDPOINTS_OF_A_PAIR = 40
CAS = Authorities.split()
IDENTITIES = {name: CAS.issue(f"/{name}") for name in ("first", "second")}
_ALL_ALLOWED = {name: CAS.sign(permissions(grant_element(f"CN=/{name}", EVERYTHING))) for name in IDENTITIES}

_EXPRESSIONS = ("*", "a*", "b*", "ab*", "[ab]*", "[!a]*", "?b*", "*1", "a?", "b2")
_PARTITIONS = ("", "p", "q", "*", "?", "p*", "[pq]")
_OPERATIONS = ("publish", "subscribe")


class Criterion(Struct, frozen=True, kw_only=True):
    """`partitions` None: no such element."""

    operation: str
    topics: tuple[str, ...]
    partitions: tuple[str, ...] | None = None

    def xml(self) -> str:
        """The element."""
        return criterion_element(self.operation, *self.topics, partitions=self.partitions)


class Rule(Struct, frozen=True, kw_only=True):
    """`domains`: ranges, both ends included."""

    allow: bool
    domains: tuple[tuple[int, int], ...]
    criteria: tuple[Criterion, ...]

    def holds(self, domain: int) -> bool:
        """Whether the rule is about the domain."""
        return any(low <= domain <= high for low, high in self.domains)

    def xml(self) -> str:
        """The element."""
        made = allow if self.allow else deny
        return made(*(each.xml() for each in self.criteria), domains=ids(*self.domains))


class Grant(Struct, frozen=True, kw_only=True):
    """`controls`: the first rule allows the controls of the pair."""

    subject: str
    validity: tuple[str, str]
    rules: tuple[Rule, ...]
    allows_by_default: bool

    def xml(self) -> str:
        """The element."""
        default = "ALLOW" if self.allows_by_default else "DENY"
        rules = "".join(rule.xml() for rule in self.rules)
        return grant_element(self.subject, rules, default=default, validity=self.validity, controls=False)


class TopicRule(Struct, frozen=True, kw_only=True):
    """A rule of the governance, the same on both sides."""

    expression: str
    read_control: bool
    write_control: bool


class Remote(Struct, frozen=True, kw_only=True):
    """What the second side presents, and what the governance asks for."""

    grants: tuple[Grant, ...]
    topic_rules: tuple[TopicRule, ...]
    join_control: bool
    domain: int
    endpoints: tuple[Endpoint, ...]

    def governance(self) -> bytes:
        """The document of both sides."""
        rules = (
            topic_rule(rule.expression, read=rule.read_control, write=rule.write_control) for rule in self.topic_rules
        )
        return governance(*rules, join=self.join_control)

    def permissions(self) -> bytes:
        """The document of the second side."""
        return permissions(*(grant.xml() for grant in self.grants))

    def sides(self, directory: Path) -> tuple[Side, Side]:
        """Both; `directory` gets a keystore of them, in which /second has what it presents, and what it starts with."""
        governed = CAS.sign(self.governance())
        documents = {"first": _ALL_ALLOWED["first"], "second": CAS.sign(self.permissions())}
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
    governed = [TopicRule(expression="*", read_control=random.random() < 0.9, write_control=random.random() < 0.9)]
    if random.random() < 0.5:
        expression = random.choice(("a*", "[ab]b*"))
        some = TopicRule(expression=expression, read_control=random.random() < 0.6, write_control=random.random() < 0.6)
        governed.insert(0, some)
    return Remote(
        grants=tuple(grants),
        topic_rules=tuple(governed),
        join_control=random.random() < 0.7,
        domain=random.choice((0, 0, 1)),
        endpoints=tuple(_endpoint(random, number) for number in range(ENDPOINTS_OF_A_PAIR)),
    )


def _grant(random: Random, subject: str, validity: tuple[str, str] = LONG) -> Grant:
    rules = [_rule(random) for _ in range(random.randint(1, 4))]
    if random.random() < 0.9:
        controls = tuple(Criterion(operation=operation, topics=CONTROL_TOPICS) for operation in _OPERATIONS)
        rules.insert(0, Rule(allow=True, domains=((0, 230),), criteria=controls))
    return Grant(subject=subject, validity=validity, rules=tuple(rules), allows_by_default=random.random() < 0.3)


def _rule(random: Random) -> Rule:
    low = random.choice((0, 0, 0, 1))
    domains = ((low, low + random.choice((0, 3))), (7, 7))[: random.randint(1, 2)]
    operations = [random.choice((*_OPERATIONS, *_OPERATIONS, "relay")) for _ in range(random.randint(1, 3))]
    # Fast DDS reads them in any order, the schema wants all of one kind together.
    operations.sort(key=("publish", "subscribe", "relay").index)
    criteria = tuple(_criterion(random, operation) for operation in operations)
    return Rule(allow=random.random() < 0.65, domains=domains, criteria=criteria)


def _criterion(random: Random, operation: str) -> Criterion:
    return Criterion(
        operation=operation,
        topics=tuple(_some(random, _EXPRESSIONS, 1, 2)),
        partitions=tuple(_some(random, _PARTITIONS[1:], 1, 2)) if random.random() < 0.5 else None,
    )


def _endpoint(random: Random, number: int) -> Endpoint:
    partitions = _some(random, ("p", "q", "*", "?", "p*"), 0, 2) if random.random() < 0.6 else ()
    operation = Operation.PUBLISH if number % 2 else Operation.SUBSCRIBE
    return Endpoint(
        operation=operation, topic=f"{random.choice(('a', 'b', 'ab'))}{number}", partitions=tuple(partitions)
    )


def _some(random: Random, of: Sequence[str], least: int, most: int) -> list[str]:
    return random.sample(list(of), random.randint(least, most))
