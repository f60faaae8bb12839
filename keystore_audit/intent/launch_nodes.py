"""The nodes that launch files start: in which enclave, under which names, and which names they use.

Their command lines are read as rcl reads them (rcl's `arguments.c`, ROS 2 design article "ROS Command Line Arguments").
What is between `--ros-args` and `--` is ROS's. The last `--enclave` counts, and of remappings the first that
matches.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.intent.environment import OVERRIDE
from keystore_audit.intent.intent import (
    ROOT,
    Action,
    IntendedNode,
    IntendedRight,
    Intent,
    Origin,
    SetVariable,
    Unresolved,
    UsedName,
    expanded,
    is_node_name,
    is_path,
    joined,
)
from keystore_audit.intent.launch_elements import NAMES, Element, Scope, Unknown, speaks_of, words
from keystore_audit.intent.source import Source, shown

PREFIX: Final = "launch-prefix"
"""What stands before a program; also the argument for every program that has none (launch, execute_local)."""

_OFFERS: Final[Mapping[str, tuple[tuple[Action, str], ...]]] = {
    # rclcpp's and rclpy's lifecycle nodes, sros2's policy/common/lifecycle_node.xml
    "lifecycle_node": (
        (Action.REPLY, "change_state"),
        (Action.REPLY, "get_available_states"),
        (Action.REPLY, "get_available_transitions"),
        (Action.REPLY, "get_state"),
        (Action.REPLY, "get_transition_graph"),
        (Action.PUBLISH, "transition_event"),
    ),
    # composition: the interface that every container has (rclcpp_components, ComponentManager)
    "node_container": (
        (Action.REPLY, "_container/list_nodes"),
        (Action.REPLY, "_container/load_node"),
        (Action.REPLY, "_container/unload_node"),
    ),
}
"""What a node of the kind does for certain, below its own name."""

_OPTIONS: Final[Mapping[str, str]] = {
    **dict.fromkeys(("-r", "--remap"), "remap"),
    **dict.fromkeys(("-e", "--enclave"), "enclave"),
    **dict.fromkeys(("-p", "--param", "--params-file", "--log-level", "--log-config-file", "--log-file-name"), ""),
}
"""ROS's options that a value follows, and what counts here."""


class _Remap(Struct, frozen=True, kw_only=True):
    """A node that would use `source` uses `target`."""

    line: int
    source: str
    target: str


class _Node(Struct, frozen=True, kw_only=True):
    """A node whose names are worked out. `name` None: the program chooses. `hidden`: names remapped for all."""

    kind: str
    name: str | Unknown | None
    namespace: str | Unknown
    remaps: tuple[_Remap, ...]
    hidden: tuple[str, ...]
    location: Location
    file: Source

    @property
    def full_name(self) -> str:
        """The fully qualified name, "" where it is not known."""
        known = isinstance(self.name, str) and isinstance(self.namespace, str)
        return joined(str(self.namespace), str(self.name)) if known else ""

    def used(self, name: str) -> str | None:
        """The fully qualified form of `name`; None where it has none or depends on what is not known."""
        node = self.name if isinstance(self.name, str) else ""
        if isinstance(self.namespace, Unknown):
            return expanded(name, node="", namespace="") if name.startswith("/") else None
        return expanded(name, node=node, namespace=self.namespace)


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
        self._called: dict[str, set[str | Unknown]] = {}
        self._loads: list[tuple[str | Unknown, tuple[_Node, ...]]] = []

    def intent(self, files: Sequence[GivenFile]) -> Intent:
        """All that was collected, from the launch file that is the first of `files` and those that it includes."""
        for target, nodes in self._loads:  # a container may come later, and all of the launch can name it
            enclave = self._container(target)
            for node in nodes:
                self._place(node, enclave)
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

    def unresolved(self, location: Location, reason: str) -> None:
        """Note that something could not be worked out; `reason` is a sentence."""
        self._unresolved[Unresolved(location=location, reason=reason)] = None

    def speaking(self, location: Location, word: str) -> bool:
        """Note that what is not read mentions security by this word, if there is one."""
        if word:
            said = f"What is not read here mentions {word}: whether it changes security cannot be told"
            self._speaking[Unresolved(location=location, reason=said)] = None
        return word != ""

    def unread(self, line: int, reason: str, scope: Scope, source: Source) -> None:
        """Something that is not read: if it starts processes, then in the environment that there is."""
        self.unresolved(source.location(line), reason)
        self._sets("what is not read here", source.file.sha256, _environment(scope), source.location(None))

    def doubtful(self, location: Location, reason: Unknown) -> None:
        """Note that something happens under a condition that cannot be decided, and is counted."""
        self.unresolved(location, f"Whether this happens depends on {reason.reason}; it is taken as if it does.")

    def process(self, element: Element, scope: Scope, source: Source) -> None:
        """A process that may be a node: of its variables those count that the file sets, or its command."""
        location = source.location(element.line)
        self.unresolved(location, "A process is started here; whether it is a node, and which, is not known.")
        command = scope.shows((*element.attributes.get("cmd", ()), " "))
        self.speaking(location, speaks_of(_prefix(element, scope), command))
        variables = _environment(scope, element)
        self._sets("", command, {name: value for name, value in variables.items() if value}, location)

    def start(self, element: Element, scope: Scope, source: Source) -> None:
        """A process with a node, and components in it."""
        location = source.location(element.line)
        enclave, remaps = self._command_line(element, scope, source)
        node = self._node(element, remaps, scope, source)
        variables = _environment(scope, element)
        enclave = variables.get(OVERRIDE, "") or enclave or ROOT
        if isinstance(enclave, str) and not is_path(enclave):
            enclave = _no(enclave, "path of an enclave")
        prefix = _prefix(element, scope)
        if self.speaking(location, speaks_of(prefix)):
            enclave = Unknown(f"{shown(prefix)}, which stands before the program")
        program = (*element.attributes.get("pkg", ()), " ", *element.attributes["exec"], " ")
        self._sets(node.full_name, scope.shows(program), variables, location)
        if node.full_name:
            self._called.setdefault(str(node.name), set()).add(enclave)
        for each in (node, *self._components(element, scope, source)):
            self._place(each, enclave)

    def load(self, element: Element, scope: Scope, source: Source) -> None:
        """Components for a container that may come later."""
        target = scope.known(element.attributes["target"])
        self._loads.append((target, tuple(self._components(element, scope, source))))

    def _command_line(
        self, element: Element, scope: Scope, source: Source
    ) -> tuple[str | Unknown | None, list[_Remap]]:
        """The enclave that the command line says, if it does, and the remappings that it has."""
        try:
            own, ros = ([*map(scope.known, words(element.attributes.get(each, ())))] for each in ("args", "ros_args"))
        except ValueError:
            raise source.malformed(element.line, "a quote in 'args' or 'ros_args' opened and never closed") from None
        enclave: str | Unknown | None = None
        told: list[str | Unknown] = []
        inside, doubt = False, None
        left = iter([*own, "--ros-args", *ros])
        for word in left:
            unknown = None
            if word == "--ros-args" or (inside and word == "--"):
                inside, doubt = word != "--", None
            elif isinstance(word, Unknown):  # outside, it may be `--ros-args` itself
                doubt, unknown = word, word if inside else None
            elif not inside:
                unknown = doubt if _OPTIONS.get(word) else None
            elif word in _OPTIONS:
                value = next(left, "")
                enclave = value if _OPTIONS[word] == "enclave" else enclave
                told += [value] if _OPTIONS[word] == "remap" else []
            if unknown is not None:
                enclave = unknown
                told.append(unknown)
        return enclave, [*self._remaps(element, told, source)]

    def _remaps(self, element: Element, told: Iterable[str | Unknown], source: Source) -> Iterator[_Remap]:
        """Remappings as written, `source:=target`; what is for one node of the process, or a scheme, is not read."""
        for text in told:
            origin, sign, target = ("", "", "") if isinstance(text, Unknown) else text.partition(":=")
            if sign and origin and target and ":" not in origin + target:
                yield _Remap(line=element.line, source=origin, target=target)
            else:
                read = text if isinstance(text, Unknown) else Unknown(f"{shown(text)}, which is not read")
                self._not_known(source.location(element.line), "A remapping of a node", read)

    def _components(self, element: Element, scope: Scope, source: Source) -> Iterator[_Node]:
        for component in element.called("composable_node"):
            holds = scope.holds(component)
            if isinstance(holds, Unknown):
                self.doubtful(source.location(component.line), holds)
            if holds is not False:
                yield self._node(component, [], scope, source)

    def _node(self, element: Element, remaps: list[_Remap], scope: Scope, source: Source) -> _Node:
        name: str | Unknown | None = scope.known(element.attributes.get("name", ())) or None
        namespace = scope.below(element)
        for each in element.called("remap"):
            origin, target = (scope.known(each.attributes[end]) for end in ("from", "to"))
            if isinstance(origin, str) and isinstance(target, str):
                remaps.append(_Remap(line=each.line, source=origin, target=target))
            else:
                unknown = next(end for end in (target, origin) if isinstance(end, Unknown))
                self._not_known(source.location(each.line), "A remapping of a node", unknown)
        for remap in reversed(remaps):  # the first that matches counts
            if remap.source in ("__node", "__name"):
                name = remap.target
            elif remap.source == "__ns":
                namespace = remap.target.rstrip("/") or ROOT
        if isinstance(name, str) and not is_node_name(name):
            name = _no(name, "name of a node")
        if isinstance(namespace, str) and not is_path(namespace):
            namespace = _no(namespace, "namespace")
        return _Node(
            kind=element.kind,
            name=name,
            namespace=namespace,
            remaps=tuple(remap for remap in remaps if not remap.source.startswith("__")),
            hidden=scope.remaps,
            location=source.location(element.line),
            file=source,
        )

    def _place(self, node: _Node, enclave: str | Unknown) -> None:
        """Note a node of which the enclave is known or not."""
        if isinstance(enclave, Unknown):
            self._not_known(node.location, "The enclave of a node", enclave)
            return
        self._enclaves.setdefault(enclave, node.location)
        full = node.full_name
        started = IntendedNode(enclave=enclave, name=full, location=node.location)
        self._nodes.setdefault((enclave, full or str(node.location)), started)
        if full:
            for action, name in _OFFERS.get(node.kind, ()):
                right = IntendedRight(
                    enclave=enclave,
                    node=full,
                    action=action,
                    name=joined(full, name),
                    allow=True,
                    location=node.location,
                )
                self._rights.setdefault((enclave, full, action, right.name), right)
        elif node.name is None:
            self.unresolved(node.location, "The program chooses the name of this node; what is below it is not known.")
        else:
            unknown = next(each for each in (node.name, node.namespace) if isinstance(each, Unknown))
            self._not_known(node.location, "The name of a node", unknown)
        self._uses(node, enclave)

    def _uses(self, node: _Node, enclave: str) -> None:
        # launch puts remappings for all before the node's own, and the first that matches counts
        taken = {node.used(name) or name for name in node.hidden}
        for remap in node.remaps:
            location = node.file.location(remap.line)
            source, name = node.used(remap.source) or remap.source, node.used(remap.target)
            if source in taken:
                continue
            taken.add(source)
            if name is None:
                said = f"The name {shown(remap.target)} of a remapping cannot be worked out, or is none"
                self.unresolved(location, f"{said} that a node can use.")
            else:
                used = UsedName(enclave=enclave, node=node.full_name, name=name, location=location)
                self._names.setdefault((enclave, node.full_name, name), used)

    def _container(self, target: str | Unknown) -> str | Unknown:
        """The enclave of the process that components go into, told by the last part of its name."""
        if isinstance(target, Unknown):
            return target
        found = self._called.get(target.rpartition("/")[2], set())
        known = "which is not started here" if not found else "of which there are several"
        return next(iter(found)) if len(found) == 1 else Unknown(f"the container {shown(target)}, {known}")

    def _sets(self, node: str, started: str, variables: Mapping[str, str | Unknown], location: Location) -> None:
        """The variables of a process, apart from the one that says its enclave."""
        for name, value in variables.items():
            if name != OVERRIDE:
                known = value if isinstance(value, str) else None
                found = SetVariable(node=node, started=started, name=name, value=known, location=location)
                self._variables[found] = None

    def _not_known(self, location: Location, what: str, unknown: Unknown) -> None:
        self.unresolved(location, f"{what} depends on {unknown.reason}.")


def _environment(scope: Scope, element: Element | None = None) -> dict[str, str | Unknown]:
    """The values of those of `NAMES` that the launch file sets for a process; the rest come from its own start."""
    found = {name: scope.environment[name] for name in NAMES if name in scope.environment}
    for each in element.called("env") if element is not None else ():
        name = scope.known(each.attributes["name"])
        if isinstance(name, Unknown):
            found |= dict.fromkeys(NAMES, name)
        elif name in NAMES:
            found[name] = scope.known(each.attributes["value"])
    return found


def _prefix(element: Element, scope: Scope) -> str:
    """What stands before the program, as far as it can be told."""
    if PREFIX in element.attributes:
        return scope.shows(element.attributes[PREFIX])
    prefix = scope.arguments.get(PREFIX, "")
    return prefix if isinstance(prefix, str) else ""


def _no(text: str, what: str) -> Unknown:
    return Unknown(f"{shown(text)}, which is no {what}")
