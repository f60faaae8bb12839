"""What the Analyzer is asked about one system: a command for each question, and one for all that is expected to be so.

Each command costs a translation of the whole model. All facts are constant, so that there is one structure: where a
command has an instance that asks for many conditions at once, that is it, and each of them is true. So all conditions
that another engine expects to be true are asked together; of a flow that is expected each hop, since there is no
instance where there is no compartment, and to look for one in vain is the dearest question (measured at 100 enclaves
and 200 topics: 31 seconds of processor time against 17). Expectations decide what is asked together and nothing else:
where there is no such instance, each question is asked by a command of its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.atoms import Atoms, name_atoms
from keystore_audit.engine.alloy.claims import Places, attackers, pair_places
from keystore_audit.engine.alloy.facts import CONSISTENCY
from keystore_audit.engine.alloy.solution import Command
from keystore_audit.errors import EngineFailed
from keystore_audit.model.formal.attacker import realm_views
from keystore_audit.model.formal.claim import ClaimAtom, ClaimKind
from keystore_audit.model.formal.flow import Flows, Leg, search_of
from keystore_audit.model.formal.system import System
from keystore_audit.properties.property import Property, Role, Status

AS_EXPECTED: Final = Command(kind="run", name="AsExpected")
"""The command for all conditions that are expected to be true."""

OPPOSITE: Final = {Status.HOLDS: Status.VIOLATED, Status.VIOLATED: Status.HOLDS}

_ASSERTION: Final = re.compile(r"^assert (\w+) \{\n(.*?)^\}", re.MULTILINE | re.DOTALL)


class Question(Struct, frozen=True, kw_only=True):
    """One question. `id`: of the property or claim, empty for whether the facts are consistent at all.

    `condition`: what the command, whose `text` this is, runs or checks. `roles`: the variables of a check, whose values
    are its witness. `when_true`: what it means that the condition is true.
    """

    id: str
    command: Command
    text: str
    condition: str
    roles: Sequence[Role] = ()
    when_true: Status = Status.HOLDS


def questions(system: System, properties: Sequence[Property], assertions: str) -> Iterator[Question]:
    """Every question about a system. `assertions`: text of `properties.als`; EngineFailed if one is not there."""
    bodies = {match[1]: match[2].strip() for match in _ASSERTION.finditer(assertions)}
    consistent = Command(kind="run", name=CONSISTENCY)
    yield Question(id="", command=consistent, text=f"run {CONSISTENCY} for 0", condition=CONSISTENCY)
    for prop in properties:
        name = prop.assertion
        if name not in bodies:
            raise EngineFailed(f"This installation is damaged: properties.als has no assertion {name}.")
        asked = Command(kind="check", name=name)
        text, roles = f"check {name} for 0", prop.roles
        yield Question(id=prop.id, command=asked, text=text, condition=bodies[name], roles=roles)
    for number, claim in enumerate(system.claims):
        command = claims.command_of(claim, number)
        yield Question(
            id=claim.id,
            command=command,
            text=claims.text_of(claim, number),
            condition=claims.condition(claim, number),
            roles=claims.roles_of(claim),
            when_true=claims.status(claim, found=command.kind == "run"),
        )


def expected_true(system: System, asked: Sequence[Question], expected: Mapping[str, Status]) -> list[Question]:
    """Those whose conditions are true if all is as `expected`, by id; of a flow that is expected, that it is one."""
    together = [each for each in asked if not each.id or expected.get(each.id) is each.when_true]
    by_id = {each.id: each for each in asked}
    flowing = [
        number
        for number, claim in enumerate(system.claims)
        if claim.kind in claims.FLOWS and expected.get(claim.id) is OPPOSITE[by_id[claim.id].when_true]
    ]
    if flowing:
        for number, condition in known_flows(system, flowing).items():
            question = by_id[system.claims[number].id]
            together.append(replace(question, condition=condition, when_true=OPPOSITE[question.when_true]))
    return together


def main_file(system: System, together: Sequence[Question], alone: Sequence[Question]) -> tuple[str, list[Command]]:
    """The text of a main file, and its commands in their order."""
    places = claims.write_places(system, range(len(system.claims))) if system.claims else ""
    head = ["module audit", "open claims" if system.claims else "open vacuity", "", places]
    joint = ["run AsExpected {", *(f"\t({each.condition}\n\t)" for each in together), "} for 0"] if together else []
    commands = [*([AS_EXPECTED] if together else []), *(each.command for each in alone)]
    return "\n".join([*head, *joint, *(each.text for each in alone)]) + "\n", commands


def known_flows(system: System, numbers: Sequence[int]) -> dict[int, str]:
    """Return, for those claims of these indices whose places a flow joins, the condition that the flow is one.

    If the condition is true, the command of the claim (`claims.condition`) has no instance.
    """
    flows, atoms = Flows(system, realm_views(system)), name_atoms(system)
    found = {}
    for number in numbers:
        claim = system.claims[number]
        pairs = [(pair, flows.shortest(search_of(pair))) for pair in claim.each_pair()]
        if all(legs for _pair, legs in pairs):
            places = pair_places(claim, number) if claim.kind is ClaimKind.ABLE else [Places.of(number)]
            shown = (shown_flow(pair, at, atoms, legs or ()) for (pair, legs), at in zip(pairs, places, strict=True))
            found[number] = "\n\tand ".join(shown)
    return found


def shown_flow(claim: ClaimAtom, at: Places, atoms: Atoms, legs: Sequence[Leg]) -> str:
    """Return the condition that `legs` are a flow that violates a claim, or that keeps it if it is about what is able.

    It begins at the source, goes on over participants that may pass data on, and ends at the target.
    """
    own = claim.kind is ClaimKind.ABLE
    suffix, (forgers, eavesdroppers) = "_by_own" if own else "", attackers(claim, at)
    hears, powers = ("", "") if own else (f", {eavesdroppers}", f", {forgers}, {eavesdroppers}")

    def who(participant: int | None) -> str:
        return "Outsider" if participant is None else atoms.enclaves.name(participant)

    def conditions() -> Iterator[str]:
        if not claim.source.channels:
            yield f"some {who(legs[0].sender)} & {at.source}"
        for place, leg in enumerate(legs):
            channel = atoms.channels.name(leg.channel)
            if place == 0 and claim.source.channels:
                yield f"gets{suffix}[{who(leg.receiver)}, {channel} & {at.first}{hears}]"
            elif place == len(legs) - 1 and claim.target.channels:
                yield f"puts{suffix}[{who(leg.sender)}, {channel} & {at.last}{powers}]"
            else:
                yield f"no {channel} & {at.left_out}"
                yield f"hop{suffix}[{who(leg.sender)}, {channel}, {who(leg.receiver)}{powers}]"
        for leg in legs[:-1]:
            yield f"no {who(leg.receiver)} & ({at.through} - {at.source})"
        if not claim.target.channels:
            yield f"some {who(legs[-1].receiver)} & {at.target}"

    return "\n\tand ".join(conditions())
