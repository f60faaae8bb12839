"""Nodes and their wiring as an Alloy module, and a main file that asks about them: for the window and users' files."""

from __future__ import annotations

from typing import Final

from keystore_audit.engine.alloy.atoms import Sort, declare, make_sort, name_atoms
from keystore_audit.engine.alloy.relations import Relations
from keystore_audit.model.formal.system import System

MODULE: Final = "application.als"
"""The hand-written module, which opens the claims and `NODES`."""

NODES: Final = "nodes.als"
"""The generated module of nodes."""

MAIN: Final = "application_audit.als"
"""The generated main file."""

ASSERTIONS: Final = ("NodesHaveEnclaves", "NodesHaveTheRightsThatTheyNeed", "WiredFlowsArePermitted", "RightsAreUsed")
"""What is asserted of every application."""

EXERCISED: Final = "WiringIsExercised"
"""The run that shows that there is something wired."""


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


def write_commands() -> str:
    """Return the main file: that something is wired, then whether it may be."""
    head = ["/** What nodes are to do, and what they may. */", "module application_audit", "open application", ""]
    checks = [f"check {name} for 0" for name in ASSERTIONS]
    return "\n".join([*head, f"run {EXERCISED} for 0", *checks]) + "\n"
