"""Asks the Alloy Analyzer about systems. Whatever is not plainly an answer is an EngineError, never "holds".

Each command costs a translation of the whole model. All facts are constant, so there is one structure. An instance of a
command that asks for many conditions at once is that structure, and each condition is true in it. So all conditions
that another engine expects to be true are asked together. Expectations decide only what is asked together. Where there
is no such instance, each question is asked by a command of its own.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.engine import moments
from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.answers import Command, witness
from keystore_audit.engine.alloy.claims import Question, check
from keystore_audit.engine.alloy.facts import (
    CONSISTENCY,
    MAIN,
    MODULES,
    count_atoms,
    fact_modules,
    module_texts,
)
from keystore_audit.engine.alloy.install import Engine
from keystore_audit.engine.alloy.kept import kept
from keystore_audit.engine.alloy.merging import Merged, merge
from keystore_audit.engine.alloy.process import Analyzer, Job
from keystore_audit.engine.alloy.solvers import record_classes, run
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.model.formal.system import System
from keystore_audit.properties import PROPERTIES
from keystore_audit.properties.result import Answer, Property, Status, Witness

MEMORY_MB: Final = 2048
"""MiB of Java heap: 500 enclaves and 1,000 channels take 1.2 GB in all."""

MAX_ATOMS: Final = 6_000
"""Atoms of all sorts together up to which Alloy is known to decide: 5,107 (500 enclaves, 1,000 channels) took 78 s."""

Expected = Sequence[Mapping[str, Status]]
"""By system: what another engine says of properties and claims, by id."""


class Decision(Struct, frozen=True, kw_only=True):
    """All that the Analyzer says of one system: `answers` by id of properties and claims.

    `atoms`: how many the system has, and how many the Analyzer was asked about.
    """

    answers: Mapping[str, Answer]
    atoms: tuple[int, int]


@contextmanager
def analyzer_of(engine: Engine, timeout: float) -> Iterator[Analyzer]:
    """The Analyzer, with so many seconds for each question; it stays until all is asked."""
    with kept():
        yield Analyzer(java=engine.java, jar=engine.jar, timeout=timeout, memory_mb=MEMORY_MB)


def examine(
    systems: Sequence[System],
    *,
    java: Path,
    jar: Path,
    timeout: float,
    memory_mb: int = MEMORY_MB,
    expected: Expected | None = None,
    names: Sequence[Collection[str]] | None = None,
) -> tuple[Decision, ...]:
    """Ask the Analyzer about each system, merged (`merging`), by a question each.

    `expected`: what is expected to be so is asked together. `names`: by system, what alone is asked about, at the audit
    instant; None: everything. More questions are about claims at later moments, and what is not as expected.
    `timeout`: seconds for each question; `memory_mb`: MiB of Java heap of each JVM. All systems are answered, or none.
    Raises EngineOutOfScale before anything starts if a system is too large. Raises EngineTimeout, EngineMissing (no
    Java at `java`) or EngineFailed if an answer is incomplete. Nothing is left running, or on disk, when the run ends
    (`kept`).
    """
    analyzer = Analyzer(java=java, jar=jar, timeout=timeout, memory_mb=memory_mb)
    if names is not None:
        cases = [_Case.of(n, system, None, those) for n, (system, those) in enumerate(zip(systems, names, strict=True))]
    else:
        cases = [_Case.of(number, system, None) for number, system in enumerate(systems)]
        cases += [case for number, system in enumerate(systems) for case in _later(number, system)]
    with kept():
        told = _answers(cases, expected, analyzer)
        found = [_over_time(number, cases, told) for number in range(len(systems))]
        if any(system.determinism for system in systems):
            from keystore_audit.engine.alloy.determinism import decide  # most audits have none

            found = [one | more for one, more in zip(found, decide(systems, analyzer), strict=True)]
    return tuple(Decision(answers=each, atoms=case.atoms) for each, case in zip(found, cases, strict=False))


def make_archive(java: Path, jar: Path) -> Path | None:
    """Make the archive of classes (`archive`) for this Java, by asking about a keystore of nobody, and return its path.

    None where this Java makes none. Raises an EngineError if the Analyzer does not answer, or it cannot be stored.
    """
    nobody = System(
        profiles=(),
        readings=(),
        may=False,
        instants=(datetime(1970, 1, 1, tzinfo=timezone.utc),),
        now=0,
        certificates=(),
        documents=(),
        trust_domains=(),
        enclaves=(),
        domains=(),
        channels=(),
        domain_rules=(),
        topic_rules=(),
        grants=(),
        rules=(),
    )
    case = _Case.of(0, nobody, None)
    analyzer = Analyzer(java=java, jar=jar, timeout=120, memory_mb=MEMORY_MB)
    return record_classes(case.job(case.questions(), []), analyzer)


class _Case(Struct, frozen=True, kw_only=True):
    """One state of the system of this number, merged.

    `moment`: twice the index of the audit instant, or a later one (`moments.later`), at which only claims are asked
    about that must hold until then. `names`: what alone is asked about, None: everything. `atoms`: before merging and
    after it.
    """

    number: int
    merged: Merged
    atoms: tuple[int, int]
    moment: int
    is_later: bool
    names: Collection[str] | None

    @classmethod
    def of(cls, number: int, system: System, moment: int | None, names: Collection[str] | None = None) -> _Case:
        """The case of a system as it is at `moment` (None: the audit instant).

        Raises EngineOutOfScale if it is too large.
        """
        merged = merge(system)
        whole, few = atoms = count_atoms(system), count_atoms(merged.system)
        if few > MAX_ATOMS:
            raise EngineOutOfScale(
                f"The model of this keystore has {whole} atoms, {few} after merging; the Alloy Analyzer is known to "
                f"decide up to {MAX_ATOMS}.",
                atoms=atoms,
            )
        now = 2 * system.now if moment is None else moment
        later = moment is not None
        return cls(number=number, merged=merged, atoms=atoms, moment=now, is_later=later, names=names)

    def questions(self) -> list[Question]:
        """What is asked."""
        every = questions(self.merged.system, () if self.is_later else PROPERTIES)
        return [each for each in every if self.names is None or not each.id or each.id in self.names]

    def job(self, together: Sequence[Question], alone: Sequence[Question]) -> Job:
        """The run that asks it."""
        system = self.merged.system
        text, commands = main_file(system, together, alone)
        return Job(
            files={
                **module_texts((*MODULES, *claims.MODULES) if system.claims else MODULES),
                **fact_modules(system),
                MAIN: text,
            },
            main=MAIN,
            commands=commands,
            atoms=self.atoms[1],
        )

    def answer(self, asked: Question, instance: bool, solutions: Path | None) -> Answer:
        """What it means whether a question has an instance, shown where that stands in `solutions`."""
        true = instance is (asked.command.kind == "run")
        status = asked.when_true if true else OPPOSITE[asked.when_true]
        if status is Status.HOLDS or not asked.id:
            return Answer(status=status)
        witnesses: tuple[Witness, ...] = ()
        if asked.roles and solutions is not None:
            witnesses = (witness(solutions, asked.command.name, asked.roles, self.merged.system),)
        moment = None if any(prop.id == asked.id for prop in PROPERTIES) else self.moment
        return self.merged.original(Answer(status=status, witnesses=witnesses, moment=moment))


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


def _over_time(number: int, cases: Sequence[_Case], told: Sequence[Mapping[str, Answer]]) -> dict[str, Answer]:
    """The answers about a system: of each claim the first violation, at whatever moment it is."""
    answers = dict(told[number])
    for case, then in zip(cases, told, strict=True):
        if case.number == number and case.is_later:
            answers |= {name: then[name] for name in then if answers[name].status is Status.HOLDS}
    return answers


def _answers(cases: Sequence[_Case], expected: Expected | None, analyzer: Analyzer) -> list[dict[str, Answer]]:
    """The answers about each case: what is as expected is asked together, the rest alone."""
    asked: list[tuple[list[Question], list[Question]]] = []
    for case in cases:
        every = case.questions()
        together = [] if expected is None else expected_true(every, expected[case.number])
        known = {question.id for question in together}
        asked.append((together, [question for question in every if question.id not in known]))
    found = _ask(cases, asked, analyzer)
    open_ = [place for place, told in enumerate(found) if "" not in told]
    left = [[each for each in cases[place].questions() if each.id not in found[place]] for place in open_]
    again = _ask([cases[place] for place in open_], [([], each) for each in left], analyzer)
    for place, told in zip(open_, again, strict=True):
        found[place].update(told)
    for told in found:
        if told.pop("").status is not Status.HOLDS:
            raise EngineFailed("The model contradicts itself, so that every property would hold of it.")
    return found


def _ask(
    cases: Sequence[_Case], asked: Sequence[tuple[list[Question], list[Question]]], analyzer: Analyzer
) -> list[dict[str, Answer]]:
    """What a question each finds about the cases, who are asked some things together and others alone.

    Nothing of what was asked together and is not as expected.
    """

    def read(job: int, found: Mapping[str, bool], solutions: Path) -> dict[str, Answer]:
        case, (together, alone) = cases[job], asked[job]
        told = {each.id: case.answer(each, found[each.command.name], solutions) for each in alone}
        if together and found[AS_EXPECTED.name]:
            told |= {each.id: case.answer(each, each.command.kind == "run", None) for each in together}
        return told

    return run([case.job(*each) for case, each in zip(cases, asked, strict=True)], analyzer, read)


AS_EXPECTED: Final = Command(kind="run", name="AsExpected")
"""The command for all conditions that are expected to be true."""

OPPOSITE: Final = {Status.HOLDS: Status.VIOLATED, Status.VIOLATED: Status.HOLDS}


def questions(system: System, properties: Sequence[Property]) -> Iterator[Question]:
    """Every question about a system."""
    consistent = Command(kind="run", name=CONSISTENCY)
    yield Question(id="", command=consistent, text=f"run {CONSISTENCY} for 0", condition=CONSISTENCY)
    for prop in properties:
        name = prop.predicate
        asked = Command(kind="check", name=name)
        yield Question(id=prop.id, command=asked, text=check(name), condition=name, roles=prop.roles)
    for number, claim in enumerate(system.claims):
        yield claims.question(claim, number)


def expected_true(asked: Sequence[Question], expected: Mapping[str, Status]) -> list[Question]:
    """Those whose conditions are true if all is as `expected`, by id."""
    return [each for each in asked if not each.id or expected.get(each.id) is each.when_true]


def main_file(system: System, together: Sequence[Question], alone: Sequence[Question]) -> tuple[str, list[Command]]:
    """The text of a main file, and its commands in their order."""
    places = claims.write_places(system, range(len(system.claims))) if system.claims else ""
    head = ["module audit", "open claims" if system.claims else "open vacuity", "", places]
    joint = ["run AsExpected {", *(f"\t({each.condition}\n\t)" for each in together), "} for 0"] if together else []
    commands = [*([AS_EXPECTED] if together else []), *(each.command for each in alone)]
    return "\n".join([*head, *joint, *(each.text for each in alone)]) + "\n", commands
