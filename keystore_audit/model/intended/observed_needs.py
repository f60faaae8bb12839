"""What nodes need, as graphs and launch files tell it: DDS operations on DDS topics, for each enclave.

Every ROS 2 node also uses names that no launch file mentions. They are for its log, its parameters, and what its
participant tells of itself. They are the usual ones here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import grouped
from keystore_audit.intent.intent import ROOT, Action, IntendedNode, Intent, Origin, UsedName, is_ros_name
from keystore_audit.keystore.layout import LayoutKind
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.matching.expression import UNESCAPED_WILDCARDS, parse
from keystore_audit.model.names import DISCOVERY_TOPIC, PARAMETER_SERVICES, Use, dds_channels, dds_expressions
from keystore_audit.profiles import Matcher

LOG: Final = "/rosout"
EVENTS: Final = "/parameter_events"
CLOCK: Final = "/clock"
TYPE_DESCRIPTION: Final = "get_type_description"
"""The service that every node offers below its name since Iron (REP 2016), and that sros2's policies do not name."""

DISCOVERY: Final[tuple[Use, ...]] = (
    (Operation.PUBLISH, DISCOVERY_TOPIC),
    (Operation.SUBSCRIBE, DISCOVERY_TOPIC),
)
"""What every participant of a DDS middleware needs (rmw_dds_common). Without it no process of ROS 2 makes one
(measured, Foxy and later); sros2 grants it without being told."""

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

    Before Foxy there were no enclaves, and `--enclave` was not known: the folder has the node's name. That of a node
    whose name no file says is not known.
    """
    if kind not in _NO_ENCLAVES:
        return intents

    def enclave(told: str, node: str) -> str:
        return node if told == ROOT and node else told

    return [
        replace(
            intent,
            nodes=tuple(
                replace(each, enclave=enclave(each.enclave, each.name))
                for each in intent.nodes
                if each.name or each.enclave != ROOT
            ),
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


# The least policy for what nodes were seen to do: for each right that is needed the literal name, and no other.
#
# Where nothing is denied but by default, that policy is the only least one: whatever is right allows at least that
# (docs/intent.md). Names with wildcards come from policies alone, and stay.


UNNAMED: Final = "/node"
"""The node of a right that no file gives a node to; names are absolute, so nothing depends on it."""

Usages = Callable[[str, str], tuple[Action, ...]]
"""What the enclave (its path) is granted to do with a ROS name, which no launch file tells."""


class PolicyRight(Struct, frozen=True, kw_only=True):
    """`name`: fully qualified, or an expression of a policy. `usual`: every node has it, whatever it is for."""

    action: Action
    name: str
    allow: bool
    usual: bool


class NodePolicy(Struct, frozen=True, kw_only=True):
    """The rights of a node, by its fully qualified name: first what it is for, then the usual ones."""

    name: str
    rights: tuple[PolicyRight, ...]


class EnclavePolicy(Struct, frozen=True, kw_only=True):
    """What the nodes of an enclave need."""

    path: str
    nodes: tuple[NodePolicy, ...]

    @property
    def rights(self) -> tuple[PolicyRight, ...]:
        """Of all nodes, each once."""
        return tuple(dict.fromkeys(right for node in self.nodes for right in node.rights))


class LeastPolicy(Struct, frozen=True, kw_only=True):
    """Enclaves by path, nodes by name.

    `doubts`: sentences about what may be missing. `wildcards`: expressions that policies hold, which are kept.
    """

    enclaves: tuple[EnclavePolicy, ...]
    doubts: tuple[str, ...]
    wildcards: tuple[str, ...]


def least_policy(intents: Sequence[Intent], kind: LayoutKind, usages: Usages, *, usual: bool = True) -> LeastPolicy:
    """What the files say that nodes do. `usual` False: without what every node does beside its work."""
    draft = _Draft(usages)
    for intent in in_layout(intents, kind):
        draft.add(intent)
    return draft.policy(usual=usual)


class _Draft:
    """A policy in the making: rights by enclave and node."""

    def __init__(self, usages: Usages) -> None:
        self._usages = usages
        self._allowed: dict[str, dict[str, dict[tuple[Action, str], None]]] = {}
        self._denied: dict[str, dict[tuple[Action, str], None]] = {}
        self._doubts: dict[str, None] = {}

    def add(self, intent: Intent) -> None:
        """What one file says."""
        for node in intent.nodes:
            self._of(node.enclave, node.name)
        for right in intent.rights:
            if right.allow:
                self._of(right.enclave, right.node)[right.action, right.name] = None
            else:
                self._denied.setdefault(right.enclave, {})[right.action, right.name] = None
        for used in intent.names:
            self._use(used)
        if intent.origin is not Origin.POLICY:  # a policy says everything that it wants
            for node, action, name in missing_usual(intent, frozenset({Usual.ALWAYS, Usual.OFTEN})):
                self._of(node.enclave, node.name)[action, name] = None
        for unresolved in intent.unresolved:
            self._doubts[f"{unresolved.location}: {unresolved.reason.rstrip('.')}."] = None

    def policy(self, *, usual: bool) -> LeastPolicy:
        """The policy of all files."""
        enclaves = tuple(
            EnclavePolicy(path=path, nodes=tuple(self._nodes(path, nodes, usual=usual)))
            for path, nodes in sorted(self._allowed.items())
        )
        names = (right.name for enclave in enclaves for right in enclave.rights if right.allow)
        wildcards = tuple(dict.fromkeys(name for name in names if not UNESCAPED_WILDCARDS.isdisjoint(name)))
        return LeastPolicy(enclaves=enclaves, doubts=tuple(self._doubts), wildcards=wildcards)

    def _of(self, enclave: str, node: str) -> dict[tuple[Action, str], None]:
        return self._allowed.setdefault(enclave, {}).setdefault(node or UNNAMED, {})

    def _use(self, used: UsedName) -> None:
        """A name that a node uses in a way that only the keystore tells."""
        rights = self._of(used.enclave, used.node)
        actions = self._usages(used.enclave, used.name)
        for action in actions:
            rights[action, used.name] = None
        if not actions:
            who = used.node or f"a node of {used.enclave}"
            reason = f"{who} uses {used.name}, and neither the file nor the keystore says how"
            self._doubts[f"{used.location}: {reason}."] = None

    def _nodes(
        self, path: str, nodes: Mapping[str, Iterable[tuple[Action, str]]], *, usual: bool
    ) -> Iterator[NodePolicy]:
        denied = Denials(self._denied.get(path, ()))
        kept = denied.kept(right for rights in nodes.values() for right in rights)
        for number, (node, rights) in enumerate(sorted(nodes.items())):
            everyday = {(action, name) for action, name, _usual in usual_rights(node)}
            made = {
                PolicyRight(action=action, name=name, allow=True, usual=(action, name) in everyday)
                for action, name in rights
                if not denied.covers(action, name)
            }
            if number == 0:  # a deny rule is the whole enclave's, whichever profile it stands in
                made |= {PolicyRight(action=a, name=name, allow=False, usual=False) for a, name in kept}
            yield NodePolicy(name=node, rights=tuple(sorted((r for r in made if usual or not r.usual), key=_order)))


_ACTIONS: Final = tuple(Action)


def _order(right: PolicyRight) -> tuple[object, ...]:
    return right.usual, right.allow, _ACTIONS.index(right.action), right.name


class Denials:
    """What a policy denies an enclave."""

    def __init__(self, rights: Iterable[tuple[Action, str]]) -> None:
        self.rights = tuple(rights)
        channels = dict.fromkeys(c for action, name in self.rights for c in dds_expressions(action.value, name))
        patterns = [(operation, parse(text, Matcher.POSIX)) for operation, text in channels]
        self._names = frozenset((each, pattern.literal) for each, pattern in patterns if pattern.literal is not None)
        self._patterns = [(each, pattern) for each, pattern in patterns if pattern.literal is None]

    def covers(self, action: Action, name: str) -> bool:
        """Whether everything that the right takes is denied."""
        return is_ros_name(name) and all(self._hits(channel) for channel in dds_expressions(action.value, name))

    def touches(self, action: Action, name: str) -> bool:
        """Whether something that the right takes is denied."""
        return any(self._hits(channel) for channel in dds_expressions(action.value, name))

    def kept(self, allowed: Iterable[tuple[Action, str]]) -> tuple[tuple[Action, str], ...]:
        """Those without which more would be allowed: beside wildcards, and where they take part of a right."""
        for action, name in allowed if self.rights else ():
            if not is_ros_name(name) or (self.touches(action, name) and not self.covers(action, name)):
                return self.rights
        return ()

    def _hits(self, channel: Use) -> bool:
        operation, topic = channel
        return channel in self._names or any(
            each is operation and pattern.matches(topic) for each, pattern in self._patterns
        )
