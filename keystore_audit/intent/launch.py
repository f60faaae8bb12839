"""Launch files, read and never run: which nodes start, in which enclaves, and which names they use.

XML, YAML and Python launch files become the same elements (`launch_elements`), which are followed here as `ros2 launch`
would, with what is set in them. What only a run would tell is noted as Unresolved, with its line (docs/intent.md).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final

from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.intent.intent import Intent
from keystore_audit.intent.launch_elements import NAMES, Element, Scope, Unknown, read_xml, read_yaml, speaks_of
from keystore_audit.intent.launch_nodes import Nodes
from keystore_audit.intent.source import Directory, Source, Unreadable, read_source, shown
from keystore_audit.keystore.root import Root

MAX_ACTIONS: Final = 10_000
"""Elements followed, those of included files each time: 5,000 nodes in their groups."""

MAX_INSIDE: Final = 100_000
"""Remappings, variables and components of these; includes can repeat a few files very often."""

MAX_CHARACTERS: Final = 1 << 20
"""Length of all files of a launch together, each counted once: the largest systems have a tenth."""

MAX_NESTING: Final = 64
"""Groups and included files within each other; a file that includes itself ends here."""

MAX_SET: Final = 200
"""Arguments and environment variables set at one time: each group copies them."""

MAX_REMAPS: Final = 32
"""Remappings for all nodes at one time: each node looks at them."""

_INERT: Final = frozenset(
    {"log", "log_debug", "log_info", "log_warning", "log_error", "set_parameter", "set_parameters_from_file"}
    | {"set_use_sim_time", "set_ros_log_dir", "shutdown", "lifecycle_transition", "emit_event", "push_env"}
)
"""Elements that neither start a node nor change the names of one."""

_GROUPS: Final = frozenset({"group", "timer", "ros_timer"})
"""Elements that are followed one by one."""

UNREAD: Final = "What is not read may start nodes or change their names; record the running system (--graph)."

_YES: Final = frozenset({"true", "1", "yes", "on"})
_NO: Final = frozenset({"false", "0", "no", "off"})


def read_launch(path: Path, arguments: Mapping[str, str]) -> Intent:
    """Read the launch file at `path`, with values for its arguments, as `--launch-argument` gives them.

    It may include what is below its own directory. Raises UsageError, naming file and line, for what is no launch file
    or larger than the limits.
    """
    source = read_source(path)
    read = _form(source)
    if read is None:
        raise source.malformed(None, "expected a launch file that ends in .xml, .launch, .yaml, .yml or .py")
    with Root.open(source.directory) as root:
        directory = Directory(os.path.dirname(path), source.directory, root)
        launch = _Launch(directory, {})
        launch.file(source, read, Scope(arguments=dict(arguments)), 0)
        if launch.later and launch.set:  # what is set behind something may be set when that comes
            launch = _Launch(directory, launch.set)
            launch.file(source, read, Scope(arguments=dict(arguments)), 0)
        return launch.nodes.intent(launch.files)


def _form(source: Source) -> Callable[[Source], Element] | None:
    if source.path.endswith(".py"):
        from keystore_audit.intent.launch_python import read_python

        return read_python
    readers = {".xml": read_xml, ".launch": read_xml, ".yaml": read_yaml, ".yml": read_yaml}
    return next((read for suffix, read in readers.items() if source.path.endswith(suffix)), None)


class _Launch:
    """One launch being followed. `set`: what the variables of `NAMES` are set to; `later`: whether anything comes
    later. `meanwhile`: what `set` will be.
    """

    def __init__(self, directory: Directory, meanwhile: Mapping[str, set[str | Unknown]]) -> None:
        self.files: list[GivenFile] = []
        self.nodes = Nodes()
        self.set: dict[str, set[str | Unknown]] = {}
        self.later = False
        self._directory = directory
        self._meanwhile = meanwhile
        self._read: dict[str, Element] = {}
        self._characters = 0
        self._followed = 0
        self._inside = 0
        self._noted: dict[str, int] = {}
        self._searched: set[int] = set()

    def file(self, source: Source, read: Callable[[Source], Element], scope: Scope, depth: int) -> None:
        """Follow a whole file."""
        if source.real not in self._read:
            self._characters += len(source.text)
            if self._characters > MAX_CHARACTERS:
                raise source.malformed(None, f"with it, the launch has more than {MAX_CHARACTERS} characters")
            self.files.append(source.file)
            self._read[source.real] = read(source)
        self._follow(self._read[source.real].children, scope, source, depth)

    def _follow(self, elements: Iterable[Element], scope: Scope, source: Source, depth: int) -> None:
        for element in elements:
            self._followed += 1
            if element.kind not in _GROUPS:
                self._inside += sum(1 + len(child.children) for child in element.children)
            if self._followed > MAX_ACTIONS or self._inside > MAX_INSIDE or depth > MAX_NESTING:
                limits = f"more than {MAX_ACTIONS} actions, or {MAX_NESTING} deep, which are not followed"
                raise source.malformed(element.line, limits)
            holds = scope.holds(element)
            if holds is True:
                self._perform(element, scope, source, depth)
            elif isinstance(holds, Unknown):
                self.nodes.doubtful(source.location(element.line), holds)
                maybe = scope.copy()
                self._perform(element, maybe, source, depth)
                scope.doubt(maybe, holds)
            if len(scope.arguments) + len(scope.environment) > MAX_SET or len(scope.remaps) > MAX_REMAPS:
                limits = f"more than {MAX_SET} values or {MAX_REMAPS} remappings set"
                raise source.malformed(element.line, f"{limits}, which are not followed")

    def _perform(self, element: Element, scope: Scope, source: Source, depth: int) -> None:
        match element.kind:
            case "node" | "lifecycle_node" | "node_container":
                self.nodes.start(element, scope, source)
                self._later(element.called("timer"), scope, source, depth)
            case "executable":
                self.nodes.process(element, scope, source)
                self._later(element.called("timer"), scope, source, depth)
            case "load_composable_node":
                self.nodes.load(element, scope, source)
            case "group":
                self._group(element, scope, source, depth)
            case "timer" | "ros_timer":
                self._later(element.children, scope, source, depth)
            case "include":
                self._include(element, scope, source, depth)
            case kind if kind not in _INERT and not self._sets(element, scope, source.location(element.line)):
                self._unread(element, scope, source)

    def _sets(self, element: Element, scope: Scope, location: Location) -> bool:
        """Whether the element sets something; if so, it is set."""
        match element.kind:
            case "arg":
                self._declare(element, scope, location)
            case "let":
                self._let(element, scope, location)
            case "set_env" | "append_env" | "unset_env":
                self._variable(element, scope, location)
            case "rep_env" | "reset_env" | "pop_env":
                self._set(scope, dict.fromkeys(NAMES, Unknown("an environment that is replaced")))
            case "push_ros_namespace" | "push_namespace":
                scope.namespace = scope.below(element)
            case "set_remap":
                self._remap(element, scope, location)
            case _:
                return False
        return True

    def _unread(self, element: Element, scope: Scope, source: Source) -> None:
        """An unknown element, as a loop, or code: one note a file, and whether it mentions security."""
        if id(element) not in self._searched:
            self._searched.add(id(element))
            word = element.words() if element.kind == "speaks" else speaks_of(element.words())
            self.nodes.speaking(source.location(element.line), word)
        self.nodes.unread(self._noted.setdefault(source.real, element.line), UNREAD, scope, source)

    def _declare(self, element: Element, scope: Scope, location: Location) -> None:
        """An argument of the file, which the caller may set; without default the caller has to."""
        name = self._name(element, scope, location)
        if name is None or name in scope.arguments:
            return
        if "default" in element.attributes:
            scope.arguments[name] = scope.known(element.attributes["default"])
            return
        said = f"The argument {shown(name)} has no default, and no value was given with --launch-argument."
        self.nodes.unresolved(location, said)
        scope.arguments[name] = Unknown(f"the argument {shown(name)}, which has no value")

    def _let(self, element: Element, scope: Scope, location: Location) -> None:
        name = self._name(element, scope, location)
        if name is not None:
            scope.arguments[name] = scope.known(element.attributes["value"])

    def _name(self, element: Element, scope: Scope, location: Location) -> str | None:
        """The name of an argument or variable; None, with a note, where it is unknown."""
        name = scope.known(element.attributes["name"])
        if isinstance(name, str):
            return name
        said = f"The name of what is set here depends on {name.reason}; other texts may depend on it."
        self.nodes.unresolved(location, said)
        return None

    def _variable(self, element: Element, scope: Scope, location: Location) -> None:
        name = self._name(element, scope, location)
        value: str | Unknown = scope.known(element.attributes.get("value", ()))
        if element.kind == "append_env":
            value = Unknown("an environment variable that is added to")
        elif name is None:
            value = Unknown("an environment variable whose name cannot be told")
        self._set(scope, dict.fromkeys(NAMES if name is None else (name,), value))

    def _set(self, scope: Scope, values: Mapping[str, str | Unknown]) -> None:
        scope.environment |= values
        for name in values.keys() & NAMES:
            self.set.setdefault(name, set()).add(values[name])

    def _remap(self, element: Element, scope: Scope, location: Location) -> None:
        """A remapping for all nodes of the group: which of them use the name is not said."""
        source, target = (scope.known(element.attributes[end]) for end in ("from", "to"))
        said = f"depends on {target.reason}" if isinstance(target, Unknown) else f"is to {shown(target)}"
        self.nodes.unresolved(location, f"A remapping for all nodes {said}; which of them use the name is not said.")
        if isinstance(source, str):
            scope.remaps = (*scope.remaps, source)

    def _group(self, element: Element, scope: Scope, source: Source, depth: int) -> None:
        """A group; what is set in it ends with it if it is `scoped`."""
        scoped = scope.known(element.attributes.get("scoped", ("true",)))
        word = scoped.strip().lower() if isinstance(scoped, str) else ""
        if isinstance(scoped, str) and word not in _YES | _NO:
            expected = f"expected 'scoped' to be true or false, found {shown(scoped)}"
            raise source.malformed(element.line, expected)
        if isinstance(scoped, Unknown) or "forwarding" in element.attributes or element.called("keep"):
            self._unread(element, scope, source)
        else:
            self._follow(element.children, scope if word in _NO else scope.copy(), source, depth + 1)

    def _later(self, elements: tuple[Element, ...], scope: Scope, source: Source, depth: int) -> None:
        """What comes when a timer ends or an event happens, in the environment that launch has then."""
        if not elements:
            return
        self.later = True
        inner = scope.copy()
        for name, values in self._meanwhile.items():
            if values != {inner.environment.get(name)}:
                inner.environment[name] = Unknown(f"when {name} is set")
        self._follow(elements, inner, source, depth + 1)

    def _include(self, element: Element, scope: Scope, source: Source, depth: int) -> None:
        """Another launch file, with values for its arguments; what it sets stays set."""
        for argument in element.called("arg", "let"):
            if "value" not in argument.attributes:
                raise source.malformed(argument.line, "expected 'arg' to have 'value', found none")
            self._let(argument, scope, source.location(argument.line))
        path = scope.known(element.attributes["file"])
        if isinstance(path, Unknown):
            reason = f"its place depends on {path.reason}"
            self.nodes.unread(element.line, f"The included launch file is not read: {reason}.", scope, source)
            return
        try:
            included = self._directory.included(path)
        except Unreadable as error:
            reason = str(error)
        else:
            read, reason = _form(included), "it ends in neither .xml, .launch, .yaml, .yml nor .py"
            if read is not None:
                self.file(included, read, scope, depth + 1)
                return
        said = f"The included launch file {shown(path.rpartition('/')[2])} is not read: {reason}."
        self.nodes.unread(element.line, said, scope, source)
