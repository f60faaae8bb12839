"""Write the running ROS graph to stdout, for `keystore-audit --graph` and `suggest` (schemas/graph.schema.json).

    keystore-audit-record > robot.graph.json

A recording is an observation. What starts later, runs in another domain or is made when it is needed is not in it:
it never shows that nothing else runs. What ROS cannot attribute to a node is left out, and told on stderr.

ROS_DOMAIN_ID and RMW_IMPLEMENTATION are those of the robot. Under security, ROS_SECURITY_ENCLAVE_OVERRIDE names an
enclave that may take part in discovery.

exit codes: 0 recorded; 2 wrong usage, or ROS does not start; 3 no node was seen, nothing written;
4 recorded, but incomplete; 130 interrupted
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import sys
import time
from collections import Counter
from collections.abc import Collection
from typing import Any, Final

# Nothing of keystore-audit and of what it needs is imported: ROS's Python runs this file alone.

_POLL: Final = 0.2
"""Seconds between two looks at the graph."""

_NODELESS: Final = "ros_discovery_info"
"""The topic by which participants tell of their nodes: its endpoints belong to none of these."""


def main() -> int:
    """Record with the Python that runs this; where that has no rclpy, with the `python3` on PATH.

    Returns the exit code.
    """
    parser = argparse.ArgumentParser(
        "keystore-audit-record", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    seconds: dict[str, Any] = {"type": float, "metavar": "SECONDS"}
    parser.add_argument("--settle", default=5.0, help="record once nothing changed for so long (default: 5)", **seconds)
    parser.add_argument("--limit", default=60.0, help="record then, whatever changes (default: 60)", **seconds)
    chosen = parser.parse_args()
    try:
        import rclpy  # type: ignore[import-not-found]
    except ImportError as error:
        python = shutil.which("python3")
        if python is not None and __name__ != "__main__":
            os.execv(python, [python, __file__, *sys.argv[1:]])  # noqa: S606 - what the user called, in ROS's Python
        return _say(2, f"{sys.executable} cannot import rclpy ({error}): source a ROS 2 installation first")
    try:
        rclpy.init(args=[])
        quiet = {"enable_rosout": False, "start_parameter_services": False}
        observer = rclpy.create_node(f"keystore_audit_record_{os.getpid()}", **quiet)
        nodes, left_out, settled = _watched(observer, chosen.settle, chosen.limit)
    except RuntimeError as error:  # RCLError: no such enclave, no such domain
        return _say(2, f"ROS refuses: {error}")
    except KeyboardInterrupt:
        return 130
    finally:
        if rclpy.ok():
            rclpy.shutdown()
    if not nodes:
        no_node = "no node was seen: do ROS_DOMAIN_ID, RMW_IMPLEMENTATION and the enclave fit the robot?"
        return _say(3, *left_out, no_node)
    json.dump({"schema_version": 1, "nodes": nodes}, sys.stdout, indent=2)
    print()  # noqa: T201
    if not settled:
        left_out.append(f"the graph changed until the end of {chosen.limit:g} seconds")
    return _say(4 if left_out else 0, *left_out)


def _say(code: int, *lines: str) -> int:
    for line in lines:
        print(line, file=sys.stderr)  # noqa: T201
    return code


def _watched(observer: Any, settle: float, limit: float) -> tuple[list[dict[str, object]], list[str], bool]:
    """The nodes and what is left out, and whether both stayed as they are for `settle` of at most `limit` seconds.

    No node at all is no state that lasts: discovery takes its time.
    """
    seen = _look(observer)
    begin = changed = time.monotonic()
    while True:
        time.sleep(_POLL)
        found, now = _look(observer), time.monotonic()
        if found != seen or not found[0]:
            seen, changed = found, now
        if now - changed >= settle or now - begin >= limit:
            return *seen, now - changed >= settle


def _look(observer: Any) -> tuple[list[dict[str, object]], list[str]]:
    """The nodes that run beside `observer`, a node itself, as the schema has them; and what is not in them."""
    from rclpy.node import NodeNameNonExistentError  # type: ignore[import-not-found]

    own = (observer.get_name(), observer.get_namespace())
    listed = observer.get_node_names_and_namespaces_with_enclaves()
    found = sorted(node for node in listed if node[:2] != own)
    nodes = []
    for node in dict.fromkeys(found):
        with contextlib.suppress(NodeNameNonExistentError):  # it ended a moment ago
            nodes.append(_node(observer, *node))
    namesakes = Counter(f"{namespace.rstrip('/')}/{name}" for name, namespace, _enclave in found)
    left_out = [
        *(
            f"{count} nodes are called {name!r}: ROS reports what one of them does"
            for name, count in namesakes.items()
            if count > 1
        ),
        *(
            f"an endpoint of {topic!r} belongs to no node that is known"
            for topic in _nodeless(observer, {node[:2] for node in listed})
        ),
    ]
    return nodes, left_out


def _node(observer: Any, name: str, namespace: str, enclave: str) -> dict[str, object]:
    """One node. Raises rclpy's NodeNameNonExistentError where it has ended."""
    from rclpy.action import graph as actions  # type: ignore[import-not-found]

    node = (name, namespace)
    served = actions.get_action_server_names_and_types_by_node(observer, *node)
    called = actions.get_action_client_names_and_types_by_node(observer, *node)
    parts = tuple(f"{action}/_action/" for action, _types in (*served, *called))  # the action stands for them
    lists = {
        "publishers": ("topic", observer.get_publisher_names_and_types_by_node(*node)),
        "subscribers": ("topic", observer.get_subscriber_names_and_types_by_node(*node)),
        "service_servers": ("service", observer.get_service_names_and_types_by_node(*node)),
        "service_clients": ("service", observer.get_client_names_and_types_by_node(*node)),
        "action_servers": ("action", served),
        "action_clients": ("action", called),
    }
    entries = {
        key: [
            {kind: used, "type": each} for used, types in sorted(found) if not used.startswith(parts) for each in types
        ]
        for key, (kind, found) in lists.items()
    }
    return {"name": name, "namespace": namespace, "enclave": enclave, **entries}


def _nodeless(observer: Any, known: Collection[tuple[str, str]]) -> list[str]:
    """DDS topics with an endpoint of none of the known nodes: of a program that is none of ROS, or that rights hide."""
    topics = dict(observer.get_topic_names_and_types(no_demangle=True))
    asked = (observer.get_publishers_info_by_topic, observer.get_subscriptions_info_by_topic)
    return [
        topic
        for topic in sorted(topics.keys() - {_NODELESS})
        if any(
            (each.node_name, each.node_namespace) not in known for ask in asked for each in ask(topic, no_mangle=True)
        )
    ]


if __name__ == "__main__":
    sys.path.pop(0)  # the folder of this file, whose other modules are not meant by anybody's import
    sys.exit(main())
