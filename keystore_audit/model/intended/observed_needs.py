"""What nodes need, as graphs and launch files tell it: DDS operations on DDS topics, for each enclave.

Every ROS 2 node also uses names that no launch file mentions: its log, its parameters, and the topic on which its
participant tells what it has. They are the usual ones here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import grouped
from keystore_audit.intent.intent import Action, IntendedNode, Intent, Origin
from keystore_audit.intent.ros_names import ROOT, is_ros_name
from keystore_audit.keystore.layout import LayoutKind
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.names import DISCOVERY_TOPIC, PARAMETER_SERVICES, Use, dds_channels

LOG: Final = "/rosout"
EVENTS: Final = "/parameter_events"
CLOCK: Final = "/clock"
TYPE_DESCRIPTION: Final = "get_type_description"
"""The service that every node offers below its name since Iron (REP 2016), and that sros2's policies do not name."""

DISCOVERY: Final[tuple[Use, ...]] = (
    (Operation.PUBLISH, DISCOVERY_TOPIC),
    (Operation.SUBSCRIBE, DISCOVERY_TOPIC),
)
"""What every participant of a DDS middleware needs (rmw_dds_common), or no process of ROS 2 makes one (measured, Foxy
and later); sros2 grants it without being told."""

_NO_ENCLAVES: Final = frozenset({LayoutKind.FLAT, LayoutKind.ARDENT})
"""Layouts of distributions in which a node's folder has the node's own name."""


class Usual(str, Enum):
    """How far a name is used by every node.

    ALWAYS: by every one, unless its code says otherwise. OFTEN: by those in C++ (they listen to parameter events) and
    those since Iron (they describe their types). GRANTED: not needed, but sros2's policies grant it to every node.
    """

    ALWAYS = "always"
    OFTEN = "often"
    GRANTED = "granted"


class Need(Struct, frozen=True, kw_only=True):
    """What a node does. `action` None: discovery. `usual`: every node does; the file need not say so.

    `node`: its fully qualified name, "" where the file does not say. `location`: where the file says it, or names the
    node.
    """

    enclave: str
    node: str
    action: Action | None
    name: str
    usual: bool
    location: Location

    @property
    def channels(self) -> tuple[Use, ...]:
        """What it takes, all of it."""
        return DISCOVERY if self.action is None else dds_channels(self.action.value, self.name)


def usual_rights(node: str) -> Iterator[tuple[Action, str, Usual]]:
    """What a node (fully qualified) does beside its own work.

    Sources: rcl's ROSOUT_TOPIC_NAME, rclcpp's TimeSource and NodeParameters, sros2's policies/common.
    """
    yield Action.PUBLISH, LOG, Usual.ALWAYS
    yield Action.PUBLISH, EVENTS, Usual.ALWAYS
    yield Action.SUBSCRIBE, EVENTS, Usual.OFTEN
    yield Action.SUBSCRIBE, CLOCK, Usual.GRANTED
    for service in PARAMETER_SERVICES if is_ros_name(node) else ():
        yield Action.REPLY, f"{node}/{service}", Usual.ALWAYS
        yield Action.REQUEST, f"{node}/{service}", Usual.GRANTED
    if is_ros_name(node):
        yield Action.REPLY, f"{node}/{TYPE_DESCRIPTION}", Usual.OFTEN


def in_layout(intents: Sequence[Intent], kind: LayoutKind) -> Sequence[Intent]:
    """The files with the enclaves that a keystore of this layout has for their nodes.

    Before Foxy there were no enclaves, and `--enclave` was not known: the folder has the node's name.
    """
    if kind not in _NO_ENCLAVES:
        return intents

    def enclave(told: str, node: str) -> str:
        return node if told == ROOT and node else told

    return [
        replace(
            intent,
            nodes=tuple(replace(each, enclave=enclave(each.enclave, each.name)) for each in intent.nodes),
            rights=tuple(replace(each, enclave=enclave(each.enclave, each.node)) for each in intent.rights),
            names=tuple(replace(each, enclave=enclave(each.enclave, each.node)) for each in intent.names),
        )
        for intent in intents
    ]


def needs(intents: Iterable[Intent]) -> tuple[Need, ...]:
    """What nodes certainly do, each right of an enclave once, where it is said first; usual ones after the others."""
    found: dict[tuple[str, Action | None, str], Need] = {}
    for need in (*_told(intents), *_usual(intents)):
        found.setdefault((need.enclave, need.action, need.name), need)
    return tuple(found.values())


def _told(intents: Iterable[Intent]) -> Iterator[Need]:
    for intent in intents:
        for right in intent.rights:
            if right.allow:
                usual = (right.action, right.name) in {(action, name) for action, name, _ in usual_rights(right.node)}
                yield Need(
                    enclave=right.enclave,
                    node=right.node,
                    action=right.action,
                    name=right.name,
                    usual=usual,
                    location=right.location,
                )


def _usual(intents: Iterable[Intent]) -> Iterator[Need]:
    """Of every node what the file leaves out."""
    for intent in intents:
        left_out = missing_usual(intent, frozenset({Usual.ALWAYS}))
        discovering = ((node, None, DISCOVERY_TOPIC) for node in intent.nodes)
        for node, action, name in (*left_out, *discovering):
            place = node.location
            yield Need(enclave=node.enclave, node=node.name, action=action, name=name, usual=True, location=place)


def missing_usual(intent: Intent, wanted: frozenset[Usual]) -> Iterator[tuple[IntendedNode, Action, str]]:
    """What the nodes do of these sorts and the file leaves out; the graph of a running node leaves out nothing."""
    listed = _listing_usual(intent)
    for node in intent.nodes:
        if node.name not in listed:
            for action, name, usual in usual_rights(node.name):
                if usual in wanted:
                    yield node, action, name


def _listing_usual(intent: Intent) -> frozenset[str]:
    """The nodes of a graph that are shown with their log or their parameters, and so with all that they have."""
    if intent.origin is not Origin.GRAPH:
        return frozenset()
    return frozenset(
        right.node
        for right in intent.rights
        if any((right.action, right.name) == (action, name) for action, name, _usual in usual_rights(right.node))
    )


def nodes_of(intents: Iterable[Intent]) -> Mapping[str, tuple[IntendedNode, ...]]:
    """The nodes by the path of their enclave, in the order of the files."""
    found = grouped((node for intent in intents for node in intent.nodes), lambda node: node.enclave)
    return {path: tuple(nodes) for path, nodes in found.items()}


def usages(name: str) -> tuple[tuple[Use, ...], ...]:
    """Everything that a node can do with a ROS name, as DDS channels: as a topic, a service or an action."""
    return tuple(dds_channels(action.value, name) for action in Action)


def usual_channels(nodes: Iterable[str]) -> Iterator[Use]:
    """What is granted to these nodes without being an excess."""
    yield from DISCOVERY
    for node in nodes:
        for action, name, _usual in usual_rights(node):
            yield from dds_channels(action.value, name)
