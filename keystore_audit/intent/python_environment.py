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
from keystore_audit.intent.launch_environment import NAMES, PREFIX, is_itself, set_by_prefix, touched
from keystore_audit.intent.python_dictionaries import ENVIRON, LOOKING, Made, called, is_environ, named_in, text_of

_FUNCTIONS: Final = frozenset({"clearenv", "load_dotenv", "putenv", "setenv", "unsetenv"})
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
_SPOKEN: Final = frozenset({*ENVIRON, "os.environ"})
"""What `getattr`, `vars`, and what replaces it for a time, calls it by."""

_FIRST: Final = frozenset({"__delitem__", "__setitem__", "pop", "putenv", "setdefault", "setenv", "unsetenv"})
"""What is called with the name of a variable first."""

_SETTERS: Final = frozenset({"AppendEnvironmentVariable", "SetEnvironmentVariable", "UnsetEnvironmentVariable"})
"""Actions whose first argument is the name of a variable."""

_REPLACING: Final = "ReplaceEnvironmentVariables"
_GIVING: Final = frozenset({"additional_env", "env"})
"""Arguments that give variables to a process."""

_NOT_FOLLOWED: Final = (ast.Lambda, ast.ListComp, ast.GeneratorExp, ast.SetComp, ast.DictComp, ast.IfExp)


def changes(module: ast.Module, skipped: Iterable[ast.AST]) -> Iterator[LaunchAction]:
    """The variables of `NAMES` that the file may set or take away: to what is known where that is said once.

    In what is `skipped`, and what that takes from elsewhere in the file, to name a variable is enough. Processes that
    start there have what is said here, whatever the file sets later.
    """
    nodes = list(ast.walk(module))
    parents = {child: node for node in nodes for child in ast.iter_child_nodes(node)}
    made = Made.of(nodes, parents)
    found: dict[str, list[tuple[int, str | None]]] = {}
    unread = _unread(nodes, skipped)
    for node in nodes:
        names = _mentioned(node, parents, made) if node in unread else ()
        for name in (*names, *_given(node, made, unread)):
            found.setdefault(name, []).append((getattr(node, "lineno", 1), None))
        for changed, value in _changed(node, parents, made):
            for name in NAMES if changed is None else changed:
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


def _unread(nodes: Sequence[ast.AST], skipped: Iterable[ast.AST]) -> set[ast.AST]:
    """All within what is skipped, and within the statements that make what it takes, as `k` of `Node(**k)`."""
    made: dict[str, list[ast.stmt]] = {}
    kept = set()  # descriptions grow wherever they stand, and are followed
    for node in nodes:
        if isinstance(node, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = named_in(targets)
            if isinstance(node.value, ast.Call) and called(node.value.func) == "LaunchDescription":
                kept |= names
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            names = named_in([node.value.func])  # x.append(...)
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
    return seen


def _given(node: ast.AST, made: Made, unread: Collection[ast.AST]) -> Iterable[str]:
    """The variables that a process may be given, or lose, by a dictionary that is not followed."""
    given: list[tuple[str | None, ast.expr]] = []
    if isinstance(node, ast.keyword):
        given = [(node.arg, node.value)]
    elif isinstance(node, ast.Dict):  # of arguments, perhaps
        given = [(text_of(key), value) for key, value in zip(node.keys, node.values, strict=True)]
    elif isinstance(node, ast.Assign):
        given = [(text_of(each.slice), node.value) for each in node.targets if isinstance(each, ast.Subscript)]
    elif isinstance(node, ast.Call) and called(node.func) == _REPLACING:
        given = [("env", value) for value in (*node.args, *(each.value for each in node.keywords))]
    elif isinstance(node, ast.Call) and len(node.args) == 2:  # setdefault
        given = [(text_of(node.args[0]), node.args[1])]
    for name, value in given:
        if name in _GIVING and value in unread and made.comes_from_elsewhere(value):
            yield from NAMES
        elif name == "env" and value in unread and not made.has_all(value):
            yield from (ENABLE, STRATEGY)


def _mentioned(node: ast.AST, parents: dict[ast.AST, ast.AST], made: Made) -> Iterable[str]:
    """The variables that are named here, unless they are only looked up, set to what they ought to be, or `_changed`
    speaks of them.
    """
    if isinstance(node, ast.Call) and called(node.func) in _SETTERS and _named_later(node, made):
        return NAMES
    if called(node) in _SETTERS and _is_handed_on(node, parents[node]):
        return NAMES
    if isinstance(node, (ast.List, ast.Tuple)):  # the words of a command
        return touched(" ".join(text for each in node.elts if (text := text_of(each)) is not None))
    text = node.arg if isinstance(node, ast.keyword) else text_of(node)
    if isinstance(node, ast.keyword) and text == "prefix":
        return () if (told := text_of(node.value)) is None else set_by_prefix(told)
    parent = parents[node]
    call = parents[parent] if isinstance(parent, ast.keyword) else parent
    looking = isinstance(call, ast.Call) and called(call.func) in LOOKING
    loading = isinstance(getattr(parent, "ctx", None), ast.Load)
    subscript = isinstance(parent, ast.Subscript) and (loading or made.is_environ(parent.value))
    if text is None or looking or subscript or isinstance(parent, (ast.Compare, ast.Expr)):
        return ()
    value = _value(node, parents)
    if text == PREFIX:
        return set_by_prefix(text_of(value) or "$")
    return () if (text in SECURE and text_of(value) == SECURE[text]) or _is_itself(text, value) else touched(text)


def _is_itself(name: str, value: ast.AST | None) -> bool:
    """Whether a variable is set to what it is already."""
    if isinstance(value, ast.Call) and called(value.func) == "perform" and isinstance(value.func, ast.Attribute):
        value = value.func.value
    if isinstance(value, ast.Subscript):
        return is_environ(value.value) and text_of(value.slice) == name
    if not isinstance(value, ast.Call) or called(value.func) not in LOOKING:
        return False
    given = [text_of(each) for each in (*value.args, *(each.value for each in value.keywords))]
    return given[:1] == [name] and is_itself(name, given[1] or "$" if len(given) > 1 else None)


def _is_handed_on(action: ast.AST, parent: ast.AST) -> bool:
    """Whether somebody else calls it, with what is not known: `functools.partial(SetEnvironmentVariable, NAME)`."""
    if isinstance(parent, ast.Call):
        return action in parent.args and called(parent.func) not in ("isinstance", "issubclass")
    return isinstance(parent, (ast.keyword, ast.Dict))


def _named_later(call: ast.Call, made: Made) -> bool:
    """Whether the variable that an action sets is neither a text nor a name, whose text is read apart."""
    given = [*call.args[:1], *(each.value for each in call.keywords if each.arg in ("name", None))]
    plain = all(isinstance(each, (ast.Constant, ast.Name)) for each in given)
    return not plain or any(made.comes_from_elsewhere(each) for each in given)


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


def _changed(
    node: ast.AST, parents: dict[ast.AST, ast.AST], made: Made
) -> Iterator[tuple[set[str] | None, str | None]]:
    """The names that are changed where all variables are spoken of (None: any), and to what, if that is plain."""
    name = called(node)
    if isinstance(node, ast.alias) and node.asname is not None and node.name in ENVIRON | _FUNCTIONS:
        yield None, None  # by another name it may be anywhere
    if name in _FUNCTIONS:
        yield _named(str(name), parents[node], made), None
    if text_of(node) in _SPOKEN and isinstance(parents[node], (ast.Call, ast.Subscript)):
        yield None, None
    if not made.is_environ(node) or (isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)):
        return
    parent = parents[node]
    if is_environ(node) and isinstance(parent, ast.Assign) and isinstance(parent.targets[0], ast.Name):
        return  # one of the aliases, which are looked at themselves
    if isinstance(parent, ast.Subscript) and not isinstance(parent.ctx, ast.Load):
        assigned = parents[parent]
        names = _keys(parent.slice, made)
        yield names, text_of(assigned.value) if names and isinstance(assigned, ast.Assign) else None
    elif isinstance(parent, ast.Attribute) and parent.attr not in _READING:
        yield _named(parent.attr, parents[parent], made), None
    elif isinstance(parent, ast.Call) and node in parent.args:
        if not made.only_reads(parent.func):
            yield None, None
    elif not isinstance(parent, (ast.Subscript, ast.Attribute, *_READERS)):
        yield None, None


def _named(function: str, call: ast.AST, made: Made) -> set[str] | None:
    """The variables that a call changes, as far as its arguments say."""
    if not isinstance(call, ast.Call) or (function not in _FIRST and function != "update"):
        return None
    parts = [_keys(each, made) for each in (call.args[:1] if function in _FIRST else call.args)]
    parts += [None if each.arg is None else {each.arg} for each in call.keywords if function == "update"]
    return None if None in parts or not parts else set().union(*filter(None, parts))


def _keys(node: ast.expr, made: Made) -> set[str] | None:
    """The names that a text is, or that a dictionary has, or that a loop goes through."""
    if isinstance(node, ast.Name):
        return made.texts(node.id)
    texts = [text_of(each) for each in (node.keys if isinstance(node, ast.Dict) else [node])]
    return None if None in texts else {text for text in texts if text is not None}
