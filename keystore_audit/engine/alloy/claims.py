"""The claims of a system as Alloy: their places as functions, and a command each.

A claim is called by its index, `Claim0`: what its author wrote stands in comments only. Claims about flows are runs
that look for a compartment (alloy/information_flow.als), so that "no flow" is said on the strength of an instance.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit import text
from keystore_audit.engine.alloy.answers import Command
from keystore_audit.engine.alloy.atoms import Relations, function, name_atoms
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.system import System
from keystore_audit.properties.result import Role, Status

MODULES: Final = ("information_flow.als", "claims.als")
"""The hand-written modules that claims need, after those of the properties; each opens the one before."""

FLOWS: Final = frozenset({ClaimKind.NO_FLOW, ClaimKind.ABLE})
"""Kinds whose command is a run that looks for a compartment."""

FLOW_EXERCISED: Final = "FlowIsExercised"
"""The run that shows that data can flow by right at all."""

INHABITED: Final = "PlacesAreInhabited"
"""The run that shows that there is something at each place of each claim. In MUST a place may be empty, where its
enclaves are left out; MAY decides then."""

PARTICIPANTS: Final = "set Enclave + Outsider"

SOME_INSIDE: Final = f"some inside: {PARTICIPANTS} |"
"""How the condition of a claim about flows begins: with the compartment that is looked for."""

_OR: Final = "\n\t\tor "

_ROLES: Final = {
    (ClaimKind.ONLY_PUBLISH, None): (Role.TRUST_DOMAIN, Role.PUBLISHER, Role.CHANNEL),
    (ClaimKind.ENCRYPTED, Attacker.OUTSIDER): (Role.TRUST_DOMAIN, Role.CHANNEL),
    (ClaimKind.ENCRYPTED, Attacker.INSIDER): (Role.TRUST_DOMAIN, Role.INSIDER, Role.CHANNEL),
    (ClaimKind.SEPARATE_DOMAINS, None): (Role.TRUST_DOMAIN, Role.ENCLAVE, Role.OTHER, Role.DOMAIN),
}
"""The variables of a check; of `encrypted` by attacker."""


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


def check(predicate: str) -> str:
    """The command that looks for a counterexample to a predicate."""
    return f"check {predicate} {{ {predicate} }} for 0"


def question(claim: ClaimAtom, number: int) -> Question:
    """Return what is asked about the claim of this index.

    A compartment shows that nothing flows, a counterexample to a check that the claim is violated.
    """
    command = Command(kind="run" if claim.kind in FLOWS else "check", name=f"Claim{number}")
    asked = _condition(claim, number)
    attacker = claim.attacker if claim.kind is ClaimKind.ENCRYPTED else None
    return Question(
        id=claim.id,
        command=command,
        text=f"{command.kind} {command.name} {{\n\t{asked}\n}} for 0",
        condition=asked,
        roles=_ROLES.get((claim.kind, attacker), ()),
        when_true=Status.VIOLATED if claim.kind is ClaimKind.ABLE else Status.HOLDS,
    )


def write_claims(system: System) -> str:
    """Return the part of a main file that asks about the claims of `system`: places, then commands."""
    if not system.claims:
        return ""
    numbered = range(len(system.claims))
    inhabited = []
    for number, claim in enumerate(system.claims):
        if claim.kind in FLOWS or claim.kind is ClaimKind.SEPARATE_DOMAINS:
            inhabited.append(f"\tsome source_{number} + first_{number}")
        inhabited.append(f"\tsome target_{number} + last_{number}")
    lines = ["-- claims", "", write_places(system, numbered), f"run {FLOW_EXERCISED} for 0"]
    lines += [f"run {INHABITED} {{", *inhabited, "} for 0", ""]
    return "\n".join([*lines, *(question(system.claims[number], number).text for number in numbered)]) + "\n"


def write_places(system: System, numbers: Iterable[int]) -> str:
    """Return the functions for the places of the claims of these indices, after a comment that says which each is."""
    atoms, relations = name_atoms(system), Relations()
    enclaves, channels = atoms["enclaves"], atoms["channels"]
    lines = []
    for number in numbers:
        claim = system.claims[number]
        said = f"{claim.kind.value} ({claim.attacker.value}), {claim.id}: {claim.location}"
        lines.append(f"-- Claim{number}: {text.alloy_comment(said)}")
        parts = ((f"part_{number}_{n}", f"part_channels_{number}_{n}", each) for each, n in _parts(claim).items())
        ends = (
            (f"source_{number}", f"first_{number}", claim.source),
            (f"target_{number}", f"last_{number}", claim.target),
        )
        for name, topics, place in (*ends, *parts):
            members = relations.atoms(enclaves, place.enclaves)
            if place.outsider:
                members = f"{members} + Outsider" if place.enclaves else "Outsider"
            lines += [function(name, PARTICIPANTS, members), relations.subset(topics, channels, place.channels)]
        lines.append(relations.subset(f"through_{number}", enclaves, claim.through))
        lines.append(relations.subset(f"left_out_{number}", channels, claim.left_out))
        if claim.source.certificates:
            name, certificates = f"certificates_{number}", claim.source.certificates
            lines.append(relations.subset(name, atoms["certificates"], certificates))
        if claim.starts:
            rows: list[set[int]] = [set() for _ in enclaves.atoms]
            for enclave, domain in claim.starts:
                rows[enclave].add(domain)
            related = relations.rows(enclaves, atoms["domains"], rows)
            lines.append(relations.relation(f"starts_{number}", "Enclave -> Domain", related))
        lines.append("")
    return "\n".join([*relations.take_private(), *lines])


def _parts(claim: ClaimAtom) -> dict[Place, int]:
    """The places of its pairs; who may not be passed is no place either."""
    places = dict.fromkeys(place for pair in claim.each_pair() for place in (pair.source, pair.target))
    return {place: number for number, place in enumerate(places)} if claim.pairs else {}


def flow(claim: ClaimAtom, number: int, honest: str = "none, Outsider") -> str:
    """Return the arguments that say what flows a claim is about: from where to where, past whom, over what, by whom.

    The last two are who forges and who eavesdrops; `honest`: where the claim names no attacker. Nothing keeps the
    outsider from listening.
    """
    attackers = {
        Attacker.RELAYS: "Enclave + Outsider, Enclave + Outsider",
        Attacker.SOURCE: f"source_{number}, Outsider",
    }
    ends = f"source_{number}, first_{number}, target_{number}, last_{number}"
    return f"{ends}, {_way(number)}, {attackers.get(claim.attacker, honest)}"


def _way(number: int) -> str:
    return f"through_{number}, Channel - left_out_{number}"


def compartment(claim: ClaimAtom, number: int, inside: str) -> str:
    """Return the condition that the participants `inside` are a compartment, for a claim about flows.

    Of what must be possible between several pairs of places, one that cuts off some pair.
    """
    if claim.kind is not ClaimKind.ABLE:
        return f"separated[{inside}, {flow(claim, number)}]"
    parts = _parts(claim)
    between = [
        ", ".join(
            f"part_{number}_{parts[end]}, part_channels_{number}_{parts[end]}" for end in (pair.source, pair.target)
        )
        for pair in (claim.each_pair() if claim.pairs else ())
    ] or [f"source_{number}, first_{number}, target_{number}, last_{number}"]
    found = [f"cut_off[{inside}, {ends}, {_way(number)}]" for ends in between]
    return found[0] if len(found) == 1 else f"({_OR.join(found)})"


def _condition(claim: ClaimAtom, number: int) -> str:
    """What the command of the claim of this index runs or checks."""
    if claim.kind in FLOWS:
        return f"{SOME_INSIDE} {compartment(claim, number, 'inside')}"
    if claim.kind is ClaimKind.SEPARATE_DOMAINS:
        who = f"enclave: Enclave & source_{number}, other: Enclave & target_{number}, domain: Domain"
        somewhere = f"(enters_somewhere + starts_{number})" if claim.starts else "enters_somewhere"
        there = f"enclave.{somewhere} & other.{somewhere}"
        entered = "(enclave + other).(enters[trust_domain])"
        return f"all trust_domain: TrustDomain, {who} |\n\t\tdomain not in {there} & {entered}"
    channel = f"channel: last_{number} | channel not in"
    if claim.kind is ClaimKind.ONLY_PUBLISH:
        permitted = f"source_{number}"
        permitted = f"({permitted} + certificates_{number})" if claim.source.certificates else permitted
        who = f"publisher: Enclave + Certificate + Outsider - {permitted}"
        return f"all trust_domain: TrustDomain, {who}, {channel} publisher.(publishes[trust_domain])"
    if claim.attacker is Attacker.INSIDER:
        who = "insider: insiders + Certificate + Outsider"
        return f"all trust_domain: TrustDomain, {who}, {channel} insider.(listens_in[trust_domain])"
    return f"all trust_domain: TrustDomain, {channel} trust_domain.in_clear"
