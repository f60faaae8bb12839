"""Asks the Alloy Analyzer about systems. Whatever is not plainly an answer is an EngineError, never "holds"."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from keystore_audit import resources
from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.facts import CONSISTENCY, EXERCISED, KEYSTORE, MAIN, MODULES, commands, facts
from keystore_audit.engine.alloy.process import OUTPUT_DIRECTORY, AnalyzerProcess, Limits, Output
from keystore_audit.engine.alloy.solution import Command, failure, verdicts, witness
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.model.system import System
from keystore_audit.properties import PROPERTIES
from keystore_audit.properties.property import Answer, Role, Status

MEMORY_MB: Final = 2048
"""MiB of Java heap: 500 enclaves and 1,000 channels take 1.2 GB in all."""

MAX_ATOMS: Final = 6_000
"""Atoms of all sorts together up to which Alloy is known to decide: 5,107 (500 enclaves, 1,000 channels) took 78 s."""

PARALLEL: Final = 2
"""Analyzers side by side: one uses little more than one core."""

_COMMANDS: Final = (
    *(Command(kind="run", name=name) for name in (CONSISTENCY, *EXERCISED.values())),
    *(Command(kind="check", name=prop.assertion) for prop in PROPERTIES),
)
"""The commands of the main file, in its order (`facts.commands`), before those of claims."""

_POLL: Final = 0.01
"""Seconds between looks at a process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """All that the Analyzer says of one system.

    `answers` by property id and claim id. `idle`: families (keys of `facts.EXERCISED`, `claims.EXERCISED`) that had
    nothing to speak of in this system, so that their properties hold for want of an object.
    """

    answers: Mapping[str, Answer]
    idle: frozenset[str]


def decide(
    system: System, *, java: Path, jar: Path, timeout: float, memory_mb: int = MEMORY_MB
) -> Mapping[str, Answer]:
    """Return the answer to every property and claim, by id; each violated one with a witness. See `examine`."""
    return decide_many([system], java=java, jar=jar, timeout=timeout, memory_mb=memory_mb)[0]


def decide_many(
    systems: Sequence[System], *, java: Path, jar: Path, timeout: float, memory_mb: int = MEMORY_MB
) -> tuple[Mapping[str, Answer], ...]:
    """Return the answers about each system. See `examine`."""
    decisions = examine(systems, java=java, jar=jar, timeout=timeout, memory_mb=memory_mb)
    return tuple(decision.answers for decision in decisions)


def examine(
    systems: Sequence[System], *, java: Path, jar: Path, timeout: float, memory_mb: int = MEMORY_MB
) -> tuple[Decision, ...]:
    """Ask the Analyzer about each system, in a process each, `PARALLEL` at a time.

    `timeout`: seconds for each process; `memory_mb`: MiB of Java heap of each. All or nothing: raises
    EngineOutOfScale before anything is started if a system is too large, EngineTimeout, EngineMissing (no Java at
    `java`) or EngineFailed if one of them was not answered completely. Nothing is left running, or on disk.
    """
    for system in systems:
        _check_scale(system)
    modules = _modules(MODULES)
    flows = _modules(claims.MODULES) if any(system.claims for system in systems) else {}
    decisions: dict[int, Decision] = {}
    waiting = deque(enumerate(systems))
    running: dict[int, AnalyzerProcess] = {}
    with ExitStack() as cleanup:
        while waiting or running:
            while waiting and len(running) < PARALLEL:
                number, system = waiting.popleft()
                limits = Limits(timeout=timeout, memory_mb=memory_mb, atoms=count_atoms(system))
                files = {**modules, **flows, KEYSTORE: facts(system), MAIN: commands(PROPERTIES, system)}
                running[number] = cleanup.enter_context(AnalyzerProcess(files, MAIN, java=java, jar=jar, limits=limits))
            for number, process in tuple(running.items()):
                output = process.poll(_POLL)
                if output is not None:
                    decisions[number] = _read(systems[number], process.directory, output, java, memory_mb)
                    running.pop(number).close()
    return tuple(decisions[number] for number in range(len(systems)))


def count_atoms(system: System) -> int:
    """Return how many atoms the model of `system` has."""
    sorts: tuple[Collection[object], ...] = (
        system.instants,
        {certificate.key for certificate in system.certificates},
        system.certificates,
        system.documents,
        system.realms,
        system.enclaves,
        system.domains,
        system.channels,
        system.domain_rules,
        system.topic_rules,
        system.grants,
        system.rules,
    )
    return sum(map(len, sorts))


def _check_scale(system: System) -> None:
    atoms = count_atoms(system)
    if atoms > MAX_ATOMS:
        raise EngineOutOfScale(
            f"The model of this keystore has {atoms} atoms; the Alloy Analyzer is known to decide up to {MAX_ATOMS}."
        )


def _modules(names: Sequence[str]) -> dict[str, str]:
    """Return the text of hand-written modules."""
    folder = resources.alloy()
    try:
        return {name: (folder / name).read_text(encoding="ascii") for name in names}
    except (OSError, UnicodeDecodeError) as error:
        raise EngineFailed(f"This installation is incomplete: an Alloy module cannot be read ({error}).") from error


def _read(system: System, directory: Path, output: Output, java: Path, memory_mb: int) -> Decision:
    if output.status != 0:
        raise failure(output.status, output.diagnostics + output.messages, java=java, memory_mb=memory_mb)
    found = verdicts(output.diagnostics, (*_COMMANDS, *claims.commands_of(system.claims)))
    if not found[CONSISTENCY]:
        raise EngineFailed("The model contradicts itself, so that every property would hold of it.")
    solutions, sizes = directory / OUTPUT_DIRECTORY, _sizes(system)
    answers = {
        prop.id: Answer(
            property_id=prop.id,
            status=Status.VIOLATED if found[prop.assertion] else Status.HOLDS,
            witnesses=(witness(solutions, prop.assertion, prop.roles, sizes),) if found[prop.assertion] else (),
        )
        for prop in PROPERTIES
    }
    for number, claim in enumerate(system.claims):
        name = claims.command_of(claim, number).name
        status, roles = claims.status(claim, found[name]), claims.roles_of(claim)
        told = (witness(solutions, name, roles, sizes),) if roles and status is Status.VIOLATED else ()
        answers[claim.id] = Answer(property_id=claim.id, status=status, witnesses=told)
    exercised = {**EXERCISED, **(claims.EXERCISED if system.claims else {})}
    return Decision(answers=answers, idle=frozenset(family for family, run in exercised.items() if not found[run]))


def _sizes(system: System) -> Mapping[Role, int]:
    """Return how many atoms may play each role."""
    return {
        Role.REALM: len(system.realms),
        Role.DOMAIN: len(system.domains),
        Role.ENCLAVE: len(system.enclaves),
        Role.OTHER: len(system.enclaves),
        Role.DOCUMENT: len(system.documents),
        Role.CHANNEL: len(system.channels),
        Role.CERTIFICATE: len(system.certificates),
        Role.OTHER_CERTIFICATE: len(system.certificates),
        Role.OTHER_CHANNEL: len(system.channels),
    }
