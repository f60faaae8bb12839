"""Asks the Alloy Analyzer about systems. Whatever is not plainly an answer is an EngineError, never "holds"."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit import resources
from keystore_audit.engine.alloy import claims, moments, paths
from keystore_audit.engine.alloy.facts import (
    CONSISTENCY,
    EXERCISED,
    KEYSTORE,
    MAIN,
    MODULES,
    fact_modules,
    facts,
)
from keystore_audit.engine.alloy.jobs import run
from keystore_audit.engine.alloy.merging import Merged, merge
from keystore_audit.engine.alloy.one_realm import with_one_realm
from keystore_audit.engine.alloy.process import Analyzer, Job
from keystore_audit.engine.alloy.questions import Questions, Sheet
from keystore_audit.engine.alloy.solution import witness, witnesses
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES
from keystore_audit.properties.property import Answer, Property, Role, Status, Witness

MEMORY_MB: Final = 2048
"""MiB of Java heap: 500 enclaves and 1,000 channels take 1.2 GB in all."""

MAX_ATOMS: Final = 6_000
"""Atoms of all sorts together up to which Alloy is known to decide: 5,107 (500 enclaves, 1,000 channels) took 78 s."""

Expected = Sequence[Mapping[str, Status]]
"""By system: what another engine says of properties and claims, by id (`questions`)."""


class Decision(Struct, frozen=True, kw_only=True):
    """All that the Analyzer says of one system.

    `answers` by property id and claim id. `idle`: families (keys of `facts.EXERCISED`, `claims.EXERCISED`) that had
    nothing to speak of in this system, so that their properties hold for want of an object. `atoms`: how many the
    system has, and how many the Analyzer was asked about.
    """

    answers: Mapping[str, Answer]
    idle: frozenset[str]
    atoms: tuple[int, int]


def examine(
    systems: Sequence[System],
    *,
    java: Path,
    jar: Path,
    timeout: float,
    memory_mb: int = MEMORY_MB,
    expected: Expected | None = None,
) -> tuple[Decision, ...]:
    """Ask the Analyzer about each system, merged (`merging`), in a process each, `jobs.PARALLEL` at a time.

    `expected`: what is expected to hold is asked together (`questions`), and no path is looked for where a flow
    violates a claim: whoever expects that has one. More processes answer claims at later moments, what is not as
    expected, and, without expectations, find paths (in systems of up to `paths.MAX_ATOMS`). `timeout`: seconds for each
    process; `memory_mb`: MiB of Java heap of each. All or nothing: raises EngineOutOfScale before anything is started
    if a system is too large, EngineTimeout, EngineMissing (no Java at `java`) or EngineFailed if one of them was not
    answered completely. Nothing is left running, or on disk.
    """
    analyzer = Analyzer(java=java, jar=jar, timeout=timeout, memory_mb=memory_mb)
    cases = [_Case.of(number, system, moment=None) for number, system in enumerate(systems)]
    cases += [case for number, system in enumerate(systems) for case in _later(number, system)]
    decisions = _decisions(cases, expected, analyzer)
    if expected is None:
        decisions = _with_paths(cases, decisions, analyzer)
    found = tuple(_over_time(number, cases, decisions) for number in range(len(systems)))
    if not any(system.determinism for system in systems):
        return found
    from keystore_audit.engine.alloy.determinism import decide as decide_behaviour  # most audits have none

    told = decide_behaviour(systems, analyzer)
    return tuple(replace(each, answers={**each.answers, **more}) for each, more in zip(found, told, strict=True))


class _Case(Struct, frozen=True, kw_only=True):
    """One state of the system of this number, merged.

    `moment`: twice the index of the audit instant, or a later one (`moments.later`), at which only claims are asked
    about that must hold until then. `whole`: atoms before merging.
    """

    number: int
    merged: Merged
    whole: int
    moment: int
    is_later: bool

    @classmethod
    def of(cls, number: int, system: System, moment: int | None) -> _Case:
        """The case of a system as it is at `moment` (None: the audit instant).

        Raises EngineOutOfScale if it is too large.
        """
        merged = merge(system)
        whole, now = count_atoms(system), 2 * system.now if moment is None else moment
        _check_scale(whole, count_atoms(merged.system))
        return cls(number=number, merged=merged, whole=whole, moment=now, is_later=moment is not None)

    @property
    def system(self) -> System:
        """What the Analyzer is asked about."""
        return self.merged.system

    @property
    def properties(self) -> Sequence[Property]:
        """The properties that are asked about."""
        return () if self.is_later else PROPERTIES

    def sheet(self) -> Sheet:
        """Where the questions stand."""
        return Sheet(self.system, self.properties, module_texts(["properties.als"])["properties.als"])


def _later(number: int, system: System) -> Iterator[_Case]:
    """The later states of a system that its claims make worth looking at."""
    until = max((claim.until for claim in system.claims if claim.until is not None), default=system.now)
    for count, moment in enumerate(moments.later(system, until)):
        if count == moments.MAX_MOMENTS:
            raise EngineOutOfScale(
                f"Until the date of a claim, grants begin or end, or others are refused, more than "
                f"{moments.MAX_MOMENTS} times."
            )
        lasting = tuple(c for c in system.claims if c.until is not None and moment <= 2 * c.until)
        yield _Case.of(number, moments.at(replace(system, claims=lasting), moment), moment)


def _over_time(number: int, cases: Sequence[_Case], decisions: Sequence[Decision]) -> Decision:
    """The decision on a system: of each claim the first violation, at whatever moment it is."""
    answers = dict(decisions[number].answers)
    for case, decision in zip(cases, decisions, strict=True):
        if case.number == number and case.is_later:
            for claim in case.system.claims:
                if answers[claim.id].status is Status.HOLDS:
                    answers[claim.id] = decision.answers[claim.id]
    return replace(decisions[number], answers=answers)


class _Outcome(Struct, frozen=True, kw_only=True):
    """What one process found: which commands have an instance, and the witnesses of those that have roles."""

    found: Mapping[str, bool]
    told: Mapping[str, Witness]


def _decisions(cases: Sequence[_Case], expected: Expected | None, analyzer: Analyzer) -> list[Decision]:
    """The decision on each case: what is as expected is asked together, the rest alone."""
    sheets = [case.sheet() for case in cases]
    says = [{} if expected is None else expected[case.number] for case in cases]
    asked = {
        place: sheet.one_by_one() if expected is None else sheet.together(says[place])
        for place, sheet in enumerate(sheets)
    }
    outcomes: list[dict[str, bool]] = [{} for _ in cases]
    told: list[dict[str, Witness]] = [{} for _ in cases]
    while asked:
        found = _ask([cases[place] for place in asked], tuple(asked.values()), analyzer)
        again: dict[int, Questions] = {}
        for (place, questions), outcome in zip(asked.items(), found, strict=True):
            answered, open_ = questions.answered(outcome.found)
            outcomes[place] |= answered
            told[place] |= outcome.told
            if open_:
                again[place] = sheets[place].again(says[place], open_)
        asked = again
    return [_decision(case, outcomes[place], told[place]) for place, case in enumerate(cases)]


def _ask(cases: Sequence[_Case], asked: Sequence[Questions], analyzer: Analyzer) -> list[_Outcome]:
    """What a process each finds about the cases."""

    def read(number: int, found: Mapping[str, bool], solutions: Path) -> _Outcome:
        case, sizes = cases[number], _sizes(cases[number].system)
        roles = {prop.assertion: prop.roles for prop in case.properties}
        roles |= {claims.command_of(c, n).name: claims.roles_of(c) for n, c in enumerate(case.system.claims)}
        violated = [name for name, instance in found.items() if instance and roles.get(name)]
        told = {name: witness(solutions, name, roles[name], sizes) for name in violated}
        for joint in asked[number].joints:
            if found[joint.command.name]:
                told |= witnesses(solutions, joint.command.name, joint.witnessed, sizes)
        return _Outcome(found=found, told=told)

    return run([_audit(case, each) for case, each in zip(cases, asked, strict=True)], analyzer, read)


def _audit(case: _Case, asked: Questions) -> Job:
    modules = module_texts((*MODULES, *claims.MODULES) if case.system.claims else MODULES)
    if len(case.system.realms) == 1:
        modules = with_one_realm(modules)
    return Job(
        files={**modules, **fact_modules(case.system), MAIN: asked.text},
        main=MAIN,
        commands=asked.commands,
        atoms=count_atoms(case.system),
    )


def _decision(case: _Case, found: Mapping[str, bool], told: Mapping[str, Witness]) -> Decision:
    if not found[CONSISTENCY]:
        raise EngineFailed("The model contradicts itself, so that every property would hold of it.")
    answers: dict[str, Answer] = {}
    for prop in case.properties:
        status = Status.VIOLATED if found[prop.assertion] else Status.HOLDS
        shown = (told[prop.assertion],) if found[prop.assertion] else ()
        answers[prop.id] = Answer(status=status, witnesses=shown)
    for number, claim in enumerate(case.system.claims):
        name = claims.command_of(claim, number).name
        status = claims.status(claim, found[name])
        violated = status is Status.VIOLATED
        shown = (told[name],) if name in told and violated else ()
        moment = case.moment if violated else None
        answers[claim.id] = Answer(status=status, witnesses=shown, moment=moment)
    exercised = {**EXERCISED, **(claims.EXERCISED if case.system.claims else {})}
    return Decision(
        answers={each: case.merged.original(answer, case.moment) for each, answer in answers.items()},
        idle=frozenset(family for family, run in exercised.items() if not found[run]),
        atoms=(case.whole, count_atoms(case.system)),
    )


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
            answer = replace(answers[claim.id], witnesses=paths.ends(path), path=path)
            answers[claim.id] = case.merged.original(answer, case.moment)
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


def _check_scale(whole: int, merged: int) -> None:
    if merged > MAX_ATOMS:
        raise EngineOutOfScale(
            f"The model of this keystore has {whole} atoms, {merged} after merging; the Alloy Analyzer is known to "
            f"decide up to {MAX_ATOMS}.",
            atoms=(whole, merged),
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
