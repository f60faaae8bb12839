"""What dictionaries of variables are made of in a Python launch file, wherever in it: names are not told by scope."""

from __future__ import annotations

import ast
import builtins
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from keystore_audit.dataclass import dataclass, field

ENVIRON: Final = frozenset({"environ", "environb"})
LOOKING: Final = frozenset({"EnvironmentVariable", "get", "getenv"})
"""What is called with the name of a variable to look it up."""

MAX_DEPTH: Final = 64
"""Dictionaries that are made of others."""

_ADDING: Final = frozenset({"__setitem__", "setdefault", "update"})
_EMPTYING: Final = frozenset({"clear", "popitem"})
_KEEPING: Final = frozenset({"pop", "setdefault", *LOOKING})
"""What changes nothing that it is called with."""

_SEEING: Final = frozenset({"copy", "count", "get", "index", "items", "keys", "values"})
"""Methods that change nothing of the list or dictionary whose they are."""

_WRITING: Final = frozenset({"copy", "deepcopy", "dump", "dumps", "join", "pformat", "pprint", "update"})
_READS: Final = frozenset({"__import__", "eval", "exec", "getattr", "globals", "input", "open", "vars"})
_BUILTIN: Final = frozenset(dir(builtins)) - _READS
"""What brings nothing from elsewhere."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """What names stand for.

    `values`: what is assigned, returned by the function, or given for the parameter; `more`: what is added to it, gone
    through by a loop, or called with it. `bound`: names that are no other module's; `aliases`: other names of
    `os.environ`. `removed`: by name of a dictionary, what the entries are called by that it loses, if not by a text
    (None: any). `through`: what is gone through by a loop, where the name stands for its texts or keys; `stored`: how
    often the name is given anything; `lent`: what is used so that it may be changed elsewhere. `gathering`: functions
    that gather what they are given, by `*` or `**`. `foreign`: parameters without a default of functions that nothing
    here calls. `whole`: what `has_all` said of names, `listed`: what `texts` did; `own`: those that do not come from
    elsewhere.
    """

    values: dict[str, list[ast.AST]] = field(default_factory=dict)
    more: dict[str, list[ast.AST]] = field(default_factory=dict)
    bound: set[str] = field(default_factory=lambda: set(_BUILTIN))
    aliases: set[str] = field(default_factory=set)
    removed: dict[str, set[str | None]] = field(default_factory=dict)
    through: dict[str, list[ast.AST]] = field(default_factory=dict)
    stored: Counter[str] = field(default_factory=Counter)
    lent: set[str] = field(default_factory=set)
    gathering: set[str] = field(default_factory=set)
    foreign: set[str] = field(default_factory=set)
    whole: dict[str, bool] = field(default_factory=dict)
    listed: dict[str, set[str] | None] = field(default_factory=dict)
    own: set[str] = field(default_factory=set)

    @staticmethod
    def of(nodes: Iterable[ast.AST], parents: Mapping[ast.AST, ast.AST]) -> Made:
        """All of a file; `nodes`: outer ones first."""
        made = Made()
        within: dict[ast.AST, str] = {}
        functions: dict[str, list[str]] = {}
        parameters: dict[str, list[str]] = {}
        calls: list[ast.Call] = []
        for node in nodes:
            outer = parents.get(node, node)
            within[node] = outer.name if isinstance(outer, ast.FunctionDef) else within.get(outer, "")
            if isinstance(node, ast.Return) and node.value is not None:
                made.values.setdefault(within[node], []).append(node.value)
            elif isinstance(node, ast.FunctionDef):
                functions[node.name] = made._define(node)
            elif isinstance(node, (ast.arg, ast.ClassDef)):
                made._bind(node.arg if isinstance(node, ast.arg) else node.name)
            elif isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
                made._bind(node.id)
            elif isinstance(node, ast.Name):
                made.lent.update([] if _only_seen(node, parents) else [node.id])
            elif isinstance(node, (ast.MatchAs, ast.MatchStar, ast.ExceptHandler)):
                made.stored[node.name or ""] += 1
            elif isinstance(node, ast.alias):
                made.stored[node.asname or node.name] += 1
            elif isinstance(node, ast.Call):
                calls.append(node)
            else:
                made._note(node)
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
                parameters.setdefault(getattr(node, "name", ""), []).extend(_without_default(node.args))
        for call in calls:
            made._call(call, functions.get(getattr(call.func, "id", "")))
            parameters.pop(getattr(call.func, "id", None) or "-", None)
        made.foreign.update(each for names in parameters.values() for each in names)
        return made

    def _bind(self, name: str) -> None:
        self.bound.add(name)
        self.stored[name] += 1

    def _define(self, function: ast.FunctionDef) -> list[str]:
        """The names of the parameters, which have the values that are given, or those of the definition."""
        self.bound.add(function.name)
        told = function.args
        self.gathering.update([function.name] if told.vararg or told.kwarg else [])
        plain = [each.arg for each in (*told.posonlyargs, *told.args)]
        named = [each.arg for each in told.kwonlyargs]
        usual = [*zip(plain[::-1], told.defaults[::-1], strict=False), *zip(named, told.kw_defaults, strict=True)]
        for name, value in usual:
            if value is not None:
                self.values.setdefault(name, []).append(value)
        return plain + named

    def _note(self, node: ast.AST) -> None:
        """What a statement, or the end of one, makes of names."""
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                kept = self.values if isinstance(target, ast.Name) else self.more
                added = target.slice if isinstance(target, ast.Subscript) else node.value
                for name in named_in([getattr(target, "value", target)]):
                    kept.setdefault(name, []).append(added)
                    self.aliases.update([name] if _is_shared(node.value) else [])
        elif isinstance(node, (ast.For, ast.comprehension, ast.AugAssign, ast.withitem)):
            bound = node.optional_vars if isinstance(node, ast.withitem) else node.target
            added = next(getattr(node, each) for each in ("iter", "value", "context_expr") if hasattr(node, each))
            for name in named_in([] if bound is None else [bound]):
                self.more.setdefault(name, []).append(added)
            if isinstance(node, (ast.For, ast.comprehension)):
                key, through = _gone_through(node)
                self.through.setdefault(key, []).append(through)
        elif isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Del):
            for name in named_in([node.value]):
                self._remove(name, node.slice)

    def _call(self, call: ast.Call, parameters: list[str] | None) -> None:
        """What a call may make of names: of the parameters of a function, of what another gets, of a dictionary.

        Classes make something; functions of other modules may change what they get.
        """
        method, held = called(call.func) or "", called(getattr(call.func, "value", call.func)) or ""
        if parameters is not None:
            given = [*zip(parameters, call.args, strict=False), *((each.arg, each.value) for each in call.keywords)]
            for name, value in given:
                if name in parameters:
                    self.values.setdefault(str(name), []).append(value)
                    self.aliases.update([str(name)] if is_environ(value) else [])
        elif not method[:1].isupper() and method not in _KEEPING:
            for each in named_in(each for each in call.args if isinstance(each, ast.Name)):
                self.more.setdefault(each, []).append(call.func)
        if method in _EMPTYING or (method == "pop" and call.args):
            self._remove(held, None if method in _EMPTYING else call.args[0])
        elif method in _ADDING:
            self.more.setdefault(held, []).extend(call.args[:1])

    def _remove(self, held: str, key: ast.AST | None) -> None:
        if text_of(key) is None:
            self.removed.setdefault(held, set()).add(key.id if isinstance(key, ast.Name) else None)

    def has_all(self, value: ast.AST, depth: int = 0) -> bool:
        """Whether a dictionary holds all variables that there were, or there is none."""
        if depth > MAX_DEPTH:
            return False
        if self.is_environ(value) or (isinstance(value, ast.Constant) and value.value is None):
            return True
        if isinstance(value, ast.Name):
            if value.id not in self.whole:
                self.whole[value.id] = False  # until it is known: a name may be made of itself
                made = self.values.get(value.id, ())
                kept = bool(made) and all(self.texts(key or "") is not None for key in self.removed.get(value.id, ()))
                self.whole[value.id] = kept and all(self.has_all(each, depth + 1) for each in made)
            return self.whole[value.id]
        if isinstance(value, ast.IfExp):
            return self.has_all(value.body, depth + 1) and self.has_all(value.orelse, depth + 1)
        return any(self.has_all(part, depth + 1) for part in _parts(value))

    def texts(self, name: str) -> set[str] | None:
        """What a name stands for that goes through texts of the file, or keys of its dictionaries, alone; else None."""
        if name not in self.listed:
            self.listed[name] = self._listed(name)
        return self.listed[name]

    def _listed(self, name: str) -> set[str] | None:
        through = self.through.get(name, ())
        if not through or len(through) != self.stored[name]:
            return None
        found = set[str | None]()
        for each in through:
            made: Sequence[ast.AST] = [each]
            if isinstance(each, ast.Name):
                made = self.values.get(each.id, []) if each.id not in self.more else []
                if not made or len(made) != self.stored[each.id] or each.id in self.lent:
                    return None
            found.update(text_of(key) for one in made for key in _texts_of(one))
        return None if None in found else {text for text in found if text is not None}

    def comes_from_elsewhere(self, value: ast.AST) -> bool:
        """Whether a dictionary or list may have names in it that this file does not say."""
        waiting, seen, asked = [value], set[str](), getattr(value, "id", "")
        while waiting:
            value = waiting.pop()
            if self.is_environ(value):
                continue
            if not isinstance(value, ast.Name):
                waiting += _names_from(value)
            elif value.id not in self.bound or value.id in self.foreign:
                self.bound.discard(asked)
                return True
            elif value.id not in seen and value.id not in self.own:
                seen.add(value.id)
                waiting += (*self.values.get(value.id, ()), *self.more.get(value.id, ()))
        self.own.update(seen)
        return False

    def only_reads(self, function: ast.AST) -> bool:
        """Whether what is called changes no dictionary that it is given, or is of this file and looked at itself."""
        name = called(function) or ""
        if isinstance(function, ast.Name) and name in self.stored:
            return False
        own = isinstance(function, ast.Name) and name in self.bound and name not in self.gathering
        return own or name in _WRITING or name[:1].isupper()

    def is_environ(self, node: ast.AST) -> bool:
        """Whether it is `os.environ`, or a name for it."""
        return is_environ(node) or (isinstance(node, ast.Name) and node.id in self.aliases)


def _without_default(told: ast.arguments) -> list[str]:
    """The parameters that have a value only if a call gives it."""
    plain = [*told.posonlyargs, *told.args]
    named = [each for each, value in zip(told.kwonlyargs, told.kw_defaults, strict=True) if value is None]
    further = filter(None, (told.vararg, told.kwarg))
    return [each.arg for each in (*plain[: len(plain) - len(told.defaults)], *named, *further)]


def _only_seen(name: ast.Name, parents: Mapping[ast.AST, ast.AST]) -> bool:
    """Whether a list or dictionary is as it was behind this use of its name."""
    parent = parents.get(name, name)
    if isinstance(parent, ast.keyword):
        parent = parents[parent]
    if isinstance(parent, ast.Call):
        function = called(parent.func) or ""
        return function in _BUILTIN or function in _WRITING or function[:1].isupper()
    if isinstance(parent, ast.Attribute):
        return parent.attr in _SEEING
    return isinstance(parent, (ast.For, ast.comprehension, ast.Compare, ast.Subscript, ast.BinOp, ast.FormattedValue))


def _is_shared(value: ast.AST) -> bool:
    """Whether it is `os.environ`, or `copy.copy` of it, which shares its variables."""
    if isinstance(value, ast.Call) and called(value.func) == "copy" and value.args:
        value = value.args[0]
    return is_environ(value)


def _gone_through(loop: ast.For | ast.comprehension) -> tuple[str, ast.AST]:
    """The name that a loop gives each text or key, and of what; "" where there is none."""
    target, through = loop.target, loop.iter
    if isinstance(target, ast.Tuple) and len(target.elts) == 2 and (held := _items_of(through)) is not None:
        target, through = target.elts[0], held
    return (target.id if isinstance(target, ast.Name) else ""), through


def _items_of(value: ast.AST) -> ast.expr | None:
    """The dictionary whose entries these are."""
    if isinstance(value, ast.Call) and isinstance(value.func, ast.Attribute) and value.func.attr == "items":
        return value.func.value
    return None


def _texts_of(value: ast.AST) -> Iterable[ast.AST | None]:
    if isinstance(value, ast.Dict):
        return value.keys
    return value.elts if isinstance(value, (ast.List, ast.Set, ast.Tuple)) else [None]


def _parts(value: ast.AST) -> Iterator[ast.AST]:
    """The dictionaries that entries of a dictionary come from."""
    if isinstance(value, ast.Dict):
        yield from (each for key, each in zip(value.keys, value.values, strict=True) if key is None)
    elif isinstance(value, ast.DictComp):
        yield from _copied(value)
    elif isinstance(value, ast.BinOp):
        yield from (value.left, value.right)
    elif isinstance(value, ast.IfExp):
        yield from (value.body, value.orelse)
    elif isinstance(value, ast.Call) and called(value.func) in ("dict", "copy", "deepcopy"):
        yield from (*value.args, *(each.value for each in value.keywords if each.arg is None))
        yield from [value.func.value] if isinstance(value.func, ast.Attribute) and not value.args else []
    elif isinstance(value, (ast.Call, ast.Attribute, ast.Subscript)):
        yield value.func if isinstance(value, ast.Call) else value.value


def _copied(copy: ast.DictComp) -> Iterator[ast.AST]:
    """The dictionary all entries of which are copied as they are."""
    (first, *others) = copy.generators
    pair, held = ast.Tuple([copy.key, copy.value], ast.Store()), _items_of(first.iter)
    if held is not None and not others and not first.ifs and ast.unparse(first.target) == ast.unparse(pair):
        yield held


def _names_from(value: ast.AST) -> Iterator[ast.AST]:
    """What the names of entries come from, or the texts of a list."""
    yield from _parts(value)
    if isinstance(value, ast.Dict):
        yield from (key for key in value.keys if key is not None)
    elif isinstance(value, ast.DictComp):
        yield value.key
    elif isinstance(value, (ast.Tuple, ast.List)):
        pair = len(value.elts) == 2 and text_of(value.elts[0]) is not None
        yield from () if pair else value.elts
    elif isinstance(value, ast.Call) and called(value.func) in _BUILTIN:
        yield from value.args
    elif isinstance(value, (ast.ListComp, ast.GeneratorExp, ast.SetComp, ast.JoinedStr, ast.FormattedValue)):
        yield from ast.iter_child_nodes(value)


def named_in(nodes: Iterable[ast.AST]) -> set[str]:
    """All names within."""
    return {inner.id for node in nodes for inner in ast.walk(node) if isinstance(inner, ast.Name)}


def called(node: ast.AST) -> str | None:
    """The last name of what is called or spoken of."""
    name: str | None = getattr(node, "attr", getattr(node, "id", None))
    return name


def is_environ(node: ast.AST) -> bool:
    """Whether it is `os.environ`, as Python or launch calls it."""
    name = called(node)
    return name in ENVIRON or (isinstance(node, ast.Attribute) and name == "environment")


def text_of(node: ast.AST | None) -> str | None:
    """The text that a constant is."""
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None
