"""From the elements of XML and YAML launch files to actions: both forms have the same elements and attributes.

Sources: launch's and launch_ros's `expose_action` names and their `parse` methods (Humble to Rolling).
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final

from msgspec import Struct

from keystore_audit.intent.launch_actions import (
    Assign,
    AssignEnvironment,
    Condition,
    Declare,
    Group,
    Include,
    LaunchAction,
    LoadComponents,
    NodeKind,
    NodeNames,
    Part,
    PushNamespace,
    Remap,
    SetRemap,
    StartNode,
    StartProcess,
    Text,
    Unknown,
    Unread,
)
from keystore_audit.intent.launch_environment import replaced, speaks_of
from keystore_audit.intent.source import Source, shown
from keystore_audit.intent.substitution import SubstitutionError, parse


class Entity(Struct, frozen=True, kw_only=True):
    """An element with its attributes, as written or, in Python, as read, and the elements in it.

    `kind`: its name, `-` written as `_`.
    """

    kind: str
    line: int
    attributes: Mapping[str, str | Text]
    children: tuple[Entity, ...]

    def called(self, *kinds: str) -> tuple[Entity, ...]:
        """The elements in it of these kinds."""
        return tuple(child for child in self.children if child.kind in kinds)

    def texts(self) -> Iterator[str]:
        """The values of its attributes, and of those of all elements in it."""
        yield from (value for value in self.attributes.values() if isinstance(value, str))
        for child in self.children:
            yield from child.texts()


INERT: Final = frozenset(
    {"log", "log_debug", "log_info", "log_warning", "log_error", "set_parameter", "set_parameters_from_file"}
    | {"set_use_sim_time", "set_ros_log_dir", "shutdown", "lifecycle_transition", "emit_event"}
)
"""Elements that neither start a node nor change the names of one."""

_YES: Final = frozenset({"true", "1", "yes", "on"})
_NO: Final = frozenset({"false", "0", "no", "off"})


def actions(root: Entity, source: Source) -> tuple[LaunchAction, ...]:
    """Read the elements of a whole launch file. Raises UsageError, naming file and line."""
    return _Entities(source).all(root.children)


class _Entities:
    def __init__(self, source: Source) -> None:
        self._source = source

    def all(self, entities: Iterable[Entity]) -> tuple[LaunchAction, ...]:
        return tuple(action for entity in entities if (action := self._action(entity)) is not None)

    def _action(self, entity: Entity) -> LaunchAction | None:
        if entity.kind in INERT:
            return None
        read = _READERS.get(entity.kind)
        if read is None:
            return self._unread(entity)
        return read(self, entity)

    def _unread(self, entity: Entity) -> LaunchAction:
        """An element that is not known, as a loop."""
        said = f"the element {shown(entity.kind)} is not read; it may start nodes or change their names"
        return Unread(**self._where(entity), reason=said, speaks=speaks_of(*entity.texts()))

    def declare(self, entity: Entity) -> LaunchAction:
        """An `<arg>` of the file."""
        default = self._optional(entity, "default")
        name = self._text(entity, "name")
        return Declare(**self._where(entity), name=name, default=default)

    def let(self, entity: Entity) -> LaunchAction:
        """A `<let>`."""
        name, value = self._text(entity, "name"), self._text(entity, "value")
        return Assign(**self._where(entity), name=name, value=value)

    def set_env(self, entity: Entity) -> LaunchAction:
        """A `<set_env>`, or an `<append_env>`, which adds to what nobody knows."""
        value: Text | None = self._text(entity, "value") if entity.kind != "unset_env" else None
        if entity.kind == "append_env":
            value = (Unknown(reason="an environment variable that is added to"),)
        name = self._text(entity, "name")
        return AssignEnvironment(**self._where(entity), name=name, value=value)

    def replace_env(self, entity: Entity) -> LaunchAction:
        """A `<rep_env>`, or a `<reset_env>` or `<pop_env>`, which bring earlier variables back."""
        return replaced(self._values(entity.called("env")), **self._where(entity), earlier=entity.kind != "rep_env")

    def code(self, entity: Entity) -> LaunchAction:
        """What stands for code that is not read."""
        said = "what is not read may start nodes or change their names; record the running system (--graph)"
        return Unread(line=entity.line, reason=said)

    def nothing(self, entity: Entity) -> LaunchAction:
        """A `<push_env>`, which changes no variable."""
        return Group(line=entity.line, actions=())

    def push_namespace(self, entity: Entity) -> LaunchAction:
        """A `<push_ros_namespace>`."""
        namespace = self._text(entity, "namespace")
        return PushNamespace(**self._where(entity), namespace=namespace)

    def set_remap(self, entity: Entity) -> LaunchAction:
        """A `<set_remap>`."""
        return SetRemap(**self._where(entity), remap=self._remap(entity))

    def group(self, entity: Entity) -> LaunchAction:
        """A `<group>`."""
        inner = tuple(child for child in entity.children if child.kind != "keep")
        return Group(
            **self._where(entity),
            actions=self.all(inner),
            scoped=self._switch(entity, "scoped"),
            forwarding=self._switch(entity, "forwarding"),
            given=self._values(entity.called("keep")),
        )

    def timer(self, entity: Entity) -> LaunchAction:
        """A `<timer>`: what happens later changes nothing for what stands behind it."""
        return Group(**self._where(entity), actions=self.all(entity.children), later=True)

    def include(self, entity: Entity) -> LaunchAction:
        """An `<include>`, with `<arg>` or `<let>` for its arguments."""
        path, arguments = self._text(entity, "file"), self._values(entity.called("arg", "let"))
        return Include(**self._where(entity), path=path, arguments=arguments)

    def node(self, entity: Entity) -> LaunchAction:
        """A `<node>`, `<lifecycle_node>` or `<node_container>`."""
        program = self._text(entity, "exec")
        kind = {"lifecycle_node": NodeKind.LIFECYCLE, "node_container": NodeKind.CONTAINER}.get(entity.kind)
        return StartNode(
            **self._where(entity),
            kind=kind or NodeKind.PLAIN,
            names=self._names(entity),
            command=(self._optional(entity, "pkg") or (), program),
            arguments=self._words(entity, "args"),
            ros_arguments=self._words(entity, "ros_args"),
            environment=self._values(entity.called("env")),
            prefix=self._optional(entity, "launch-prefix"),
            components=self._components(entity),
        )

    def load(self, entity: Entity) -> LaunchAction:
        """A `<load_composable_node>`."""
        target = self._text(entity, "target")
        components = self._components(entity)
        return LoadComponents(**self._where(entity), target=target, components=components)

    def process(self, entity: Entity) -> LaunchAction:
        """An `<executable>`."""
        return StartProcess(
            **self._where(entity),
            command=(self._optional(entity, "cmd") or (),),
            environment=self._values(entity.called("env")),
            prefix=self._optional(entity, "launch-prefix"),
        )

    def _components(self, entity: Entity) -> tuple[NodeNames, ...]:
        found = []
        for component in entity.called("composable_node"):
            self._text(component, "plugin")
            found.append(self._names(component))
        return tuple(found)

    def _names(self, entity: Entity) -> NodeNames:
        return NodeNames(
            line=entity.line,
            name=self._optional(entity, "name"),
            namespace=self._optional(entity, "namespace"),
            remaps=tuple(self._remap(remap) for remap in entity.called("remap")),
            conditions=self._conditions(entity) if entity.kind == "composable_node" else (),
        )

    def _remap(self, entity: Entity) -> Remap:
        return Remap(line=entity.line, source=self._text(entity, "from"), target=self._text(entity, "to"))

    def _values(self, entities: Iterable[Entity]) -> tuple[tuple[Text, Text], ...]:
        return tuple((self._text(entity, "name"), self._text(entity, "value")) for entity in entities)

    def _where(self, entity: Entity) -> dict[str, Any]:
        """What every action has: its line and conditions."""
        return {"line": entity.line, "conditions": self._conditions(entity)}

    def _conditions(self, entity: Entity) -> tuple[Condition, ...]:
        found = ((self._optional(entity, key), key == "unless") for key in ("if", "unless"))
        return tuple(Condition(text=text, negated=negated) for text, negated in found if text is not None)

    def _switch(self, entity: Entity, attribute: str) -> bool:
        """An attribute that is true unless it says otherwise."""
        written = str(entity.attributes.get(attribute, "true"))
        if written.strip().lower() not in _YES | _NO:
            found = f"expected {attribute!r} to be true or false, found {shown(written)}"
            raise self._source.malformed(entity.line, found)
        return written.strip().lower() in _YES

    def _text(self, entity: Entity, attribute: str) -> Text:
        text = self._optional(entity, attribute)
        if text is None:
            raise self._source.malformed(entity.line, f"expected {entity.kind!r} to have {attribute!r}, found none")
        return text

    def _optional(self, entity: Entity, attribute: str) -> Text | None:
        written = entity.attributes.get(attribute)
        if written is None or isinstance(written, tuple):
            return written
        try:
            return parse(written)
        except SubstitutionError as error:
            raise self._source.malformed(entity.line, f"in {attribute!r} {error}") from None

    def _words(self, entity: Entity, attribute: str) -> tuple[Text, ...]:
        """A command line: split at blanks as a shell does, but for what substitutions give."""
        words: list[list[Part]] = [[]]
        for part in self._optional(entity, attribute) or ():
            if not isinstance(part, str):
                words[-1].append(part)
                continue
            try:
                tokens = shlex.split(part)
            except ValueError:
                raise self._source.malformed(entity.line, f"a quote in {attribute!r} opened and never closed") from None
            if part[0].isspace() or not tokens:
                words.append([])
            for number, token in enumerate(tokens):
                if number:
                    words.append([])
                words[-1].append(token)
            if part[-1].isspace():
                words.append([])
        return tuple(tuple(word) for word in words if word)


_READERS: Final[Mapping[str, Callable[[_Entities, Entity], LaunchAction]]] = {
    "arg": _Entities.declare,
    "let": _Entities.let,
    "set_env": _Entities.set_env,
    "unset_env": _Entities.set_env,
    "append_env": _Entities.set_env,
    "rep_env": _Entities.replace_env,
    "reset_env": _Entities.replace_env,
    "pop_env": _Entities.replace_env,
    "push_env": _Entities.nothing,
    "push_ros_namespace": _Entities.push_namespace,
    "push_namespace": _Entities.push_namespace,
    "set_remap": _Entities.set_remap,
    "group": _Entities.group,
    "timer": _Entities.timer,
    "ros_timer": _Entities.timer,
    "include": _Entities.include,
    "node": _Entities.node,
    "lifecycle_node": _Entities.node,
    "node_container": _Entities.node,
    "load_composable_node": _Entities.load,
    "executable": _Entities.process,
    "code": _Entities.code,
}
