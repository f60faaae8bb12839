"""Tells an instance of a user's command in the user's names: which atoms its variables stand for."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from keystore_audit.engine.alloy.solution import read_instances
from keystore_audit.errors import EngineFailed
from keystore_audit.findings import Location
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import ros_name
from keystore_audit.properties.counterexample import Counterexample, Step
from keystore_audit.text import instant, shorten

MAX_TOLD: Final = 8
"""Variables that are told, and tuples of each."""

MAX_NAME: Final = 160
"""Characters of one name."""

_ATOM: Final = re.compile(r"(?:[\w$]+/)*(?:([A-Z]{1,2})(\d{1,9})(?:_[A-Za-z0-9_]*)?|([A-Za-z_]+))\$0", re.ASCII)


def describe_instance(system: System, command: str, solutions: Path) -> Counterexample:
    """The instance that the Analyzer left of `command`, by its outermost variables.

    Raises EngineFailed if it is not there or names what is not in the system.
    """
    variables = dict(_variables(solutions, command))
    names = _Names(system)
    told: list[str] = []
    steps: list[Step] = []
    for variable, tuples in list(variables.items())[:MAX_TOLD]:
        words = [" -> ".join(names.of(atom) for atom in atoms) for atoms in tuples[:MAX_TOLD]]
        told.append(f"{variable}: {', '.join(words) or 'nothing'}{', ...' if len(tuples) > MAX_TOLD else ''}")
        steps += [step for atoms in tuples[:MAX_TOLD] for step in map(names.step, atoms) if step is not None]
    if not told:
        return Counterexample(text="An instance has no variables to tell: begin the check with `all`.", steps=())
    return Counterexample(text=f"With {'; '.join(told)}.", steps=tuple(dict.fromkeys(steps)))


def _variables(solutions: Path, command: str) -> Iterator[tuple[str, list[list[str]]]]:
    """The outermost quantified variables, with the tuples of atoms that they stand for."""
    prefix = f"${command}_"
    for skolem in read_instances(solutions / f"{command}-solution-0.xml", command)[0].iterfind("./skolem"):
        label = skolem.get("label", "")
        if label.startswith(prefix):
            tuples = [[atom.get("label", "") for atom in each.findall("./atom")] for each in skolem.findall("./tuple")]
            yield label.removeprefix(prefix), tuples


class _Names:
    """What atoms are in the keystore."""

    def __init__(self, system: System) -> None:
        self._system = system

    def of(self, atom: str) -> str:
        """The name of an atom, for a sentence."""
        found = self._found(atom)
        return shorten(found[0] if isinstance(found, tuple) else found, MAX_NAME)

    def step(self, atom: str) -> Step | None:
        """The place of an atom, where it has one."""
        found = self._found(atom)
        name, location = found if isinstance(found, tuple) else (found, None)
        if location is None:
            return None
        enclave = name if atom.rpartition("/")[2].startswith("E") else None
        return Step(enclave=enclave, channel=None, witness=name, path=location.path, line=location.line)

    def _found(self, atom: str) -> str | tuple[str, Location | None]:
        """An atom's name and place; a word of the model's own stands for itself."""
        match = _ATOM.fullmatch(atom)
        if match is None:
            return atom
        if match[3] is not None:
            return match[3]
        try:
            return self._looked_up(match[1], int(match[2]))
        except (IndexError, KeyError):
            raise EngineFailed(f"The Alloy Analyzer's counterexample names {atom!r}, which is not there.") from None

    def _looked_up(self, letters: str, index: int) -> tuple[str, Location | None]:
        system = self._system
        match letters:
            case "E":
                return system.enclaves[index].label, system.enclaves[index].location
            case "T":
                return self._channel(index), None
            case "D":
                return system.domains[index].label, None
            case "C":
                return system.certificates[index].label, system.certificates[index].location
            case "P":
                return system.documents[index].label, system.documents[index].location
            case "R":
                members = [enclave.label for enclave in system.enclaves if enclave.realm == index]
                return f"the trust of {', '.join(members[:3])}{' and others' if len(members) > 3 else ''}", None
            case "N":
                return system.nodes[index].label, None
            case "I":
                return instant(system.instants[index]), None
            case "K":
                return f"key {index}", None
            case _:
                return self._entry(letters, index)

    def _entry(self, letters: str, index: int) -> tuple[str, Location]:
        """A rule or grant, by its line."""
        system = self._system
        places = {
            "DR": [rule.location for rule in system.domain_rules],
            "TR": [rule.location for rule in system.topic_rules],
            "G": [grant.location for grant in system.grants],
            "PR": [rule.location for rule in system.rules],
        }
        location = places[letters][index]
        return str(location), location

    def _channel(self, index: int) -> str:
        channel = self._system.channels[index]
        name = ros_name(channel.topic)
        name = f"topics such as {name}" if channel.infinite else name
        partition = f" in partition {channel.partition!r}" if channel.partition else ""
        return f"{name}{partition} ({self._system.domains[channel.domain].label})"
