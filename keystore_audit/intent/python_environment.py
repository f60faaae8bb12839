"""What a Python launch file makes of its own environment, which every process has that it starts.

`environment` of a LaunchContext is `os.environ` (launch, launch_context.py). Looked at is every place in the file,
followed or not; one where it is only read is none of these.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Final

from keystore_audit.intent.environment import ENABLE, SECURE, STRATEGY
from keystore_audit.intent.launch_actions import AssignEnvironment, LaunchAction, Unknown, Unread
from keystore_audit.intent.launch_environment import NAMES, touched

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

_SETTERS: Final = frozenset({"AppendEnvironmentVariable", "SetEnvironmentVariable", "UnsetEnvironmentVariable"})
"""Actions whose first argument is the name of a variable."""

_NOT_FOLLOWED: Final = (ast.Lambda, ast.ListComp, ast.GeneratorExp, ast.SetComp, ast.DictComp, ast.IfExp)


def changes(module: ast.Module, skipped: Iterable[ast.AST]) -> Iterator[LaunchAction]:
    """The variables of `NAMES` that the file may set or take away: to what is known where that is said once.

    In what is `skipped`, and what that takes from elsewhere in the file, to name a variable is enough. Processes that
    start there have what is said here, whatever the file sets later.
    """
    nodes = list(ast.walk(module))
    parents = {child: node for node in nodes for child in ast.iter_child_nodes(node)}
    found: dict[str, list[tuple[int, str | None]]] = {}
    whole = {
        name
        for node in nodes
        if isinstance(node, ast.Assign) and _has_all(node.value, ())
        for name in _named_in(node.targets)
    }
    for node in _unread(nodes, skipped):
        for name in _mentioned(node, parents, whole):
            found.setdefault(name, []).append((getattr(node, "lineno", 1), None))
    for node in nodes:
        for names, value in _changed(node, parents):
            for name in NAMES if names is None else names:
                found.setdefault(name, []).append((getattr(node, "lineno", 1), value))
    named = [name for name in NAMES if name in found]
    for name in named:
        values = {value for _line, value in found[name]}
        line, value = found[name][0]
        told = value if len(values) == 1 and value is not None else Unknown(reason=f"what line {line} makes of {name}")
        yield AssignEnvironment(line=line, name=(name,), value=(told,))
    if named:
        yield Unread(
            line=found[named[0]][0][0], reason=f"what is done with {named[0]} is not followed; it may start nodes"
        )


def _unread(nodes: Sequence[ast.AST], skipped: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """All within what is skipped, and within the statements that make what it takes, as `k` of `Node(**k)`."""
    made: dict[str, list[ast.stmt]] = {}
    kept = set()  # descriptions grow wherever they stand, and are followed
    for node in nodes:
        if isinstance(node, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = _named_in(targets)
            if isinstance(node.value, ast.Call) and _called(node.value.func) == "LaunchDescription":
                kept |= names
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            names = _named_in([node.value.func])  # x.append(...)
        else:
            continue
        for name in names:
            made.setdefault(name, []).append(node)
    waiting = [*skipped, *(node for node in nodes if isinstance(node, _NOT_FOLLOWED))]
    waiting += [node for node in nodes if isinstance(node, ast.keyword) and node.arg is None]
    seen: set[ast.AST] = set()
    while waiting:
        node = waiting.pop()
        if node not in seen:
            seen.add(node)
            waiting += ast.iter_child_nodes(node)
            if isinstance(node, ast.Name) and (node.id not in kept or not isinstance(node.ctx, ast.Load)):
                waiting += made.pop(node.id, ())
    return (node for node in nodes if node in seen)


def _named_in(nodes: Iterable[ast.AST]) -> set[str]:
    return {inner.id for node in nodes for inner in ast.walk(node) if isinstance(inner, ast.Name)}


def _mentioned(node: ast.AST, parents: dict[ast.AST, ast.AST], whole: Collection[str]) -> Iterable[str]:
    """The variables that are named here, unless they are only looked up, set to what they ought to be, or `_changed`
    speaks of them; and where all are replaced, those that decide whether there is security.
    """
    if isinstance(node, ast.keyword) and node.arg == "env" and not _has_all(node.value, whole):
        return (ENABLE, STRATEGY)
    if isinstance(node, ast.Call) and _called(node.func) in _SETTERS and _named_later(node):
        return NAMES
    text = node.arg if isinstance(node, ast.keyword) else _text(node)
    parent = parents[node]
    call = parents[parent] if isinstance(parent, ast.keyword) else parent
    looking = isinstance(call, ast.Call) and _called(call.func) in _LOOKING
    subscript = isinstance(parent, ast.Subscript) and (isinstance(parent.ctx, ast.Load) or _is_environ(parent.value))
    if text is None or looking or subscript or isinstance(parent, (ast.Compare, ast.Expr)):
        return ()
    return () if text in SECURE and _text(_value(node, parents)) == SECURE[text] else touched(text)


def _has_all(value: ast.expr, whole: Collection[str]) -> bool:
    """Whether a dictionary holds all variables that there were, as those called `whole` do, or there is none."""
    if isinstance(value, ast.Constant) and value.value is None:
        return True
    if isinstance(value, ast.Call) and _called(value.func) in _READING - {"copy"}:
        return False
    return any(_is_environ(node) or getattr(node, "id", None) in whole for node in ast.walk(value))


def _named_later(call: ast.Call) -> bool:
    """Whether the variable that an action sets is neither a text nor a name, whose text is read apart."""
    given = [*call.args[:1], *(each.value for each in call.keywords if each.arg == "name")]
    return not all(isinstance(each, (ast.Constant, ast.Name)) for each in given)


def _value(node: ast.AST, parents: dict[ast.AST, ast.AST]) -> ast.expr | None:
    """What the variable that `node` names is set to."""
    parent = parents[node]
    if isinstance(node, ast.keyword):
        return node.value
    if isinstance(parent, ast.Dict) and node in parent.keys:
        return parent.values[parent.keys.index(node)]
    if isinstance(parent, ast.Subscript) and isinstance(assigned := parents[parent], ast.Assign):
        return assigned.value
    if isinstance(parent, ast.Call) and len(parent.args) == 2 and parent.args[0] is node:
        return parent.args[1]
    return None


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
