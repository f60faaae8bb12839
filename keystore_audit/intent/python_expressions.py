"""Expressions of a Python launch file, read as far as nothing has to be run for it."""

from __future__ import annotations

import ast
import posixpath
from collections.abc import Iterator, Mapping
from typing import Final

from keystore_audit.intent.launch_actions import Part, Reference, Text, Unknown, Variable
from keystore_audit.intent.python_actions import CLASSES, RUN
from keystore_audit.intent.python_calls import Call
from keystore_audit.intent.python_values import (
    Growing,
    Imported,
    Items,
    Opaque,
    Pairs,
    Plain,
    TextValue,
    Value,
    bounded,
    dictionary,
    frozen,
    sequence,
    text_of,
    with_entries,
)
from keystore_audit.intent.source import Source, shown

MAX_DEPTH: Final = 64
"""Expressions within each other."""

MAX_VALUES: Final = 200_000
"""Values put together, those of a list counted each time that it becomes part of another."""

MAX_PAIRS: Final = 1_000
"""Entries of a dictionary, those of dictionaries in it counted."""

_SPREAD: Final = "a list that only running the file works out"
"""What stands for any number of values, or arguments."""

_LAUNCH: Final = frozenset({"launch", "launch_ros", "launch_xml", "launch_yaml"})
_SAME: Final = frozenset(
    {"str", "os.fspath", "os.path.abspath", "os.path.realpath", "os.path.normpath", "pathlib.Path"}
)
_LOOKUPS: Final = dict.fromkeys(("os.environ.get", "os.getenv"), "launch.substitutions.EnvironmentVariable")
_ENVIRON: Final = Imported(path="os.environ")
_SAME_METHODS: Final = frozenset({"resolve", "absolute", "as_posix"})
_SHARE: Final = frozenset({"get_package_share_directory", "get_package_share_path", "get_package_prefix"})


class Expressions:
    """Reads expressions with `names`, what each name stands for where the expression is."""

    def __init__(self, source: Source, names: Mapping[str, Value]) -> None:
        """Keep both; `names` may change meanwhile."""
        self._source = source
        self._names = names
        self._values = 0
        self.opaque: list[ast.expr] = []
        """The expressions that only running the file works out."""

    def part(self, value: Value, line: int) -> Value:
        """The value as part of another. Raises UsageError if that was done too often."""
        made = frozen(value, line)
        if isinstance(made, Items):
            self._values += made.size
        elif isinstance(value, Growing):
            self._values += len(value.items)
        elif isinstance(made, Pairs):
            self._values += len(made.pairs)
        if self._values > MAX_VALUES:
            raise self._source.malformed(line, f"lists of more than {MAX_VALUES} values, which are not followed")
        return made

    def value(self, node: ast.expr, depth: int = 0) -> Value:
        """What the expression stands for. Raises UsageError only where lists become too many."""
        if depth > MAX_DEPTH:
            value: Value = _opaque(node, f"an expression more than {MAX_DEPTH} deep")
        else:
            value = self._worked_out(node, depth)
        if isinstance(value, Opaque):
            self.opaque.append(node)
        return value

    def _worked_out(self, node: ast.expr, depth: int) -> Value:
        if isinstance(node, ast.Constant):
            return _constant(node)
        if isinstance(node, ast.Name):
            return self._name(node)
        if isinstance(node, ast.Attribute):
            return self._attribute(node, depth)
        if isinstance(node, (ast.List, ast.Tuple)):
            return Growing(items=list(self._items(node.elts, depth)))
        if isinstance(node, ast.Dict):
            return self._dictionary(node, depth)
        if isinstance(node, ast.JoinedStr):
            return self._formatted(node, depth)
        if isinstance(node, ast.BinOp):
            return self._joined(node, depth)
        if isinstance(node, ast.Call):
            return self._call(node, depth)
        if isinstance(node, ast.Subscript) and self.value(node.value, depth + 1) == _ENVIRON:
            name = self.part(self.value(node.slice, depth + 1), node.lineno)
            named = Call(line=node.lineno, name="EnvironmentVariable", positional=(name,), keywords={})
            return CLASSES[named.name](named)
        return _opaque(node, "an expression that only running the file works out")

    def _name(self, node: ast.Name) -> Value:
        if node.id in self._names:
            return self._names[node.id]
        if node.id == "__file__":
            own = posixpath.basename(self._source.real)
            return TextValue(text=(Reference(variable=Variable.DIRECTORY), f"/{own}"))
        if node.id in ("dict", "str"):
            return Imported(path=node.id)
        return _opaque(node, f"the name {shown(node.id)}, which nothing here sets")

    def _attribute(self, node: ast.Attribute, depth: int) -> Value:
        value = self.value(node.value, depth + 1)
        if isinstance(value, Imported):
            return Imported(path=f"{value.path}.{node.attr}")
        if isinstance(value, TextValue) and node.attr == "parent":
            return TextValue(text=_parent(value.text))
        return _opaque(node, f"the attribute {shown(node.attr)}, which only running the file works out")

    def _items(self, nodes: list[ast.expr], depth: int) -> Iterator[Value]:
        for node in nodes:
            if not isinstance(node, ast.Starred):
                yield self.part(self.value(node, depth + 1), node.lineno)
                continue
            spread = self.part(self.value(node.value, depth + 1), node.lineno)
            if isinstance(spread, Items):
                yield from spread.items
            else:
                yield _opaque(node, _SPREAD)

    def _dictionary(self, node: ast.Dict, depth: int) -> Value:
        pairs: list[tuple[Value, Value]] = []
        inherited = False
        for key, entry in zip(node.keys, node.values, strict=True):
            value = self.part(self.value(entry, depth + 1), entry.lineno)
            if key is not None:
                pairs.append((self.part(self.value(key, depth + 1), entry.lineno), value))
            elif isinstance(value := dictionary(value), Pairs) and not (value.inherited and pairs):
                pairs += value.pairs
                inherited = inherited or value.inherited
            else:
                return _opaque(node, "a dictionary that only running the file works out")
        if len(pairs) > MAX_PAIRS:
            return _opaque(node, "a dictionary that is too long")
        return Pairs(pairs=tuple(pairs), inherited=inherited)

    def _formatted(self, node: ast.JoinedStr, depth: int) -> Value:
        parts: list[Part] = []
        for piece in node.values:
            if isinstance(piece, ast.Constant):
                parts.append(str(piece.value))
                continue
            value = self.value(piece.value, depth + 1) if isinstance(piece, ast.FormattedValue) else None
            simple = isinstance(piece, ast.FormattedValue) and piece.conversion == -1 and piece.format_spec is None
            if isinstance(value, TextValue) and value.plain and simple:
                parts += value.text
            elif isinstance(value, Plain) and simple:
                parts.append(str(value.value))
            else:
                reason = value.reason if isinstance(value, Opaque) else "a piece of an f-string"
                parts.append(Unknown(reason=reason))
        return TextValue(text=bounded(parts))

    def _joined(self, node: ast.BinOp, depth: int) -> Value:
        left, right = self.value(node.left, depth + 1), self.value(node.right, depth + 1)
        texts = isinstance(left, TextValue) and isinstance(right, TextValue) and left.plain and right.plain
        if texts and isinstance(node.op, ast.Add):
            return TextValue(text=bounded((*text_of(left), *text_of(right))))
        if texts and isinstance(node.op, ast.Div):
            return TextValue(text=_path(text_of(left), text_of(right)))
        if isinstance(node.op, ast.Add):
            first, second = self.part(left, node.lineno), self.part(right, node.lineno)
            if isinstance(first, Items) and isinstance(second, Items):
                whole = sequence((*first.items, *second.items), node.lineno)
                return Growing(items=list(whole.items)) if isinstance(whole, Items) else whole
        return _opaque(node, "an expression that only running the file works out")

    def _call(self, node: ast.Call, depth: int) -> Value:
        if isinstance(node.func, ast.Attribute):
            receiver = self.value(node.func.value, depth + 1)
            if isinstance(receiver, Pairs) and node.func.attr == "items" and not node.args:
                return receiver
            if isinstance(receiver, TextValue) and node.func.attr in _SAME_METHODS:
                return receiver
        function = self.value(node.func, depth + 1)
        if not isinstance(function, Imported):
            return _opaque(node, f"the result of {_called(node)}, which is not called")
        positional = tuple(self._items(node.args, depth))
        keywords: dict[str, Value] = {}
        for keyword in node.keywords:
            if keyword.arg is None:
                return _opaque(node, f"{_called(node)}, whose arguments only running the file works out")
            keywords[keyword.arg] = self.part(self.value(keyword.value, depth + 1), keyword.value.lineno)
            if isinstance(keywords[keyword.arg], Opaque):
                self.opaque.append(keyword.value)
        return self._imported(node, function.path, positional, keywords)

    def _imported(
        self, node: ast.Call, path: str, positional: tuple[Value, ...], keywords: Mapping[str, Value]
    ) -> Value:
        path = _LOOKUPS.get(path, path)
        name = path.rpartition(".")[2]
        if path.split(".", 1)[0] in _LAUNCH:
            if name in RUN:
                return TextValue(text=(Unknown(reason=RUN[name]),), plain=False)
            if name in CLASSES and not any(isinstance(item, Opaque) and item.reason == _SPREAD for item in positional):
                return CLASSES[name](Call(line=node.lineno, name=name, positional=positional, keywords=keywords))
        elif name in _SHARE:
            return TextValue(text=(Unknown(reason="where a package is installed"),))
        elif path == "os.path.join" and positional:
            joined = text_of(positional[0])
            for part in positional[1:]:
                joined = _path(joined, text_of(part))
            return TextValue(text=joined)
        elif path == "os.path.dirname" and len(positional) == 1:
            return TextValue(text=_parent(text_of(positional[0])))
        elif path == "os.environ.copy":
            return Pairs(pairs=(), inherited=True)
        elif path == "dict" and len(positional) <= 1:
            held = dictionary(positional[0]) if positional else Pairs(pairs=())
            if isinstance(held, Pairs):
                return with_entries(held, keywords)
        elif path in _SAME and len(positional) == 1 and isinstance(positional[0], (TextValue, Plain)):
            return TextValue(text=text_of(positional[0]))
        return _opaque(node, f"the result of {_called(node)}, which is not called")


def _opaque(node: ast.expr, reason: str) -> Opaque:
    return Opaque(line=node.lineno, reason=reason)


def _called(node: ast.Call) -> str:
    """The function of a call as it is written, its last name."""
    function = node.func
    if isinstance(function, ast.Attribute):
        return shown(function.attr)
    return shown(function.id) if isinstance(function, ast.Name) else "a function"


def _constant(node: ast.Constant) -> Value:
    if isinstance(node.value, str):
        return TextValue(text=bounded((node.value,)))
    if node.value is None or isinstance(node.value, (bool, float)):
        return Plain(value=node.value)
    if isinstance(node.value, int) and abs(node.value) < 1 << 63:
        return Plain(value=node.value)
    return _opaque(node, "a constant that is no text")


def _parent(text: Text) -> Text:
    """The directory of a path, which begins with one that is known."""
    if text and isinstance(text[-1], str) and "/" in text[-1]:
        return bounded((*text[:-1], text[-1].rpartition("/")[0]))
    return bounded((*text, "/.."))


def _path(directory: Text, name: Text) -> Text:
    """A path below another, unless it is absolute."""
    first = name[0] if name else ""
    absolute = first.startswith("/") if isinstance(first, str) else isinstance(first, Reference)
    return name if absolute else bounded((*directory, "/", *name))
