"""What behaviours rest on, decided again by Alloy from the facts of the keystore (alloy/forwarding.als)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from keystore_audit.engine.alloy.atoms import Sort, name_atoms
from keystore_audit.engine.alloy.claims import MODULES as CLAIM_MODULES
from keystore_audit.engine.alloy.facts import MODULES, fact_modules
from keystore_audit.engine.alloy.process import Job
from keystore_audit.engine.alloy.relations import Relations
from keystore_audit.engine.alloy.runner import count_atoms, module_texts
from keystore_audit.engine.alloy.solution import Command
from keystore_audit.errors import EngineOutOfScale
from keystore_audit.model.formal.behaviour import Meeting, Passage, Spread
from keystore_audit.model.formal.system import System

MODULE: Final = "forwarding.als"
"""The hand-written module."""

MAIN: Final = "wiring.als"
"""The generated main file."""

CONFIRMED: Final = "BehaviourIsOfThisKeystore"
"""The check that confirms it."""


MAX_ATOMS: Final = 3_000
"""Atoms up to which the Analyzer is asked: the keystore is not merged here, and takes some 20 s then."""


def wiring_job(system: System) -> Job:
    """The process that confirms what the claims of determinism of `system` rest on.

    Raises EngineOutOfScale where the system is too large.
    """
    atoms = count_atoms(system)
    if atoms > MAX_ATOMS:
        raise EngineOutOfScale(
            f"The model of this keystore has {atoms} atoms; what forwards rest on is confirmed for up to {MAX_ATOMS}."
        )
    modules = module_texts((*MODULES, CLAIM_MODULES[0], MODULE))
    return Job(
        files={**modules, **fact_modules(system), MAIN: write_wiring(system)},
        main=MAIN,
        commands=(Command(kind="check", name=CONFIRMED),),
        atoms=atoms,
    )


def write_wiring(system: System) -> str:
    """Return the main file: what is said of `system`, and the check that Alloy says the same."""
    writer = _Writer(system)
    meetings = dict.fromkeys(meeting for claim in system.determinism for meeting in claim.meetings)
    spreads = dict.fromkeys(claim.spread for claim in system.determinism if claim.spread is not None)
    said = [writer.meeting(number, meeting) for number, meeting in enumerate(meetings)]
    said += [writer.spread(number, spread) for number, spread in enumerate(spreads)]
    head = ["/** Who hands samples to whom, as the other engine has it. */", "module wiring", "open forwarding", ""]
    check = [f"check {CONFIRMED} {{", *(f"\t{each}" for each in said), "} for 0"]
    return "\n".join([*head, *writer.functions(), "", *check]) + "\n"


class _Writer:
    """Writes sets as functions, whose declared types the Analyzer parses fast."""

    def __init__(self, system: System) -> None:
        self._atoms = name_atoms(system)
        self._relations = Relations()
        self._lines: list[str] = []

    def functions(self) -> Iterator[str]:
        """The functions that were needed."""
        yield from self._relations.take_private()
        yield from self._lines

    def meeting(self, number: int, meeting: Meeting) -> str:
        """The condition that the senders are these."""
        put = self._channels(f"put_{number}", meeting.put)
        among = self._enclaves(f"candidates_{number}", meeting.candidates)
        senders = self._enclaves(f"senders_{number}", meeting.senders)
        if meeting.receiver is None:
            return f"{among} & publishers[{put}] = {senders}"
        got = self._channels(f"got_{number}", meeting.got)
        return f"{among} & senders[{put}, {self._atoms.enclaves.name(meeting.receiver)}, {got}] = {senders}"

    def spread(self, number: int, spread: Spread) -> str:
        """The condition that nothing high comes any further."""
        inside = self._enclaves(f"inside_{number}", spread.inside)
        declared = self._enclaves(f"declared_{number}", spread.declared)
        first = self._channels(f"first_{number}", spread.first)
        left_out = self._channels(f"left_out_{number}", spread.left_out)
        passed = self._passages(f"passed_{number}", spread.passages, reached=True)
        closed = self._passages(f"closed_{number}", spread.passages, reached=False)
        return f"contained[{inside}, {declared}, {passed}, {closed}, {first}, Channel - {left_out}]"

    def _passages(self, name: str, passages: Iterable[Passage], *, reached: bool) -> str:
        """What the forwards that are reached put, or what those that are not take."""
        rows: list[set[int]] = [set() for _enclave in self._atoms.enclaves.atoms]
        for each in passages:
            if each.reached == reached:
                rows[each.enclave] |= each.targets if reached else each.sources
        written = self._relations.rows(self._atoms.enclaves, self._atoms.channels, rows)
        self._lines.append(self._relations.relation(name, "Enclave -> Channel", written))
        return name

    def _channels(self, name: str, members: frozenset[int]) -> str:
        return self._set(name, self._atoms.channels, members)

    def _enclaves(self, name: str, members: frozenset[int]) -> str:
        return self._set(name, self._atoms.enclaves, members)

    def _set(self, name: str, sort: Sort, members: frozenset[int]) -> str:
        self._lines.append(self._relations.subset(name, sort, members))
        return name
