"""The module that users' files open: the words of the model, and the names that they give to enclaves and topics."""

from __future__ import annotations

from typing import Final

from keystore_audit.engine.alloy.atoms import name_atoms
from keystore_audit.engine.alloy.relations import Relations
from keystore_audit.model.formal.system import System

VOCABULARY: Final = "keystore_audit"
"""The name of the module."""


def write_vocabulary(system: System) -> str:
    """Return the module, with a function for each of the places of `system`."""
    atoms, relations = name_atoms(system), Relations()
    lines = []
    for place in system.places:
        sort, members = (atoms.enclaves, place.enclaves) if place.channels is None else (atoms.channels, place.channels)
        lines.append(relations.subset(place.name, sort, members or ()))
    head = f"/** What files of properties open: docs/alloy-properties.md. */\nmodule {VOCABULARY}\n"
    head += "open application\n" if system.nodes else "open claims\n"
    return "\n".join([head, *relations.take_private(), *lines]) + "\n"
