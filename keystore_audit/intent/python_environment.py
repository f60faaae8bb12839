"""Where a Python launch file may change security in code that is not followed, or through `os.environ`.

Nothing is worked out: a name or text of security in such code, an environment that comes from elsewhere, and any use of
the process's own environment but to look something up leave open what processes start with.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from keystore_audit.intent.launch_actions import Unread
from keystore_audit.intent.launch_environment import speaks_of

_ENVIRON: Final = frozenset({"environ", "environb", "environment"})
"""`environment` of a LaunchContext is `os.environ` (launch, launch_context.py)."""

_FUNCTIONS: Final = frozenset({"clearenv", "load_dotenv", "putenv", "setenv", "unsetenv"})
_LOOKING: Final = frozenset({"EnvironmentVariable", "get", "getenv"})
"""What is called with the name of a variable to look it up."""

_READING: Final = frozenset({"copy", "get", "items", "keys", "values"})
_READERS: Final = (ast.Compare, ast.Dict, ast.For, ast.comprehension, ast.keyword)
"""What takes all of the variables and changes none: `{**os.environ}`, `"X" in os.environ`."""

_COPIES: Final = frozenset({"copy", "deepcopy", "dict", "len", "list", "print", "sorted"})
_GIVING: Final = frozenset({"additional_env", "env"})
"""Arguments that give variables to a process."""

_SETTERS: Final = frozenset({"AppendEnvironmentVariable", "SetEnvironmentVariable", "UnsetEnvironmentVariable"})
"""Actions whose first argument is the name of a variable."""

_REPLACING: Final = frozenset({"PopEnvironment", "ReplaceEnvironmentVariables", "ResetEnvironment"})
_NOT_FOLLOWED: Final = (ast.Lambda, ast.ListComp, ast.GeneratorExp, ast.SetComp, ast.DictComp, ast.IfExp)


def speaking(module: ast.Module, skipped: Iterable[ast.AST]) -> Iterator[Unread]:
    """What speaks of security in what is `skipped`, and what that takes from elsewhere in the file; each line once."""
    nodes = list(ast.walk(module))
    parents = {child: node for node in nodes for child in ast.iter_child_nodes(node)}
    unread = _unread(nodes, skipped)
    found: dict[int, str] = {}
    for node in nodes:
        word = _changes_its_own(node, parents) or (_named(node, parents) if node in unread else "")
        if word:
            found.setdefault(getattr(node, "lineno", 1), word)
    for line, word in found.items():
        yield Unread(line=line, reason="code that is not followed may start nodes or change variables", speaks=word)


def _unread(nodes: Sequence[ast.AST], skipped: Iterable[ast.AST]) -> set[ast.AST]:
    """All within what is skipped, and within the statements that make what it takes, as `k` of `Node(**k)`."""
    made: dict[str, list[ast.stmt]] = {}
    kept = set()  # descriptions grow wherever they stand, and are followed
    for node in nodes:
        if isinstance(node, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = _names_in(targets)
            if isinstance(node.value, ast.Call) and _called(node.value.func) == "LaunchDescription":
                kept |= names
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            names = _names_in([node.value.func])  # x.append(...)
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


def _named(node: ast.AST, parents: Mapping[ast.AST, ast.AST]) -> str:
    """The word of security that a piece of unread code is; looking a variable up changes nothing."""
    parent = parents[node]
    if isinstance(node, ast.keyword):
        handed_on = node.arg in _GIVING and not _is_told(node)
        return str(node.arg) if handed_on else speaks_of(node.arg or "")
    if isinstance(node, ast.Constant):
        text = node.value.decode("latin-1") if isinstance(node.value, bytes) else node.value
        call = parents[parent] if isinstance(parent, ast.keyword) else parent
        looked_up = isinstance(call, ast.Call) and _called(call.func) in _LOOKING
        looked_up = looked_up or (isinstance(parent, ast.Subscript) and isinstance(parent.ctx, ast.Load))
        if not isinstance(text, str) or looked_up or isinstance(parent, (ast.Expr, ast.Compare)):
            return ""
        return text if text in _GIVING else speaks_of(text)
    name = _called(node)
    if name in _REPLACING or (name in _SETTERS and not _sets_told(node, parent)):
        return str(name)
    return speaks_of(name or getattr(node, "name", None) or getattr(node, "arg", None) or "")


def _is_told(given: ast.keyword) -> bool:
    """Whether the variables that a process is given stand there, beside all that there were."""
    if isinstance(given.value, ast.Constant):
        return given.value.value is None
    told = isinstance(given.value, ast.Dict) and all(isinstance(key, ast.Constant) for key in given.value.keys)
    return told and given.arg == "additional_env"


def _sets_told(action: ast.AST, call: ast.AST) -> bool:
    """Whether the variable's name stands there, which is looked at itself."""
    if not isinstance(call, ast.Call) or call.func is not action:
        return isinstance(call, (ast.Attribute, ast.alias))
    given = [*call.args[:1], *(each.value for each in call.keywords if each.arg in ("name", None))]
    return all(isinstance(each, ast.Constant) for each in given)


def _changes_its_own(node: ast.AST, parents: Mapping[ast.AST, ast.AST]) -> str:
    """How the file may change the environment of launch itself, which every process has that it starts."""
    name, parent = _called(node), parents.get(node)
    if isinstance(node, ast.alias) and node.asname is not None and node.name in _ENVIRON | _FUNCTIONS:
        return node.name
    if isinstance(node, ast.Constant) and node.value in ("environ", "os.environ"):
        return "os.environ" if isinstance(parent, (ast.Call, ast.Subscript)) else ""
    if name in _FUNCTIONS:
        return str(name)
    if name not in _ENVIRON or (name == "environment" and isinstance(node, ast.Name)):
        return ""
    if isinstance(parent, ast.Subscript):
        return "" if isinstance(parent.ctx, ast.Load) or _is_harmless(parent.slice) else "os.environ"
    if isinstance(parent, ast.Attribute):
        call = parents[parent]
        changed = call.args[0] if isinstance(call, ast.Call) and call.args else None
        told = parent.attr in ("pop", "setdefault") and changed is not None and _is_harmless(changed)
        return "" if told or parent.attr in _READING else "os.environ"
    if isinstance(parent, ast.Call):
        return "" if node in parent.args and _called(parent.func) in _COPIES else "os.environ"
    return "" if isinstance(parent, (ast.Attribute, *_READERS)) else "os.environ"


def _is_harmless(key: ast.expr) -> bool:
    """Whether it is the name of a variable that has nothing to do with security."""
    return isinstance(key, ast.Constant) and isinstance(key.value, str) and not speaks_of(key.value)


def _called(node: ast.AST) -> str | None:
    """The name that a function, class or module is called by, without what it is of."""
    if isinstance(node, ast.Name):
        return node.id
    return node.attr if isinstance(node, ast.Attribute) else None


def _names_in(nodes: Iterable[ast.AST]) -> set[str]:
    return {found.id for node in nodes for found in ast.walk(node) if isinstance(found, ast.Name)}
