"""Reads what the Analyzer answered: strictly, because an answer that is misread could read as "holds"."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from lxml import etree
from msgspec import Struct

from keystore_audit.engine.alloy.atoms import index_of
from keystore_audit.errors import EngineFailed
from keystore_audit.properties.property import Role, Witness
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

    Raises EngineFailed unless there is exactly one verdict for each, in order, and no line besides.
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


def witness(directory: Path, command: str, roles: Sequence[Role], sizes: Mapping[Role, int]) -> Witness:
    """Return the atoms that make the check `command` fail, from the instance that the Analyzer left in `directory`.

    `sizes`: how many atoms may play each role. Raises EngineFailed if the instance is not there, is no XML, or does
    not name one known atom for each of `roles`.
    """
    return _roles(_skolems(directory / f"{command}-solution-0.xml", command), command, roles, sizes)


def witnesses(
    directory: Path, command: str, members: Mapping[str, Sequence[Role]], sizes: Mapping[Role, int]
) -> dict[str, Witness]:
    """Return, for checks that `command` stands for, by name, the atoms that make each of them fail. As `witness`.

    Their variables are called `member_role`. A realm that is the only one needs none.
    """
    atoms = _skolems(directory / f"{command}-solution-0.xml", command) if members else {}
    found: dict[str, Witness] = {}
    for member, roles in members.items():
        known: Witness = {role: 0 for role in roles if role is Role.REALM and sizes[role] == 1}
        theirs = {
            name.removeprefix(f"{member}_"): atom for name, atom in atoms.items() if name.startswith(f"{member}_")
        }
        found[member] = {**known, **_roles(theirs, member, [role for role in roles if role not in known], sizes)}
    return found


def _roles(atoms: Mapping[str, str], command: str, roles: Sequence[Role], sizes: Mapping[Role, int]) -> Witness:
    found: dict[Role, int] = {}
    for asked in roles:
        answer, role = atoms.get(asked.value, ""), asked
        if asked in (Role.PUBLISHER, Role.INSIDER):
            if _OUTSIDER.fullmatch(answer):
                continue
            role = Role.ENCLAVE if index_of(answer, Role.CERTIFICATE) is None else Role.CERTIFICATE
        index = index_of(answer, role)
        if index is None or index >= sizes[role]:
            raise EngineFailed(f"The Alloy Analyzer's counterexample to {command} names no {asked.value}.")
        found[role] = index
    return found


def _skolems(path: Path, assertion: str) -> dict[str, str]:
    """Return for each quantified variable of `assertion` the atom that the instance gives it."""
    prefix = f"${assertion}_"
    found: dict[str, str] = {}
    for skolem in _read(path, assertion).iterfind("./instance/skolem"):
        label = skolem.get("label", "")
        tuples = skolem.findall("./tuple/atom")
        if label.startswith(prefix) and len(tuples) == 1:
            found[label.removeprefix(prefix)] = tuples[0].get("label", "")
    return found


def read_instances(path: Path, command: str) -> list[etree._Element]:
    """Return the states of the trace that `command` found, in order. Raises EngineFailed if it cannot be read."""
    instances = _read(path, command).findall("./instance")
    if not instances:
        raise EngineFailed(f"The Alloy Analyzer's instance of {command} is not there.")
    return instances


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
