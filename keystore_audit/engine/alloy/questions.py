"""What the Analyzer is asked about one system: commands, and which of them a joint command can stand for.

Each command costs a translation of the whole model, and each instance is written out in full. So what is expected to
have an instance is asked together, and so is what is expected to have none: two commands for everything. Where there
is an instance of all at once, each has one; where there is none of any, none has one. Expectations are the native
engine's answers. They decide what is asked together and nothing else: where a joint command is not answered as
expected, its members are asked one by one.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Final

from keystore_audit.dataclass import dataclass, field, replace
from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.atoms import name_atoms
from keystore_audit.engine.alloy.facts import CONSISTENCY, EXERCISED
from keystore_audit.engine.alloy.solution import Command
from keystore_audit.errors import EngineFailed
from keystore_audit.model.claim import ClaimKind
from keystore_audit.model.system import System
from keystore_audit.properties.property import Property, Role, Status

ALL_OCCUR: Final = Command(kind="run", name="AllOccur")
"""Stands for commands with an instance: its own holds one of each, with the witnesses of what is violated."""

ANY_OCCURS: Final = Command(kind="run", name="AnyOccurs")
"""Stands for commands without an instance: without one of its own none of them has one."""

_ASSERTION: Final = re.compile(r"^assert (\w+) \{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
_UNIVERSAL: Final = re.compile(r"all (.+?) \|\s+(.+)", re.DOTALL)
_LAST: Final = re.compile(r"(.+), (\w+): ([^:|]+)")
_EXCLUDED: Final = re.compile(r"(\w+) not in ([^|]+)")
_WORD: Final = re.compile(r"\w+", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """A command that stands for `members`: where it has an instance (or none: `outcome`), so have they.

    `witnessed`: of those members whose witness its instance holds, the roles, which there are called `member_role`.
    """

    command: Command
    text: str
    members: tuple[Command, ...]
    outcome: bool
    witnessed: Mapping[str, Sequence[Role]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Questions:
    """A main file: `text`, with `commands` in this order. `joints`: those of them that stand for others."""

    text: str
    commands: tuple[Command, ...]
    joints: tuple[Joint, ...]

    def answered(self, found: Mapping[str, bool]) -> tuple[dict[str, bool], tuple[Command, ...]]:
        """Return the outcome of each command and member of a joint one, and the members that have to be asked again."""
        outcomes = dict(found)
        open_: list[Command] = []
        for joint in self.joints:
            if outcomes.pop(joint.command.name) is joint.outcome:
                outcomes |= {member.name: joint.outcome for member in joint.members}
            else:
                open_ += joint.members
        return outcomes, tuple(open_)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Single:
    """A question by a command of its own: `text` of the command, `condition` that it runs or checks.

    `roles`: the variables of a check, whose values are its witness. `occurs`: whether an instance is expected.
    """

    command: Command
    text: str
    condition: str
    roles: Sequence[Role] = ()
    occurs: bool | None = None
    flow: bool = False


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
        """The file that asks together what is expected to have an instance, and together what is expected to have none.

        `expected`: by id of properties and claims.
        """
        singles = tuple(self._singles(expected))
        occur = [each for each in singles if each.occurs]
        none = [each for each in singles if each.occurs is False]
        return self._file(singles, (self._all_occur(occur), self._any_occurs(none)))

    def again(self, expected: Mapping[str, Status], only: Collection[Command]) -> Questions:
        """The file that asks about `only`, which were not answered as expected when they were asked together.

        Runs against vacuity are alone then, since their expectation is nobody's answer; with them out of the way the
        rest is perhaps as expected. Where they are not among `only`, everything is alone.
        """
        if not any(command.name in _VACUITY for command in only):
            return self.one_by_one(only)
        singles = [each for each in self._singles(expected) if each.command in only]
        occur = [each for each in singles if each.occurs and each.command.name not in _VACUITY]
        return self._file(singles, (self._all_occur(occur),))

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
            yield _Single(
                command=Command(kind="check", name=prop.assertion),
                text=f"check {prop.assertion} for 0",
                condition=self.condition(prop) if expected else "",
                roles=prop.roles,
                occurs=_OCCURS.get(expected.get(prop.id)),
            )
        if self._system.claims:
            yield _run(claims.FLOW_EXERCISED)
            places = " and ".join(f"({place})" for place in claims.inhabited_places(self._system.claims))
            yield replace(_run(claims.INHABITED), text=claims.inhabited(self._system.claims), condition=places)
        for number, claim in enumerate(self._system.claims):
            violation = _OCCURS.get(expected.get(claim.id))
            # The instance of a claim that nothing flows shows that it holds.
            turned = claim.kind is ClaimKind.NO_FLOW and violation is not None
            yield _Single(
                command=claims.command_of(claim, number),
                text=claims.text_of(claim, number),
                condition=claims.condition(claim, number),
                roles=claims.roles_of(claim),
                occurs=not violation if turned else violation,
                flow=claim.kind in claims.FLOWS,
            )

    def _all_occur(self, singles: Sequence[_Single]) -> Joint:
        conditions = [self._violation(each) if each.command.kind == "check" else each.condition for each in singles]
        return Joint(
            command=ALL_OCCUR,
            text=_joint(ALL_OCCUR, conditions),
            members=tuple(each.command for each in singles),
            outcome=True,
            witnessed={each.command.name: each.roles for each in singles if each.roles},
        )

    def _any_occurs(self, singles: Sequence[_Single]) -> Joint:
        """One set of participants for all flows: the Analyzer looks for one only where no disjunction is around it."""
        held = [without_last(each.condition) for each in singles if not each.flow]
        flows = [each.condition.removeprefix(claims.SOME_INSIDE) for each in singles if each.flow]
        alternatives = [*(["not {\n\t" + "\n\t".join(f"({each})" for each in held) + "\n\t}"] if held else []), *flows]
        condition = "\n\tor ".join(alternatives)
        return Joint(
            command=ANY_OCCURS,
            text=_joint(ANY_OCCURS, [f"{claims.SOME_INSIDE}\n\t{condition}" if flows else condition]),
            members=tuple(each.command for each in singles),
            outcome=False,
        )

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

_EACH_REALM: Final = "realm: Realm, "


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
