"""What users say that their nodes forward, and what follows for one system (docs/model.md, Determinism)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.errors import UsageError
from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.channels import Channels, ReadRegion
from keystore_audit.model.claims.claims import Marks, check_granted, granted_channels, marked
from keystore_audit.model.claims.globs import Globs, by_default, named_paths, nearest, region_of
from keystore_audit.model.formal.behaviour import Scheduler
from keystore_audit.model.formal.system import System
from keystore_audit.model.meaning import Usability
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


def with_determinism(
    systems: Sequence[System],
    declared: Declared,
    channels: Channels,
    keystore: Keystore,
    usability: Mapping[tuple[str, str], Usability],
    domain: int | None,
) -> tuple[System, ...]:
    """The systems with the claims of determinism as facts. `usability`: by directory and profile. `domain`: the one
    that the robots use, None: any.

    Raises errors.UsageError for what is declared of something that is not in the keystore.
    """
    if not declared.claims or not systems:
        return tuple(systems)
    from keystore_audit.model.claims.forwarding import Forwarding  # most audits have none

    _check(declared, systems, channels, keystore)
    resolved = [Forwarding(system, declared, channels, keystore, usability, domain) for system in systems]
    atoms = [[each.atom(claim) for claim in declared.claims] for each in resolved]
    for number in range(len(declared.claims)):
        read: dict[tuple[str, ...], object] = {}
        for each, found in zip(resolved, atoms, strict=True):
            told = each.told(found[number])
            if read.setdefault(each.system.profiles, told) != told:
                read[each.system.profiles] = None
        for each, found in zip(resolved, atoms, strict=True):
            if read[each.system.profiles] is None:
                found[number] = replace(found[number], behaviours=(), undecided=UNREAD)
    return tuple(replace(each.system, determinism=tuple(found)) for each, found in zip(resolved, atoms, strict=True))


def _check(declared: Declared, systems: Sequence[System], channels: Channels, keystore: Keystore) -> None:
    """Raises errors.UsageError for names that find nothing, and for an enclave that is high and has forwards."""
    paths = [enclave.path for enclave in keystore.enclaves]
    used = granted_channels(systems)
    for forward in declared.forwards:
        if forward.enclave not in paths:
            near = nearest(forward.enclave, paths)
            raise UsageError(
                f"{marked(forward, forward.enclave)}: {forward.enclave!r} is no enclave of this keystore{near}."
            )
        for topic in (*forward.sources, *forward.targets):
            check_granted(topic, channels, used, marked(forward, topic))
    for claim in declared.claims:
        for topic in (*claim.low, *claim.high.topics):
            check_granted(topic, channels, used, marked(claim, topic))
        for glob in claim.high.enclaves:
            found = named_paths(glob, paths, marked(claim, glob))
            for forward in declared.forwards:
                if forward.enclave in found:
                    raise UsageError(
                        f"{claim.place}: {forward.enclave!r} is high, and what it does is declared at {forward.place}: "
                        "name the topics that it gets instead."
                    )
