"""Where code of a Python launch file that is not read may change security, or the environment of launch itself.

Nothing is worked out: a word of security in such code leaves open what processes start with, and so does an environment
made elsewhere and any use of the process's own but to look something up.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from typing import Final

from keystore_audit.intent.launch_actions import Unread
from keystore_audit.intent.launch_environment import speaks_of

_CHANGING: Final = frozenset(
    {"clearenv", "load_dotenv", "putenv", "setenv", "unsetenv", "environb"}
    | {"PopEnvironment", "ReplaceEnvironmentVariables", "ResetEnvironment"}
)
_READING: Final = frozenset({"copy", "get", "items", "keys", "values"})
_GIVING: Final = frozenset({"additional_env", "env"})
"""Arguments that give variables to a process."""

_SETTERS: Final = frozenset({"AppendEnvironmentVariable", "SetEnvironmentVariable", "UnsetEnvironmentVariable"})
"""Actions whose first argument is the name of a variable."""


def speaking(module: ast.Module, unread: Iterable[ast.AST]) -> tuple[Unread, ...]:
    """What speaks of security in what is `unread`, and in what that takes from elsewhere in the file: one place."""
    parents = {child: node for node in ast.walk(module) for child in ast.iter_child_nodes(node)}
    without = _with_origins(module, unread)
    found = []
    for node in parents:
        word = _changing(node, parents) or (_said(node, parents) if node in without else "")
        if word:
            found.append((getattr(node, "lineno", 1), word))
    reason = "code that is not read may start nodes or change variables"
    return tuple(Unread(line=line, reason=reason, speaks=word) for line, word in sorted(found)[:1])


def _with_origins(module: ast.Module, unread: Iterable[ast.AST]) -> set[ast.AST]:
    """All within what is not read, and within the statements that make what it takes, as `k` of `Node(**k)`."""
    made: dict[str, list[ast.AST]] = {}
    for node in ast.walk(module):
        if isinstance(node, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for name in names_in(*targets):
                made.setdefault(name, []).append(node)
    waiting, seen = [*unread], set[ast.AST]()
    while waiting:
        node = waiting.pop()
        if node not in seen:
            seen.add(node)
            waiting += ast.iter_child_nodes(node)
            waiting += made.pop(node.id, ()) if isinstance(node, ast.Name) else ()
    return seen


def _said(node: ast.AST, parents: Mapping[ast.AST, ast.AST]) -> str:
    """The word of security that a piece of code is."""
    if isinstance(node, ast.Constant):
        text = node.value.decode("latin-1") if isinstance(node.value, bytes) else node.value
        if not isinstance(text, str) or isinstance(parents[node], ast.Expr):
            return ""
        return text if text in _GIVING else speaks_of(text)
    if isinstance(node, ast.keyword) and node.arg in _GIVING:
        told = isinstance(node.value, ast.Dict) and all(isinstance(key, ast.Constant) for key in node.value.keys)
        none = isinstance(node.value, ast.Constant) and node.value.value is None
        return "" if none or (told and node.arg == "additional_env") else node.arg
    called, call = getattr(node, "id", None) or getattr(node, "attr", ""), parents[node]
    if called in _SETTERS and not (
        isinstance(call, ast.Call) and any(isinstance(e, ast.Constant) for e in call.args[:1])
    ):
        return str(called)
    names = (getattr(node, each, None) for each in ("id", "attr", "arg", "name"))
    return speaks_of(*(name for name in names if isinstance(name, str)))


def _changing(node: ast.AST, parents: Mapping[ast.AST, ast.AST]) -> str:
    """How the file may change the environment of launch itself, which every process has that it starts."""
    parent = parents[node]
    if isinstance(node, ast.Constant) and node.value in ("environ", "os.environ"):
        return "os.environ"
    name = getattr(node, "id", None) or getattr(node, "attr", None)
    if name in _CHANGING:
        return str(name)
    if name != "environ" and not (name == "environment" and isinstance(node, ast.Attribute)):
        return "os.environ" if isinstance(node, ast.alias) and node.name == "environ" and node.asname else ""
    if isinstance(parent, ast.Subscript):
        told = isinstance(parent.slice, ast.Constant) and not speaks_of(str(parent.slice.value))
        return "" if told or isinstance(parent.ctx, ast.Load) else "os.environ"
    reading = isinstance(parent, ast.Attribute) and parent.attr in _READING
    return "" if reading or isinstance(parent, ast.Compare) else "os.environ"


def names_in(*nodes: ast.AST) -> set[str]:
    """The names in these pieces of code, used, set or made."""
    found = set[str]()
    for node in (each for top in nodes for each in ast.walk(top)):
        for field in ("id", "name", "rest"):
            if isinstance(name := getattr(node, field, None), str) and not isinstance(node, ast.alias):
                found.add(name)
        if isinstance(node, ast.alias):
            found.add((node.asname or node.name).partition(".")[0])
    return found
