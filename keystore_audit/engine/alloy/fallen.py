"""Which smallest sets of compromised participants let something through, as Alloy (alloy/fallen.als).

The Analyzer is told nothing that is expected. It looks for a set of no enclave, then of one, and so on. Each set found
is excluded with all larger ones, until none is left. Enclaves that are alike stay apart, whatever else is merged: each
may be in a set or not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.answers import Command, skolems
from keystore_audit.engine.alloy.atoms import Relations, index_of, name_atoms
from keystore_audit.engine.alloy.facts import CONSISTENCY, MODULES, count_atoms, fact_modules, module_texts
from keystore_audit.engine.alloy.merging import merge
from keystore_audit.engine.alloy.process import Analyzer, Job
from keystore_audit.engine.alloy.solvers import run
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.model.formal.system import System
from keystore_audit.properties.result import Role

MODULE: Final = "fallen.als"
"""The hand-written module."""

MAIN: Final = "asked.als"
"""The generated main file."""

COMMANDS: Final = (Command(kind="run", name=CONSISTENCY), Command(kind="run", name="Fall"))
"""That the facts are consistent, without which no answer means anything, and whether a set is found."""

MOST: Final = 100
"""Enclaves up to which it is asked, and sets: each is a question, which takes 5 s with 50, and grows as their cube."""


def smallest_sets(system: System, most: int, analyzer: Analyzer) -> list[frozenset[int]]:
    """The smallest sets of at most so many that violate the system's one claim, in order of size.

    Raises EngineOutOfScale where there are too many enclaves, or sets, and an EngineError where the Analyzer does not
    answer.
    """
    system = merge(system, twins=False).system
    found: list[frozenset[int]] = []
    size = 0
    while size <= most and frozenset() not in found:
        if max(len(system.enclaves), len(found)) > MOST:
            raise EngineOutOfScale(f"There are more than {MOST} enclaves, or sets of compromised ones.")
        fallen = _ask(system, size, found, analyzer)
        if fallen is None:
            size += 1
        else:
            found.append(fallen)
    return found


def _ask(system: System, size: int, found: Sequence[frozenset[int]], analyzer: Analyzer) -> frozenset[int] | None:
    """Another set of this size, or smaller, that is no larger one of those found."""

    def read(_job: int, told: Mapping[str, bool], solutions: Path) -> frozenset[int] | None:
        if not told[CONSISTENCY]:
            raise EngineFailed("The model contradicts itself, so that nothing would get through in it.")
        if not told["Fall"]:
            return None
        chosen = skolems(solutions, "Fall")
        atoms = (chosen[name][0][0] for name in _names(size))
        return frozenset(index for atom in atoms if (index := index_of(atom, Role.ENCLAVE, system)) is not None)

    job = Job(
        files={
            **module_texts((*MODULES, *claims.MODULES, MODULE)),
            **fact_modules(system),
            MAIN: write_question(system, size, found),
        },
        main=MAIN,
        commands=COMMANDS,
        atoms=count_atoms(system),
    )
    return run([job], analyzer, read)[0]


def _names(size: int) -> list[str]:
    return [f"fallen_{number}" for number in range(size)]


def write_question(system: System, size: int, found: Sequence[frozenset[int]]) -> str:
    """Return the main file that asks for a set of this size at most with a flow, and with none of those found in it."""
    enclaves = name_atoms(system)["enclaves"]
    fallen = " + ".join(_names(size)) or "none"
    chosen = f"some {', '.join(_names(size))}: Enclave |" if size else ""
    lines = ["module asked", "open fallen", "", claims.write_places(system, (0,)), f"run {CONSISTENCY} for 0"]
    lines += ["run Fall {", f"\t{chosen} flows[{claims.flow(system.claims[0], 0, f'{fallen}, {fallen} + Outsider')}]"]
    for each in found:
        lines.append(f"\t\tand not {Relations().atoms(enclaves, each)} in {fallen}")
    return "\n".join([*lines, "} for 0"]) + "\n"
