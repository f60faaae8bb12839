"""ROS 2 names as people write them: what is fully qualified, and how the others become so.

Sources: rmw's `validate_full_topic_name.c` and `validate_node_name.c` for what a name is, ROS 2 design article "Topic
and Service names" and rcl's `expand_topic_name.c` for relative and private names. Lengths are not limited here.
"""

from __future__ import annotations

import re
from typing import Final

FULL_NAME: Final = re.compile(r"(?:/[A-Za-z_][A-Za-z0-9_]*)+")
"""A fully qualified name: tokens, each behind one `/`, nothing after the last."""

ROOT: Final = "/"
"""The namespace that everything is below; also the enclave of a process that names none (rcl's `security.c`)."""

_TOKEN: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def is_ros_name(path: str) -> bool:
    """Return whether `path` is a fully qualified ROS name: of a topic, service, action or enclave (but the root).

    Tokens `[A-Za-z_][A-Za-z0-9_]*`, each behind one `/`, nothing after the last.
    """
    return FULL_NAME.fullmatch(path) is not None


def is_node_name(name: str) -> bool:
    """Return whether `name` is one token, as the name of a node without its namespace is."""
    return _TOKEN.fullmatch(name) is not None


def is_path(path: str) -> bool:
    """Return whether `path` is the root or a fully qualified name: what a namespace and an enclave are."""
    return path == ROOT or is_ros_name(path)


def joined(namespace: str, name: str) -> str:
    """Return the relative `name` below `namespace`, with one `/` between them."""
    return f"{namespace.rstrip('/')}/{name}"


def expanded(name: str, *, node: str, namespace: str) -> str | None:
    """Return the fully qualified form of `name` as the node `node` in `namespace` uses it; None if it has none.

    `~` stands for the node (never known where `node` is ""); a name that begins with `/` is absolute and any other
    relative to the namespace. What rcl refuses, and so what no node can use, has no such form, and neither has what
    stands for parts of names, as `{node}`.
    """
    plain = name
    if name.startswith("~"):
        if not node or name[1:2] not in ("", "/"):
            return None
        plain = joined(namespace, node) + name[1:]
    elif not name.startswith("/"):
        plain = joined(namespace, name)
    return plain if is_ros_name(plain) else None
