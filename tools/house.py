"""How large the house is, by what no formatting changes; exit 1 where a figure is above its limit in house.toml.

nodes: of syntax trees, without docstrings, imports and annotations. imports: of own modules, in any form. circles:
groups of modules that import each other. vendors: texts and identifiers outside the top-level profiles/ that name an
implementation. A figure that fell is the new limit (`--keep`); one rises only in a commit that says why.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import tomlkit

ROOT = Path(__file__).resolve().parent.parent
LIMITS = Path(__file__).with_suffix(".toml")
PRODUCT = "keystore_audit"
VENDOR = re.compile(r"fast_?\s?dds|cyclone_?\s?dds|opendds|connext|zenoh", re.IGNORECASE)
_SIGNS = (ast.expr_context, ast.operator, ast.unaryop, ast.boolop, ast.cmpop)


def figures(top: str) -> Mapping[str, int]:
    """The size of all modules below `top`, a folder of the project."""
    found = Counter(modules=0, nodes=0, classes=0, imports=0, circles=0, vendors=0)
    known = {_name(path) for path in (ROOT / PRODUCT).rglob("*.py")}
    uses: dict[str, set[str]] = {}
    for path in (ROOT / top).rglob("*.py"):
        name = _name(path)
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        nodes = [*ast.walk(ast.parse(path.read_text("utf-8")))]
        typing = {id(part) for node in nodes if _is_for_types(node) for part in ast.walk(node)}
        imported = [(id(node), _known(target, known)) for node, target in _imports(nodes, package)]
        found["modules"] += 1
        found["imports"] += len({target for _node, target in imported} - {None, name})
        uses[name] = {target for node, target in imported if target and node not in typing}
        found.update(_counted(nodes, free=name.split(".")[1:2] == ["profiles"]))
    found["circles"] = _circles(uses)
    return found


def _name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)


def _imports(nodes: Iterable[ast.AST], package: str) -> Iterator[tuple[ast.AST, str]]:
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from ((node, each.name) for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = [*package.split(".")[: 1 - node.level or None]] if node.level else []
            yield from ((node, ".".join(filter(None, (*base, node.module, each.name)))) for each in node.names)


def _known(target: str, known: Iterable[str]) -> str | None:
    """The module that an import is of, or from."""
    while target and target not in known:
        target = target.rpartition(".")[0]
    return target or None


def _counted(nodes: Iterable[ast.AST], *, free: bool) -> Iterator[str]:
    skipped: set[int] = set()
    for node in nodes:
        if id(node) in skipped or isinstance(node, _SIGNS):
            continue
        if isinstance(node, (ast.Import, ast.ImportFrom)) or _is_docstring(node):
            skipped.update(map(id, ast.walk(node)))
            continue
        for field in ("annotation", "returns"):
            if isinstance(annotation := getattr(node, field, None), ast.AST):
                skipped.update(map(id, ast.walk(annotation)))
        yield "nodes"
        if isinstance(node, ast.ClassDef):
            yield "classes"
        for field in () if free else ("value", "id", "name", "attr", "arg"):
            text = getattr(node, field, None)
            if isinstance(text, str) and (field != "value" or isinstance(node, ast.Constant)) and VENDOR.search(text):
                yield "vendors"


def _is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _circles(uses: Mapping[str, Iterable[str]]) -> int:
    """Groups of modules each of which leads to all of its group."""
    reached: dict[str, set[str]] = {}
    for name in uses:
        waiting, seen = [name], set[str]()
        while waiting:
            new = [each for each in uses.get(waiting.pop(), ()) if each not in seen]
            seen.update(new)
            waiting += new
        reached[name] = seen
    groups = {
        frozenset(o for o in reached[name] if name in reached.get(o, ())) for name in uses if name in reached[name]
    }
    return sum(len(group) > 1 for group in groups)


def main() -> int:
    """The command line."""
    limits = tomlkit.parse(LIMITS.read_text("utf-8"))
    above = False
    for top in limits:
        for what, value in figures(top).items():
            limit = limits[top][what]
            above = above or value > limit
            print(f"{top:<16}{what:<10}{value:>9}" + (f"  above its limit, {limit}" if value > limit else ""))
            if "--keep" in sys.argv:
                limits[top][what] = min(value, limit)
    if "--keep" in sys.argv:
        LIMITS.write_text(tomlkit.dumps(limits), "utf-8")
    return 1 if above else 0


if __name__ == "__main__":
    sys.exit(main())
