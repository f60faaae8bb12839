"""Intended rights, whatever file says them: the values that `keystore_audit.intent` reads files into."""

from __future__ import annotations

import re
from enum import Enum
from typing import Final

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.given import GivenFile

# ROS 2 names as people write them: what is fully qualified, and how the others become so.
#
# What a name is: rmw's `validate_full_topic_name.c` and `validate_node_name.c`. Relative and private names: ROS 2
# design article "Topic and Service names" and rcl's `expand_topic_name.c`. Lengths are not limited here.


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


class Action(str, Enum):
    """What a node does with a topic, service or action, in the words of SROS2's policy (ROS 2 design, article 182)."""

    PUBLISH = "publish"
    SUBSCRIBE = "subscribe"
    REQUEST = "request"
    REPLY = "reply"
    CALL = "call"
    EXECUTE = "execute"


class Origin(str, Enum):
    """Which sort of file says it."""

    POLICY = "policy"
    GRAPH = "graph"
    LAUNCH = "launch"


class IntendedNode(Struct, frozen=True, kw_only=True):
    """A node that is to run in the enclave (its path).

    `name`: its fully qualified ROS name, "" where the file does not say.
    """

    enclave: str
    name: str
    location: Location


class IntendedRight(Struct, frozen=True, kw_only=True):
    """What a node does, or (`allow` False, policies alone) must not do.

    `name`: fully qualified ROS name; in a policy it may be an expression with wildcards. `node`: the fully qualified
    name of the node, "" where the file does not say. `location`: in the file that says so, its path as the user gave
    it.
    """

    enclave: str
    node: str
    action: Action
    name: str
    allow: bool
    location: Location


class UsedName(Struct, frozen=True, kw_only=True):
    """A name that a node uses while the file does not say how: a remapping in a launch file."""

    enclave: str
    node: str
    name: str
    location: Location


class Unresolved(Struct, frozen=True, kw_only=True):
    """Something in the file that could not be worked out, so that rights may be missing from the intent.

    `reason`: a sentence.
    """

    location: Location
    reason: str


class SetVariable(Struct, frozen=True, kw_only=True):
    """A variable that a launch file sets for a process, and that decides whether there is security in it.

    `value` is None where it cannot be told. `node` is empty where the program chooses the name. `started`: what runs
    there, if the file says, else a digest of the file; it tells processes without a name apart.
    """

    node: str
    name: str
    value: str | None
    location: Location
    started: str = ""


class Intent(Struct, frozen=True, kw_only=True):
    """What one file, with all that it includes, says.

    `files`: it and those it includes, in the order in which they were read. `enclaves`: every path it names, with the
    place. `speaking`: unread parts that mention security, so that they may switch it off.
    """

    origin: Origin
    path: str
    files: tuple[GivenFile, ...]
    enclaves: tuple[tuple[str, Location], ...]
    nodes: tuple[IntendedNode, ...]
    rights: tuple[IntendedRight, ...]
    names: tuple[UsedName, ...] = ()
    unresolved: tuple[Unresolved, ...] = ()
    variables: tuple[SetVariable, ...] = ()
    speaking: tuple[Unresolved, ...] = ()
