"""Launch files, read and never run: which nodes start, in which enclaves, and which names they use.

XML, YAML and Python launch files become the same actions (`launch_actions`), which are followed here as `ros2 launch`
would, with what is set in them. What only a run would tell is noted as Unresolved, with its line (docs/intent.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from keystore_audit.given import GivenFile
from keystore_audit.intent.intent import Intent
from keystore_audit.intent.launch_actions import (
    Assign,
    AssignEnvironment,
    Declare,
    Group,
    Include,
    LaunchAction,
    LoadComponents,
    PushNamespace,
    SetRemap,
    StartNode,
    StartProcess,
    Text,
    Unknown,
    Unread,
)
from keystore_audit.intent.launch_environment import NAMES, is_lookup
from keystore_audit.intent.launch_nodes import Nodes
from keystore_audit.intent.launch_scope import GlobalRemap, Scope
from keystore_audit.intent.ros_names import ROOT
from keystore_audit.intent.source import Directory, Source, Unreadable, read_source, shown
from keystore_audit.keystore.root import Root

MAX_ACTIONS: Final = 10_000
"""Actions followed, those of included files each time: 5,000 nodes in their groups."""

MAX_CHARACTERS: Final = 1 << 20
"""Length of all files of a launch together, each counted once: the largest systems have a tenth."""

MAX_NESTING: Final = 16
"""Launch files that include each other; a file that includes itself ends here."""

MAX_GROUPS: Final = 64
"""Groups within each other; in Python a name can stand for a group that holds itself as it was before."""

MAX_SET: Final = 200
"""Arguments and environment variables set at one time: each group copies them."""

MAX_REMAPS: Final = 32
"""Remappings for all nodes at one time: each node keeps them."""

_FORMS: Final = {".xml": "xml", ".yaml": "yaml", ".yml": "yaml", ".py": "python"}


def read_launch(path: Path, arguments: Mapping[str, str]) -> Intent:
    """Read the launch file at `path`, with values for its arguments, as `--launch-argument` gives them.

    It may include what is below its own directory. Raises UsageError, naming file and line, for what is no launch file
    or larger than the limits.
    """
    source = read_source(path)
    form = _form(source)
    if form is None:
        raise source.malformed(None, "expected a launch file that ends in .xml, .yaml, .yml or .py")
    with Root.open(source.directory) as root:
        directory = Directory(path, source, root)
        launch = _Launch(directory)
        launch.file(source, form, Scope(arguments=dict(arguments)), 1)
        if launch.later and launch.set:  # what is set behind something may be set when that comes
            launch.begin(launch.set)
            launch.file(source, form, Scope(arguments=dict(arguments)), 1)
        return launch.nodes.intent(launch.files)


def _form(source: Source) -> str | None:
    return next((form for suffix, form in _FORMS.items() if source.path.endswith(suffix)), None)


def _actions(source: Source, form: str) -> tuple[LaunchAction, ...]:
    if form == "python":
        from keystore_audit.intent.launch_python import read

        return read(source)
    from keystore_audit.intent.launch_entities import actions

    if form == "yaml":
        from keystore_audit.intent.launch_yaml import read as read_yaml

        return actions(read_yaml(source), source)
    from keystore_audit.intent.launch_xml import read as read_xml

    return actions(read_xml(source), source)


class _Launch:
    """One launch being followed. `set`: what the variables of `NAMES` are set to for all of it, not in a group alone;
    `later`: whether anything comes later. `meanwhile`: what `set` will be.
    """

    def __init__(self, directory: Directory) -> None:
        self.files: list[GivenFile] = []
        self._directory = directory
        self._read: dict[str, tuple[LaunchAction, ...]] = {}
        self._characters = 0
        self.begin({})

    def begin(self, meanwhile: Mapping[str, set[str | Unknown]]) -> None:
        """Nothing is followed yet; what was read stays."""
        self.nodes = Nodes()
        self.set: dict[str, set[str | Unknown]] = {}
        self.later = False
        self._meanwhile = meanwhile
        self._for_all = True
        self._followed = 0
        self._groups = 0

    def file(self, source: Source, form: str, scope: Scope, nesting: int) -> None:
        """Follow a whole file."""
        if source.real not in self._read:
            self._characters += len(source.text)
            if self._characters > MAX_CHARACTERS:
                raise source.malformed(None, f"with it, the launch has more than {MAX_CHARACTERS} characters")
            self.files.append(source.file)
            self._read[source.real] = _actions(source, form)
        self._follow(self._read[source.real], scope, source, nesting)

    def _follow(self, actions: Iterable[LaunchAction], scope: Scope, source: Source, nesting: int) -> None:
        for action in actions:
            self._followed += 1
            if self._followed > MAX_ACTIONS:
                raise source.malformed(action.line, f"more than {MAX_ACTIONS} actions, which are not followed")
            holds = scope.holds(action.conditions, source)
            if holds is True:
                self._perform(action, scope, source, nesting)
            elif isinstance(holds, Unknown):
                self.nodes.doubtful(source.location(action.line), holds)
                maybe = scope.copy()
                self._perform(action, maybe, source, nesting)
                scope.doubt(maybe, holds.reason)
            if len(scope.arguments) + len(scope.environment) > MAX_SET or len(scope.remaps) > MAX_REMAPS:
                limits = f"more than {MAX_SET} values or {MAX_REMAPS} remappings set"
                raise source.malformed(action.line, f"{limits}, which are not followed")

    def _perform(self, action: LaunchAction, scope: Scope, source: Source, nesting: int) -> None:
        if isinstance(action, StartNode):
            self.nodes.start(action, scope, source)
        elif isinstance(action, StartProcess):
            self.nodes.process(action, scope, source)
        elif isinstance(action, LoadComponents):
            self.nodes.load(action, scope, source)
        elif isinstance(action, Group):
            self._group(action, scope, source, nesting)
        elif isinstance(action, Include):
            self._include(action, scope, source, nesting)
        elif isinstance(action, Unread):
            self.nodes.unread(action.line, f"{action.reason[0].upper()}{action.reason[1:]}.", scope, source)
            self.nodes.speaking(source.location(action.line), action.speaks)
        else:
            self._set(action, scope, source)

    def _set(self, action: LaunchAction, scope: Scope, source: Source) -> None:
        if isinstance(action, Declare):
            self._declare(action, scope, source)
        elif isinstance(action, Assign):
            self._assign(scope.arguments, action, scope, source)
        elif isinstance(action, AssignEnvironment):
            self._assign(scope.environment, action, scope, source)
        elif isinstance(action, PushNamespace):
            scope.namespace = scope.below(action.namespace, source)
        elif isinstance(action, SetRemap):
            self._remap(action, scope, source)

    def _declare(self, action: Declare, scope: Scope, source: Source) -> None:
        name = self._name(action, action.name, scope, source)
        if name is None or name in scope.arguments:
            return
        if action.default is not None:
            scope.arguments[name] = scope.known(action.default, source)
            return
        said = f"The argument {shown(name)} has no default, and no value was given with --launch-argument."
        self.nodes.unresolved(source.location(action.line), said)
        scope.arguments[name] = Unknown(reason=f"the argument {shown(name)}, which has no value")

    def _assign(
        self, values: dict[str, str | Unknown], action: Assign | AssignEnvironment, scope: Scope, source: Source
    ) -> None:
        name = self._name(action, action.name, scope, source)
        if name is None:
            if isinstance(action, AssignEnvironment):
                values |= dict.fromkeys(NAMES, Unknown(reason="an environment variable whose name cannot be told"))
                self._note(values, NAMES)
            return
        if isinstance(action, AssignEnvironment) and action.value and is_lookup(name, action.value):
            return
        if action.value is not None:
            values[name] = scope.known(action.value, source)
        elif isinstance(action, AssignEnvironment):
            values[name] = ""
        else:
            values.pop(name, None)
        if isinstance(action, AssignEnvironment) and name in NAMES:
            self._note(values, (name,))

    def _note(self, environment: Mapping[str, str | Unknown], names: Iterable[str]) -> None:
        """What variables are set to, if that stays."""
        for name in names if self._for_all else ():
            self.set.setdefault(name, set()).add(environment[name])

    def _name(self, action: LaunchAction, text: Text, scope: Scope, source: Source) -> str | None:
        """The name of an argument or variable; None, and said, where it cannot be told."""
        name = scope.known(text, source)
        if isinstance(name, str):
            return name
        said = f"The name of what is set here depends on {name.reason}; other texts may depend on it."
        self.nodes.unresolved(source.location(action.line), said)
        return None

    def _remap(self, action: SetRemap, scope: Scope, source: Source) -> None:
        known = scope.remapped(action.remap, source)
        if isinstance(known, Unknown):
            said = f"A remapping for all nodes of the group depends on {known.reason}."
            self.nodes.unresolved(source.location(action.line), said)
            return
        remap = GlobalRemap(line=action.remap.line, file=source, source=known[0], target=known[1])
        scope.remaps.append(remap)
        self.nodes.remap(remap)

    def _group(self, action: Group, scope: Scope, source: Source, nesting: int) -> None:
        inner = scope.copy() if action.scoped else scope
        given = [(scope.known(name, source), scope.known(value, source)) for name, value in action.given]
        if not action.forwarding:
            inner.arguments, inner.environment, inner.namespace, inner.remaps = {}, {}, ROOT, []
        for name, value in given:
            if isinstance(name, str):
                inner.arguments[name] = value
            else:
                self.nodes.unresolved(source.location(action.line), f"The name of an argument is {name.reason}.")
        self._groups += 1
        if self._groups > MAX_GROUPS:
            raise source.malformed(action.line, f"groups more than {MAX_GROUPS} deep, which are not followed")
        for_all, self.later = self._for_all, self.later or action.later
        self._for_all = action.later or (for_all and not action.scoped)
        for name, values in self._meanwhile.items() if action.later else ():
            if values != {inner.environment.get(name)}:
                inner.environment[name] = Unknown(reason=f"when {name} is set")
        self._follow(action.actions, inner, source, nesting)
        self._groups, self._for_all = self._groups - 1, for_all

    def _include(self, action: Include, scope: Scope, source: Source, nesting: int) -> None:
        location = source.location(action.line)
        for name, value in action.arguments:
            known = scope.known(name, source)
            if isinstance(known, str):
                scope.arguments[known] = scope.known(value, source)
            else:
                self.nodes.unresolved(location, f"The name of an argument depends on {known.reason}.")
        path = scope.known(action.path, source)
        if isinstance(path, Unknown):
            said = f"The included launch file is not read: its place depends on {path.reason}."
            self.nodes.unread(action.line, said, scope, source)
            return
        if nesting >= MAX_NESTING:
            raise source.malformed(action.line, f"includes more than {MAX_NESTING} deep, which are not followed")
        called = shown(path.rpartition("/")[2])
        try:
            included = self._directory.included(path)
        except Unreadable as error:
            self.nodes.unread(action.line, f"The included launch file {called} is not read: {error}.", scope, source)
            return
        form = _form(included)
        if form is None:
            said = f"The included launch file {called} is not read: it ends in neither .xml, .yaml, .yml nor .py."
            self.nodes.unread(action.line, said, scope, source)
            return
        self.file(included, form, scope, nesting + 1)
