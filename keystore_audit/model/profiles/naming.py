"""What people call implementations and scopes: titles, with the distributions of ROS 2 that ship them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from keystore_audit.model.profiles.profile import Profile
from keystore_audit.model.profiles.variants import DEFAULT, VARIANTS
from keystore_audit.text import some

MAX_NAMED: Final = 6
"""Implementations named one by one; the profiles of a finding have them all."""


def implementations(profiles: Iterable[Profile | str]) -> str:
    """`Cyclone DDS 0.10 (Humble, Jazzy, Kilted)`, of profiles or of the names of known ones."""
    found = (each if isinstance(each, Profile) else VARIANTS.get(each) for each in profiles)
    return some([_implementation(profile) for profile in found if profile is not None], MAX_NAMED)


def _implementation(profile: Profile) -> str:
    shipped = ", ".join(name.capitalize() for name in profile.distributions)
    return f"{profile.title} ({shipped})" if shipped else profile.title


def shipped_by(names: Iterable[str]) -> str:
    """`Humble, Jazzy`: the distributions that ship one of these variants; empty where none does."""
    found = {each for name in names if name in VARIANTS for each in VARIANTS[name].distributions}
    return ", ".join(name.capitalize() for name in sorted(found))


def scope_of(names: Sequence[str]) -> str:
    """`Jazzy with Fast DDS 2.14`: what a verdict over these variants is about. Empty where it is about all that
    supported distributions ship, or where nothing was judged. Where no distribution ships all, each with its own.
    """
    known = [VARIANTS[name] for name in names if name in VARIANTS]
    if not known or set(DEFAULT) <= set(names):
        return ""
    common = [each for each in known[0].distributions if all(each in profile.distributions for profile in known)]
    if not common:
        return ", ".join(map(_implementation, known))
    where = " or ".join(name.capitalize() for name in common)
    return f"{where} with {' and '.join(profile.title for profile in known)}"
