"""What users say that their nodes forward, and what follows for one system (docs/model.md, Determinism)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.findings import Location, Severity
from keystore_audit.model.channels import ReadRegion
from keystore_audit.model.claims.globs import Globs, by_default, region_of
from keystore_audit.model.claims.stated import Marks
from keystore_audit.model.formal.behaviour import Scheduler
from keystore_audit.model.names import AMBIENT

UNREAD: Final = "it depends on what could not be read"
"""Why a claim is undecided where the readings of a system differ."""


class Forward(Struct, frozen=True, kw_only=True):
    """A node of an enclave publishes on each of `targets` what it got of `sources` (DDS topics), as it came.

    `sources` in the order of their priority. An enclave with forwards does nothing else. `location`, `place`: where it
    is declared, as in `claims.Claim`.
    """

    enclave: str
    sources: tuple[str, ...]
    targets: tuple[str, ...]
    scheduler: Scheduler
    location: Location
    place: str
    marks: Marks = ()


class Determinism(Struct, frozen=True, kw_only=True):
    """That two runs show the same on `low` (DDS topics), whatever comes from `high`, if all other inputs are the same.

    `forwards`: those on which what is on `low` depends. The rest is as in `claims.Claim`.
    """

    id: str
    statement: str
    severity: Severity
    high: Globs
    low: tuple[str, ...]
    forwards: tuple[Forward, ...]
    include_ambient: bool
    location: Location
    place: str
    marks: Marks = ()

    @property
    def meaning(self) -> str:
        """What is claimed, and of which forwards, apart from names and words: equal for equal claims."""
        forwards = [[f.enclave, f.sources, sorted(f.targets), f.scheduler.value] for f in self.forwards]
        high = [sorted(self.high.enclaves), sorted(self.high.topics)]
        return json.dumps(["deterministic", sorted(self.low), high, self.include_ambient, forwards])


class Declared(Struct, frozen=True, kw_only=True):
    """The forwards that are declared, and what is claimed of them."""

    forwards: tuple[Forward, ...] = ()
    claims: tuple[Determinism, ...] = ()

    def regions(self) -> tuple[ReadRegion, ...]:
        """The sets of names that take part in the classes, so that the claims are exact."""
        topics: dict[str, None] = {}
        for forward in self.forwards:
            topics.update(dict.fromkeys((*forward.sources, *forward.targets)))
        for claim in self.claims:
            topics.update(dict.fromkeys((*claim.low, *claim.high.topics)))
        if not self.claims:
            return ()
        return (
            region_of(AMBIENT),
            *(region for topic in topics for region in (region_of((topic,)), by_default(topic))),
        )


def leading_to(low: Iterable[str], forwards: Sequence[Forward]) -> tuple[Forward, ...]:
    """The forwards on which what is on these topics depends, in their order."""
    topics = set(low)
    found: set[int] = set()
    while True:
        more = {n for n, forward in enumerate(forwards) if n not in found and topics.intersection(forward.targets)}
        if not more:
            return tuple(forwards[number] for number in sorted(found))
        found |= more
        topics.update(source for number in more for source in forwards[number].sources)
