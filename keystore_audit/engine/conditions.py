"""Under which assumptions what holds does: each is left out once, and what does not hold then needed it.

The native engine asks; it need not be asked by whom an attacker could be, since one that is enough is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

from msgspec.structs import replace

from keystore_audit.assumptions import CONDITIONS, WORLD, Assumption
from keystore_audit.engine.native import NativeEngine
from keystore_audit.model.formal.system import Reading, System
from keystore_audit.profiles import VARIANTS
from keystore_audit.properties.property import Status
from keystore_audit.properties.result import PropertyResult

R = TypeVar("R", bound=PropertyResult)

Without = Mapping[tuple[str, str], Collection[Assumption]]
"""By profile and property: what it needs in order to hold."""


def with_conditions(results: Sequence[R], systems: Sequence[System]) -> tuple[R, ...]:
    """The results; of what holds under a profile, with what it needs for that."""
    holding = [name for result in results for name, each in result.profiles.items() if each.status is Status.HOLDS]
    needs = _needs(systems, frozenset(holding)) if holding else {}

    def conditional(result: R) -> R:
        profiles = {
            name: replace(each, needs=tuple(needs.get((name, result.prop.id), ())))
            if each.status is Status.HOLDS
            else each
            for name, each in result.profiles.items()
        }
        return replace(result, profiles=profiles)

    return tuple(map(conditional, results))


def _needs(systems: Sequence[System], profiles: frozenset[str]) -> Without:
    found: dict[tuple[str, str], list[Assumption]] = {}
    for assumption in CONDITIONS:
        for system, statuses in _asked_without(assumption, systems, profiles):
            lasting = {claim.id for claim in system.claims if claim.until is not None}  # not asked again
            for name in system.profiles:
                for prop, status in statuses.items():
                    needed = found.setdefault((name, prop), [])
                    if (status is not Status.HOLDS or prop in lasting) and assumption not in needed:
                        needed.append(assumption)
    return found


def _asked_without(
    assumption: Assumption, systems: Iterable[System], profiles: frozenset[str]
) -> Iterator[tuple[System, Mapping[str, Status]]]:
    """What holds without the assumption, in the reading that goes without it."""
    asked = []
    for system in systems:
        names = tuple(n for n in system.profiles if n in profiles and (assumption in WORLD or is_announced_to(n)))
        if names and assumption in system.assumed and (system.reading is Reading.MAY or assumption not in WORLD):
            announced = system.asks_announced_only or assumption is Assumption.TRUTHFUL_ANNOUNCEMENTS
            less = system.assumed - {assumption}
            asked.append(replace(system, profiles=names, assumed=less, asks_announced_only=announced))
    return zip(asked, NativeEngine(asked).first_statuses(), strict=True)


def is_announced_to(profile: str) -> bool:
    """Whether the implementation goes by what peers announce of their endpoints."""
    return VARIANTS[profile].trust.trusts_declarations


def without(assumption: Assumption, results: Sequence[R], assumed: frozenset[Assumption]) -> tuple[R, ...]:
    """The results; where the assumption is not made that all of them need, what holds is unknown."""
    if assumption in assumed:
        return tuple(results)
    return tuple(
        replace(
            result,
            profiles={
                name: replace(each, status=Status.UNKNOWN) if each.status is Status.HOLDS else each
                for name, each in result.profiles.items()
            },
        )
        for result in results
    )
