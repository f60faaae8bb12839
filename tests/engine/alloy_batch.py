"""Decides many systems in one JVM: the shipped modules, facts and commands, through the Analyzer's own API.

The product starts a process for each main file; a test of hundreds of systems cannot. The JVM lives in this process
(JPype, a development dependency) and stays, because a process can start one only once.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import jpype
import pytest
from msgspec.structs import replace

from keystore_audit import resources
from keystore_audit.engine.alloy import claims, install
from keystore_audit.engine.alloy.atoms import Relations, Sort
from keystore_audit.engine.alloy.export import commands
from keystore_audit.engine.alloy.facts import CONSISTENCY, facts
from keystore_audit.engine.alloy.process import LATE_SECOND_COMPILER
from keystore_audit.engine.alloy.runner import OPPOSITE
from keystore_audit.errors import EngineMissing
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES, Status

_NO_INTEGERS = {"util/integer.als": "module util/integer\n"}
"""In place of the Analyzer's own, which it reads anew for each module that it opens: half of all its reading. Our
modules use nothing of it; one that did would not be read."""

_SYMMETRY = 20
"""The predicate's size that the Analyzer chooses, by default, to break symmetries with."""

_BY_PREDICATE = {prop.predicate: prop.id for prop in PROPERTIES}


def engine() -> install.Engine:
    """The Analyzer, fetched if need be; where it cannot be had, a failure in CI and a skip elsewhere."""
    try:
        return install.locate(None, offline=False, ci=False)
    except EngineMissing as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(error.message)


def shipped() -> dict[str, str]:
    """The text of each shipped module, by its file's name."""
    return {path.name: path.read_text() for path in resources.alloy().glob("*.als")}


def decide_batch(systems: Sequence[System], changed: Mapping[str, str] | None = None) -> list[dict[str, bool]]:
    """For each system, whether each property (by id) holds. `changed`: modules to use instead."""
    with tempfile.TemporaryDirectory(prefix="alloy-batch-") as directory:
        modules = shipped() | dict(changed or {})
        return [_decide(Path(directory), modules, system) for system in systems]


def compare_batch(systems: Sequence[System], expected: Sequence[Mapping[str, bool]]) -> Iterator[list[str]]:
    """Hold what is expected of each system (whether each property and claim, by id, holds) against Alloy.

    What differs comes back. Two commands ask about all at once; each is asked alone only where they tell of something.
    """
    modules = shipped()
    with tempfile.TemporaryDirectory(prefix="alloy-batch-") as directory:
        for system, right in zip(systems, expected, strict=True):
            world, named = whole_world(Path(directory), modules, system), named_by_command(system, right)
            differing: list[str] = []
            if not as_expected(world, dict(named.values())):
                found = _told(world)
                differing = [each for each, (name, has) in named.items() if found[name] is not has]
                assert differing, "the answers differ together and agree one by one"
            yield differing


def whole_world(directory: Path, modules: dict[str, str], system: System) -> Any:
    """The model of a system, with a command for each property and claim."""
    return _world(directory, modules | asking(system), "audit.als")


def asking(system: System) -> dict[str, str]:
    """The two files of a system, in which each property and claim has a command."""
    return {"keystore.als": facts(system), "audit.als": commands(PROPERTIES, system)}


def named_by_command(system: System, expected: Mapping[str, bool]) -> dict[str, tuple[str, bool]]:
    """For each property and claim (by id), the name of its command, and whether that should have an instance."""
    found = {identifier: (name, not expected[identifier]) for name, identifier in _BY_PREDICATE.items()}
    for number, claim in enumerate(system.claims):
        asked = claims.question(claim, number)
        status = Status.HOLDS if expected[claim.id] else Status.VIOLATED
        is_run = asked.command.kind == "run"
        found[claim.id] = (asked.command.name, (status is asked.when_true) is is_run)
    assert found.keys() == expected.keys()
    return found


def as_expected(world: Any, expected: Mapping[str, bool]) -> bool:
    """Whether one instance has what each command that should have one looks for, and none what any other looks for.

    `expected`: by the names of commands, of which nearly all are part of one question or the other.
    """
    asked = {str(command.label): command for command in world.getAllCommands()}
    whole = asked[CONSISTENCY]
    right, wrong = whole.formula, whole.formula.not_()
    alone = []
    for name, has_instance in expected.items():
        if has_instance:
            right = right.and_(asked[name].formula)
        elif asked[name].check:
            wrong = wrong.or_(asked[name].formula)
        else:
            alone.append(asked[name])  # a compartment that is looked for is no part of a larger question
    if not _occurs(world, whole.change(right)):
        return False
    return not any(_occurs(world, each) for each in (whole.change(wrong), *alone))


def decide_claims(systems: Sequence[System], changed: Mapping[str, str] | None = None) -> list[dict[str, Status]]:
    """For each system, the answer to each claim (by id); properties are left out. `changed`: modules to use instead."""
    with tempfile.TemporaryDirectory(prefix="alloy-batch-") as directory:
        modules = shipped() | dict(changed or {})
        return [_decide_claims(Path(directory), modules, system) for system in systems]


def _decide_claims(directory: Path, modules: dict[str, str], system: System) -> dict[str, Status]:
    questions = [claims.question(claim, number) for number, claim in enumerate(system.claims)]
    names = {CONSISTENCY, *(asked.command.name for asked in questions)}
    files = modules | {"keystore.als": facts(system), "audit.als": commands((), system)}
    found = outcomes(directory, files, names=names)
    assert found[CONSISTENCY]
    answers = {}
    for asked in questions:
        true = found[asked.command.name] is (asked.command.kind == "run")
        answers[asked.id] = asked.when_true if true else OPPOSITE[asked.when_true]
    return answers


def outcomes(
    directory: Path, modules: dict[str, str], main: str = "audit.als", names: Collection[str] | None = None
) -> dict[str, bool]:
    """For each command of `main`, whether it has an instance, with the files `modules` put into `directory`.

    `names`: of those that are asked; None for all.
    """
    return _told(_world(directory, modules, main), names)


def unexpected(directory: Path, modules: dict[str, str], main: str) -> list[str]:
    """The commands whose outcome is not what the `expect` in their text says: one without it is among them.

    With the Analyzer's own breaking of symmetries, without which theorems about any keystore take four times as long.
    """
    world = _world(directory, modules, main)
    found = {command: bool(_solution(world, command, _SYMMETRY).satisfiable()) for command in world.getAllCommands()}
    assert found, f"{main} asks nothing"
    return [str(command.label) for command, occurs in found.items() if command.expects != occurs]


def _world(directory: Path, modules: dict[str, str], main: str) -> Any:
    """The model whose files these would be in `directory`: none is written, or read where there is one."""
    analyzer = _analyzer()
    place = os.path.realpath(directory)
    loaded = jpype.JClass("java.util.HashMap")()
    for name, text in (modules | _NO_INTEGERS).items():
        loaded.put(f"{place}/{name}", text)
    return analyzer.parse(analyzer.silent, loaded, f"{place}/{main}")


def _told(world: Any, names: Collection[str] | None = None) -> dict[str, bool]:
    asked = {str(command.label): command for command in world.getAllCommands()}
    return {name: _occurs(world, asked[name]) for name in (asked if names is None else names)}


def _occurs(world: Any, command: Any) -> bool:
    """Whether the command has an instance."""
    return bool(_solution(world, command).satisfiable())


def _solution(world: Any, command: Any, symmetry: int = 0) -> Any:
    analyzer = _analyzer()
    analyzer.options.symmetry = symmetry
    return analyzer.execute(analyzer.silent, world.getAllReachableSigs(), command, analyzer.options)


def _decide(directory: Path, modules: dict[str, str], system: System) -> dict[str, bool]:
    found = outcomes(directory, modules | asking(replace(system, claims=())))
    assert found[CONSISTENCY]
    return {identifier: not found[assertion] for assertion, identifier in _BY_PREDICATE.items()}


def evaluate(
    directory: Path, modules: dict[str, str], expressions: Sequence[str], opening: str = "claims"
) -> list[set[tuple[int, ...]]]:
    """The tuples of each expression, atoms by index, in the one instance of the facts; the module `opening` is open."""
    return [
        {tuple(map(_number, atoms)) for atoms in tuples} for tuples in values(directory, modules, expressions, opening)
    ]


def values(
    directory: Path, modules: dict[str, str], expressions: Sequence[str], opening: str = "claims"
) -> list[set[tuple[str, ...]]]:
    """The same, atoms by name."""
    asked = f"module asked\nopen {opening}\nrun Facts {{}} for 0\n"
    world = _world(directory, modules | {"asked.als": asked}, "asked.als")
    solution = _solution(world, world.getAllCommands().get(0))
    assert solution.satisfiable()
    found = []
    for expression in expressions:
        tuples = solution.eval(_analyzer().expression(world, expression))
        found.append({tuple(str(t.atom(place)) for place in range(t.arity())) for t in tuples})
    return found


def unlike(
    directory: Path,
    modules: dict[str, str],
    expected: Mapping[str, Collection[tuple[str, ...]]],
) -> list[str]:
    """The expressions that have other values than expected: atoms by name, as `values` has them.

    A question to the translator: it is some ten times as fast as the evaluator of an instance.
    """
    wrong = {}
    for expression, tuples in expected.items():
        named = [" -> ".join(atom.split("/")[-1].removesuffix("$0") for atom in atoms) for atoms in sorted(tuples)]
        wrong[expression] = f"not (({expression}) = ({' + '.join(named)}))" if named else f"some ({expression})"
    return _occurring(directory, modules, "open claims", wrong)


def _occurring(directory: Path, modules: dict[str, str], head: str, formulas: Mapping[str, str]) -> list[str]:
    """The names of the formulas that are true, in a module that begins with `head`: all are asked at once first."""
    questions = [" or ".join(formulas.values()), *formulas.values()]
    runs = [f"run {{ {question} }} for 0" for question in questions]
    world = _world(directory, modules | {"asked.als": "\n".join(["module asked", head, *runs, ""])}, "asked.als")
    together, *alone = world.getAllCommands()
    if not _occurs(world, together):
        return []
    found = [each for each, command in zip(formulas, alone, strict=True) if _occurs(world, command)]
    assert found, "one of all is true, and none alone"
    return found


Pairs = Collection[tuple[int, int]]
"""Of atoms of two sorts, by index."""


def otherwise(
    directory: Path, modules: dict[str, str], expected: Mapping[str, tuple[Sort, Pairs]], channels: Sort
) -> list[str]:
    """The expressions that are not the relation expected of them, from atoms of a sort to `channels`.

    A question to the translator: it is some ten times as fast as the evaluator of an instance (`evaluate`).
    """
    write = Relations()
    wrong, functions = {}, []
    for number, (expression, (sort, pairs)) in enumerate(expected.items()):
        images = [[channel for first, channel in pairs if first == index] for index in range(len(sort.atoms))]
        name, declared = f"expected_{number}", f"{sort.sig} -> {channels.sig}"
        functions.append(write.relation(name, declared, write.rows(sort, channels, images)))
        wrong[expression] = f"not (({expression}) = {name})"
    return _occurring(directory, modules, "\n".join(["open claims", *write.take_private(), *functions]), wrong)


def _number(atom: str) -> int:
    """Its index; that of the outsider, who has none, is -1."""
    if atom.endswith("Outsider$0"):
        return -1
    return int(re.search(r"[A-Z]{1,2}(\d+)\w*\$0$", atom)[1])  # type: ignore[index]


class _Analyzer:
    """The classes of the Analyzer that are used here, and options like those of the product's runner."""

    def __init__(self) -> None:
        start_jvm()
        self.parse: Any = jpype.JClass("edu.mit.csail.sdg.parser.CompUtil").parseEverything_fromFile
        self.expression: Any = jpype.JClass("edu.mit.csail.sdg.parser.CompUtil").parseOneExpression_fromString
        self.execute: Any = jpype.JClass("edu.mit.csail.sdg.translator.TranslateAlloyToKodkod").execute_command
        self.silent: Any = jpype.JClass("edu.mit.csail.sdg.alloy4.A4Reporter").NOP
        self.options: Any = jpype.JClass("edu.mit.csail.sdg.translator.A4Options")()
        self.options.solver = jpype.JClass("kodkod.engine.satlab.SATFactory").get("sat4j")
        self.options.skolemDepth = 0


@lru_cache(maxsize=1)
def _analyzer() -> _Analyzer:
    return _Analyzer()


def start_jvm() -> None:
    """Start the JVM of this process with the Analyzer in its class path, if it does not run yet."""
    if jpype.isJVMStarted():
        return
    found = engine()
    library = next(found.java.resolve().parent.parent.glob("lib/server/libjvm.*"))
    jpype.startJVM(
        str(library),
        "-Xss64m",
        "-Xmx1g",
        "-XX:+UseSerialGC",
        "-XX:MetaspaceSize=128m",  # no collection each time that some more classes are there
        "-XX:-StackTraceInThrowable",  # reading makes errors by the thousand that it drops: a fifth of its time
        "-Xmn256m",  # fewer collections: nearly all of it is soon thrown away
        *LATE_SECOND_COMPILER,
        "-Dorg.slf4j.simpleLogger.defaultLogLevel=error",
        "-Djava.awt.headless=true",
        "--enable-native-access=ALL-UNNAMED",
        classpath=[str(found.jar)],
    )
