"""Writes the running ROS graph to stdout, in the form that `keystore-audit --graph` reads (schemas/graph.schema.json).

    python3 tools/write_graph.py --wait 10 > robot.graph.json

It needs rclpy, so a sourced ROS 2 installation, and no part of keystore-audit. NOT RUN by its authors: no ROS 2 was
there when it was written, so it was checked against rclpy's documentation alone. Look at what it writes before you
rely on it; keystore-audit refuses whatever is not of the form.

Under security, run it in an enclave that may take part in discovery (ROS_SECURITY_ENCLAVE_OVERRIDE). It sees what is
running while it waits, and nothing else: a node that starts later, or a client that is made when it is needed, is not
in the graph. Nodes of other domains are not seen either.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterable
from typing import Any

OWN_NAME = "keystore_audit_write_graph"
ACTION_PART = "/_action/"

NamesAndTypes = Iterable[tuple[str, list[str]]]


def endpoints(found: NamesAndTypes, kind: str) -> list[dict[str, str]]:
    """Entries of one list; the topics and services of actions are left out, since the actions stand for them."""
    return [
        {kind: name, "type": type_name}
        for name, types in sorted(found)
        if kind == "action" or ACTION_PART not in name
        for type_name in types
    ]


def actions(observer: Any, role: str, node: tuple[str, str]) -> NamesAndTypes:
    """Actions of a node, with their types. Rolling moves these functions from a module to the node's class."""
    name = f"get_action_{role}_names_and_types_by_node"
    found: NamesAndTypes
    if hasattr(observer, name):
        found = getattr(observer, name)(*node)
    else:
        from rclpy.action import graph as by_node  # type: ignore[import-not-found]

        found = getattr(by_node, name)(observer, *node)
    return found


def describe(observer: Any, name: str, namespace: str, enclave: str) -> dict[str, object]:
    """One node as the form has it. `observer`: an rclpy node."""
    node = (name, namespace)
    return {
        "name": name,
        "namespace": namespace,
        "enclave": enclave,
        "publishers": endpoints(observer.get_publisher_names_and_types_by_node(*node), "topic"),
        "subscribers": endpoints(observer.get_subscriber_names_and_types_by_node(*node), "topic"),
        "service_servers": endpoints(observer.get_service_names_and_types_by_node(*node), "service"),
        "service_clients": endpoints(observer.get_client_names_and_types_by_node(*node), "service"),
        "action_servers": endpoints(actions(observer, "server", node), "action"),
        "action_clients": endpoints(actions(observer, "client", node), "action"),
    }


def graph(observer: Any) -> dict[str, object]:
    """All nodes but this one."""
    found = sorted(observer.get_node_names_and_namespaces_with_enclaves())
    nodes = [describe(observer, *node) for node in dict.fromkeys(map(tuple, found)) if node[0] != OWN_NAME]
    return {"schema_version": 1, "nodes": nodes}


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wait", type=float, default=5.0, metavar="SECONDS", help="for discovery (default: 5)")
    seconds = parser.parse_args().wait
    try:
        import rclpy  # type: ignore[import-not-found]
    except ImportError:
        print("rclpy is not there: source a ROS 2 installation first", file=sys.stderr)
        return 2
    rclpy.init()
    try:
        observer = rclpy.create_node(OWN_NAME)
        time.sleep(seconds)
        json.dump(graph(observer), sys.stdout, indent=2)
        print()
    finally:
        rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
