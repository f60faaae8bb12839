"""Random rules of permissions over a small alphabet, so that they compete."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random

from msgspec import Struct

from tests.keystore.documents import Domain, criterion, ids, rule


class Rules(Struct, frozen=True, kw_only=True):
    """What rules are drawn from. `count`: how many partitions a criterion lists, None for none.

    `relays`: how many criteria of relaying a rule has.
    """

    expressions: Callable[[Random], Sequence[str]]
    partitions: Sequence[str]
    count: Sequence[int | None]
    domains: Callable[[Random], Sequence[Domain]]
    relays: Sequence[int] = (0, 0, 0, 1)
    allows: float = 0.6

    def where(self, random: Random) -> str:
        """One or two ids or ranges."""
        return ids(*random.sample(self.domains(random), random.choice((1, 1, 2))))

    def criterion(self, random: Random, kind: str) -> str:
        """With one or two topics."""
        topics = random.sample(self.expressions(random), random.choice((1, 1, 2)))
        count = random.choice(self.count)
        return criterion(kind, *topics, partitions=random.sample(self.partitions, count) if count else ())

    def rule(self, random: Random) -> str:
        """In the order of the schema, which Fast DDS asks for."""
        kinds = (("publish", (0, 1, 1, 2)), ("subscribe", (0, 1, 1, 2)), ("relay", self.relays))
        criteria = [self.criterion(random, kind) for kind, counts in kinds for _ in range(random.choice(counts))]
        return rule(*criteria, allow=random.random() < self.allows, domains=self.where(random))
