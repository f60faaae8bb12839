"""Observational determinism as Alloy: a small model of its own for each behaviour (alloy/determinism.als).

The bound of rounds is the depth of the native search (`engine.native_determinism`): with more rounds, no new pair of
states comes. In that bound the engines are not independent; in all else they are. What behaviours rest on, who hands
samples to whom, Alloy decides again from the facts of the keystore (alloy/forwarding.als).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

from keystore_audit import text
from keystore_audit.engine.alloy.answers import Command
from keystore_audit.engine.alloy.atoms import Relations, Sort, name_atoms
from keystore_audit.engine.alloy.claims import MODULES as CLAIM_MODULES
from keystore_audit.engine.alloy.facts import MODULES, count_atoms, fact_modules, module_texts
from keystore_audit.engine.alloy.process import Analyzer, Job
from keystore_audit.engine.alloy.solvers import run
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

COMMANDS: Final = (Command(kind="run", name=SHOWN), *(Command(kind="check", name=name) for name in (CERTAIN, PERHAPS)))
"""What is asked of a behaviour: that it shows something, and that what it shows is alike."""

_SORTS: Final = {Scheduler.PRIORITY: "ByPriority", Scheduler.ANY: "InAnyOrder"}

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
    holds = found[SHOWN] and not found[PERHAPS]
    return Answer(status=Status.HOLDS if holds else Status.UNKNOWN)


def _job(behaviour: Behaviour) -> Job:
    return Job(
        files={**module_texts((MODULE,)), MAIN: write_behaviour(behaviour, rounds_of(behaviour) or 0)},
        main=MAIN,
        commands=COMMANDS,
        atoms=behaviour.writers + len(behaviour.slots),
    )


def write_behaviour(behaviour: Behaviour, steps: int) -> str:
    """Return the main file about a behaviour. Names of topics stand in comments only."""
    lines = [
        "/** One declared behaviour: what comes to the topics that are low, written by keystore-audit. */",
        "module behaviour\nopen determinism\n",
    ]
    for number, topic in enumerate(behaviour.topics):
        sort = "Low" if number in behaviour.low else "Topic"
        lines.append(f"-- T{number}: {text.alloy_comment(topic)}\none sig T{number} extends {sort} {{}}")
    inputs = [("Input", {each.topic}, each.reaches) for each in behaviour.inputs]
    forwards = [(_SORTS[each.scheduler], each.targets, each.reaches) for each in behaviour.forwards]
    for letter, writers in (("I", inputs), ("F", forwards)):
        for number, (sort, topics, slots) in enumerate(writers):
            said = f"on = {_union('T', topics)} and reaches = {_union('S', slots)}"
            lines.append(f"one sig {letter}{number} extends {sort} {{}} {{ {said} }}")
    for number, slot in enumerate(behaviour.slots):
        before = {other for other in behaviour.slots_of(slot.forward) if other < number}
        said = f"of = F{slot.forward} and behind = {_union('S', before)}"
        lines.append(f"one sig S{number} extends Slot {{}} {{ {said} }}")
    lines.append(f"\nrun {SHOWN} {{ two_runs[none] and eventually shows }} for 0 but 1..{steps} steps")
    for name in (CERTAIN, PERHAPS):
        free = _union("I", behaviour.free(perhaps=name == PERHAPS))
        lines.append(f"check {name} {{ two_runs[{free}] implies always alike }} for 0 but 1..{steps} steps")
    return "\n".join(lines) + "\n"


def _union(letter: str, numbers: Collection[int]) -> str:
    return " + ".join(f"{letter}{number}" for number in sorted(numbers)) or "none"


def _wiring_job(system: System) -> Job:
    """The process that confirms what the claims of determinism of `system` rest on.

    Raises EngineOutOfScale where the system is too large.
    """
    atoms = count_atoms(system)
    if atoms > MAX_ATOMS:
        raise EngineOutOfScale(
            f"The model of this keystore has {atoms} atoms; what forwards rest on is confirmed for up to {MAX_ATOMS}."
        )
    modules = module_texts((*MODULES, CLAIM_MODULES[0], "forwarding.als"))
    return Job(
        files={**modules, **fact_modules(system), WIRING: write_wiring(system)},
        main=WIRING,
        commands=(Command(kind="check", name=CONFIRMED),),
        atoms=atoms,
    )


def write_wiring(system: System) -> str:
    """Return the main file: what is said of `system`, and the check that Alloy says the same."""
    atoms, relations = name_atoms(system), Relations()
    enclaves, channels = atoms["enclaves"], atoms["channels"]
    lines: list[str] = []
    said: list[str] = []

    def named(name: str, sort: Sort, members: Iterable[int]) -> str:
        lines.append(relations.subset(name, sort, members))
        return name

    def passages(name: str, passed: Iterable[tuple[int, frozenset[int]]]) -> str:
        rows: list[set[int]] = [set() for _enclave in system.enclaves]
        for enclave, topics in passed:
            rows[enclave] |= topics
        written = relations.rows(enclaves, channels, rows)
        lines.append(relations.relation(name, "Enclave -> Channel", written))
        return name

    for n, meeting in enumerate(dict.fromkeys(each for claim in system.determinism for each in claim.meetings)):
        on = named(f"on_{n}", channels, meeting.channels)
        senders = named(f"senders_{n}", enclaves, meeting.senders)
        receiver = None if meeting.receiver is None else enclaves.name(meeting.receiver)
        found = f"publishers[{on}]" if receiver is None else f"senders[{on}, {receiver}, {on}]"
        said.append(f"\t{found} = {senders}")
    for n, spread in enumerate(dict.fromkeys(c.spread for c in system.determinism if c.spread is not None)):
        arguments = (
            named(f"inside_{n}", enclaves, spread.inside),
            named(f"declared_{n}", enclaves, spread.declared),
            passages(f"passed_{n}", ((each.enclave, each.targets) for each in spread.passages if each.reached)),
            passages(f"closed_{n}", ((each.enclave, each.sources) for each in spread.passages if not each.reached)),
            named(f"first_{n}", channels, spread.first),
            f"Channel - {named(f'left_out_{n}', channels, spread.left_out)}",
        )
        said.append(f"\tcontained[{', '.join(arguments)}]")
    head = "/** Who hands samples to whom, as the other engine has it. */\nmodule wiring\nopen forwarding\n"
    return "\n".join([head, *relations.take_private(), *lines, f"\ncheck {CONFIRMED} {{", *said, "} for 0"]) + "\n"
