"""Which implementations share a system: all that are alike in all their readings."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec.structs import replace

from keystore_audit.grouped import gathered
from keystore_audit.model.formal.system import System


def apart(systems: Iterable[System]) -> tuple[System, ...]:
    """Each system as many times as it has profiles, for one of them each time.

    Implementations that read a keystore alike may still differ for claims. They may differ in which enclaves start,
    which topics can exist, and which subjects elsewhere a grant names. So no answer may pass from one to the others.
    """
    return tuple(replace(system, profiles=(name,)) for system in systems for name in system.profiles)


def together(systems: Iterable[System]) -> tuple[System, ...]:
    """One system for all profiles that are alike in all their readings."""
    by_profile = gathered((name, replace(system, profiles=())) for system in systems for name in system.profiles)
    kinds: list[tuple[list[str], list[System]]] = []
    for name, readings in by_profile.items():
        alike = next((names for names, known in kinds if known == readings), None)
        if alike is None:
            kinds.append(([name], readings))
        else:
            alike.append(name)
    return tuple(replace(each, profiles=tuple(names)) for names, readings in kinds for each in readings)
