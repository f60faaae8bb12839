"""The way that data takes where a claim says that none flows: a shortest walk, as the Analyzer's trace tells it.

Asked of violated claims alone, in a main file of its own, since the module `propagation` is temporal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from lxml import etree

from keystore_audit.engine.alloy.atoms import index_of
from keystore_audit.engine.alloy.claims import Places, attackers, write_places
from keystore_audit.engine.alloy.solution import Command, read_instances
from keystore_audit.errors import EngineFailed
from keystore_audit.model.formal.claim import ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties.property import Answer, Hop, Role, Status, Witness

MODULES: Final = ("propagation.als",)
"""The hand-written modules that paths need, after those of the claims."""

MAIN: Final = "paths.als"
"""The generated main file."""

MAX_ATOMS: Final = 400
"""Atoms up to which a path is looked for: each state of a trace costs as much as a command."""


def wanted(system: System, answers: Mapping[str, Answer]) -> tuple[int, ...]:
    """Return the indices of the claims about flows that are violated."""
    return tuple(
        number
        for number, claim in enumerate(system.claims)
        if claim.kind is ClaimKind.NO_FLOW and answers[claim.id].status is Status.VIOLATED
    )


def commands_of(numbers: Sequence[int]) -> tuple[Command, ...]:
    """Return the commands that ask for the paths of the claims of these indices."""
    return tuple(Command(kind="run", name=f"Path{number}") for number in numbers)


def write_paths(system: System, numbers: Sequence[int]) -> str:
    """Return the main file that asks for a path for each of the claims of these indices.

    A path visits at most every enclave, the outsider and, where it ends where it began, one of them again.
    """
    steps = len(system.enclaves) + 2
    lines = [
        "/** For each claim that is violated by a flow, a shortest one. */",
        "module paths",
        "open propagation",
        "",
        write_places(system, numbers),
    ]
    for number in numbers:
        at = Places.of(number)
        forgers, eavesdroppers = attackers(system.claims[number], at)
        places = f"{at.source}, {at.first}, {at.target}, {at.last}, {at.through}, Channel - {at.left_out}"
        lines.append(
            f"run Path{number} {{\n\twalk[{places}, {forgers}, {eavesdroppers}]\n}} for 0 but 1..{steps} steps"
        )
    return "\n".join(lines) + "\n"


def ends(path: Sequence[Hop]) -> tuple[Witness, ...]:
    """Return the witness that a path is: the enclaves where it begins and ends."""
    found = {Role.ENCLAVE: path[0].sender, Role.OTHER: path[-1].receiver}
    return ({role: enclave for role, enclave in found.items() if enclave is not None},)


def read_path(solutions: Path, number: int, system: System, moment: int) -> tuple[Hop, ...]:
    """Return the path of the claim of this index from the trace that the Analyzer left in `solutions`.

    `moment`: at which the data goes (`moments.later`).

    Raises EngineFailed if the trace is not there or names no known atoms.
    """
    name = f"Path{number}"
    trace = _Trace(name, system)
    hops: list[Hop] = []
    holder: int | None = None
    last: int | None = None
    out: int | None = None
    for state, instance in enumerate(read_instances(solutions / f"{name}-solution-0.xml", name)):
        before, holder = holder, trace.participant(instance)
        channel = trace.channel(instance, "over")
        if (state == 0 or (holder, channel) != (before, last)) and channel is not None:
            hops.append(Hop(sender=before, channel=channel, receiver=holder, instant=moment // 2))
        elif state > 0 and (holder, channel) != (before, last):
            raise trace.unreadable()
        last = channel
        out = trace.channel(instance, "out")
    if not hops and out is None:
        raise trace.unreadable()
    if out is not None:
        hops.append(Hop(sender=holder, channel=out, receiver=None, instant=moment // 2))
    return tuple(hops)


class _Trace:
    """Reads what the datum has, state by state."""

    def __init__(self, name: str, system: System) -> None:
        self._name = name
        self._sizes = {Role.ENCLAVE: len(system.enclaves), Role.CHANNEL: len(system.channels)}

    def participant(self, instance: etree._Element) -> int | None:
        """Who has the datum: an enclave, or None for the outsider."""
        held = self._field(instance, "holder")
        if len(held) != 1:
            raise self.unreadable()
        return None if held[0].rpartition("/")[2] == "Outsider$0" else self._index(held[0], Role.ENCLAVE)

    def channel(self, instance: etree._Element, field: str) -> int | None:
        """The channel in a field of the datum, if there is one."""
        found = self._field(instance, field)
        if len(found) > 1:
            raise self.unreadable()
        return self._index(found[0], Role.CHANNEL) if found else None

    def unreadable(self) -> EngineFailed:
        """The error that says so."""
        return EngineFailed(f"The Alloy Analyzer's trace of {self._name} cannot be followed.")

    def _field(self, instance: etree._Element, label: str) -> list[str]:
        fields = instance.findall(f"./field[@label='{label}']")
        if len(fields) != 1:
            raise self.unreadable()
        pairs = [[atom.get("label", "") for atom in found] for found in fields[0].findall("./tuple")]
        return [pair[-1] for pair in pairs]

    def _index(self, label: str, role: Role) -> int:
        index = index_of(label, role)
        if index is None or index >= self._sizes[role]:
            raise self.unreadable()
        return index
