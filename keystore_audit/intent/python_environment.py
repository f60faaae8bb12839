"""What a Python launch file makes of its own environment, which every process has that it starts.

`environment` of a LaunchContext is `os.environ` (launch, launch_context.py). Looked at is every place in the file,
followed or not; one where it is only read is none of these.
"""

from __future__ import annotations

import ast
import builtins
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Final

from keystore_audit.dataclass import dataclass, field
from keystore_audit.intent.environment import ENABLE, SECURE, STRATEGY
from keystore_audit.intent.launch_actions import AssignEnvironment, LaunchAction, Unknown, Unread
from keystore_audit.intent.launch_environment import NAMES, PREFIX, is_itself, set_by_prefix, touched

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

_REPLACING: Final = "ReplaceEnvironmentVariables"
_GIVING: Final = frozenset({"additional_env", "env"})
"""Arguments that give variables to a process."""

_EMPTYING: Final = frozenset({"clear", "popitem"})
_ADDING: Final = frozenset({"__setitem__", "setdefault", "update"})
_READS: Final = frozenset({"__import__", "eval", "exec", "getattr", "globals", "input", "open", "vars"})
_BUILTIN: Final = frozenset(dir(builtins)) - _READS
"""What brings nothing from elsewhere."""

_NOT_FOLLOWED: Final = (ast.Lambda, ast.ListComp, ast.GeneratorExp, ast.SetComp, ast.DictComp, ast.IfExp)


def changes(module: ast.Module, skipped: Iterable[ast.AST]) -> Iterator[LaunchAction]:
    """The variables of `NAMES` that the file may set or take away: to what is known where that is said once.

    In what is `skipped`, and what that takes from elsewhere in the file, to name a variable is enough. Processes that
    start there have what is said here, whatever the file sets later.
    """
    nodes = list(ast.walk(module))
    parents = {child: node for node in nodes for child in ast.iter_child_nodes(node)}
    made = _Made.of(nodes, parents)
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
    return seen


def _named_in(nodes: Iterable[ast.AST]) -> set[str]:
    return {inner.id for node in nodes for inner in ast.walk(node) if isinstance(inner, ast.Name)}


MAX_DEPTH: Final = 64
"""Dictionaries that are made of others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Made:
    """What names stand for, wherever in the file.

    `values`: what is assigned, or returned by the function; `more`: what is added to it, gone through by a loop, or
    called with it. `bound`: names that are no other module's; `aliases`: other names of `os.environ`. `emptied`: names
    of dictionaries that lose entries which are not named. `whole`: what `has_all` said of
    names; `own`: those that do not come from elsewhere.
    """

    values: dict[str, list[ast.AST]] = field(default_factory=dict)
    more: dict[str, list[ast.AST]] = field(default_factory=dict)
    bound: set[str] = field(default_factory=lambda: set(_BUILTIN))
    aliases: set[str] = field(default_factory=set)
    emptied: set[str] = field(default_factory=set)
    whole: dict[str, bool] = field(default_factory=dict)
    own: set[str] = field(default_factory=set)

    @staticmethod
    def of(nodes: Iterable[ast.AST], parents: Mapping[ast.AST, ast.AST]) -> _Made:
        """All of a file; `nodes`: outer ones first."""
        made = _Made()
        within: dict[ast.AST, str] = {}
        for node in nodes:
            outer = parents.get(node, node)
            within[node] = outer.name if isinstance(outer, ast.FunctionDef) else within.get(outer, "")
            if isinstance(node, ast.Return) and node.value is not None:
                made.values.setdefault(within[node], []).append(node.value)
            elif isinstance(node, ast.arg):
                made.bound.add(node.arg)
            elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                made.bound.add(node.name)
            elif isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
                made.bound.add(node.id)
            else:
                made._note(node)
        return made

    def _note(self, node: ast.AST) -> None:
        """What a statement or an expression makes of names."""
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                kept = self.values if isinstance(target, ast.Name) else self.more
                added = target.slice if isinstance(target, ast.Subscript) else node.value
                for name in _named_in([getattr(target, "value", target)]):
                    kept.setdefault(name, []).append(added)
                    self.aliases.update([name] if _is_environ(node.value) else [])
        elif isinstance(node, (ast.For, ast.comprehension, ast.AugAssign, ast.withitem)):
            bound = node.optional_vars if isinstance(node, ast.withitem) else node.target
            added = next(getattr(node, each) for each in ("iter", "value", "context_expr") if hasattr(node, each))
            for name in _named_in([] if bound is None else [bound]):
                self.more.setdefault(name, []).append(added)
        elif isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Del) and _text(node.slice) is None:
            self.emptied.update(_named_in([node.value]))
        elif isinstance(node, ast.Call):
            method, held = _called(node.func) or "", _called(getattr(node.func, "value", node.func)) or ""
            for each in () if method[:1].isupper() or method in _LOOKING | _FIRST else node.args:
                if isinstance(each, ast.Name):  # classes make something, functions may change what they get
                    self.more.setdefault(each.id, []).append(node.func)
            if method in _EMPTYING or (method == "pop" and node.args and _text(node.args[0]) is None):
                self.emptied.add(held)
            elif method in _ADDING:
                self.more.setdefault(held, []).extend(node.args[:1])

    def has_all(self, value: ast.AST, depth: int = 0) -> bool:
        """Whether a dictionary holds all variables that there were, or there is none."""
        if depth > MAX_DEPTH:
            return False
        if self.is_environ(value) or (isinstance(value, ast.Constant) and value.value is None):
            return True
        if isinstance(value, ast.Name):
            if value.id not in self.whole:
                self.whole[value.id] = False  # until it is known: a name may be made of itself
                made = () if value.id in self.emptied else self.values.get(value.id, ())
                self.whole[value.id] = bool(made) and all(self.has_all(each, depth + 1) for each in made)
            return self.whole[value.id]
        if isinstance(value, ast.IfExp):
            return self.has_all(value.body, depth + 1) and self.has_all(value.orelse, depth + 1)
        return any(self.has_all(part, depth + 1) for part in _parts(value))

    def comes_from_elsewhere(self, value: ast.AST) -> bool:
        """Whether a dictionary or list may have names in it that this file does not say."""
        waiting, seen, asked = [value], set[str](), getattr(value, "id", "")
        while waiting:
            value = waiting.pop()
            if self.is_environ(value):
                continue
            if not isinstance(value, ast.Name):
                waiting += _names_from(value)
            elif value.id not in self.bound:
                self.bound.discard(asked)
                return True
            elif value.id not in seen and value.id not in self.own:
                seen.add(value.id)
                waiting += (*self.values.get(value.id, ()), *self.more.get(value.id, ()))
        self.own.update(seen)
        return False

    def is_environ(self, node: ast.AST) -> bool:
        """Whether it is `os.environ`, or a name for it."""
        return _is_environ(node) or (isinstance(node, ast.Name) and node.id in self.aliases)


def _parts(value: ast.AST) -> Iterator[ast.AST]:
    """The dictionaries that entries of a dictionary come from."""
    if isinstance(value, ast.Dict):
        yield from (each for key, each in zip(value.keys, value.values, strict=True) if key is None)
    elif isinstance(value, ast.BinOp):
        yield from (value.left, value.right)
    elif isinstance(value, ast.IfExp):
        yield from (value.body, value.orelse)
    elif isinstance(value, ast.Call) and _called(value.func) in ("dict", "copy", "deepcopy"):
        yield from (*value.args, *(each.value for each in value.keywords if each.arg is None))
        yield from [value.func.value] if isinstance(value.func, ast.Attribute) and not value.args else []
    elif isinstance(value, (ast.Call, ast.Attribute, ast.Subscript)):
        yield value.func if isinstance(value, ast.Call) else value.value


def _names_from(value: ast.AST) -> Iterator[ast.AST]:
    """What the names of entries come from, or the texts of a list."""
    yield from _parts(value)
    if isinstance(value, ast.Dict):
        yield from (key for key in value.keys if key is not None)
    elif isinstance(value, ast.DictComp):
        yield value.key
    elif isinstance(value, (ast.Tuple, ast.List)):
        pair = len(value.elts) == 2 and _text(value.elts[0]) is not None
        yield from () if pair else value.elts
    elif isinstance(value, ast.Call) and _called(value.func) in _BUILTIN:
        yield from value.args
    elif isinstance(value, (ast.ListComp, ast.GeneratorExp, ast.SetComp, ast.JoinedStr, ast.FormattedValue)):
        yield from ast.iter_child_nodes(value)


def _given(node: ast.AST, made: _Made, unread: Collection[ast.AST]) -> Iterable[str]:
    """The variables that a process may be given, or lose, by a dictionary that is not followed."""
    given: list[tuple[str | None, ast.expr]] = []
    if isinstance(node, ast.keyword):
        given = [(node.arg, node.value)]
    elif isinstance(node, ast.Dict):  # of arguments, perhaps
        given = [(_text(key), value) for key, value in zip(node.keys, node.values, strict=True)]
    elif isinstance(node, ast.Call) and _called(node.func) == _REPLACING:
        given = [("env", value) for value in (*node.args, *(each.value for each in node.keywords))]
    for name, value in given:
        if name in _GIVING and value in unread and made.comes_from_elsewhere(value):
            yield from NAMES
        elif name == "env" and value in unread and not made.has_all(value):
            yield from (ENABLE, STRATEGY)


def _mentioned(node: ast.AST, parents: dict[ast.AST, ast.AST], made: _Made) -> Iterable[str]:
    """The variables that are named here, unless they are only looked up, set to what they ought to be, or `_changed`
    speaks of them.
    """
    if isinstance(node, ast.Call) and _called(node.func) in _SETTERS and _named_later(node, made):
        return NAMES
    if isinstance(node, (ast.List, ast.Tuple)):  # the words of a command
        return touched(" ".join(text for each in node.elts if (text := _text(each)) is not None))
    text = node.arg if isinstance(node, ast.keyword) else _text(node)
    if isinstance(node, ast.keyword) and text == "prefix":
        return () if (told := _text(node.value)) is None else set_by_prefix(told)
    parent = parents[node]
    call = parents[parent] if isinstance(parent, ast.keyword) else parent
    looking = isinstance(call, ast.Call) and _called(call.func) in _LOOKING
    loading = isinstance(getattr(parent, "ctx", None), ast.Load)
    subscript = isinstance(parent, ast.Subscript) and (loading or made.is_environ(parent.value))
    if text is None or looking or subscript or isinstance(parent, (ast.Compare, ast.Expr)):
        return ()
    value = _value(node, parents)
    if text == PREFIX:
        return set_by_prefix(_text(value) or "$")
    return () if (text in SECURE and _text(value) == SECURE[text]) or _is_itself(text, value) else touched(text)


def _is_itself(name: str, value: ast.AST | None) -> bool:
    """Whether a variable is set to what it is already."""
    if isinstance(value, ast.Call) and _called(value.func) == "perform" and isinstance(value.func, ast.Attribute):
        value = value.func.value
    if isinstance(value, ast.Subscript):
        return _is_environ(value.value) and _text(value.slice) == name
    if not isinstance(value, ast.Call) or _called(value.func) not in _LOOKING:
        return False
    given = [_text(each) for each in (*value.args, *(each.value for each in value.keywords))]
    return given[:1] == [name] and is_itself(name, given[1] or "$" if len(given) > 1 else None)


def _named_later(call: ast.Call, made: _Made) -> bool:
    """Whether the variable that an action sets is neither a text nor a name, whose text is read apart."""
    given = [*call.args[:1], *(each.value for each in call.keywords if each.arg == "name")]
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


def _called(node: ast.AST) -> str | None:
    """The last name of what is called or spoken of."""
    name: str | None = getattr(node, "attr", getattr(node, "id", None))
    return name


def _is_environ(node: ast.AST) -> bool:
    called = _called(node)
    return called in _ENVIRON or (isinstance(node, ast.Attribute) and called == "environment")


def _changed(
    node: ast.AST, parents: dict[ast.AST, ast.AST], made: _Made
) -> Iterator[tuple[set[str] | None, str | None]]:
    """The names that are changed where all variables are spoken of (None: any), and to what, if that is plain."""
    called = _called(node)
    if isinstance(node, ast.alias) and node.asname is not None and node.name in _ENVIRON | _FUNCTIONS:
        yield None, None  # by another name it may be anywhere
    if called in _FUNCTIONS:
        yield _named(str(called), parents[node]), None
    if not made.is_environ(node) or (isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)):
        return
    parent = parents[node]
    if _is_environ(node) and isinstance(parent, ast.Assign) and isinstance(parent.targets[0], ast.Name):
        return  # one of the aliases, which are looked at themselves
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
