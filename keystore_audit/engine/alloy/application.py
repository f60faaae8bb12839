"""Nodes with their wiring, and the words that users' files open, as Alloy modules."""

from __future__ import annotations

from typing import Final

from keystore_audit.engine.alloy.atoms import Relations, Sort, declare, make_sort, name_atoms
from keystore_audit.model.formal.system import System

MODULE: Final = "application.als"
"""The hand-written module, which opens the claims and `NODES`."""

NODES: Final = "nodes.als"
"""The generated module of nodes."""

VOCABULARY: Final = "keystore_audit"
"""The name of the module that users' files open."""


def node_sort(system: System) -> Sort:
    """Return the atoms of the nodes."""
    return make_sort("Node", "N", [(node.label, str(node.location)) for node in system.nodes])


def write_nodes(system: System) -> str:
    """Return the module `nodes`. Names stand in comments only."""
    atoms, nodes, relations = name_atoms(system), node_sort(system), Relations()
    enclaves = [() if node.enclave is None else (node.enclave,) for node in system.nodes]
    lines = [
        relations.relation(name, declared, relations.rows(nodes, sort, rows))
        for name, declared, sort, rows in (
            ("runs_in", "Node -> Enclave", atoms.enclaves, enclaves),
            ("publishes_to", "Node -> Channel", atoms.channels, [node.publishes for node in system.nodes]),
            ("subscribes_to", "Node -> Channel", atoms.channels, [node.subscribes for node in system.nodes]),
        )
    ]
    head = [
        "/**",
        " * The nodes of a graph, launch file or policy, and their wiring, written by keystore-audit. Do not edit.",
        " *",
        " * `runs_in`: the enclave with which a node starts. `publishes_to`, `subscribes_to`: what it is there to do.",
        " */",
        "module nodes",
        "open keystore",
        "",
        "/** A ROS 2 node, by its name. */",
        "abstract sig Node {}",
    ]
    return "\n".join([*head, declare(nodes), "", *relations.take_private(), *lines]) + "\n"


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
