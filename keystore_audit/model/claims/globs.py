"""Globs on names, as settings and options have them: what they match, their regions, and a guess what was meant."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.model.channels import ReadRegion
from keystore_audit.model.formal.system import Participant, System
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
    """The beginning of a message about the place; empty where the place is not known."""
    return f"{place}: " if place else ""


def named_paths(glob: str, paths: Sequence[str], place: str) -> list[str]:
    """The enclaves that the glob at the place names. Raises errors.UsageError where there are none."""
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


# Which participants of a system users mean who name enclaves by globs.
#
# Unmanaged identities have no path, so that no pattern of paths catches them, whatever their subject says. They are
# meant where everybody is.


def means_everybody(glob: str) -> bool:
    """Whether it matches every possible name of an enclave."""
    return glob.rstrip("*") == "/" != glob


def named_enclaves(system: System, globs: Collection[str], known: Collection[str], *, unread: bool) -> frozenset[int]:
    """The enclaves that the globs name; `known`: the paths of all that could be read.

    `unread`: also (MAY) those with unknown names, and unmanaged identities where everybody is meant.
    """
    found = all_matching(globs, [enclave.label for enclave in system.enclaves]).intersection(known)
    named = frozenset(number for number, enclave in enumerate(system.enclaves) if enclave.label in found)
    if not unread or not globs:
        return named
    return named | nameless(system, known) | (unmanaged(system) if any(map(means_everybody, globs)) else frozenset())


def left_out(system: System, globs: Collection[str], known: Collection[str]) -> tuple[Participant, ...]:
    """(MUST) Those that were left out and that the globs name, or may: a pattern, one whose name is unknown."""
    named = all_matching(globs, [each.label for each in system.left_out])
    patterns = not set(globs).issubset(known)
    return tuple(e for e in system.left_out if e.label in named or (patterns and e.label not in known))


def nameless(system: System, known: Collection[str]) -> frozenset[int]:
    """(MAY) The enclaves with unknown names."""
    return frozenset(n for n, enclave in enumerate(system.enclaves) if enclave.opaque and enclave.label not in known)


def unmanaged(system: System) -> frozenset[int]:
    """The participants that are no enclaves."""
    return frozenset(number for number, enclave in enumerate(system.enclaves) if enclave.unmanaged)


def with_all_certificates(system: System, enclaves: Iterable[int]) -> frozenset[int]:
    """The enclaves, and the others as which they can join: enclaves and unmanaged identities that have their keys.

    Of unread ones (MAY) it is unknown whose key they have.
    """
    enclaves = frozenset(enclaves)
    keys = {system.key_of(number) for number in enclaves} - {None}
    sharing = {n for n, atom in enumerate(system.enclaves) if atom.opaque or system.key_of(n) in keys}
    return enclaves | sharing if enclaves else enclaves
