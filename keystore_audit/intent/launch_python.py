"""Launch files in Python, read as text as far as they are literal: parsed, never imported, compiled or run.

What says by itself what it starts (`Node(...)`, `SetEnvironmentVariable(...)`, lists of those, names for them) becomes
the elements that XML has (`launch_elements`). All else is one note, since it may start anything. Where unread code
holds a word of security, or hands over an environment made elsewhere, it may change security.
"""

from __future__ import annotations

import ast
import warnings
from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.intent.launch_elements import Element, speaks_of
from keystore_audit.intent.python_values import CLASSES, LOST, Expressions, Imported, Value, code, names_in
from keystore_audit.intent.source import Source

MAX_CHARACTERS: Final = 1 << 17
"""Length of a launch file in Python, the largest are a fifth: CPython's parser before 3.11 does not bound the depth."""

ENTRY: Final = "generate_launch_description"
"""The function that launch calls."""

_DEFINED: Final = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)

Bound = dict[str, list[ast.stmt]]
"""By name the statements of the file and of its function that bind it, whole ones such as loops among them."""


def read_python(source: Source) -> Element:
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
    entry = next((each for each in module.body if isinstance(each, ast.FunctionDef) and each.name == ENTRY), None)
    bound: Bound = {}
    for statement in (*module.body, *(entry.body if entry is not None else ())):
        for name in {statement.name} if isinstance(statement, _DEFINED) else names_in(statement, bound=True):
            bound.setdefault(name, []).append(statement)
    told = {name for name, by in bound.items() if sum(not isinstance(each, ast.AugAssign) for each in by) == 1}
    first = _Reader(source, told, set())
    first.follow(module, entry)
    reader = _Reader(source, told, {name for node in first.unread for name in names_in(node)})
    found = reader.follow(module, entry)
    outside = sorted(map(code, reader.noted), key=lambda element: element.line)[:1]
    return Element(kind="launch", line=1, children=(*outside, *_speaking(module, bound, reader.unread), *found))


class _Reader(Expressions):
    """Follows statements in order as far as they are assignments, lists that grow, and a return."""

    def follow(self, module: ast.Module, entry: ast.FunctionDef | None) -> list[Element]:
        """The elements of the description that the file's function returns."""
        self._statements(module.body)
        plain = entry is not None and not entry.decorator_list and ENTRY in self._told and "*" not in self._told
        if entry is None or not plain or any(isinstance(each, (ast.Yield, ast.YieldFrom)) for each in ast.walk(entry)):
            return [self._note(module)]
        returned = self._statements(entry.body)
        if returned is None or returned.value is None:
            return [self._note(entry)]
        return self._elements(returned, self._value(returned.value))

    def _statements(self, statements: Iterable[ast.stmt]) -> ast.Return | None:
        for statement in statements:
            if isinstance(statement, ast.Return):
                return statement
            self._statement(statement)
        return None

    def _statement(self, statement: ast.stmt) -> None:
        match statement:
            case ast.Import(names) | ast.ImportFrom(names=names):
                origin = f"{'.' * statement.level}{statement.module}." if isinstance(statement, ast.ImportFrom) else ""
                for each in names:
                    top = each.name if origin or each.asname else each.name.partition(".")[0]
                    self._bind(each.asname or top, Imported(f"{origin}{top}"))
            case ast.FunctionDef(name) | ast.AsyncFunctionDef(name) | ast.ClassDef(name):
                if name != ENTRY:
                    self.unread.append(statement)
            case ast.Assign([ast.Name(name)], value) | ast.AnnAssign(ast.Name(name), value=ast.expr() as value):
                held = self._value(value)
                if isinstance(value, ast.Name) and isinstance(held, (list, dict)):
                    self.unread.append(statement)  # what is done to it by one name is not seen by the other
                else:
                    self._bind(name, held)
            case ast.AugAssign(ast.Name(name), ast.Add(), value):
                self._grow(statement, name, self._value(value))
            case ast.Expr(
                ast.Call(ast.Attribute(ast.Name(name), "append" | "add_action" | "extend" as how), [value], [])
            ):
                added = self._value(value)
                self._grow(statement, name, added if how == "extend" else [added])
            case (
                ast.Expr(ast.Constant())
                | ast.Pass()
                | ast.If(ast.Compare(ast.Name("__name__"), [ast.Eq()], [ast.Constant("__main__")]), orelse=[])
            ):
                pass
            case _:
                self._note(statement)

    def _bind(self, name: str, value: Value) -> None:
        self._names[name] = value if name in self._told else LOST

    def _grow(self, statement: ast.stmt, name: str, added: Value) -> None:
        held = self._names.get(name)
        if isinstance(held, list) and isinstance(added, list) and name not in self._used:
            held += added
        else:
            self._note(statement)
            self._names[name] = held if isinstance(held, list) else LOST


# What of the code that is not read may change security, or the environment of launch itself


_CHANGING: Final = frozenset({"clearenv", "environb", "load_dotenv", "putenv", "setenv", "unsetenv"})
_GIVING: Final = frozenset({"additional_env", "env"})
"""Arguments that give variables to a process."""
_SETTERS: Final = frozenset(
    name for name, (kind, _arguments) in CLASSES.items() if kind.endswith("_env") and kind != "push_env"
)
"""Actions that change variables; of some the first argument is the name of one."""


def _speaking(module: ast.Module, bound: Bound, unread: Iterable[ast.AST]) -> Iterator[Element]:
    """What speaks of security in what is `unread`, and in the statements that make what that takes, as `k` of
    `Node(**k)`: one place.
    """
    parents = {child: node for node in ast.walk(module) for child in ast.iter_child_nodes(node)}
    waiting, within = [*unread], set[ast.AST]()
    while waiting:
        node = waiting.pop()
        if node not in within:
            within.add(node)
            waiting += ast.iter_child_nodes(node)
            waiting += bound.get(node.id, ()) if isinstance(node, ast.Name) else ()
    found = []
    for node, parent in parents.items():
        word = _changing(node, parent) or (_said(node, parent) if node in within else "")
        if word:
            found.append((getattr(node, "lineno", 1), word))
    for line, word in sorted(found)[:1]:
        yield Element(kind="speaks", line=line, attributes={"word": (word,)})


def _said(node: ast.AST, parent: ast.AST) -> str:
    """The word of security that a piece of code is."""
    match node, parent:
        case ast.Constant(), ast.Expr():
            return ""
        case ast.Constant(str() | bytes() as plain), _:
            text = plain if isinstance(plain, str) else plain.decode("latin-1")
            return text if text in _GIVING else speaks_of(text)
        case ast.keyword("env" | "additional_env", ast.Constant(None)), _:
            return ""
        case ast.keyword("additional_env", ast.Dict(keys)), _ if all(isinstance(key, ast.Constant) for key in keys):
            return ""
        case ast.keyword("env" | "additional_env" as name), _:
            return name
        case ((ast.Name(name) | ast.Attribute(attr=name)), _) if name in _SETTERS:
            told = isinstance(parent, ast.Call) and any(isinstance(each, ast.Constant) for each in parent.args[:1])
            return "" if told else name
    names = (getattr(node, each, None) for each in ("id", "attr", "arg", "name"))
    return speaks_of(*(name for name in names if isinstance(name, str)))


def _changing(node: ast.AST, parent: ast.AST) -> str:
    """How the file may change the environment of launch itself, which every process has that it starts."""
    match node, parent:
        case ast.Constant("environ" | "os.environ"), _:
            return "os.environ"
        case ((ast.Name(name) | ast.Attribute(attr=name)), _) if name in _CHANGING:
            return name
        case ((ast.Name("environ") | ast.Attribute(attr="environ" | "environment")), ast.Subscript(_, key, context)):
            told = isinstance(key, ast.Constant) and not speaks_of(str(key.value))
            return "" if told or isinstance(context, ast.Load) else "os.environ"
        case ((ast.Name("environ") | ast.Attribute(attr="environ" | "environment")), _):
            reading = isinstance(parent, ast.Attribute) and parent.attr == "get"
            return "" if reading or isinstance(parent, ast.Compare) else "os.environ"
        case ast.alias("environ", str()), _:
            return "os.environ"
    return ""
