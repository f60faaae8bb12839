"""What the Analyzer is asked about one system: commands, and which of them a joint command can stand for.

Each command costs a translation of the whole model, and each instance is written out in full. So everything is asked by
one command: for an instance of each question that is expected to have one, beside which each condition is true that is
expected to have no counterexample. All facts are constant, so that there is one structure: where the command has an
instance, that is it, and what it says of each question is the answer to each. Of a flow that is expected each hop is
asked (`known_flows`), since there is no instance where there is no compartment. Expectations are the native engine's
answers. They decide what is asked together and nothing else: where the joint command has no instance, its members are
asked one by one.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct, field
from msgspec.structs import replace

from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.atoms import name_atoms
from keystore_audit.engine.alloy.facts import CONSISTENCY, EXERCISED
from keystore_audit.engine.alloy.solution import Command
from keystore_audit.errors import EngineFailed
from keystore_audit.model.formal.claim import ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties.property import Property, Role, Status

AS_EXPECTED: Final = Command(kind="run", name="AsExpected")
"""Stands for commands of which it is expected whether they have an instance: where it has one, so it is.

Its instance holds the witnesses of what is violated.
"""

_ASSERTION: Final = re.compile(r"^assert (\w+) \{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
_UNIVERSAL: Final = re.compile(r"all (.+?) \|\s+(.+)", re.DOTALL)
_LAST: Final = re.compile(r"(.+), (\w+): ([^:|]+)")
_EXCLUDED: Final = re.compile(r"(\w+) not in ([^|]+)")
_WORD: Final = re.compile(r"\w+", re.ASCII)


class Joint(Struct, frozen=True, kw_only=True):
    """A command that stands for `members`: where it has an instance, each of them has one or has none, as said there.

    `witnessed`: of those members whose witness its instance holds, the roles, which there are called `member_role`.
    """

    command: Command
    text: str
    members: Mapping[Command, bool]
    witnessed: Mapping[str, Sequence[Role]] = field(default_factory=dict)


class Questions(Struct, frozen=True, kw_only=True):
    """A main file: `text`, with `commands` in this order. `joints`: those of them that stand for others."""

    text: str
    commands: tuple[Command, ...]
    joints: tuple[Joint, ...]

    def answered(self, found: Mapping[str, bool]) -> tuple[dict[str, bool], tuple[Command, ...]]:
        """Return the outcome of each command and member of a joint one, and the members that have to be asked again."""
        outcomes = dict(found)
        open_: list[Command] = []
        for joint in self.joints:
            if outcomes.pop(joint.command.name):
                outcomes |= {member.name: outcome for member, outcome in joint.members.items()}
            else:
                open_ += joint.members
        return outcomes, tuple(open_)


class _Single(Struct, frozen=True, kw_only=True):
    """A question by a command of its own: `text` of the command, `condition` that it runs or checks.

    `roles`: the variables of a check, whose values are its witness. `occurs`: whether an instance is expected; where
    none is, `otherwise` is what must be true then, empty if that is not known.
    """

    command: Command
    text: str
    condition: str
    roles: Sequence[Role] = ()
    occurs: bool | None = None
    otherwise: str = ""


class Sheet:
    """Writes main files about one system.

    `properties`: those that are asked about; all claims of the system are. `assertions`: text of `properties.als`.
    """

    def __init__(self, system: System, properties: Sequence[Property], assertions: str) -> None:
        self._system = system
        self._properties = properties
        self._bodies = {match[1]: match[2].strip() for match in _ASSERTION.finditer(assertions)}
        self._realm = name_atoms(system).realms.name(0) if len(system.realms) == 1 else None

    def one_by_one(self, only: Iterable[Command] | None = None) -> Questions:
        """The file that asks each question by a command of its own. `only`: of all questions these."""
        chosen = None if only is None else set(only)
        singles = [each for each in self._singles({}) if chosen is None or each.command in chosen]
        return self._file(singles, ())

    def together(self, expected: Mapping[str, Status]) -> Questions:
        """The file that asks together everything of which something is expected.

        `expected`: by id of properties and claims.
        """
        singles = tuple(self._singles(expected))
        return self._file(singles, (self._as_expected(singles),))

    def again(self, expected: Mapping[str, Status], only: Collection[Command]) -> Questions:
        """The file that asks about `only`, which were not answered as expected when they were asked together.

        Runs against vacuity are alone then, since their expectation is nobody's answer; with them out of the way the
        rest is perhaps as expected. Where they are not among `only`, everything is alone.
        """
        if not any(command.name in _VACUITY for command in only):
            return self.one_by_one(only)
        singles = [each for each in self._singles(expected) if each.command in only]
        rest = [each for each in singles if each.command.name not in _VACUITY]
        return self._file(singles, (self._as_expected(rest),))

    def condition(self, prop: Property) -> str:
        """Return what a property asserts. Raises EngineFailed if its assertion is not there."""
        if prop.assertion not in self._bodies:
            raise EngineFailed(f"This installation is damaged: properties.als has no assertion {prop.assertion}.")
        return self._bodies[prop.assertion]

    def _file(self, singles: Iterable[_Single], joints: Iterable[Joint]) -> Questions:
        opened = "claims" if self._system.claims else "vacuity"
        places = claims.write_places(self._system, range(len(self._system.claims))) if self._system.claims else ""
        joints = tuple(joint for joint in joints if joint.members)
        members = {member for joint in joints for member in joint.members}
        alone = {each.command: each.text for each in singles if each.command not in members}
        texts = (*(joint.text for joint in joints), *alone.values())
        return Questions(
            text="\n".join(["module audit", f"open {opened}", "", places, *texts]) + "\n",
            commands=(*(joint.command for joint in joints), *alone),
            joints=joints,
        )

    def _singles(self, expected: Mapping[str, Status]) -> Iterator[_Single]:
        """Every question, in the order of answers."""
        for name in (CONSISTENCY, *EXERCISED.values()):
            yield _run(name)
        for prop in self._properties:
            condition = self.condition(prop) if expected else ""
            yield _Single(
                command=Command(kind="check", name=prop.assertion),
                text=f"check {prop.assertion} for 0",
                condition=condition,
                roles=prop.roles,
                occurs=_OCCURS.get(expected.get(prop.id)),
                otherwise=without_last(condition),
            )
        if self._system.claims:
            yield _run(claims.FLOW_EXERCISED)
            places = " and ".join(f"({place})" for place in claims.inhabited_places(self._system.claims))
            yield replace(_run(claims.INHABITED), text=claims.inhabited(self._system.claims), condition=places)
        violated = [_OCCURS.get(expected.get(claim.id)) for claim in self._system.claims]
        flowing = [
            number
            for number, claim in enumerate(self._system.claims)
            if claim.kind in claims.FLOWS and violated[number] is (claim.kind is ClaimKind.NO_FLOW)
        ]
        flows = self._known_flows(flowing)
        for number, claim in enumerate(self._system.claims):
            condition = claims.condition(claim, number)
            # The instance of a claim that nothing flows shows that it holds.
            turned = claim.kind is ClaimKind.NO_FLOW and violated[number] is not None
            yield _Single(
                command=claims.command_of(claim, number),
                text=claims.text_of(claim, number),
                condition=condition,
                roles=claims.roles_of(claim),
                occurs=not violated[number] if turned else violated[number],
                otherwise=flows.get(number, "") if claim.kind in claims.FLOWS else without_last(condition),
            )

    def _known_flows(self, numbers: Sequence[int]) -> Mapping[int, str]:
        if not numbers:
            return {}
        from keystore_audit.engine.alloy.known_flows import known_flows  # most audits have none

        return known_flows(self._system, numbers)

    def _as_expected(self, singles: Iterable[_Single]) -> Joint:
        """The command for those of whom it is known how to ask for what is expected."""
        asked = [each for each in singles if each.occurs or (each.occurs is False and each.otherwise)]
        return Joint(
            command=AS_EXPECTED,
            text=_joint(AS_EXPECTED, map(self._expected, asked)),
            members={each.command: bool(each.occurs) for each in asked},
            witnessed={each.command.name: each.roles for each in asked if each.occurs and each.roles},
        )

    def _expected(self, single: _Single) -> str:
        if not single.occurs:
            return single.otherwise
        return self._violation(single) if single.command.kind == "check" else single.condition

    def _violation(self, single: _Single) -> str:
        """The negation of a check's condition, with variables called by its name too.

        Where there is one realm only, it is called by its name: a variable for it would make everything vary.
        """
        match = _UNIVERSAL.fullmatch(single.condition)
        if match is None:
            raise EngineFailed(f"This installation is damaged: {single.command.name} is not about all of something.")
        declared, body = match.groups()
        called = {role.value: f"{single.command.name}_{role.value}" for role in single.roles}
        if self._realm is not None and declared.startswith(_EACH_REALM):
            declared = declared.removeprefix(_EACH_REALM)
            called[Role.REALM.value] = self._realm

        def renamed(text: str) -> str:
            return _WORD.sub(lambda word: called.get(word[0], word[0]), text)

        return f"some {renamed(declared)} |\n\t\tnot ({renamed(body)})"


_VACUITY: Final = frozenset({CONSISTENCY, *EXERCISED.values(), *claims.EXERCISED.values()})

_OCCURS: Final[Mapping[Status | None, bool]] = {Status.VIOLATED: True, Status.HOLDS: False}
"""Whether a check has an instance, a counterexample."""

_EACH_REALM: Final = "realm: of_enclaves, "


def _run(name: str) -> _Single:
    """The run against vacuity of this name, which everybody expects to have an instance."""
    return _Single(command=Command(kind="run", name=name), text=f"run {name} for 0", condition=name, occurs=True)


def without_last(condition: str) -> str:
    """The same condition without its last variable, where it says that no `v` of some set is in another one.

    So sets are compared at once, where there is no witness to look for.
    """
    universal = _UNIVERSAL.fullmatch(condition)
    if universal is None:
        return condition
    declared, excluded = _LAST.fullmatch(universal[1]), _EXCLUDED.fullmatch(universal[2])
    if declared is None or excluded is None or declared[2] != excluded[1] or declared[2] in _WORD.findall(excluded[2]):
        return condition
    before, _variable, among = declared.groups()
    last = before.rpartition(", ")[2]
    if _WORD.fullmatch(last):  # of one type with the last variable
        before = f"{before}: {among}"
    elif ":" not in last:
        return condition
    return f"all {before} | no ({excluded[2].strip()}) & ({among})"


def _joint(command: Command, conditions: Iterable[str]) -> str:
    """A command that asks for all of the conditions at once."""
    return "\n".join([f"{command.kind} {command.name} {{", *(f"\t({each}\n\t)" for each in conditions), "} for 0"])
