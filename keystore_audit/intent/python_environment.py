"""What a Python launch file makes of its own environment, which every process has that it starts.

`environment` of a LaunchContext is `os.environ` (launch, launch_context.py). Looked at is every place in the file,
followed or not; one where it is only read is none of these.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.intent.launch_actions import AssignEnvironment, Unknown
from keystore_audit.intent.launch_environment import NAMES, named

_ENVIRON: Final = frozenset({"environ", "environb"})
_FUNCTIONS: Final = frozenset({"putenv", "unsetenv"})
_READING: Final = frozenset({"copy", "get", "items", "keys", "values"})
_READERS: Final = (
    ast.BinOp,
    ast.Call,
    ast.Compare,
    ast.Dict,
    ast.For,
    ast.FormattedValue,
    ast.comprehension,
    ast.keyword,
)
"""What takes all of the variables and changes none: `dict(os.environ)`, `{**os.environ}`, `"X" in os.environ`."""
_FIRST: Final = frozenset({"__delitem__", "__setitem__", "pop", "setdefault", *_FUNCTIONS})
"""What is called with the name of a variable first."""

_LOOKING: Final = frozenset({"get", "getenv", "EnvironmentVariable"})
"""What is called with the name of a variable to look it up."""

_NOT_FOLLOWED: Final = (ast.Lambda, ast.ListComp, ast.GeneratorExp, ast.SetComp, ast.DictComp, ast.IfExp)


def changes(module: ast.Module, skipped: Iterable[ast.stmt]) -> Iterator[AssignEnvironment]:
    """The variables of `NAMES` that the file may set or take away: to what is known where that is said once.

    In statements that are `skipped`, and in expressions that nobody works out, to name a variable is enough.
    """
    parents = {child: node for node in ast.walk(module) for child in ast.iter_child_nodes(node)}
    found: dict[str, list[tuple[int, str | None]]] = {}
    unread = [*skipped, *(node for node in ast.walk(module) if isinstance(node, _NOT_FOLLOWED)), *_spread(module)]
    inside: dict[ast.AST, None] = {}
    for each in unread:
        if each not in inside:  # they stand in each other, a thousand deep in hostile files
            inside |= dict.fromkeys(ast.walk(each))
    for node in inside:
        if name := _mentioned(node, parents):
            found.setdefault(name, []).append((getattr(node, "lineno", 1), None))
    for node in ast.walk(module):
        for names, value in _changed(node, parents):
            for name in NAMES if names is None else names:
                found.setdefault(name, []).append((getattr(node, "lineno", 1), value))
    for name in filter(found.__contains__, NAMES):
        values = {value for _line, value in found[name]}
        line, value = found[name][0]
        told = value if len(values) == 1 and value is not None else Unknown(reason=f"what line {line} makes of {name}")
        yield AssignEnvironment(line=line, name=(name,), value=(told,))


def _spread(module: ast.Module) -> Iterator[ast.AST]:
    """Dictionaries that calls take their arguments from, `Node(**these)`, and whatever is assigned to or in them."""
    given = [node for node in ast.walk(module) if isinstance(node, ast.keyword) and node.arg is None]
    names = {node.id for each in given for node in ast.walk(each) if isinstance(node, ast.Name)}
    for node in ast.walk(module):
        if isinstance(node, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            held = {inner.id for target in targets for inner in ast.walk(target) if isinstance(inner, ast.Name)}
            if held & names:
                yield node
    yield from given


def _mentioned(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> str | None:
    """The variable that is named here, unless it is only looked up, or `_changed` speaks of it."""
    text = node.arg if isinstance(node, ast.keyword) else _text(node)
    name = named(text) if text is not None else None
    parent = parents[node]
    looking = isinstance(parent, ast.Call) and _called(parent.func) in _LOOKING
    subscript = isinstance(parent, ast.Subscript) and (isinstance(parent.ctx, ast.Load) or _is_environ(parent.value))
    return None if looking or subscript or isinstance(parent, (ast.Compare, ast.Expr)) else name


def _called(node: ast.AST) -> str | None:
    """The last name of what is called or spoken of."""
    name: str | None = getattr(node, "attr", getattr(node, "id", None))
    return name


def _is_environ(node: ast.AST) -> bool:
    called = _called(node)
    return called in _ENVIRON or (isinstance(node, ast.Attribute) and called == "environment")


def _changed(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> Iterator[tuple[set[str] | None, str | None]]:
    """The names that are changed where all variables are spoken of (None: any), and to what, if that is plain."""
    called = _called(node)
    if isinstance(node, ast.alias) and node.asname is not None and node.name in _ENVIRON | _FUNCTIONS:
        yield None, None  # by another name it may be anywhere
    if called in _FUNCTIONS:
        yield _named(str(called), parents[node]), None
    if not _is_environ(node):
        return
    parent = parents[node]
    if isinstance(parent, ast.Subscript) and not isinstance(parent.ctx, ast.Load):
        assigned = parents[parent]
        names = _keys(parent.slice)
        yield names, _text(assigned.value) if names and isinstance(assigned, ast.Assign) else None
    elif isinstance(parent, ast.Attribute) and parent.attr not in _READING:
        yield _named(parent.attr, parents[parent]), None
    elif not isinstance(parent, (ast.Subscript, ast.Attribute, *_READERS)):
        yield None, None


def _named(function: str, call: ast.AST) -> set[str] | None:
    """The variables that a call changes, as far as its arguments say."""
    if not isinstance(call, ast.Call) or (function not in _FIRST and function != "update"):
        return None
    parts = [_keys(each) for each in (call.args[:1] if function in _FIRST else call.args)]
    parts += [None if each.arg is None else {each.arg} for each in call.keywords if function == "update"]
    return None if None in parts or not parts else set().union(*filter(None, parts))


def _keys(node: ast.expr) -> set[str] | None:
    """The names that a text is, or that a dictionary has."""
    texts = [_text(each) for each in (node.keys if isinstance(node, ast.Dict) else [node])]
    return None if None in texts else {text for text in texts if text is not None}


def _text(node: ast.AST | None) -> str | None:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None
