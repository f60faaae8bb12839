"""Which participants of a system users mean who name enclaves by globs.

Identities at large have no path, so that no pattern of paths catches them, whatever their subject says. They are meant
where everybody is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from keystore_audit.model.claims.globs import all_matching
from keystore_audit.model.formal.system import LeftOut, System


def means_everybody(glob: str) -> bool:
    """Whether it matches whatever an enclave may be called."""
    return glob.rstrip("*") == "/" != glob


def named_enclaves(system: System, globs: Collection[str], known: Collection[str], *, unread: bool) -> frozenset[int]:
    """The enclaves that the globs name; `known`: the paths of all that could be read.

    `unread`: and those (MAY) of which nobody knows what they are called, and identities at large where everybody is
    meant.
    """
    found = all_matching(globs, [enclave.label for enclave in system.enclaves]).intersection(known)
    named = frozenset(number for number, enclave in enumerate(system.enclaves) if enclave.label in found)
    if not unread or not globs:
        return named
    return named | nameless(system, known) | (at_large(system) if any(map(means_everybody, globs)) else frozenset())


def left_out(system: System, globs: Collection[str], known: Collection[str]) -> tuple[LeftOut, ...]:
    """(MUST) Those that were left out and that the globs name, or may: a pattern, one whose name is unknown."""
    named = all_matching(globs, [each.label for each in system.left_out])
    patterns = not set(globs).issubset(known)
    return tuple(e for e in system.left_out if e.label in named or (patterns and e.label not in known))


def nameless(system: System, known: Collection[str]) -> frozenset[int]:
    """(MAY) Those of which nobody knows what they are called."""
    return frozenset(n for n, enclave in enumerate(system.enclaves) if enclave.opaque and enclave.label not in known)


def at_large(system: System) -> frozenset[int]:
    """The participants that are no enclaves."""
    return frozenset(number for number, enclave in enumerate(system.enclaves) if enclave.at_large)


def with_all_certificates(system: System, enclaves: Iterable[int]) -> frozenset[int]:
    """The enclaves, and the others as which they can join: enclaves and identities at large that have their keys.

    Of those that could not be read (MAY) nobody knows whose key they have.
    """
    enclaves = frozenset(enclaves)
    keys = {system.key_of(number) for number in enclaves} - {None}
    sharing = {n for n, atom in enumerate(system.enclaves) if atom.opaque or system.key_of(n) in keys}
    return enclaves | sharing if enclaves else enclaves
