"""The facts of a system at a later moment, for claims that must hold until a date.

Dates change only which grants are in force, who is refused, and what implementations make of enclaves by themselves.
So each combination is asked about once, with static facts. Each costs a start of the Analyzer, and is as exact and as
fast as the audit itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from datetime import timedelta
from typing import Final, TypeVar

from msgspec.structs import replace

from keystore_audit.model.formal.system import CertificateAtom, GrantAtom, System

MAX_MOMENTS: Final = 16
"""Moments asked about for one system."""

_TICK: Final = timedelta(microseconds=1)

Dated = TypeVar("Dated", CertificateAtom, GrantAtom)


def changes(system: System, until: int) -> Iterator[int]:
    """Yield the audit instant, and the later moments up to the instant `until` at which something changes. That is:
    which grants are in force, who is revoked or refused, or which endpoints implementations make.

    A moment is twice the index of an instant, plus one for the time between it and the next (as in
    `model.formal.permission.Permissions`).
    """
    before: object = None
    for moment in range(2 * system.now, max(until, system.now) * 2 + 1):
        now = _in_force(system, moment)
        if now != before:
            yield moment
        before = now


def later(system: System, until: int) -> Iterator[int]:
    """Yield the moments after the audit instant; of several that are alike the first counts."""
    known = set()
    for moment in changes(system, until):
        if (now := _in_force(system, moment)) not in known and moment != 2 * system.now:
            yield moment
        known.add(now)


def at(system: System, moment: int) -> System:
    """Return the same system as it is at `moment`, with an added instant if the moment lies between two."""
    index, between = divmod(moment, 2)
    system = system.at(moment)
    if not between:
        return replace(system, now=index)

    def shift(instant: int) -> int:
        return instant + 1 if instant > index else instant

    instants = system.instants
    return replace(
        system,
        instants=(*instants[: index + 1], instants[index] + _TICK, *instants[index + 1 :]),
        now=index + 1,
        certificates=redated(system.certificates, shift),
        grants=redated(system.grants, shift),
    )


def redated(dated: Iterable[Dated], of: Callable[[int], int]) -> tuple[Dated, ...]:
    """Return the same with other instants."""
    return tuple(replace(each, not_before=of(each.not_before), not_after=of(each.not_after)) for each in dated)


def _in_force(system: System, moment: int) -> tuple[object, ...]:
    """Grants; by trust domain, whom it refuses; and what implementations make of enclaves by themselves."""
    grants = enumerate(system.grants)
    found = frozenset(number for number, grant in grants if 2 * grant.not_before <= moment <= 2 * grant.not_after)
    then = system.at(moment)
    refused = ((trust_domain.revoked, trust_domain.refuses) for trust_domain in then.trust_domains)
    return found, *refused, *(enclave.by_itself for enclave in then.enclaves)
