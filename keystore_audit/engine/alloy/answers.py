"""What the Analyzer's answers say: verdicts, the atoms of counterexamples, and why a run failed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from lxml import etree
from msgspec import Struct

from keystore_audit.engine.alloy.atoms import index_of
from keystore_audit.errors import EngineFailed
from keystore_audit.model.formal.system import System
from keystore_audit.properties.result import Role, Witness
from keystore_audit.text import shorten

MAX_INSTANCE: Final = 64 * 1024 * 1024
"""Bytes of one instance: 10,000 atoms take some 2 MB."""

_VERDICT: Final = re.compile(r"(\d+)\. (check|run)\s+(\S+)\s.*\b(UNSAT|SAT)", re.ASCII)
_OUTSIDER: Final = re.compile(r"(?:\w+/)*Outsider\$0", re.ASCII)
_ERROR: Final = re.compile(r"(\w+ error) in (?:.*[/\\])?([^/\\]+?) at line (\d+) column (\d+):\s*([^\n]*)")
_TOO_OLD: Final = ("UnsupportedClassVersionError", "Unrecognized option", "Unrecognized VM option")


class Command(Struct, frozen=True, kw_only=True):
    """A command of the main file: `kind` is check or run."""

    kind: str
    name: str


def verdicts(diagnostics: str, commands: Sequence[Command]) -> dict[str, bool]:
    """Return for each command, by name, whether it has an instance.

    Raises EngineFailed unless there is exactly one verdict for each, in order, and no other line.
    """
    lines = [line for line in diagnostics.replace("\b", "").splitlines() if line.strip()]
    found: dict[str, bool] = {}
    for line, (number, command) in zip(lines, enumerate(commands), strict=False):
        match = _VERDICT.fullmatch(line.strip())
        if match is None or (int(match[1]), match[2], match[3]) != (number, command.kind, command.name):
            raise EngineFailed(
                f"The Alloy Analyzer gave no verdict on {command.name}, but: {shorten(line.strip(), 200)}"
            )
        found[command.name] = match[4] == "SAT"
    if len(lines) != len(commands):
        raise EngineFailed(
            f"The Alloy Analyzer answered {len(lines)} of {len(commands)} commands, which is no answer at all."
        )
    return found


def witness(directory: Path, command: str, roles: Sequence[Role], system: System) -> Witness:
    """Return the atoms that make the check `command` fail, from the instance that the Analyzer left in `directory`.

    Raises EngineFailed if the instance is not there, is no XML, or does not name one atom of the system for each of
    `roles`.
    """
    variables = skolems(directory, command)
    found: dict[Role, int] = {}
    for asked in roles:
        values, role = variables.get(asked.value, []), asked
        answer = values[0][0] if len(values) == 1 and len(values[0]) == 1 else ""
        if asked in (Role.PUBLISHER, Role.INSIDER):
            if _OUTSIDER.fullmatch(answer):
                continue
            role = Role.ENCLAVE if index_of(answer, Role.CERTIFICATE, system) is None else Role.CERTIFICATE
        index = index_of(answer, role, system)
        if index is None:
            raise EngineFailed(f"The Alloy Analyzer's counterexample to {command} names no {asked.value}.")
        found[role] = index
    return found


def skolems(directory: Path, command: str) -> dict[str, list[list[str]]]:
    """The tuples of atoms that each outermost variable of `command` stands for in the instance that was left of it."""
    prefix, path = f"${command}_", directory / f"{command}-solution-0.xml"
    instance = _read(path, command).find("./instance")
    if instance is None:
        raise EngineFailed(f"The Alloy Analyzer's instance of {command} is not there.")
    return {
        skolem.get("label", "").removeprefix(prefix): [
            [atom.get("label", "") for atom in each.findall("./atom")] for each in skolem.findall("./tuple")
        ]
        for skolem in instance.iterfind("./skolem")
        if skolem.get("label", "").startswith(prefix)
    }


def _read(path: Path, assertion: str) -> etree._Element:
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)
    try:
        if path.stat().st_size > MAX_INSTANCE:
            raise EngineFailed(f"The Alloy Analyzer's counterexample to {assertion} is too large to read.")
        return etree.fromstring(path.read_bytes(), parser)
    except (OSError, etree.XMLSyntaxError) as error:
        raise EngineFailed(f"The Alloy Analyzer's counterexample to {assertion} cannot be read: {error}.") from error


def failure(status: int, diagnostics: str, *, java: Path, memory_mb: int) -> EngineFailed:
    """Return the error that says, in a sentence, why a run ended with `status` other than 0."""
    if status < 0:
        return EngineFailed(f"The Alloy Analyzer was killed by signal {-status}.")
    if "OutOfMemoryError" in diagnostics:
        return EngineFailed(f"The Alloy Analyzer ran out of its {memory_mb} MiB of memory.")
    if "StackOverflowError" in diagnostics:
        return EngineFailed("The Alloy Analyzer ran out of stack.")
    if any(sign in diagnostics for sign in _TOO_OLD):
        return EngineFailed(f"The Java at {java} cannot run the Alloy Analyzer: it needs Java 17 or newer.")
    if match := _ERROR.search(diagnostics):
        kind, file, line, column, message = match.groups()
        text = f"The Alloy Analyzer refuses the model: {kind} in {file}, line {line}, column {column}."
        return EngineFailed(f"{text} {shorten(message.strip(), 200)}".rstrip())
    last = next((line.strip() for line in diagnostics.splitlines() if line.strip()), "it said nothing")
    return EngineFailed(f"The Alloy Analyzer failed with status {status}: {shorten(last, 200)}")
