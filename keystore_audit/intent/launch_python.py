"""Launch files in Python, read as text as far as they are literal: parsed, never imported, compiled or run.

What says by itself what it starts (`Node(...)`, `SetEnvironmentVariable(...)`, lists of those, names for them) becomes
the elements that XML has (`launch_entities`). All else is one note, since it may start anything; where code that is
not read holds a word of security, or hands over an environment made elsewhere, it may change security.
"""

from __future__ import annotations

import ast
import posixpath
import warnings
from collections.abc import Iterable, Iterator, Mapping
from typing import Final, TypeVar

from msgspec.structs import replace

from keystore_audit.intent.launch_actions import LaunchAction, Reference, Text, Variable, bounded
from keystore_audit.intent.launch_entities import Entity, actions
from keystore_audit.intent.python_environment import names_in, speaking
from keystore_audit.intent.python_values import (
    CLASSES,
    FIRST,
    LOST,
    PAIRS,
    RUN_ONLY,
    SOURCES,
    WITHIN,
    Condition,
    Imported,
    Value,
    path_of,
    text_of,
    unknown,
    words_of,
)
from keystore_audit.intent.source import Source
from keystore_audit.intent.substitution import RUN

MAX_CHARACTERS: Final = 1 << 17
"""Length of a launch file in Python, the largest are a fifth: CPython's parser before 3.11 does not bound the depth."""

MAX_DEPTH: Final = 64
"""Expressions, lists and groups within each other."""

MAX_VALUES: Final = 20_000
"""Values in one list or group, at every depth: as many as actions are followed."""

ENTRY: Final = "generate_launch_description"
"""The function that launch calls."""

_DEFINED: Final = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)

_Held = TypeVar("_Held", bound="list[Value] | Entity")


def read(source: Source) -> tuple[LaunchAction, ...]:
    """Read a launch file. Raises UsageError, naming file and line, for what is no Python."""
    if len(source.text) > MAX_CHARACTERS:
        raise source.malformed(None, f"more than {MAX_CHARACTERS} characters of Python, which are not read")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the file's style, on stderr
            module = ast.parse(source.text)
    except SyntaxError as error:
        raise source.malformed(error.lineno, f"the text is no Python: {error.msg}") from None
    except (ValueError, RecursionError, MemoryError):  # a NUL character, expressions too deep for the parser
        raise source.malformed(None, "the text is no Python, or too deep to be parsed") from None
    reader = _Reader(source, module)
    found = reader.follow(module)
    first = min((getattr(node, "lineno", 1) for node in reader.noted), default=1)
    root = _told_once(Entity(kind="launch", line=1, attributes={}, children=tuple(found)), first)
    outside = () if not reader.noted else (_code(first),)
    return (*speaking(module, reader.unread), *actions(replace(root, children=(*outside, *root.children)), source))


def _code(line: int) -> Entity:
    return Entity(kind="code", line=line, attributes={}, children=())


def _told_once(entity: Entity, line: int) -> Entity:
    """The element with all that is not read in one place."""
    children = tuple(_told_once(child, line) for child in entity.children)
    return _code(line) if entity.kind == "code" else replace(entity, children=children)


class _Reader:
    """Follows statements in order as far as they are assignments, lists that grow, and a return.

    `noted`: what may start nodes; `unread`: that, and all other code that is not read.
    """

    def __init__(self, source: Source, module: ast.Module) -> None:
        self.noted: list[ast.AST] = []
        self.unread: list[ast.AST] = []
        self._source = source
        self._names: dict[str, Value] = {
            "__file__": (Reference(variable=Variable.DIRECTORY), f"/{posixpath.basename(source.real)}")
        }
        self._weights: dict[int, tuple[object, int, int]] = {}
        self._parts: dict[int, Value] = {}  # with the values, so that no other gets the number of one that is gone
        functions = [each for each in ast.walk(module) if isinstance(each, (*_DEFINED, ast.Lambda))]
        apart = [each for each in functions if getattr(each, "name", "") != ENTRY]
        self._elsewhere = {name for each in apart for name in names_in(each)}

    def follow(self, module: ast.Module) -> list[Entity]:
        """The elements of the description that the file's function returns."""
        self._statements(module.body)
        defined = self._names.get(ENTRY)
        entry = next((each for each in module.body if defined == Imported(f"{ENTRY}:{each.lineno}")), None)
        if not isinstance(entry, ast.FunctionDef) or entry.decorator_list:
            return [self._note(module)]
        returned = self._statements(entry.body)
        if returned is None or returned.value is None:
            return [self._note(entry)]
        return self._elements(returned.value, self._value(returned.value))

    def _statements(self, statements: Iterable[ast.stmt]) -> ast.Return | None:
        for statement in statements:
            odd = any(isinstance(node, (ast.NamedExpr, ast.Yield, ast.Await)) for node in ast.walk(statement))
            if odd and not isinstance(statement, _DEFINED):
                self._lose(statement)
            elif isinstance(statement, ast.Return):
                return statement
            else:
                self._statement(statement)
        return None

    def _statement(self, statement: ast.stmt) -> None:
        match statement:
            case ast.Import(names):
                for each in names:
                    bound = each.asname or each.name.partition(".")[0]
                    self._names[bound] = Imported(each.name if each.asname else bound)
            case ast.ImportFrom(module, names) if names[0].name != "*":
                for each in names:
                    origin = f"{'.' * statement.level}{module}.{each.name}"
                    self._names[each.asname or each.name] = Imported(origin)
            case ast.FunctionDef(name) | ast.AsyncFunctionDef(name) | ast.ClassDef(name):
                self._names[name] = Imported(f"{name}:{statement.lineno}")
                if name != ENTRY:
                    self.unread.append(statement)
            case ast.Assign([ast.Name(name)], value) | ast.AnnAssign(ast.Name(name), value=ast.expr() as value):
                self._names[name] = self._value(value)
            case ast.AugAssign(ast.Name(name), ast.Add(), value):
                self._grow(statement, self._names.get(name), value, one=False)
            case ast.Expr(ast.Call(ast.Attribute(ast.Name(name), "append" | "add_action" | "extend" as how), [value])):
                self._grow(statement, self._names.get(name), value, one=how != "extend")
            case (
                ast.Expr(ast.Constant())
                | ast.Pass()
                | ast.If(ast.Compare(ast.Name("__name__"), [ast.Eq()], [ast.Constant("__main__")]), orelse=[])
            ):
                pass
            case _:
                self._lose(statement)

    def _grow(self, statement: ast.stmt, held: Value, added: ast.expr, *, one: bool) -> None:
        value = self._value(added)
        if isinstance(held, list) and id(held) not in self._parts and (one or isinstance(value, list)):
            held += [self._part(value)] if one or not isinstance(value, list) else value
            self._weigh(statement, held, held)
        else:
            self._lose(statement)

    def _lose(self, statement: ast.AST) -> None:
        """A statement that is not followed: nothing that it may set, or add to, is known from here on."""
        self._note(statement)
        for node in ast.walk(statement):
            if isinstance(node, ast.alias) and node.name == "*":  # every name may be another now
                self._names = {name: unknown("a name that may be another") for name in self._names}
        used = {
            each.id for each in ast.walk(statement) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Load)
        }
        for name in names_in(statement):
            held = self._names.get(name)
            if name not in used or isinstance(held, (list, dict)):
                self._names[name] = self._changed(held, statement)

    def _changed(self, held: Value, node: ast.AST) -> Value:
        """What may have become of a value: lists of elements still have what they had."""
        if isinstance(held, list) and (not held or any(isinstance(each, Entity) for each in held)):
            held.append(self._note(node))
            return held
        return LOST

    def _note(self, node: ast.AST) -> Entity:
        """Something that may start nodes."""
        self.noted.append(node)
        self.unread.append(node)
        return _code(getattr(node, "lineno", 1))

    def _opaque(self, node: ast.expr, reason: str = "an expression that only running the file works out") -> Text:
        """An expression that is not read; it may add to lists that it names."""
        self.unread.append(node)
        for name in names_in(node):
            held = self._names.get(name)
            if isinstance(held, (list, dict)):
                self._names[name] = self._changed(held, node)
        return unknown(reason)

    def _value(self, node: ast.expr, depth: int = 0) -> Value:
        if depth > MAX_DEPTH:
            return self._opaque(node, f"an expression more than {MAX_DEPTH} deep")
        match node:
            case ast.Constant(str(text)):
                return bounded((text,))
            case ast.Constant(None | bool() | int() | float() as plain):
                return plain if not isinstance(plain, int) or abs(plain) < 1 << 63 else LOST
            case ast.Name(name) if name in self._names:
                held = self._names[name]
                shared = isinstance(held, (list, dict)) and name in self._elsewhere
                return self._changed(held, node) if shared else held
            case ast.Attribute(holder, name):
                held = self._value(holder, depth + 1)
                return Imported(f"{held.path}.{name}") if isinstance(held, Imported) else self._opaque(node)
            case ast.List(parts) | ast.Tuple(parts):
                return self._list(node, parts, depth)
            case ast.Dict(keys, values) if all(isinstance(key, ast.Constant) for key in keys):
                entries = [self._part(self._value(value, depth + 1)) for value in values]
                return dict(
                    zip((str(key.value) for key in keys if isinstance(key, ast.Constant)), entries, strict=True)
                )
            case ast.JoinedStr(pieces):
                return self._joined(node, pieces, depth)
            case ast.BinOp(left, ast.Add(), right):
                return self._sum(node, self._value(left, depth + 1), self._value(right, depth + 1))
            case ast.FormattedValue(value, -1, None):
                return self._value(value, depth + 1)
            case ast.Call():
                return self._call(node, depth)
        return self._opaque(node)

    def _list(self, node: ast.expr, parts: Iterable[ast.expr], depth: int) -> Value:
        found: list[Value] = []
        for part in parts:
            spread = isinstance(part, ast.Starred)
            value = self._value(part.value if isinstance(part, ast.Starred) else part, depth + 1)
            if spread and isinstance(value, list):
                found += value
            else:
                found.append(self._note(part) if spread else self._part(value))
        return self._weigh(node, found, found)

    def _joined(self, node: ast.expr, pieces: Iterable[ast.expr], depth: int) -> Value:
        whole: Value = ()
        for piece in pieces:
            whole = self._sum(node, whole, self._value(piece, depth + 1))
        return whole

    def _sum(self, node: ast.expr, left: Value, right: Value) -> Value:
        if isinstance(left, list) and isinstance(right, list):
            both = [*left, *right]
            return self._weigh(node, both, both)
        texts = [each for each in (left, right) if isinstance(each, tuple) and not isinstance(each, Imported)]
        parts = [part for each in texts for part in text_of(each)]
        substituted = any(isinstance(each, Reference) and each.variable is not Variable.DIRECTORY for each in parts)
        return bounded(parts) if len(texts) == 2 and not substituted else self._opaque(node)

    def _part(self, value: Value) -> Value:
        """The value as part of another: a list that grows afterwards is not followed."""
        self._parts[id(value)] = value
        return value

    def _weigh(self, node: ast.AST, value: _Held, parts: Iterable[Value]) -> _Held:
        """The value, if it is neither too large nor too deep to be gone through. Raises UsageError."""
        found = [self._weights[id(part)][1:] for part in parts if id(part) in self._weights]
        size, depth = 1 + sum(size for size, _depth in found), 1 + max((depth for _size, depth in found), default=0)
        if size > MAX_VALUES or depth > MAX_DEPTH:
            line = getattr(node, "lineno", None)
            raise self._source.malformed(line, f"more than {MAX_VALUES} values or {MAX_DEPTH} levels, not followed")
        self._weights[id(value)] = (value, size, depth)
        return value

    def _call(self, node: ast.Call, depth: int) -> Value:
        if isinstance(node.func, ast.Attribute) and node.func.attr == "items" and not node.args:
            return self._value(node.func.value, depth + 1)
        function = self._value(node.func, depth + 1)
        spread = any(isinstance(each, ast.Starred) for each in node.args) or any(not each.arg for each in node.keywords)
        if not isinstance(function, Imported) or spread:
            return self._opaque(node, "the result of a function, which is not called")
        package, name = function.path.partition(".")[0], function.path.rpartition(".")[2]
        given = [self._part(self._value(each, depth + 1)) for each in node.args]
        named = {each.arg or "": self._part(self._value(each.value, depth + 1)) for each in node.keywords}
        if package in ("launch", "launch_ros", "launch_xml", "launch_yaml"):
            return self._made(node, name, given, named)
        if name in ("get_package_share_directory", "get_package_prefix"):
            return unknown(RUN["find-pkg-share"])
        texts = [text_of(each) for each in given]
        if function.path == "os.path.join" and texts:
            return path_of(texts)
        own = bool(texts and texts[0] and isinstance(texts[0][0], Reference))
        if function.path == "os.path.dirname" and own and isinstance(texts[0][-1], str):
            return bounded((*texts[0][:-1], texts[0][-1].rpartition("/")[0]))
        if function.path in ("os.path.realpath", "os.path.abspath") and own:
            return texts[0]
        return self._opaque(node, "the result of a function, which is not called")

    def _made(self, node: ast.Call, name: str, given: list[Value], named: dict[str, Value]) -> Value:
        """What calling a class of launch or launch_ros makes."""
        first = given[0] if given else next((named[each] for each in FIRST if each in named), None)
        if name == "LaunchDescription":
            found: list[Value] = [*first] if isinstance(first, list) else [*self._elements(node, first)]
            return self._weigh(node, found, found)
        if name in ("IfCondition", "UnlessCondition"):
            return Condition("if" if name == "IfCondition" else "unless", text_of(first))
        if name in ("LaunchConfiguration", "EnvironmentVariable"):
            default = given[1] if len(given) > 1 else named.get("default", named.get("default_value"))
            variable = Variable.ARGUMENT if name == "LaunchConfiguration" else Variable.ENVIRONMENT
            told = None if default is None else text_of(default)
            return (Reference(variable=variable, name=text_of(first), default=told),)
        if name == "ThisLaunchFileDir":
            return (Reference(variable=Variable.DIRECTORY),)
        if name == "TextSubstitution" or name in SOURCES:
            return text_of(first)
        if name == "PathJoinSubstitution" and isinstance(first, list):
            return path_of(map(text_of, first))
        if name in RUN_ONLY:
            return unknown(RUN[RUN_ONLY[name]])
        kind, attributes, needed = CLASSES.get(name, ("", {}, ()))
        if not kind or len(given) > len(attributes):
            return self._opaque(node, f"what {name} makes, which is not read")
        entity = self._entity(node, kind, attributes, dict(zip(attributes, given, strict=False)) | named)
        lacking = {each: unknown(f"{each!r}, which is not given") for each in needed}
        made = replace(entity, attributes=lacking | {**entity.attributes})
        return self._weigh(node, made, entity.children)

    def _entity(self, node: ast.Call, kind: str, names: Mapping[str, str], given: Mapping[str, Value]) -> Entity:
        attributes: dict[str, str | Text] = {}
        children: list[Entity] = []
        for argument, value in given.items():
            if value is None:
                continue
            if argument in WITHIN:
                within = self._elements(node, value)
                later = argument.startswith("on_") and kind != "timer"
                timer = Entity(kind="timer", line=node.lineno, attributes={}, children=tuple(within))
                children += [self._weigh(node, timer, within)] if later else within
            elif argument in PAIRS:
                children += self._pairs(node, argument, value)
            elif argument == "condition":
                held = value if isinstance(value, Condition) else Condition("if", unknown("another condition"))
                attributes[held.word] = held.text
            elif argument in ("arguments", "ros_arguments"):
                known = argument == "arguments" and isinstance(value, list)
                name = "args" if known else "ros_args"
                attributes[name] = (*attributes.get(name, ()), " ", *words_of(value))
            elif argument in ("scoped", "forwarding"):
                attributes[argument] = "false" if value is False else "true"
                children += [] if isinstance(value, bool) else [self._note(node)]
            elif names.get(argument):
                target = value.attributes.get("name", LOST) if isinstance(value, Entity) else None
                text = words_of(value) if argument == "cmd" else text_of(value)
                attributes[names[argument]] = text if target is None else target
            elif argument == "env":
                self.unread.append(node)
        return Entity(kind=kind, line=node.lineno, attributes=attributes, children=tuple(children))

    def _pairs(self, node: ast.Call, argument: str, value: Value) -> Iterator[Entity]:
        kind, one, other = PAIRS[argument]
        pairs: list[tuple[Value, Value]] = [(LOST, LOST)]
        if isinstance(value, dict):
            pairs = [((key,), entry) for key, entry in value.items()]
        elif isinstance(value, list):
            pairs = [(e[0], e[1]) if isinstance(e, list) and len(e) == 2 else (LOST, LOST) for e in value]
        elif argument == "additional_env":
            self.unread.append(node)
        for left, right in pairs:
            yield Entity(
                kind=kind, line=node.lineno, attributes={one: text_of(left), other: text_of(right)}, children=()
            )

    def _elements(self, node: ast.AST, value: Value) -> list[Entity]:
        """The elements in a list, or that one; those that come when it has ended behind it."""
        if isinstance(value, Entity):
            later = value.called("timer") if value.kind not in ("timer", "group") else ()
            return [value, *later]
        if isinstance(value, list):
            return [each for part in value for each in self._elements(node, part)]
        return [] if value is None else [self._note(node)]
