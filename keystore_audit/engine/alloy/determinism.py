"""Observational determinism as Alloy: a small model of its own for each behaviour (alloy/determinism.als).

The bound of steps is the depth of the native search (`engine.native_determinism`): with more rounds, no new pair of
states comes. In that bound the engines are not independent; in all else they are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from lxml import etree
from msgspec import Struct
from msgspec.structs import replace

from keystore_audit import text
from keystore_audit.engine.alloy.jobs import run
from keystore_audit.engine.alloy.process import Analyzer, Job
from keystore_audit.engine.alloy.runner import module_texts
from keystore_audit.engine.alloy.solution import Command, read_instances
from keystore_audit.engine.alloy.wiring import CONFIRMED, wiring_job
from keystore_audit.engine.native_determinism import explore
from keystore_audit.errors import EngineFailed
from keystore_audit.model.formal.behaviour import Behaviour, DeterminismAtom, Scheduler
from keystore_audit.model.formal.system import System
from keystore_audit.properties.property import Acts, Answer, Round, Status

MODULE: Final = "determinism.als"
"""The hand-written module."""

MAIN: Final = "behaviour.als"
"""The generated main file."""

SHOWN: Final = "SomethingIsSeen"
"""The run that shows that there is something to compare."""

CERTAIN: Final = "Deterministic"
"""The check with the inputs that differ for certain."""

PERHAPS: Final = "DeterministicWhateverOthersDo"
"""The check with those that perhaps differ as well."""


class _Case(Struct, frozen=True, kw_only=True):
    """A behaviour that is small enough to be asked about in `steps` rounds."""

    behaviour: Behaviour
    steps: int


def decide(systems: Sequence[System], analyzer: Analyzer) -> list[dict[str, Answer]]:
    """The answers to the claims of each system, by id; equal behaviours of several are asked about once.

    Raises an EngineError if the Analyzer does not answer everything that it is asked.
    """
    behaviours = (b for system in systems for claim in system.determinism for b in claim.behaviours)
    cases = [case for case in map(_case, dict.fromkeys(behaviours)) if case is not None]
    known: dict[Behaviour, Answer] = {}

    def read(job: int, found: Mapping[str, bool], solutions: Path) -> None:
        if job >= len(cases):
            _confirm(found)
        else:
            known[cases[job].behaviour] = _read(cases[job].behaviour, found, solutions)

    resting = [system for system in systems if any(claim.meetings for claim in system.determinism)]
    run([*map(_job, cases), *map(wiring_job, resting)], analyzer, read)
    return [{claim.id: _together(claim, known) for claim in system.determinism} for system in systems]


def _confirm(found: Mapping[str, bool]) -> None:
    """Raises EngineFailed unless Alloy finds that the behaviours are those of the keystore."""
    if found[CONFIRMED]:
        raise EngineFailed("The Alloy Analyzer does not confirm who hands samples to the forwards declared.")


def _case(behaviour: Behaviour) -> _Case | None:
    """The behaviour with a bound that is complete; None where there is none that the Analyzer can be asked about."""
    certain, free = explore(behaviour, perhaps=False), explore(behaviour, perhaps=True)
    steps = max(certain.depth, free.depth) + 1
    return _Case(behaviour=behaviour, steps=steps) if certain.complete and free.complete else None


def _together(claim: DeterminismAtom, known: Mapping[Behaviour, Answer]) -> Answer:
    """One answer for all behaviours of a claim: unknown where one of them was not asked about."""
    answers = [known.get(behaviour) for behaviour in claim.behaviours]
    for number, answer in enumerate(answers):
        if answer is not None and answer.status is Status.VIOLATED:
            return replace(answer, behaviour=number)
    holds = bool(answers) and all(answer is not None and answer.status is Status.HOLDS for answer in answers)
    return Answer(status=Status.HOLDS if holds else Status.UNKNOWN)


def _job(case: _Case) -> Job:
    behaviour = case.behaviour
    return Job(
        files={**module_texts((MODULE,)), MAIN: write_behaviour(behaviour, case.steps)},
        main=MAIN,
        commands=commands_of(behaviour),
        atoms=behaviour.writers + len(behaviour.slots),
    )


def commands_of(behaviour: Behaviour) -> tuple[Command, ...]:
    """Return the commands about a behaviour: that it shows something, and that what it shows is alike."""
    doubtful = behaviour.free(perhaps=True) != behaviour.free(perhaps=False)
    checks = (CERTAIN, PERHAPS) if doubtful else (CERTAIN,)
    return (Command(kind="run", name=SHOWN), *(Command(kind="check", name=name) for name in checks))


def write_behaviour(behaviour: Behaviour, steps: int) -> str:
    """Return the main file about a behaviour. Names of topics stand in comments only."""
    lines = [
        "/** One declared behaviour: what comes to the topics that are low, written by keystore-audit. */",
        "module behaviour",
        "open determinism",
        "",
        *_atoms(behaviour),
        "",
        f"run {SHOWN} {{ two_runs[none] and eventually shows }} for 0 but 1..{steps} steps",
    ]
    for command in commands_of(behaviour)[1:]:
        free = _union("I", sorted(behaviour.free(perhaps=command.name == PERHAPS)))
        lines.append(f"check {command.name} {{ two_runs[{free}] implies always alike }} for 0 but 1..{steps} steps")
    return "\n".join(lines) + "\n"


def _atoms(behaviour: Behaviour) -> Iterator[str]:
    for number, topic in enumerate(behaviour.topics):
        sort = "Low" if number in behaviour.low else "Topic"
        yield f"-- T{number}: {text.alloy_comment(topic)}"
        yield f"one sig T{number} extends {sort} {{}}"
    for number, each in enumerate(behaviour.inputs):
        yield _writer(f"I{number}", "Input", [each.topic], each.reaches)
    for number, forward in enumerate(behaviour.forwards):
        sort = "ByPriority" if forward.scheduler is Scheduler.PRIORITY else "InAnyOrder"
        yield _writer(f"F{number}", sort, sorted(forward.targets), forward.reaches)
    for number, slot in enumerate(behaviour.slots):
        before = [other for other in behaviour.slots_of(slot.forward) if other < number]
        yield f"one sig S{number} extends Slot {{}} {{ of = F{slot.forward} and behind = {_union('S', before)} }}"


def _writer(name: str, sort: str, topics: Iterable[int], slots: Iterable[int]) -> str:
    arrives = _union("S", sorted(slots))
    return f"one sig {name} extends {sort} {{}} {{ on = {_union('T', topics)} and reaches = {arrives} }}"


def _union(letter: str, numbers: Iterable[int]) -> str:
    return " + ".join(f"{letter}{number}" for number in numbers) or "none"


def _read(behaviour: Behaviour, found: Mapping[str, bool], solutions: Path) -> Answer:
    """The answer about one behaviour; a difference comes with the two runs."""
    if found[CERTAIN]:
        rounds = read_rounds(solutions / f"{CERTAIN}-solution-0.xml", behaviour)
        return Answer(status=Status.VIOLATED, witnesses=({},), rounds=rounds)
    holds = found[SHOWN] and not found.get(PERHAPS, False)
    return Answer(status=Status.HOLDS if holds else Status.UNKNOWN)


def read_rounds(path: Path, behaviour: Behaviour) -> tuple[Round, ...]:
    """Return the two runs of a counterexample, up to the first difference.

    Raises EngineFailed if they are not there, or show none.
    """
    rounds = []
    for state in read_instances(path, CERTAIN):
        both = Round(one=_acts(state, "Left", behaviour), other=_acts(state, "Right", behaviour))
        rounds.append(both)
        if any(both.one.sent[writer] != both.other.sent[writer] for writer in behaviour.seen()):
            return tuple(rounds)
    raise EngineFailed(f"The Alloy Analyzer's counterexample to {CERTAIN} shows no difference.")


def _acts(state: etree._Element, name: str, behaviour: Behaviour) -> Acts:
    sent: list[int | None] = [None] * behaviour.writers
    for _run, writer, value in _tuples(state, "sent", name, 3):
        number = int(writer[1:]) + (len(behaviour.inputs) if writer.startswith("F") else 0)
        sent[number] = ("One", "Another").index(value)
    taken = sorted(int(slot[1:]) for _run, slot in _tuples(state, "taken", name, 2))
    return Acts(sent=tuple(sent), taken=tuple(taken))


def _tuples(state: etree._Element, label: str, name: str, arity: int) -> Iterator[list[str]]:
    """The tuples of a field that belong to one run, in the names of this module and its main file."""
    for field in state.findall(f"./field[@label='{label}']"):
        for each in field.findall("./tuple"):
            atoms = [a.get("label", "").rpartition("/")[2].removesuffix("$0") for a in each.findall("./atom")]
            if len(atoms) != arity:
                raise EngineFailed(f"The Alloy Analyzer's counterexample to {CERTAIN} cannot be followed.")
            if atoms[0] == name:
                yield atoms
