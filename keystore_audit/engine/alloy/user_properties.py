"""Users' own Alloy files, asked of every system, in a JVM that is asked nothing else: none can change our properties.

A file is the main file of its run. Beside it are the modules, the facts, and the module `keystore_audit` with its names
for enclaves and topics. The facts are constants, so no file can change them. A file that contradicts them leaves the
run `CONSISTENT` without an instance, and everything undecided.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.engine.alloy import claims, install
from keystore_audit.engine.alloy.answers import Command, skolems
from keystore_audit.engine.alloy.atoms import atom_of
from keystore_audit.engine.alloy.export import MODULE, NODES, VOCABULARY, write_nodes, write_vocabulary
from keystore_audit.engine.alloy.facts import MODULES, count_atoms, fact_modules, module_texts
from keystore_audit.engine.alloy.process import Analyzer, Job, Output
from keystore_audit.engine.alloy.runner import MAX_ATOMS, MEMORY_MB
from keystore_audit.engine.alloy.solvers import run
from keystore_audit.engine.alloy.user_file import CONSISTENT, Asked, UserFile
from keystore_audit.engine.engines import AskedSystems, Engines
from keystore_audit.errors import EngineError, EngineFailed, EngineOutOfScale, UsageError
from keystore_audit.findings import Location
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import topics_named
from keystore_audit.properties.result import (
    AlloyResult,
    Answer,
    Counterexample,
    EngineRun,
    EngineStatus,
    Property,
    Status,
    Step,
)
from keystore_audit.resources import in_ci
from keystore_audit.text import instant, shorten

MAIN: Final = "user_properties.als"
"""What a user's file is called where the Analyzer reads it."""

MAX_TOLD: Final = 8
"""Variables of an instance that are told, and tuples of each."""

MAX_NAME: Final = 160
"""Characters of one name."""

_PLAIN: Final = re.compile(r"[\w\s:,&+\-.()\[\]~^*<>]+", re.ASCII)
_ENCLOSED: Final = re.compile(r"\([^()\[\]]*\)|\[[^()\[\]]*\]")
_VARIABLE: Final = re.compile(r"(?:disj\s+)?(\w+)", re.ASCII)

_COMPLAINT: Final = re.compile(
    r"(?:\w+ error in (?:.*[/\\])?user_properties\.als at line (\d+) column (\d+):\s*([^\n]*(?:(?<=:)\n[^\n]*)?))"
    r"|(?:\d+\. line (\d+), column (\d+) .*?filename=(?:.*[/\\])?user_properties\.als ([^\n]*))"
)
"""An error, or a warning, about the user's file; what could stand there instead is on a line of its own."""

_WARNINGS: Final = re.compile(r"^Warnings?$", re.MULTILINE)


class Told(Struct, frozen=True, kw_only=True):
    """The answer to one command in one system; `example` only where it is VIOLATED, `reason` where it is UNKNOWN.

    `vacuous`: nothing is in the range of a check that HOLDS.
    """

    status: Status
    example: Counterexample | None = None
    reason: str = ""
    vacuous: bool = False


def decide_files(
    files: Sequence[UserFile],
    systems: Sequence[System],
    profiles: Sequence[str],
    runs: Iterable[EngineRun],
    engines: Engines,
    stage: Callable[[str], None] | None,
) -> tuple[AlloyResult, ...]:
    """The result of every command of the files under every profile; unknown wherever Alloy gave no answer.

    `systems` have the places of all files, in order. `runs`: how Alloy fared about our own properties. The timeout is
    that of each system and file. Raises errors.UsageError, with line and column, for what Alloy refuses in a file.
    """
    first = 0
    results: list[AlloyResult] = []
    for file in files:
        until = first + len(file.places)
        mine = [replace(system, places=system.places[first:until], claims=()) for system in systems]
        first = until
        if stage:
            stage(f"asking the Alloy Analyzer about {file.path}")
        told = _told(file, mine, runs, engines, stage)
        results += (
            _result(asked, file.text, mine, [each[number] for each in told], profiles)
            for number, asked in enumerate(file.commands)
        )
    return tuple(results)


def _told(
    file: UserFile,
    systems: Sequence[System],
    runs: Iterable[EngineRun],
    engines: Engines,
    stage: Callable[[str], None] | None,
) -> list[list[Told]]:
    """By system, the answers to the commands."""
    try:
        alloy = next((run for run in runs if run.name == "alloy"), None)
        if alloy is None or alloy.status is not EngineStatus.OK:
            raise EngineFailed(alloy.reason if alloy else "")
        found = install.find(engines.jar, offline=engines.offline, ci=in_ci(), progress=stage)
        analyzer = Analyzer(java=found.java, jar=found.jar, timeout=engines.timeout, memory_mb=MEMORY_MB)
        return ask(file, systems, analyzer)
    except EngineError as error:
        reason = f"Alloy gave no answer ({error.message.rstrip('.')})"
        return [[Told(status=Status.UNKNOWN, reason=reason) for _ in file.commands] for _ in systems]


def ask(file: UserFile, systems: Sequence[System], analyzer: Analyzer) -> list[list[Told]]:
    """Return for each system the answers to the commands of the file.

    Raises errors.UsageError for what Alloy refuses in it, and EngineError as `runner.examine` does.
    """
    for system in systems:
        if count_atoms(system) > MAX_ATOMS:
            raise EngineOutOfScale(f"its model has {count_atoms(system)} atoms, more than the {MAX_ATOMS} that it can")
    jobs = [job(file, system) for system in systems]
    return run(
        jobs,
        analyzer,
        lambda number, found, solutions: [_answer(a, systems[number], found, solutions) for a in file.commands],
        lambda output: _checked(file, output),
    )


def job(file: UserFile, system: System) -> Job:
    """The run that asks a file about a system."""
    further = ranges(file)
    text = f"{file.text}\n{''.join(further.values())}" if further else file.text
    written = {**module_texts((*MODULES, *claims.MODULES)), **fact_modules(system), MAIN: text}
    if system.nodes:
        written |= {**module_texts((MODULE,)), NODES: write_nodes(system)}
    asked = [Command(kind=asked.kind, name=asked.name) for asked in file.commands]
    spoken_of = [Command(kind="run", name=run_of(asked)) for asked in file.commands if asked.name in further]
    return Job(
        files={**written, f"{VOCABULARY}.als": write_vocabulary(system)},
        main=MAIN,
        commands=(*asked, Command(kind="run", name=CONSISTENT), *spoken_of),
        atoms=count_atoms(system),
    )


def _checked(file: UserFile, output: Output) -> Output:
    """What the Analyzer wrote, without warnings about other files. Raises UsageError for complaints about the user's.

    A warning counts as an error: what is always empty, or never used, is a property that does not ask what it says.
    """
    complaint = _COMPLAINT.search(output.diagnostics) or _COMPLAINT.search(output.messages)
    if complaint is not None:
        line, column, message = (complaint[1], complaint[2], complaint[3]) if complaint[1] else complaint.groups()[3:]
        raise UsageError(f"{file.path}:{line}:{column}: Alloy says: {shorten(' '.join(message.split()), 300)}")
    return replace(output, diagnostics=_WARNINGS.split(output.diagnostics)[0])


def _answer(asked: Asked, system: System, found: Mapping[str, bool], solutions: Path) -> Told:
    """The answer to one command, or why there is none."""
    if not found[CONSISTENT]:
        reason = "what the file says contradicts what the keystore says, so that everything would be true"
        return Told(status=Status.UNKNOWN, reason=reason)
    if any(place.unread for place in system.places):
        reason = "the file names enclaves, and the name of one enclave is unknown"
        return Told(status=Status.UNKNOWN, reason=reason)
    if found[asked.name] == asked.instance:
        return Told(status=Status.HOLDS, vacuous=not found.get(run_of(asked), True))
    if asked.instance:
        return Told(status=Status.VIOLATED, example=Counterexample(text="There is no instance of it.", steps=()))
    return Told(status=Status.VIOLATED, example=describe_instance(system, asked.name, solutions))


def _result(
    asked: Asked, text: str, systems: Sequence[System], told: Sequence[Told], profiles: Sequence[str]
) -> AlloyResult:
    """The result of one command: HOLDS or VIOLATED only where every reading says so."""
    examples = [each.example for each in told]
    answers = [{asked.id: Answer(status=each.status, witnesses=({},) * (each.example is not None))} for each in told]
    engines = {} if all(each.reason for each in told) else {"alloy": answers}
    combined = AskedSystems(systems, engines, profiles)
    return AlloyResult(
        prop=Property(
            id=asked.id,
            statement=asked.statement,
            attacker="as the file says",
            clause=f"asserted in {asked.location.path}",
            roles=(),
        ),
        profiles=combined.by_profile(asked.id, lambda at, _answer: examples[at]),
        severity=asked.severity,
        location=asked.location,
        meaning=text,
        vacuous=any(one.vacuous for one in told),
        reason=next((one.reason for one in told if one.reason), "" if told else "no right was decided"),
    )


def describe_instance(system: System, command: str, solutions: Path) -> Counterexample:
    """The instance that the Analyzer left of `command`, by its outermost variables.

    Raises EngineFailed if it is not there or names what is not in the system.
    """
    told: list[str] = []
    steps: list[Step] = []
    for variable, tuples in list(skolems(solutions, command).items())[:MAX_TOLD]:
        words = [
            " -> ".join(shorten(_meaning(system, each)[0], MAX_NAME) for each in atoms) for atoms in tuples[:MAX_TOLD]
        ]
        told.append(f"{variable}: {', '.join(words) or 'nothing'}{', ...' if len(tuples) > MAX_TOLD else ''}")
        for atom in (atom for atoms in tuples[:MAX_TOLD] for atom in atoms):
            name, place = _meaning(system, atom)
            if place is not None:
                enclave = name if (atom_of(atom) or ("",))[0] == "enclaves" else None
                steps.append(Step(enclave=enclave, channel=None, witness=name, path=place.path, line=place.line))
    if not told:
        return Counterexample(text="An instance has no variables to tell: begin the check with `all`.", steps=())
    return Counterexample(text=f"With {'; '.join(told)}.", steps=tuple(dict.fromkeys(steps)))


def _meaning(system: System, atom: str) -> tuple[str, Location | None]:
    """An atom's name and place; a word of the model's own stands for itself."""
    sort, index = atom_of(atom) or ("", 0)
    try:
        match sort:
            case "":
                return atom.removesuffix("$0").rpartition("/")[2], None
            case "channels":
                channel = system.channels[index]
                partition = f" in partition {channel.partition!r}" if channel.partition else ""
                name = topics_named(channel.topic, endless=channel.infinite)
                return f"{name}{partition} ({system.domains[channel.domain].label})", None
            case "trust_domains":
                members = [enclave.label for enclave in system.enclaves if enclave.trust_domain == index]
                return f"the trust of {', '.join(members[:3])}{' and others' if len(members) > 3 else ''}", None
            case "instants":
                return instant(system.instants[index]), None
            case "keys":
                return f"key {index}", None
            case "domains" | "nodes":
                return getattr(system, sort)[index].label, None
            case _:  # a rule or grant is called by its line
                found = getattr(system, sort)[index]
                return getattr(found, "label", str(found.location)), found.location
    except IndexError:
        raise EngineFailed(f"The Alloy Analyzer's counterexample names {atom!r}, which is not there.") from None


def ranges(file: UserFile) -> dict[str, str]:
    """By command a run, as its name and text, that has an instance where there is something to speak of.

    Of nothing everything is true. Asked is about the `all` that a check, or the assertion of its name, begins with, if
    it is plainly written.
    """
    found = ((asked, _declared(file.text, asked)) for asked in file.commands if asked.kind == "check")
    return {asked.name: f"run {run_of(asked)} {{ {asks} }} for 0\n" for asked, asks in found if asks}


def run_of(asked: Asked) -> str:
    """The name of that run."""
    return f"KeystoreAuditRangeOf{asked.name}"


def _declared(text: str, asked: Asked) -> str:
    """That something is what the outermost `all` declares; nothing where it is not plain what that is."""
    begin = re.search(rf"^[ \t]*(?:assert|check)\s+{asked.name}\s*\{{\s*all\s", text, re.MULTILINE | re.ASCII)
    if begin is None:
        return ""
    declarations = re.split(r"[|{]", text[begin.end() :], maxsplit=1)[0]
    if "--" in declarations or not _PLAIN.fullmatch(declarations):
        return ""
    outside = declarations
    while _ENCLOSED.search(outside):
        outside = _ENCLOSED.sub("", outside)
    names = [_VARIABLE.fullmatch(each.partition(":")[0].strip()) for each in outside.split(",")]
    told = [f"some {name[1]}" for name in names if name is not None]
    return f"some {declarations.strip()} | {' and '.join(told)}" if len(told) == len(names) else ""
