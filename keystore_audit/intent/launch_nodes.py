"""The nodes that launch files start: in which enclave, under which names, and which names they use."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.intent.environment import OVERRIDE
from keystore_audit.intent.intent import (
    Action,
    IntendedNode,
    IntendedRight,
    Intent,
    Origin,
    SetVariable,
    Unresolved,
    UsedName,
)
from keystore_audit.intent.launch_actions import LoadComponents, NodeKind, NodeNames, StartNode, StartProcess, Unknown
from keystore_audit.intent.launch_environment import (
    before_program,
    command_line,
    speaks_of,
    started_with,
)
from keystore_audit.intent.launch_scope import GlobalRemap, Scope
from keystore_audit.intent.ros_arguments import RosArguments, Rule, read
from keystore_audit.intent.ros_names import ROOT, expanded, is_node_name, is_path, joined
from keystore_audit.intent.source import Source, shown

MAX_NODES: Final = 5_000
"""Nodes of one launch: the largest systems have hundreds."""

MAX_NAMES: Final = 100_000
"""Names and unresolved places of one launch; includes can repeat a few files very often."""

_OFFERS: Final = {
    # rclcpp's and rclpy's lifecycle nodes, sros2's policy/common/lifecycle_node.xml
    NodeKind.LIFECYCLE: (
        (Action.REPLY, "change_state"),
        (Action.REPLY, "get_available_states"),
        (Action.REPLY, "get_available_transitions"),
        (Action.REPLY, "get_state"),
        (Action.REPLY, "get_transition_graph"),
        (Action.PUBLISH, "transition_event"),
    ),
    # composition: the interface that every container has (rclcpp_components, ComponentManager)
    NodeKind.CONTAINER: (
        (Action.REPLY, "_container/list_nodes"),
        (Action.REPLY, "_container/load_node"),
        (Action.REPLY, "_container/unload_node"),
    ),
    NodeKind.PLAIN: (),
}
"""What a node of the kind does for certain, below its own name."""


class _Node(Struct, frozen=True, kw_only=True):
    """A node whose names are worked out. `name` None: the program chooses."""

    name: str | Unknown | None
    namespace: str | Unknown
    rules: tuple[tuple[int, Rule], ...]
    location: Location
    file: Source
    globals: tuple[GlobalRemap, ...]
    kind: NodeKind = NodeKind.PLAIN

    @property
    def full_name(self) -> str:
        """The fully qualified name, "" where it is not known."""
        known = isinstance(self.name, str) and isinstance(self.namespace, str)
        return joined(str(self.namespace), str(self.name)) if known else ""

    def used(self, name: str) -> str | None:
        """The fully qualified form of `name`; None where it has none or depends on what is not known."""
        if isinstance(self.namespace, Unknown):
            return expanded(name, node="", namespace="") if name.startswith("/") else None
        return expanded(name, node=self.name if isinstance(self.name, str) else "", namespace=self.namespace)


class _Load(Struct, frozen=True, kw_only=True):
    """Components that wait for the container to be known: all of the launch can name it."""

    target: str | Unknown
    namespace: str | Unknown
    nodes: tuple[_Node, ...]
    location: Location


class Nodes:
    """Collects what is started; `intent` gives all of it."""

    def __init__(self) -> None:
        """Nothing is started yet."""
        self._enclaves: dict[str, Location] = {}
        self._nodes: dict[tuple[str, str], IntendedNode] = {}
        self._rights: dict[tuple[str, str, Action, str], IntendedRight] = {}
        self._names: dict[tuple[str, str, str], UsedName] = {}
        self._unresolved: dict[Unresolved, None] = {}
        self._variables: dict[SetVariable, None] = {}
        self._speaking: dict[Unresolved, None] = {}
        self._processes: dict[str, str | Unknown] = {}
        self._called: dict[str, set[str | Unknown]] = {}
        self._loads: list[_Load] = []
        self._remaps: list[GlobalRemap] = []
        self._count = 0

    def unresolved(self, location: Location, reason: str) -> None:
        """Note that something could not be worked out; `reason` is a sentence."""
        self._unresolved[Unresolved(location=location, reason=reason)] = None
        self._bounded(location)

    def remap(self, remap: GlobalRemap) -> None:
        """Note a remapping for all nodes of a scope, when it is set."""
        self._remaps.append(remap)

    def start(self, action: StartNode, scope: Scope, source: Source) -> None:
        """A process with a node, and components in it."""
        command = read(
            [scope.known(word, source) for word in action.arguments],
            [scope.known(word, source) for word in action.ros_arguments],
        )
        location = source.location(action.line)
        for unknown in command.unknown:
            self._not_known(location, "A remapping of a node", unknown)
        node = self._node(action.names, command, scope, source, action.kind)
        variables = started_with(action, scope, source)
        enclave = _enclave(command, variables)
        prefix = before_program(action, scope, source)
        if self.speaking(location, speaks_of(prefix)):
            enclave = Unknown(reason=f"{shown(prefix)}, which stands before the program")
        self._sets(node.full_name, command_line(action, scope, source), variables, location)
        if node.full_name:
            self._processes[node.full_name] = enclave
            self._called.setdefault(node.full_name.rpartition("/")[2], set()).add(enclave)
        self._place(node, enclave)
        for component in self._components(action.components, scope, source):
            self._place(component, enclave)

    def process(self, action: StartProcess, scope: Scope, source: Source) -> None:
        """A process that may be a node: of its variables those count that the file sets, or its command."""
        location = source.location(action.line)
        self.unresolved(location, "A process is started here; whether it is a node, and which, is not known.")
        command = command_line(action, scope, source)
        self.speaking(location, speaks_of(before_program(action, scope, source), command))
        named = started_with(action, scope, source)
        self._sets("", command, {n: value for n, value in named.items() if value}, location)

    def speaking(self, location: Location, word: str) -> bool:
        """Note that what is not read speaks of security by this word, if there is one."""
        if word:
            said = f"What is not read here speaks of {word}: whether it changes security cannot be told"
            self._speaking[Unresolved(location=location, reason=said)] = None
            self._bounded(location)
        return word != ""

    def unread(self, line: int, reason: str, scope: Scope, source: Source) -> None:
        """Something that is not read: if it starts processes, then in the environment that there is."""
        self.unresolved(source.location(line), reason)
        variables = started_with(StartProcess(line=line), scope, source)
        self._sets("what is not read here", source.file.sha256, variables, source.location(None))

    def _sets(self, node: str, started: str, variables: Mapping[str, str | Unknown], location: Location) -> None:
        """The variables of a process, apart from the one that says its enclave."""
        for name, value in variables.items():
            if name != OVERRIDE:
                known = value if isinstance(value, str) else None
                found = SetVariable(node=node, started=started, name=name, value=known, location=location)
                self._variables[found] = None

    def load(self, action: LoadComponents, scope: Scope, source: Source) -> None:
        """Components for a container that may come later."""
        load = _Load(
            target=scope.known(action.target, source),
            namespace=scope.namespace,
            nodes=tuple(self._components(action.components, scope, source)),
            location=source.location(action.line),
        )
        self._loads.append(load)

    def intent(self, files: Sequence[GivenFile]) -> Intent:
        """All that was collected, from the launch file that is the first of `files` and those that it includes."""
        for load in self._loads:
            enclave = self._container(load)
            for node in load.nodes:
                self._place(node, enclave)
        for remap in self._remaps:
            self._global(remap)
        return Intent(
            origin=Origin.LAUNCH,
            path=files[0].path,
            files=tuple(files),
            enclaves=tuple(self._enclaves.items()),
            nodes=tuple(self._nodes.values()),
            rights=tuple(self._rights.values()),
            names=tuple(self._names.values()),
            unresolved=tuple(self._unresolved),
            variables=tuple(self._variables),
            speaking=tuple(self._speaking),
        )

    def _components(self, components: Iterable[NodeNames], scope: Scope, source: Source) -> Iterator[_Node]:
        nothing = RosArguments(enclave=None, rules=(), unknown=())
        for names in components:
            holds = scope.holds(names.conditions, source)
            if holds is False:
                continue
            if isinstance(holds, Unknown):
                self.doubtful(source.location(names.line), holds)
            yield self._node(names, nothing, scope, source, NodeKind.PLAIN)

    def doubtful(self, location: Location, reason: Unknown) -> None:
        """Note that something happens under a condition that cannot be decided, and is counted."""
        self.unresolved(location, f"Whether this happens depends on {reason.reason}; it is taken as if it does.")

    def _node(self, names: NodeNames, command: RosArguments, scope: Scope, source: Source, kind: NodeKind) -> _Node:
        location = source.location(names.line)
        name: str | Unknown | None = None if names.name is None else scope.known(names.name, source) or None
        namespace = scope.below(names.namespace, source)
        rules = [(names.line, rule) for rule in command.rules]
        for remap in names.remaps:
            known = scope.remapped(remap, source)
            if isinstance(known, Unknown):
                self._not_known(source.location(remap.line), "A remapping of a node", known)
            else:
                rules.append((remap.line, Rule(node="", source=known[0], target=known[1])))
        mine = [(line, rule) for line, rule in rules if rule.node in ("", name)]
        if len(mine) < len(rules) and not isinstance(name, str):
            self.unresolved(location, "A remapping is for nodes of one name, and the name of this one is not known.")
        for _line, rule in reversed(mine):  # the first that matches counts
            if rule.source in ("__node", "__name"):
                name = rule.target
            elif rule.source == "__ns":
                namespace = rule.target if rule.target == ROOT else rule.target.rstrip("/")
        if isinstance(name, str) and not is_node_name(name):
            name = _no(name, "name of a node")
        if isinstance(namespace, str) and not is_path(namespace):
            namespace = _no(namespace, "namespace")
        return _Node(
            name=name,
            namespace=namespace,
            rules=tuple((line, rule) for line, rule in mine if not rule.source.startswith("__")),
            location=location,
            file=source,
            globals=tuple(scope.remaps),
            kind=kind,
        )

    def _place(self, node: _Node, enclave: str | Unknown) -> None:
        """Note a node of which the enclave is known or not."""
        self._count += 1
        if self._count > MAX_NODES:
            raise node.file.malformed(node.location.line, f"more than {MAX_NODES} nodes, which are not followed")
        if isinstance(enclave, Unknown):
            self._not_known(node.location, "The enclave of a node", enclave)
            return
        self._enclaves.setdefault(enclave, node.location)
        full = node.full_name
        if full:
            self._nodes.setdefault((enclave, full), IntendedNode(enclave=enclave, name=full, location=node.location))
            self._offers(node, enclave, full)
        elif node.name is None:
            self.unresolved(node.location, "The program chooses the name of this node; what is below it is not known.")
        elif isinstance(unknown := node.name if isinstance(node.name, Unknown) else node.namespace, Unknown):
            self._not_known(node.location, "The name of a node", unknown)
        self._uses(node, enclave)

    def _offers(self, node: _Node, enclave: str, full: str) -> None:
        for action, name in _OFFERS[node.kind]:
            right = IntendedRight(
                enclave=enclave,
                node=full,
                action=action,
                name=joined(full, name),
                allow=True,
                location=node.location,
            )
            self._rights.setdefault((enclave, full, action, right.name), right)

    def _uses(self, node: _Node, enclave: str) -> None:
        taken = set()
        for remap in node.globals:  # launch puts them before the node's own, and the first that matches counts
            taken.add(node.used(remap.source) or remap.source)
            name = node.used(remap.target)
            if name is None:
                self._no_name(Location(path=remap.file.path, line=remap.line), remap.target)
            else:
                remap.users.append((enclave, node.full_name, name))
        for line, rule in node.rules:
            location = node.file.location(line)
            source = node.used(rule.source) or rule.source
            if source in taken:
                continue
            taken.add(source)
            name = node.used(rule.target)
            if name is None:
                self._no_name(location, rule.target)
            else:
                self._use(enclave, node.full_name, name, location)

    def _use(self, enclave: str, node: str, name: str, location: Location) -> None:
        used = UsedName(enclave=enclave, node=node, name=name, location=location)
        self._names.setdefault((enclave, node, name), used)
        self._bounded(location)

    def _global(self, remap: GlobalRemap) -> None:
        """One node behind it is taken to be meant; of several nobody knows which use the name."""
        location = Location(path=remap.file.path, line=remap.line)
        users = dict.fromkeys(remap.users)
        if len(users) == 1:
            self._use(*next(iter(users)), location)
        elif users:
            said = f"The name {shown(remap.target)} is set for {len(users)} nodes; which of them use it is not said."
            self.unresolved(location, said)

    def _container(self, load: _Load) -> str | Unknown:
        """The enclave of the process that the components go into."""
        target = load.target
        if isinstance(target, Unknown):
            return target
        relative = not target.startswith("/") and isinstance(load.namespace, str)
        full = joined(str(load.namespace), target) if relative else target
        found = {self._processes[name] for name in (full, joined(ROOT, target)) if name in self._processes}
        if not found:
            found = self._called.get(target.rpartition("/")[2], set())
        if len(found) == 1:
            return next(iter(found))
        known = "which is not started here" if not found else "of which there are several"
        return Unknown(reason=f"the container {shown(target)}, {known}")

    def _not_known(self, location: Location, what: str, unknown: Unknown) -> None:
        self.unresolved(location, f"{what} depends on {unknown.reason}.")

    def _no_name(self, location: Location, target: str) -> None:
        said = f"The name {shown(target)} of a remapping cannot be worked out, or is none that a node can use."
        self.unresolved(location, said)

    def _bounded(self, location: Location) -> None:
        if len(self._names) + len(self._unresolved) > MAX_NAMES:
            raise UsageError(f"{location.path}: more than {MAX_NAMES} names and unresolved places, which are not kept.")


def _enclave(command: RosArguments, variables: Mapping[str, str | Unknown]) -> str | Unknown:
    """The enclave of a process: the override variable before the command line, the root before nothing."""
    enclave = variables.get(OVERRIDE, "") or command.enclave or ROOT
    if isinstance(enclave, str) and not is_path(enclave):
        return _no(enclave, "path of an enclave")
    return enclave


def _no(text: str, what: str) -> Unknown:
    return Unknown(reason=f"{shown(text)}, which is no {what}")
