"""The claims of a system as Alloy: their places as functions, and a command each.

A claim is called by its index, `Claim0`: what its author wrote stands in comments only. Claims about flows are runs
that look for a compartment (alloy/information_flow.als), so that "no flow" is said on the strength of an instance.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit import text
from keystore_audit.engine.alloy.atoms import Relations, function, name_atoms
from keystore_audit.engine.alloy.process import Command
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


class Places(Struct, frozen=True, kw_only=True):
    """The functions of one claim, by name, as they are used in commands."""

    source: str
    first: str
    target: str
    last: str
    through: str
    left_out: str
    starts: str
    certificates: str

    @classmethod
    def of(cls, number: int) -> Places:
        """The names for the claim of this index."""
        return cls(**{name: f"{name}_{number}" for name in cls.__struct_fields__})


def pair_places(claim: ClaimAtom, number: int) -> list[Places]:
    """Return the places of each pair of a claim of ability; those of the claim where it names no pairs."""
    at = Places.of(number)
    if not claim.pairs:
        return [at]
    parts = {part: place for place, part in enumerate(_parts(claim))}
    found = []
    for one, other in claim.pairs:
        here, there = parts[one], parts[other]
        found.append(
            replace(
                at,
                source=f"part_{number}_{here}",
                first=f"part_channels_{number}_{here}",
                target=f"part_{number}_{there}",
                last=f"part_channels_{number}_{there}",
            )
        )
    return found


def _parts(claim: ClaimAtom) -> list[Place]:
    return list(dict.fromkeys(place for pair in claim.pairs for place in pair))


def command_of(claim: ClaimAtom, number: int) -> Command:
    """Return the command that decides the claim of this index."""
    return Command(kind="run" if claim.kind in FLOWS else "check", name=f"Claim{number}")


def status(claim: ClaimAtom, found: bool) -> Status:
    """Return the answer, by whether the command of `claim` has an instance.

    A compartment shows that nothing flows, a counterexample to a check that the claim is violated.
    """
    holds = found if claim.kind is ClaimKind.NO_FLOW else not found
    return Status.HOLDS if holds else Status.VIOLATED


def roles_of(claim: ClaimAtom) -> tuple[Role, ...]:
    """Return the variables of the check of `claim`; none where it is a run."""
    attacker = claim.attacker if claim.kind is ClaimKind.ENCRYPTED else None
    return _ROLES.get((claim.kind, attacker), ())


def write_claims(system: System) -> str:
    """Return the part of a main file that asks about the claims of `system`: places, then commands."""
    if not system.claims:
        return ""
    numbers = range(len(system.claims))
    lines = [write_places(system, numbers), f"run {FLOW_EXERCISED} for 0", inhabited(system.claims), ""]
    return "\n".join(["-- claims", "", *lines, *(text_of(system.claims[number], number) for number in numbers)]) + "\n"


def write_places(system: System, numbers: Iterable[int]) -> str:
    """Return the functions for the places of the claims of these indices."""
    writer = _Writer(system)
    places = [line for number in numbers for line in writer.places(system.claims[number], number)]
    return "\n".join([*writer.relations.take_private(), *places])


def text_of(claim: ClaimAtom, number: int) -> str:
    """Return the text of the command that decides the claim of this index."""
    return f"{command_of(claim, number).kind} Claim{number} {{\n\t{condition(claim, number)}\n}} for 0"


def attackers(claim: ClaimAtom, places: Places) -> tuple[str, str]:
    """Return who forges and who eavesdrops in the flows of `claim`. Nothing keeps the outsider from listening."""
    if claim.attacker is Attacker.RELAYS:
        return "Enclave + Outsider", "Enclave + Outsider"
    return (places.source if claim.attacker is Attacker.SOURCE else "none"), "Outsider"


def compartment(claim: ClaimAtom, number: int, inside: str) -> str:
    """Return the condition that the participants `inside` are a compartment, for a claim about flows.

    Of what must be possible between several pairs of places, one that cuts off some pair.
    """
    if claim.kind is ClaimKind.ABLE:
        found = []
        for at in pair_places(claim, number):
            ends = f"{at.source}, {at.first}, {at.target}, {at.last}"
            found.append(f"cut_off[{inside}, {ends}, {at.through}, Channel - {at.left_out}]")
        return found[0] if len(found) == 1 else f"({_OR.join(found)})"
    at = Places.of(number)
    places = f"{inside}, {at.source}, {at.first}, {at.target}, {at.last}, {at.through}, Channel - {at.left_out}"
    forgers, eavesdroppers = attackers(claim, at)
    return f"separated[{places}, {forgers}, {eavesdroppers}]"


def condition(claim: ClaimAtom, number: int) -> str:
    """Return what the command of the claim of this index runs or checks."""
    at = Places.of(number)
    if claim.kind in FLOWS:
        return f"{SOME_INSIDE} {compartment(claim, number, 'inside')}"
    if claim.kind is ClaimKind.ONLY_PUBLISH:
        permitted = f"({at.source} + {at.certificates})" if claim.source.certificates else at.source
        who = f"publisher: Enclave + Certificate + Outsider - {permitted}, channel: {at.last}"
        return f"all trust_domain: TrustDomain, {who} | channel not in publisher.(publishes[trust_domain])"
    if claim.kind is ClaimKind.SEPARATE_DOMAINS:
        who = f"enclave: Enclave & {at.source}, other: Enclave & {at.target}, domain: Domain"
        somewhere = f"(enters_somewhere + {at.starts})" if claim.starts else "enters_somewhere"
        there = f"enclave.{somewhere} & other.{somewhere}"
        entered = "(enclave + other).(enters[trust_domain])"
        return f"all trust_domain: TrustDomain, {who} |\n\t\tdomain not in {there} & {entered}"
    if claim.attacker is Attacker.INSIDER:
        who = f"insider: insiders + Certificate + Outsider, channel: {at.last}"
        return f"all trust_domain: TrustDomain, {who} | channel not in insider.(listens_in[trust_domain])"
    return f"all trust_domain: TrustDomain, channel: {at.last} | channel not in trust_domain.in_clear"


def inhabited(claims: Sequence[ClaimAtom]) -> str:
    """Return the run that shows that there is something at each place of each claim."""
    lines = []
    for number, claim in enumerate(claims):
        at = Places.of(number)
        if claim.kind in FLOWS or claim.kind is ClaimKind.SEPARATE_DOMAINS:
            lines.append(f"\tsome {at.source} + {at.first}")
        lines.append(f"\tsome {at.target} + {at.last}")
    return "\n".join([f"run {INHABITED} {{", *lines, "} for 0"])


class _Writer:
    """Writes the places of claims."""

    def __init__(self, system: System) -> None:
        self._atoms = name_atoms(system)
        self.relations = Relations()

    def places(self, claim: ClaimAtom, number: int) -> Iterator[str]:
        """The functions of one claim, after a comment that says which it is."""
        enclaves, channels, at = self._atoms.enclaves, self._atoms.channels, Places.of(number)
        said = f"{claim.kind.value} ({claim.attacker.value}), {claim.id}: {claim.location}"
        yield f"-- Claim{number}: {text.alloy_comment(said)}"
        yield function(at.source, PARTICIPANTS, self._participants(claim.source))
        yield self.relations.subset(at.first, channels, claim.source.channels)
        yield function(at.target, PARTICIPANTS, self._participants(claim.target))
        yield self.relations.subset(at.last, channels, claim.target.channels)
        yield self.relations.subset(at.through, enclaves, claim.through)
        yield self.relations.subset(at.left_out, channels, claim.left_out)
        for part, each in enumerate(_parts(claim)):
            possible = replace(each, enclaves=each.enclaves - claim.through)
            yield function(f"part_{number}_{part}", PARTICIPANTS, self._participants(possible))
            yield self.relations.subset(f"part_channels_{number}_{part}", channels, each.channels)
        if claim.source.certificates:
            yield self.relations.subset(at.certificates, self._atoms.certificates, claim.source.certificates)
        if claim.starts:
            rows: list[set[int]] = [set() for _ in enclaves.atoms]
            for enclave, domain in claim.starts:
                rows[enclave].add(domain)
            related = self.relations.rows(enclaves, self._atoms.domains, rows)
            yield self.relations.relation(at.starts, "Enclave -> Domain", related)
        yield ""

    def _participants(self, place: Place) -> str:
        enclaves = self.relations.atoms(self._atoms.enclaves, place.enclaves)
        if not place.outsider:
            return enclaves
        return f"{enclaves} + Outsider" if place.enclaves else "Outsider"
