"""Flows that are expected, written for the Analyzer hop by hop (`hop` in alloy/information_flow.als).

To look for a compartment in vain is the dearest question of all: where everybody may write everything, each right is a
choice of the solver. A flow is all constants. Which one is found by the native search over the same system that the
Analyzer is asked about; the Analyzer decides whether each of its hops is one, by rules of its own. Where they all are,
whatever holds the beginning holds the end, so that there is no compartment.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from keystore_audit.engine.alloy.atoms import Atoms, name_atoms
from keystore_audit.engine.alloy.claims import Places, attackers, pair_places
from keystore_audit.model.formal.attacker import realm_views
from keystore_audit.model.formal.claim import ClaimAtom, ClaimKind
from keystore_audit.model.formal.flow import Flows, Leg, search_of
from keystore_audit.model.formal.system import System


def known_flows(system: System, numbers: Sequence[int]) -> dict[int, str]:
    """Return, for those claims of these indices whose places a flow joins, the condition that the flow is one.

    If the condition is true, the command of the claim (`claims.condition`) has no instance.
    """
    if not numbers:
        return {}
    flows = Flows(system, realm_views(system))
    atoms = name_atoms(system)
    found = {}
    for number in numbers:
        claim = system.claims[number]
        pairs = [(pair, flows.shortest(search_of(pair))) for pair in claim.each_pair()]
        if all(legs for _pair, legs in pairs):
            places = pair_places(claim, number) if claim.kind is ClaimKind.ABLE else [Places.of(number)]
            conditions = (shown(pair, at, atoms, legs) for (pair, legs), at in zip(pairs, places, strict=True) if legs)
            found[number] = "\n\tand ".join(conditions)
    return found


def shown(claim: ClaimAtom, at: Places, atoms: Atoms, legs: Sequence[Leg]) -> str:
    """Return the condition that `legs` are a flow between the places of the claim, which are written so."""
    return "\n\tand ".join(_Shown(claim, at, atoms).conditions(legs))


class _Shown:
    """Writes the conditions that a flow is one that violates a claim, or that keeps it if it is about what is able."""

    def __init__(self, claim: ClaimAtom, at: Places, atoms: Atoms) -> None:
        self._claim = claim
        self._at = at
        self._atoms = atoms
        own = claim.kind is ClaimKind.ABLE
        forgers, eavesdroppers = attackers(claim, self._at)
        self._suffix = "_by_own" if own else ""
        self._forgers = "" if own else f", {forgers}"
        self._eavesdroppers = "" if own else f", {eavesdroppers}"

    def conditions(self, legs: Sequence[Leg]) -> Iterator[str]:
        """Begins at the source, goes on over participants that may pass data on, and ends at the target."""
        at, claim, powers = self._at, self._claim, f"{self._forgers}{self._eavesdroppers}"
        on_the_way = [self._who(leg.receiver) for leg in legs[:-1]]
        if not claim.source.channels:
            yield f"some {self._who(legs[0].sender)} & {at.source}"
        for place, leg in enumerate(legs):
            channel = self._atoms.channels.name(leg.channel)
            if place == 0 and claim.source.channels:
                yield f"gets{self._suffix}[{self._who(leg.receiver)}, {channel} & {at.first}{self._eavesdroppers}]"
            elif place == len(legs) - 1 and claim.target.channels:
                yield f"puts{self._suffix}[{self._who(leg.sender)}, {channel} & {at.last}{powers}]"
            else:
                yield f"no {channel} & {at.left_out}"
                yield f"hop{self._suffix}[{self._who(leg.sender)}, {channel}, {self._who(leg.receiver)}{powers}]"
        for participant in on_the_way:
            yield f"no {participant} & ({at.through} - {at.source})"
        if not claim.target.channels:
            yield f"some {self._who(legs[-1].receiver)} & {at.target}"

    def _who(self, participant: int | None) -> str:
        return "Outsider" if participant is None else self._atoms.enclaves.name(participant)
