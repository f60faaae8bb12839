"""Globs on names, as settings and options have them: what they match, their regions, and what was perhaps meant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.model.channels import ReadRegion
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.semantics import DEFAULT_PARTITION, Area
from keystore_audit.profiles import Matcher
from keystore_audit.text import meant


class Globs(Struct, frozen=True, kw_only=True):
    """A place as a user names it: globs on enclave paths, or on DDS topic names, or the outsider.

    Globs are POSIX expressions, as in permissions: `*` also matches `/`.
    """

    enclaves: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    outsider: bool = False


def matching(glob: str, names: Iterable[str]) -> list[str]:
    """The names that the glob matches."""
    pattern = parse(glob, Matcher.POSIX)
    return [name for name in names if pattern.matches(name)]


def all_matching(globs: Iterable[str], names: Sequence[str]) -> set[str]:
    """The names that some of the globs match."""
    return {name for glob in globs for name in matching(glob, names)}


def nearest(glob: str, paths: Sequence[str]) -> str:
    """A hint for a glob that finds nothing, or nothing."""
    return meant(glob, paths, "; the nearest is {!r}")


def at(place: str) -> str:
    """How a message begins about what stands at the place; nothing where that is not known."""
    return f"{place}: " if place else ""


def named_paths(glob: str, paths: Sequence[str], place: str) -> list[str]:
    """The enclaves that the glob names, which stands at the place. Raises errors.UsageError where there are none."""
    found = matching(glob, paths)
    if not found:
        raise UsageError(f"{at(place)}{glob!r} names no enclave of this keystore{nearest(glob, paths)}.")
    return found


def region_of(topics: tuple[str, ...]) -> ReadRegion:
    """The region of globs on DDS topics, in every partition."""
    return Matcher.POSIX, (Area(topics=topics, partitions=None),)


def by_default(topic: str) -> ReadRegion:
    """The topic in the default partition, where the nodes of ROS 2 are."""
    return Matcher.POSIX, (Area(topics=(topic,), partitions=DEFAULT_PARTITION),)


IN_DEFAULT_PARTITION: Final = by_default("*")
"""Every topic there."""


def topic_regions(topics: tuple[str, ...]) -> tuple[ReadRegion, ...]:
    """The region of the globs, and those of each by itself, so that it is known which of them find nothing."""
    return (region_of(topics), *(region_of((glob,)) for glob in topics))
