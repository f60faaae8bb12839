"""Asks the Alloy Analyzer about systems. Whatever is not plainly an answer is an EngineError, never "holds"."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from keystore_audit import resources
from keystore_audit.engine.alloy import claims, moments, paths
from keystore_audit.engine.alloy.facts import CONSISTENCY, EXERCISED, KEYSTORE, MAIN, MODULES, commands, facts
from keystore_audit.engine.alloy.jobs import Analyzer, Job, run
from keystore_audit.engine.alloy.solution import Command, witness
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.model.system import System
from keystore_audit.properties import PROPERTIES
from keystore_audit.properties.property import Answer, Role, Status

MEMORY_MB: Final = 2048
"""MiB of Java heap: 500 enclaves and 1,000 channels take 1.2 GB in all."""

MAX_ATOMS: Final = 6_000
"""Atoms of all sorts together up to which Alloy is known to decide: 5,107 (500 enclaves, 1,000 channels) took 78 s."""

_VACUITY: Final = tuple(Command(kind="run", name=name) for name in (CONSISTENCY, *EXERCISED.values()))
"""The first commands of the main file (`facts.commands`); checks of properties and the commands of claims follow."""


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
    """Ask the Analyzer about each system, in a process each, `jobs.PARALLEL` at a time.

    More processes answer claims at later moments, and find the path where a flow violates a claim (in systems of up
    to `paths.MAX_ATOMS`). `timeout`: seconds for each process; `memory_mb`: MiB of Java heap of each. All or nothing:
    raises EngineOutOfScale before anything is started if a system is too large, EngineTimeout, EngineMissing (no Java
    at `java`) or EngineFailed if one of them was not answered completely. Nothing is left running, or on disk.
    """
    analyzer = Analyzer(java=java, jar=jar, timeout=timeout, memory_mb=memory_mb)
    for system in systems:
        _check_scale(system)
    cases = [_Case(number=number, system=system, moment=None) for number, system in enumerate(systems)]
    cases += [case for number, system in enumerate(systems) for case in _later(number, system)]
    decisions = run([_audit(case) for case in cases], analyzer, lambda job, *answer: _read(cases[job], *answer))
    decisions = _with_paths(cases, decisions, analyzer)
    found = tuple(_over_time(number, cases, decisions) for number in range(len(systems)))
    if not any(system.determinism for system in systems):
        return found
    from keystore_audit.engine.alloy.determinism import decide as decide_behaviour  # most audits have none

    told = decide_behaviour(systems, analyzer)
    return tuple(replace(each, answers={**each.answers, **more}) for each, more in zip(found, told, strict=True))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Case:
    """One state of the system of this number.

    `moment`: None at the audit instant; else a later one (`moments.later`), and `system` is what it is then, with the
    claims that must hold until then.
    """

    number: int
    system: System
    moment: int | None


def _later(number: int, system: System) -> Iterator[_Case]:
    """The later states of a system that its claims make worth looking at."""
    until = max((claim.until for claim in system.claims if claim.until is not None), default=system.now)
    for count, moment in enumerate(moments.later(system, until)):
        if count == moments.MAX_MOMENTS:
            raise EngineOutOfScale(
                f"Until the date of a claim, grants begin or end more than {moments.MAX_MOMENTS} times."
            )
        lasting = tuple(c for c in system.claims if c.until is not None and moment <= 2 * c.until)
        then = moments.at(replace(system, claims=lasting), moment)
        yield _Case(number=number, system=then, moment=moment)


def _over_time(number: int, cases: Sequence[_Case], decisions: Sequence[Decision]) -> Decision:
    """The decision on a system: of each claim the first violation, at whatever moment it is."""
    answers = dict(decisions[number].answers)
    for case, decision in zip(cases, decisions, strict=True):
        if case.number == number and case.moment is not None:
            for claim in case.system.claims:
                if answers[claim.id].status is Status.HOLDS:
                    answers[claim.id] = decision.answers[claim.id]
    return replace(decisions[number], answers=answers)


def _audit(case: _Case) -> Job:
    system = case.system
    properties = PROPERTIES if case.moment is None else ()
    asked = [Command(kind="check", name=prop.assertion) for prop in properties]
    files = {**module_texts(MODULES), KEYSTORE: facts(system), MAIN: commands(properties, system)}
    return Job(
        files={**files, **module_texts(claims.MODULES)} if system.claims else files,
        main=MAIN,
        commands=(*_VACUITY, *asked, *claims.commands_of(system.claims)),
        atoms=count_atoms(system),
    )


def _read(case: _Case, found: Mapping[str, bool], solutions: Path) -> Decision:
    if not found[CONSISTENCY]:
        raise EngineFailed("The model contradicts itself, so that every property would hold of it.")
    system, sizes = case.system, _sizes(case.system)
    answers: dict[str, Answer] = {}
    for prop in PROPERTIES if case.moment is None else ():
        violated = found[prop.assertion]
        answers[prop.id] = Answer(
            property_id=prop.id,
            status=Status.VIOLATED if violated else Status.HOLDS,
            witnesses=(witness(solutions, prop.assertion, prop.roles, sizes),) if violated else (),
        )
    for number, claim in enumerate(system.claims):
        name = claims.command_of(claim, number).name
        status, roles = claims.status(claim, found[name]), claims.roles_of(claim)
        violated = status is Status.VIOLATED
        told = (witness(solutions, name, roles, sizes),) if roles and violated else ()
        moment = (2 * system.now if case.moment is None else case.moment) if violated else None
        answers[claim.id] = Answer(property_id=claim.id, status=status, witnesses=told, moment=moment)
    exercised = {**EXERCISED, **(claims.EXERCISED if system.claims else {})}
    return Decision(answers=answers, idle=frozenset(family for family, run in exercised.items() if not found[run]))


def _with_paths(cases: Sequence[_Case], decisions: Sequence[Decision], analyzer: Analyzer) -> list[Decision]:
    """The same decisions, with the path of each flow that violates a claim, where it first does."""
    told = list(decisions)
    jobs: list[Job] = []
    asked: list[tuple[int, tuple[int, ...]]] = []
    known: set[tuple[int, str]] = set()
    for place, (case, decision) in enumerate(zip(cases, decisions, strict=True)):
        violated = paths.wanted(case.system, decision.answers)
        numbers = tuple(n for n in violated if (case.number, case.system.claims[n].id) not in known)
        known |= {(case.number, case.system.claims[n].id) for n in numbers}
        if numbers and count_atoms(case.system) <= paths.MAX_ATOMS:
            asked.append((place, numbers))
            jobs.append(_search(case.system, numbers))

    def read(job: int, found: Mapping[str, bool], solutions: Path) -> None:
        place, numbers = asked[job]
        case, answers = cases[place], dict(told[place].answers)
        for number in numbers:
            if not found[f"Path{number}"]:
                raise EngineFailed("The Alloy Analyzer finds no path for a flow that there must be.")
            claim = case.system.claims[number]
            path = paths.read_path(solutions, number, case.system, case.moment)
            answers[claim.id] = replace(answers[claim.id], witnesses=paths.ends(path), path=path)
        told[place] = replace(told[place], answers=answers)

    run(jobs, analyzer, read)
    return told


def _search(system: System, numbers: Sequence[int]) -> Job:
    modules = module_texts((*MODULES, *claims.MODULES, *paths.MODULES))
    return Job(
        files={**modules, KEYSTORE: facts(system), paths.MAIN: paths.write_paths(system, numbers)},
        main=paths.MAIN,
        commands=paths.commands_of(numbers),
        atoms=count_atoms(system),
    )


def _check_scale(system: System) -> None:
    atoms = count_atoms(system)
    if atoms > MAX_ATOMS:
        raise EngineOutOfScale(
            f"The model of this keystore has {atoms} atoms; the Alloy Analyzer is known to decide up to {MAX_ATOMS}."
        )


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


def module_texts(names: Sequence[str]) -> dict[str, str]:
    """Return the text of hand-written modules."""
    folder = resources.alloy()
    try:
        return {name: (folder / name).read_text(encoding="ascii") for name in names}
    except (OSError, UnicodeDecodeError) as error:
        raise EngineFailed(f"This installation is incomplete: an Alloy module cannot be read ({error}).") from error


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
