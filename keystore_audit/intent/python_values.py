"""What expressions of a Python launch file stand for: texts, lists, and the elements of launch's own classes."""

from __future__ import annotations

import ast
import posixpath
import shlex
from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from msgspec import Struct

from keystore_audit.intent.launch_elements import (
    COMMANDS,
    INSTALLED,
    REQUIRED,
    Element,
    Part,
    Reference,
    Text,
    Unknown,
    bounded,
)
from keystore_audit.intent.source import Source

MAX_DEPTH: Final = 64
"""Expressions within each other."""

MAX_VALUES: Final = 100_000
"""Values of all lists that are gone through: `x = [x, x]` doubles each time."""

CLASSES: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "DeclareLaunchArgument": ("arg", ("name",)),
    "SetLaunchConfiguration": ("let", ("name", "value")),
    "SetEnvironmentVariable": ("set_env", ("name", "value")),
    "AppendEnvironmentVariable": ("append_env", ("name", "value")),
    "UnsetEnvironmentVariable": ("unset_env", ("name",)),
    "ReplaceEnvironmentVariables": ("rep_env", ("environment",)),
    "ResetEnvironment": ("reset_env", ()),
    "PushEnvironment": ("push_env", ()),
    "PopEnvironment": ("pop_env", ()),
    "SetRemap": ("set_remap", ("src", "dst")),
    **dict.fromkeys(("PushRosNamespace", "PushROSNamespace"), ("push_ros_namespace", ("namespace",))),
    "GroupAction": ("group", ("actions",)),
    "IncludeLaunchDescription": ("include", ("launch_description_source",)),
    "Node": ("node", ()),
    "LifecycleNode": ("lifecycle_node", ()),
    "ComposableNodeContainer": ("node_container", ()),
    "ComposableNode": ("composable_node", ()),
    "LoadComposableNodes": ("load_composable_node", ()),
    "ExecuteProcess": ("executable", ()),
    "LogInfo": ("log", ()),
    **dict.fromkeys(("SetParameter", "SetParametersFromFile", "SetUseSimTime"), ("log", ("name", "value"))),
    **dict.fromkeys(("TimerAction", "OnProcessExit", "OnProcessStart", "OnShutdown"), ("timer", ())),
    "RegisterEventHandler": ("timer", ("event_handler",)),
}
"""By class of launch and launch_ros (Humble to Rolling): the element that it is, and its arguments by position."""

_ATTRIBUTES: Final[Mapping[str, str]] = {
    **{name: name for name in ("forwarding", "name", "namespace", "plugin", "scoped", "value")},
    "default_value": "default",
    "dst": "to",
    "executable": "exec",
    "launch_description_source": "file",
    "node_executable": "exec",
    "node_name": "name",
    "node_namespace": "namespace",
    "node_plugin": "plugin",
    "package": "pkg",
    "prefix": "launch-prefix",
    "src": "from",
    "target_container": "target",
}
"""Arguments that are texts, and the attribute of the element that each is."""

_WITHIN: Final = frozenset({"actions", "event_handler", "composable_node_descriptions"})
_LATER: Final = frozenset({"on_exit", "on_start", "on_shutdown"})
"""Arguments that hold elements; those that come when the process has ended, or started."""

_PAIRS: Final[Mapping[str, tuple[str, str, str]]] = {
    "remappings": ("remap", "from", "to"),
    "launch_arguments": ("arg", "name", "value"),
    "launch_configurations": ("keep", "name", "value"),
    "additional_env": ("env", "name", "value"),
}
"""Arguments that hold pairs, and what each of those is."""

_TRANSPARENT: Final = frozenset(
    {"TextSubstitution", *(f"{form}LaunchDescriptionSource" for form in ("Python", "XML", "YAML", "Any", "Frontend"))}
)
"""Classes that stand for their first argument."""

_OWN_PACKAGES: Final = frozenset({"launch", "launch_ros", "launch_xml", "launch_yaml"})


class Imported(Struct, frozen=True):
    """A module, class or function, with dots."""

    path: str


Value = Text | list["Value"] | dict[str, "Value"] | Element | Imported | None
"""A list may grow while statements are followed, until it is used. A condition is an element with `if` or `unless`."""

LOST: Final[Text] = (Unknown("what only running the file works out"),)


class Expressions:
    """Works out expressions. `noted`: what may start nodes; `unread`: that, and all other code that is not read."""

    def __init__(self, source: Source, told: set[str], shared: set[str]) -> None:
        """Nothing is known but where the file is. `told`: names that mean one thing in all of the file; `shared`: names
        in code that is not read and may change lists.
        """
        self.noted: list[ast.AST] = []
        self.unread: list[ast.AST] = []
        self._source = source
        self._told = told
        self._shared = shared
        self._names: dict[str, Value] = {"__file__": (source.real,)}
        self._used: set[str] = set()
        self._values = 0

    def _note(self, node: ast.AST) -> Element:
        """Something that may start nodes."""
        self.noted.append(node)
        self.unread.append(node)
        return code(node)

    def _opaque(self, node: ast.expr, reason: str = "an expression that only running the file works out") -> Text:
        """An expression that is not read; it may add to lists that it names."""
        self.unread.append(node)
        return (Unknown(reason),)

    def _value(self, node: ast.expr, depth: int = 0) -> Value:
        if depth > MAX_DEPTH:
            return self._opaque(node, f"an expression more than {MAX_DEPTH} deep")
        match node:
            case ast.Constant(plain):
                return _plain(plain)
            case ast.Name(name) if name in self._names:
                return self._named(node, name)
            case ast.Attribute(holder, name):
                held = self._value(holder, depth + 1)
                return Imported(f"{held.path}.{name}") if isinstance(held, Imported) else self._opaque(node)
            case ast.List(parts) | ast.Tuple(parts):
                return self._list(parts, depth)
            case ast.Dict(keys, values) if all(isinstance(key, ast.Constant) for key in keys):
                names = [str(key.value) for key in keys if isinstance(key, ast.Constant)]
                return dict(zip(names, [self._value(value, depth + 1) for value in values], strict=True))
            case ast.JoinedStr(pieces):
                return self._sum(node, [self._value(piece, depth + 1) for piece in pieces])
            case ast.BinOp(left, ast.Add(), right):
                return self._sum(node, [self._value(left, depth + 1), self._value(right, depth + 1)])
            case ast.FormattedValue(value, -1, None) | ast.Call(ast.Attribute(value, "items"), []):
                return self._value(value, depth + 1)
            case ast.Call():
                return self._call(node, depth)
        return self._opaque(node)

    def _named(self, node: ast.Name, name: str) -> Value:
        """What the name holds. Of a list that may have changed, the elements are started all the same."""
        self._used.add(name)
        held = self._names[name]
        if name not in self._shared or not isinstance(held, (list, dict)):
            return held
        if isinstance(held, dict) or not all(isinstance(each, Element) for each in held):
            return LOST
        self._note(node)
        return held

    def _list(self, parts: Iterable[ast.expr], depth: int) -> Value:
        found: list[Value] = []
        for part in parts:
            value = self._value(part.value if isinstance(part, ast.Starred) else part, depth + 1)
            if not isinstance(part, ast.Starred):
                found.append(value)
            else:
                found += value if isinstance(value, list) else [self._note(part)]
            self._spend(len(found))
        return found

    def _sum(self, node: ast.expr, parts: list[Value]) -> Value:
        """Lists, or texts without a substitution in them: those are objects, which Python does not add."""
        if len(parts) == 2 and all(isinstance(each, list) for each in parts):
            return [each for part in parts if isinstance(part, list) for each in part]
        pieces = [piece for part in parts if isinstance(part, tuple) for piece in part]
        plain = all(isinstance(part, tuple) for part in parts) and not any(isinstance(p, Reference) for p in pieces)
        return bounded(pieces) if plain else self._opaque(node)

    def _call(self, node: ast.Call, depth: int) -> Value:
        function = self._value(node.func, depth + 1)
        spread = any(isinstance(each, ast.Starred) for each in node.args) or not all(each.arg for each in node.keywords)
        if not isinstance(function, Imported) or spread:
            return self._opaque(node, "the result of a function, which is not called")
        name = function.path.rpartition(".")[2]
        given = [self._value(each, depth + 1) for each in node.args]
        named = {str(each.arg): self._value(each.value, depth + 1) for each in node.keywords}
        if name in INSTALLED:
            return (Unknown(INSTALLED[name]),)
        if name in COMMANDS:
            return self._opaque(node, COMMANDS[name])
        if function.path.partition(".")[0] in _OWN_PACKAGES:
            return self._made(node, name, given, named)
        texts = [self._text(each) for each in given]
        first = _literal(texts[0]) if texts else None
        match function.path:
            case "os.path.join" if texts:
                return _path(texts)
            case "os.path.dirname" if first is not None:
                return (posixpath.dirname(first),)
            case "os.path.realpath" | "os.path.abspath" if first is not None and first.startswith("/"):
                return texts[0]
        return self._opaque(node, "the result of a function, which is not called")

    def _made(self, node: ast.Call, name: str, given: list[Value], named: dict[str, Value]) -> Value:
        """What calling a class of launch or launch_ros makes."""
        first = given[0] if given else next(iter(named.values()), None)
        second = given[1] if len(given) > 1 else named.get("default", named.get("default_value"))
        match name:
            case "LaunchDescription":
                return [*self._elements(node, first)]
            case "IfCondition" | "UnlessCondition":
                word = "if" if name == "IfCondition" else "unless"
                return Element(kind="condition", line=node.lineno, attributes={word: self._text(first)})
            case "LaunchConfiguration" | "EnvironmentVariable":
                return self._reference(node, name, self._text(first), second)
            case "ThisLaunchFileDir":
                return (self._source.directory,)
            case "PathJoinSubstitution" if isinstance(first, list):
                return _path([self._text(each) for each in first])
            case _ if name in _TRANSPARENT:
                return self._text(first)
        kind, positions = CLASSES.get(name, ("", ()))
        if not kind or len(given) > len(positions):
            return self._opaque(node, f"what {name} makes, which is not read")
        return self._element(node, kind, dict(zip(positions, given, strict=False)) | named)

    def _reference(self, node: ast.Call, kind: str, name: Text, default: Value) -> Text:
        """An argument or variable, whose name and default have to be literal."""
        word, otherwise = _literal(name), None if default is None else _literal(self._text(default))
        if not word or (default is not None and otherwise is None):
            return self._opaque(node, "a substitution within another")
        return (Reference(name=word, default=otherwise, environment=kind == "EnvironmentVariable"),)

    def _element(self, node: ast.Call, kind: str, given: Mapping[str, Value]) -> Value:
        attributes: dict[str, Text] = {}
        children: list[Element] = []
        for argument, value in given.items():
            if value is None:
                continue
            if argument in _WITHIN or (argument in _LATER and kind == "timer"):
                children += self._elements(node, value)
            elif argument in _LATER:
                children.append(Element(kind="timer", line=node.lineno, children=tuple(self._elements(node, value))))
            elif argument in _PAIRS:
                children += self._pairs(node, argument, value)
            elif argument == "condition":
                known = value.attributes if isinstance(value, Element) and value.kind == "condition" else None
                attributes |= known or {"if": (Unknown("another condition"),)}
            elif argument in ("arguments", "ros_arguments"):
                name = "args" if argument == "arguments" and isinstance(value, list) else "ros_args"
                attributes[name] = bounded((*attributes.get(name, ()), " ", *self._command(value)))
            elif argument == "cmd":
                attributes["cmd"] = self._command(value)
            elif argument == "env":
                self.unread.append(node)
            elif argument in _ATTRIBUTES:
                named = value.attributes.get("name", LOST) if isinstance(value, Element) else self._text(value)
                attributes[_ATTRIBUTES[argument]] = named
        if not attributes.keys() >= {*REQUIRED.get(kind, ())}:
            return self._opaque(node, "what is not given all that it needs")
        return Element(kind=kind, line=node.lineno, attributes=attributes, children=tuple(children))

    def _pairs(self, node: ast.Call, argument: str, value: Value) -> Iterator[Element]:
        kind, one, other = _PAIRS[argument]
        pairs: list[tuple[Value, Value]] = [(LOST, LOST)]
        if isinstance(value, dict):
            pairs = [((key,), entry) for key, entry in value.items()]
        elif isinstance(value, list):
            pairs = [(each[0], each[1]) if isinstance(each, list) and len(each) == 2 else pairs[0] for each in value]
        elif argument == "additional_env":
            self.unread.append(node)
        for left, right in pairs:
            yield Element(kind=kind, line=node.lineno, attributes={one: self._text(left), other: self._text(right)})

    def _elements(self, node: ast.AST, value: Value) -> list[Element]:
        """The elements in a list, or that one."""
        leaves = (leaf for leaf in self._leaves(value) if leaf is not None)
        return [leaf if isinstance(leaf, Element) else self._note(node) for leaf in leaves]

    def _text(self, value: Value) -> Text:
        """What launch makes of a value where it wants a text: of a list, its pieces joined."""
        none = (Unknown("a value that is no text"),)
        return bounded(part for leaf in self._leaves(value) for part in (leaf if isinstance(leaf, tuple) else none))

    def _command(self, value: Value) -> Text:
        """A command line; what is no list may be any number of words."""
        if not isinstance(value, list):
            return self._text(value)
        parts: list[Part] = []
        for word in value:
            parts += (shlex.quote(part) if isinstance(part, str) else part for part in self._text(word))
            parts.append(" ")
        return bounded(parts)

    def _leaves(self, value: Value) -> Iterator[Value]:
        """What is in lists within each other, in order."""
        waiting = [value]
        while waiting:
            self._spend(1)
            value = waiting.pop()
            if isinstance(value, list):
                waiting += reversed(value)
            else:
                yield value

    def _spend(self, values: int) -> None:
        self._values += values
        if self._values > MAX_VALUES:
            raise self._source.malformed(None, f"more than {MAX_VALUES} values, which are not followed")


def _plain(value: object) -> Value:
    """The text of a constant; None is none."""
    if value is None or isinstance(value, (str, bool, float)) or (isinstance(value, int) and abs(value) < 1 << 63):
        return None if value is None else bounded((str(value),))
    return LOST


def _literal(text: Text) -> str | None:
    """The whole text, None where some of it has to be worked out."""
    return "".join(map(str, text)) if all(isinstance(part, str) for part in text) else None


def _path(parts: list[Text]) -> Text:
    """Paths below each other; one that may be absolute puts those before it away."""
    whole: Text = ()
    for number, text in enumerate(parts):
        first = text[0] if text else ""
        if number and not isinstance(first, str):
            return (Unknown("a path that may be absolute"),)
        whole = text if not number or str(first).startswith("/") else bounded((*whole, "/", *text))
    return whole


def code(node: ast.AST) -> Element:
    """The element for code that is not read."""
    return Element(kind="code", line=getattr(node, "lineno", 1))


def names_in(code: ast.AST, *, bound: bool = False) -> set[str]:
    """The names in a piece of code: used, set or made; `bound`: those set or made alone."""
    found = set[str]()
    for node in ast.walk(code):
        if isinstance(node, ast.alias):
            found.add((node.asname or node.name).partition(".")[0])
        elif not (bound and isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)):
            names = (getattr(node, field, None) for field in ("id", "name", "rest"))
            found.update(name for name in names if isinstance(name, str))
    return found
