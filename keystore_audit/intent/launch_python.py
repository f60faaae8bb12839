"""Launch files in Python, read as text: parsed, never imported, compiled or run.

The statements of the file and of its `generate_launch_description` are followed in order as long as they go straight
on: imports, names that are set, lists that grow. Whatever else there is, is noted with its line, and what it may have
changed is not known from there on. Where that speaks of security, it may change it.
"""

from __future__ import annotations

import ast
import warnings
from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.intent.launch_actions import LaunchAction, Unread
from keystore_audit.intent.python_actions import actions_of
from keystore_audit.intent.python_environment import speaking
from keystore_audit.intent.python_expressions import MAX_PAIRS, Expressions
from keystore_audit.intent.python_values import Growing, Imported, Items, Opaque, Pairs, Value, with_entries
from keystore_audit.intent.source import Source, shown

MAX_CHARACTERS: Final = 1 << 17
"""Length of a launch file in Python, the largest are a fifth: CPython's parser before 3.11 does not bound the depth."""

ENTRY: Final = "generate_launch_description"
"""The function that launch calls."""

_ADD_ONE: Final = frozenset({"add_action", "add_entity", "append"})


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
    names: dict[str, Value] = {}
    outer = _Statements(source, names)
    outer.follow(module.body)
    called = names.get(ENTRY)  # what the name means at last: it may have been given to something else
    if outer.entry is None or not isinstance(called, Opaque) or called.line != outer.entry.lineno:
        none = Unread(line=1, reason=f"no function {ENTRY} is defined here, which may start nodes")
        return (*speaking(module, module.body), *outer.unread, none)
    inner = _Statements(source, dict(names))
    inner.follow(outer.entry.body)
    returned = tuple(inner.returned(outer.entry))
    return (*speaking(module, (*outer.skipped, *inner.skipped)), *outer.unread, *inner.unread, *returned)


class _Statements:
    """Statements in order; `unread` collects what is not followed."""

    def __init__(self, source: Source, names: dict[str, Value]) -> None:
        self.unread: list[LaunchAction] = []
        self._skipped: list[ast.stmt] = []
        self.entry: ast.FunctionDef | None = None
        self._names = names
        self._expressions = Expressions(source, names)
        self._functions: set[str] = set()
        self._returned: Value | None = None
        self._ended = False

    @property
    def skipped(self) -> Iterator[ast.AST]:
        """What is not followed: statements, and expressions within those that are."""
        yield from self._skipped
        yield from self._expressions.opaque

    def returned(self, function: ast.FunctionDef) -> Iterator[LaunchAction]:
        """The actions of the launch description that is returned."""
        value = self._returned
        if isinstance(value, Growing):
            value = self._expressions.part(value, function.lineno)
        if isinstance(value, (Items, Opaque)):
            yield from actions_of(value, function.lineno)
        else:
            yield Unread(line=function.lineno, reason=f"what {ENTRY} returns is not read; it may start nodes")

    def follow(self, statements: Iterable[ast.stmt]) -> None:
        """Follow statements until one returns."""
        for statement in statements:
            if self._ended:
                return
            self._statement(statement)

    def _statement(self, statement: ast.stmt) -> None:
        if isinstance(statement, (ast.Import, ast.ImportFrom)):
            self._import(statement)
        elif isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            self._define(statement)
        elif any(isinstance(node, ast.NamedExpr) for node in ast.walk(statement)):
            self._not_followed(statement)
        elif isinstance(statement, ast.Return):
            self._returned = None if statement.value is None else self._value(statement.value, statement)
            self._ended = True
        elif isinstance(statement, ast.Assign) and len(statement.targets) == 1:
            self._assign(statement, statement.targets[0], statement.value)
        elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
            self._assign(statement, statement.target, statement.value)
        elif isinstance(statement, ast.AugAssign):
            self._grow(statement)
        elif isinstance(statement, ast.Expr):
            self._expression(statement)
        elif not (isinstance(statement, (ast.Pass, ast.AnnAssign)) or _is_main(statement)):
            self._not_followed(statement)

    def _import(self, statement: ast.Import | ast.ImportFrom) -> None:
        for alias in statement.names:
            if alias.name == "*":
                self._not_followed(statement)
            elif isinstance(statement, ast.Import):
                bound = alias.asname or alias.name.split(".", 1)[0]
                self._names[bound] = Imported(path=alias.name if alias.asname else bound)
            else:
                module = statement.module or ""
                self._names[alias.asname or alias.name] = Imported(path=f"{'.' * statement.level}{module}.{alias.name}")

    def _define(self, statement: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) -> None:
        if statement.name == ENTRY:
            plain = isinstance(statement, ast.FunctionDef) and not statement.decorator_list
            self.entry = statement if plain and isinstance(statement, ast.FunctionDef) else None
        if statement is not self.entry:
            self._skipped.append(statement)
        self._functions.add(statement.name)
        self._names[statement.name] = Opaque(line=statement.lineno, reason=f"the function {shown(statement.name)}")

    def _assign(self, statement: ast.stmt, target: ast.expr, value: ast.expr) -> None:
        if isinstance(target, ast.Name):
            self._names[target.id] = self._value(value, statement)
        else:
            self._enter(statement, target, value)

    def _enter(self, statement: ast.stmt, target: ast.expr, value: ast.expr) -> None:
        """An entry of a dictionary that has one name: by another it would be changed, too."""
        match target:
            case ast.Subscript(ast.Name(name), ast.Constant(str(key))):
                held = self._names.get(name)
                alone = sum(each is held for each in self._names.values()) == 1
                if isinstance(held, Pairs) and alone and len(held.pairs) < MAX_PAIRS:
                    entry = self._expressions.part(self._value(value, statement), statement.lineno)
                    self._names[name] = with_entries(held, {key: entry})
                    return
        self._not_followed(statement)

    def _value(self, node: ast.expr, statement: ast.stmt) -> Value:
        """The value of an expression; a call that is not followed may add to lists that it gets or knows."""
        value = self._expressions.value(node)
        if isinstance(value, Opaque):
            names = [found.id for found in ast.walk(node) if isinstance(found, ast.Name)]
            if any(name in self._functions or self._may_change(name) for name in names):
                self._not_followed(statement)
        return value

    def _may_change(self, name: str) -> bool:
        held = self._names.get(name)
        return isinstance(held, Growing) or (isinstance(held, Pairs) and held.inherited)

    def _grow(self, statement: ast.AugAssign) -> None:
        target = statement.target
        held = self._names.get(target.id) if isinstance(target, ast.Name) else None
        added = self._expressions.part(self._expressions.value(statement.value), statement.lineno)
        if isinstance(held, Growing) and isinstance(statement.op, ast.Add) and isinstance(added, Items):
            self._add(held, added.items, statement)
        else:
            self._not_followed(statement)

    def _add(self, held: Growing, items: Iterable[Value], statement: ast.stmt) -> None:
        if held.used:
            self._not_followed(statement)  # what it is part of grows with it, or does not: that depends on launch
        held.items += items

    def _expression(self, statement: ast.Expr) -> None:
        """A statement that is an expression: a docstring, or a list that grows."""
        match statement.value:
            case ast.Constant():
                return
            case ast.Call(ast.Attribute(holder, method), arguments, keywords):
                held = self._expressions.value(holder)
                if isinstance(held, Growing) and len(arguments) == 1 and not keywords:
                    added = self._expressions.part(self._expressions.value(arguments[0]), statement.lineno)
                    if method in _ADD_ONE:
                        self._add(held, (added,), statement)
                        return
                    if method == "extend" and isinstance(added, Items):
                        self._add(held, added.items, statement)
                        return
        self._not_followed(statement)

    def _not_followed(self, statement: ast.stmt) -> None:
        """Note a statement; nothing that it may set or change is known from here on."""
        self._skipped.append(statement)
        said = "a statement that is not followed; it may start nodes or change their names"
        self.unread.append(Unread(line=statement.lineno, reason=said))
        lost = Opaque(line=statement.lineno, reason=f"what the statement in line {statement.lineno} sets")
        if isinstance(statement, ast.ImportFrom):  # a star: every name may be another now
            self._names.clear()
        for node in ast.walk(statement):
            if isinstance(node, ast.Name):
                held = self._names.get(node.id)
                changed = isinstance(held, Growing) and not held.description
                if not isinstance(node.ctx, ast.Load) or changed:
                    self._names[node.id] = lost
                if isinstance(held, Pairs):
                    self._names |= {name: lost for name, each in self._names.items() if each is held}
            elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                self._names[node.name] = lost
                self.entry = None if node.name == ENTRY else self.entry
            elif isinstance(node, ast.alias):
                self._names[(node.asname or node.name).split(".", 1)[0]] = lost
            elif isinstance(node, (ast.ExceptHandler, ast.MatchAs, ast.MatchStar)) and node.name is not None:
                self._names[node.name] = lost
            elif isinstance(node, ast.MatchMapping) and node.rest is not None:
                self._names[node.rest] = lost


def _is_main(statement: ast.stmt) -> bool:
    """Whether it is `if __name__ == "__main__":`, which is never so when launch loads the file."""
    match statement:
        case ast.If(ast.Compare(ast.Name("__name__"), [ast.Eq()], [ast.Constant("__main__")]), orelse=[]):
            return True
    return False
