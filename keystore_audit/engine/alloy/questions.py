"""What the Analyzer is asked about one system: commands, and which of them one joint command can stand for.

Each command costs a translation of the whole model, so that asking twenty properties one by one costs ten times what
one conjunction of them does. So what is expected to hold is asked together: a conjunction without counterexample proves
each of its members. Expectations are the native engine's answers. They decide what is asked together and nothing else:
where a joint command is not answered as expected, its members are asked one by one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.facts import CONSISTENCY, EXERCISED
from keystore_audit.engine.alloy.solution import Command
from keystore_audit.errors import EngineFailed
from keystore_audit.model.claim import ClaimKind
from keystore_audit.model.system import System
from keystore_audit.properties.property import Property, Status

NOTHING_IS_VACUOUS: Final = Command(kind="run", name="NothingIsVacuous")
"""Stands for the runs against vacuity: its instance is one of each."""

ALL_HOLD: Final = Command(kind="check", name="AllHold")
"""Stands for checks: without a counterexample none of them has one."""

ALL_ARE_SEPARATED: Final = Command(kind="run", name="AllAreSeparated")
"""Stands for the runs of claims that nothing flows: an instance holds a compartment for each."""

_ASSERTION: Final = re.compile(r"^assert (\w+) \{\n(.*?)^\}", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """A command that stands for `members`: where it has an instance (or none: `outcome`), so have they."""

    command: Command
    text: str
    members: tuple[Command, ...]
    outcome: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Questions:
    """A main file: `text`, with `commands` in this order. `joints`: those of them that stand for others."""

    text: str
    commands: tuple[Command, ...]
    joints: tuple[Joint, ...]

    def answered(self, found: Mapping[str, bool]) -> tuple[dict[str, bool], tuple[Command, ...]]:
        """Return the outcome of each command and member of a joint one, and the members that have to be asked alone."""
        outcomes = dict(found)
        open_: list[Command] = []
        for joint in self.joints:
            if outcomes.pop(joint.command.name) is joint.outcome:
                outcomes |= {member.name: joint.outcome for member in joint.members}
            else:
                open_ += joint.members
        return outcomes, tuple(open_)


class Sheet:
    """Writes main files about one system.

    `properties`: those that are asked about; all claims of the system are. `assertions`: text of `properties.als`.
    """

    def __init__(self, system: System, properties: Sequence[Property], assertions: str) -> None:
        self._system = system
        self._properties = properties
        self._assertions = assertions

    def one_by_one(self, only: Iterable[Command] | None = None) -> Questions:
        """The file that asks each question by a command of its own. `only`: of all questions these."""
        chosen = None if only is None else set(only)
        texts = {command: text for command, text in self._singles() if chosen is None or command in chosen}
        return self._file(tuple(texts), texts.values(), ())

    def together(self, expected: Mapping[str, Status]) -> Questions:
        """The file that asks together what is expected to hold. `expected`: by id of properties and claims."""
        joints = tuple(joint for joint in self._joints(expected) if joint.members)
        members = {member for joint in joints for member in joint.members}
        alone = {command: text for command, text in self._singles() if command not in members}
        commands = (*(joint.command for joint in joints), *alone)
        return self._file(commands, (*(joint.text for joint in joints), *alone.values()), joints)

    def _file(self, commands: tuple[Command, ...], texts: Iterable[str], joints: tuple[Joint, ...]) -> Questions:
        opened = "claims" if self._system.claims else "vacuity"
        places = claims.write_places(self._system, range(len(self._system.claims))) if self._system.claims else ""
        text = "\n".join(["module audit", f"open {opened}", "", places, *texts]) + "\n"
        return Questions(text=text, commands=commands, joints=joints)

    def _singles(self) -> Iterator[tuple[Command, str]]:
        """Every command with its text, in the order of answers."""
        system = self._system
        for name in (CONSISTENCY, *EXERCISED.values()):
            yield Command(kind="run", name=name), f"run {name} for 0"
        for prop in self._properties:
            yield Command(kind="check", name=prop.assertion), f"check {prop.assertion} for 0"
        if system.claims:
            yield Command(kind="run", name=claims.FLOW_EXERCISED), f"run {claims.FLOW_EXERCISED} for 0"
            yield Command(kind="run", name=claims.INHABITED), claims.inhabited(system.claims)
        for number, claim in enumerate(system.claims):
            yield claims.command_of(claim, number), claims.text_of(claim, number)

    def _joints(self, expected: Mapping[str, Status]) -> Iterator[Joint]:
        system = self._system
        runs = [CONSISTENCY, *EXERCISED.values(), *(claims.EXERCISED.values() if system.claims else ())]
        holding = [name for name in runs if name != claims.INHABITED]
        if system.claims:
            holding += claims.inhabited_places(system.claims)
        yield Joint(
            command=NOTHING_IS_VACUOUS,
            text=_joint(NOTHING_IS_VACUOUS, holding),
            members=tuple(Command(kind="run", name=name) for name in runs),
            outcome=True,
        )
        held = [prop for prop in self._properties if expected.get(prop.id) is Status.HOLDS]
        claimed = [n for n, claim in enumerate(system.claims) if expected.get(claim.id) is Status.HOLDS]
        flows = [n for n in claimed if system.claims[n].kind is ClaimKind.NO_FLOW]
        # The Analyzer finds a set of participants only where no disjunction stands around it: "able" is asked alone.
        others = [n for n in claimed if system.claims[n].kind not in claims.FLOWS]
        bodies = self._bodies() if held else {}
        conditions = [self._body(bodies, prop) for prop in held]
        conditions += [claims.condition(system.claims[n], n) for n in others]
        yield Joint(
            command=ALL_HOLD,
            text=_joint(ALL_HOLD, conditions),
            members=(
                *(Command(kind="check", name=prop.assertion) for prop in held),
                *(claims.command_of(system.claims[n], n) for n in others),
            ),
            outcome=False,
        )
        yield Joint(
            command=ALL_ARE_SEPARATED,
            text=_joint(ALL_ARE_SEPARATED, [claims.condition(system.claims[n], n) for n in flows]),
            members=tuple(claims.command_of(system.claims[n], n) for n in flows),
            outcome=True,
        )

    def _bodies(self) -> dict[str, str]:
        return {match[1]: match[2].strip() for match in _ASSERTION.finditer(self._assertions)}

    @staticmethod
    def _body(bodies: Mapping[str, str], prop: Property) -> str:
        if prop.assertion not in bodies:
            raise EngineFailed(f"This installation is damaged: properties.als has no assertion {prop.assertion}.")
        return bodies[prop.assertion]


def _joint(command: Command, conditions: Iterable[str]) -> str:
    """A command that asks for all of the conditions at once."""
    return "\n".join([f"{command.kind} {command.name} {{", *(f"\t({each}\n\t)" for each in conditions), "} for 0"])
