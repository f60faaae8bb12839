"""Observational determinism as Alloy: a small model of its own for each behaviour (alloy/determinism.als).

The bound of rounds is the depth of the native search (`engine.native_determinism`): with more rounds, no new pair of
states comes. In that bound the engines are not independent; in all else they are. What behaviours rest on, who hands
samples to whom, Alloy decides again from the facts of the keystore (alloy/forwarding.als).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from keystore_audit import text
from keystore_audit.engine.alloy.atoms import Relations, name_atoms
from keystore_audit.engine.alloy.claims import MODULES as CLAIM_MODULES
from keystore_audit.engine.alloy.facts import MODULES, count_atoms, fact_modules, module_texts
from keystore_audit.engine.alloy.process import Analyzer, Command, Job, run
from keystore_audit.engine.native_determinism import explore, together
from keystore_audit.errors import EngineFailed, EngineOutOfScale
from keystore_audit.model.formal.asked import Behaviour, Scheduler
from keystore_audit.model.formal.system import System
from keystore_audit.properties.result import Answer, Status

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

WIRING: Final = "wiring.als"
"""The generated main file about what behaviours rest on."""

CONFIRMED: Final = "BehaviourIsOfThisKeystore"
"""The check that confirms it."""

MAX_ATOMS: Final = 3_000
"""Atoms up to which that is asked: the keystore is not merged here, and takes some 20 s then."""


def decide(systems: Sequence[System], analyzer: Analyzer) -> list[dict[str, Answer]]:
    """The answers to the claims of each system, by id; equal behaviours of several are asked about once.

    Raises an EngineError if the Analyzer does not answer everything that it is asked.
    """
    every = dict.fromkeys(b for system in systems for claim in system.determinism for b in claim.behaviours)
    asked = [behaviour for behaviour in every if rounds_of(behaviour) is not None]
    resting = [system for system in systems if any(claim.meetings for claim in system.determinism)]
    known: dict[Behaviour, Answer] = {}

    def read(job: int, found: Mapping[str, bool], _solutions: Path) -> None:
        if job < len(asked):
            known[asked[job]] = _answer(asked[job], found)
        elif found[CONFIRMED]:
            raise EngineFailed("The Alloy Analyzer does not confirm who hands samples to the forwards declared.")

    run([*map(_job, asked), *map(_wiring_job, resting)], analyzer, read)
    return [{c.id: together(map(known.get, c.behaviours)) for c in system.determinism} for system in systems]


def rounds_of(behaviour: Behaviour) -> int | None:
    """How many rounds are enough; None where there are too many to ask the Analyzer."""
    certain, free = explore(behaviour, perhaps=False), explore(behaviour, perhaps=True)
    return max(certain.depth, free.depth) + 1 if certain.complete and free.complete else None


def _answer(behaviour: Behaviour, found: Mapping[str, bool]) -> Answer:
    """The answer about one behaviour; a difference is shown by the native engine.

    Raises EngineFailed where that knows none: a counterexample that shows nothing is no answer.
    """
    if found[CERTAIN]:
        rounds = explore(behaviour, perhaps=False).rounds
        if not rounds:
            raise EngineFailed(f"The Alloy Analyzer's counterexample to {CERTAIN} shows no difference.")
        return Answer(status=Status.VIOLATED, witnesses=({},), rounds=rounds)
    holds = found[SHOWN] and not found.get(PERHAPS, False)
    return Answer(status=Status.HOLDS if holds else Status.UNKNOWN)


def _job(behaviour: Behaviour) -> Job:
    return Job(
        files={**module_texts((MODULE,)), MAIN: write_behaviour(behaviour, rounds_of(behaviour) or 0)},
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


def _wiring_job(system: System) -> Job:
    """The process that confirms what the claims of determinism of `system` rest on.

    Raises EngineOutOfScale where the system is too large.
    """
    atoms = count_atoms(system)
    if atoms > MAX_ATOMS:
        raise EngineOutOfScale(
            f"The model of this keystore has {atoms} atoms; what forwards rest on is confirmed for up to {MAX_ATOMS}."
        )
    return Job(
        files={
            **module_texts((*MODULES, CLAIM_MODULES[0], "forwarding.als")),
            **fact_modules(system),
            WIRING: write_wiring(system),
        },
        main=WIRING,
        commands=(Command(kind="check", name=CONFIRMED),),
        atoms=atoms,
    )


def write_wiring(system: System) -> str:
    """Return the main file: what is said of `system`, and the check that Alloy says the same."""
    atoms, relations = name_atoms(system), Relations()
    lines: list[str] = []

    def channels(name: str, members: frozenset[int]) -> str:
        lines.append(relations.subset(name, atoms.channels, members))
        return name

    def enclaves(name: str, members: frozenset[int]) -> str:
        lines.append(relations.subset(name, atoms.enclaves, members))
        return name

    def passages(name: str, passed: Iterable[tuple[int, frozenset[int]]]) -> str:
        rows: list[set[int]] = [set() for _enclave in atoms.enclaves.atoms]
        for enclave, topics in passed:
            rows[enclave] |= topics
        written = relations.rows(atoms.enclaves, atoms.channels, rows)
        lines.append(relations.relation(name, "Enclave -> Channel", written))
        return name

    said = []
    for n, meeting in enumerate(dict.fromkeys(each for claim in system.determinism for each in claim.meetings)):
        on, whose = channels(f"on_{n}", meeting.channels), enclaves(f"senders_{n}", meeting.senders)
        receiver = None if meeting.receiver is None else atoms.enclaves.name(meeting.receiver)
        found = f"publishers[{on}]" if receiver is None else f"senders[{on}, {receiver}, {on}]"
        said.append(f"{found} = {whose}")
    for n, spread in enumerate(dict.fromkeys(c.spread for c in system.determinism if c.spread is not None)):
        inside, declared = enclaves(f"inside_{n}", spread.inside), enclaves(f"declared_{n}", spread.declared)
        first, left_out = channels(f"first_{n}", spread.first), channels(f"left_out_{n}", spread.left_out)
        passed = passages(f"passed_{n}", ((each.enclave, each.targets) for each in spread.passages if each.reached))
        closed = passages(f"closed_{n}", ((e.enclave, e.sources) for e in spread.passages if not e.reached))
        said.append(f"contained[{inside}, {declared}, {passed}, {closed}, {first}, Channel - {left_out}]")
    head = ["/** Who hands samples to whom, as the other engine has it. */", "module wiring", "open forwarding", ""]
    check = [f"check {CONFIRMED} {{", *(f"\t{each}" for each in said), "} for 0"]
    return "\n".join([*head, *relations.take_private(), *lines, "", *check]) + "\n"
