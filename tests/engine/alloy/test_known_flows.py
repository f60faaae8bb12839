"""What is taken for a flow, hop by hop, is one: where the Analyzer agrees to it, it finds no compartment."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from keystore_audit import resources
from keystore_audit.engine.alloy import claims
from keystore_audit.engine.alloy.atoms import name_atoms
from keystore_audit.engine.alloy.claims import Places
from keystore_audit.engine.alloy.facts import facts
from keystore_audit.engine.alloy.runner import known_flows, main_file, questions, shown_flow
from keystore_audit.model.formal.asked import ClaimAtom
from keystore_audit.model.formal.flow import Leg
from keystore_audit.model.formal.system import System
from tests.engine.alloy_batch import outcomes, shipped
from tests.engine.systems import lively, random_system, with_claims

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

SYSTEMS = 8
CLAIMS = 10
"""Of each system; the seeds are fixed."""

TRIED = 14
"""Ways drawn at random, for each claim."""


def ways(system: System, claim: ClaimAtom, chance: random.Random) -> Iterator[tuple[Leg, ...]]:
    """Walks of up to three hops from the source to the target, over anybody and any channel, possible or not."""
    participants: list[int | None] = [*range(len(system.enclaves))]
    if claim.attacker.value == "relays":
        participants.append(None)
    channels = range(len(system.channels))
    begins = [*claim.source.enclaves, *([None] if claim.source.outsider else [])]
    ends = [*claim.target.enclaves, *([None] if claim.target.outsider else [])]
    for _ in range(TRIED):
        middle = [chance.choice(participants) for _ in range(chance.choice((0, 0, 0, 1, 1, 2)))]
        if claim.source.channels:
            legs = [Leg(None, chance.choice(sorted(claim.source.channels)), chance.choice(participants))]
        elif begins:
            legs = []
        else:
            return
        holder = legs[0].receiver if legs else chance.choice(begins)
        if claim.target.channels:
            if not legs and not middle:
                yield (Leg(holder, chance.choice(sorted(claim.target.channels)), None),)
                continue
        elif ends:
            middle.append(chance.choice(ends))
        else:
            return
        for receiver in middle:
            legs.append(Leg(holder, chance.choice(channels), receiver))
            holder = receiver
        if claim.target.channels:
            legs.append(Leg(holder, chance.choice(sorted(claim.target.channels)), None))
        yield tuple(legs)


def test_a_flow_that_the_analyzer_agrees_to_leaves_no_compartment(tmp_path: Path) -> None:
    modules = shipped()
    there = agreed = refused = 0
    for seed in range(SYSTEMS):
        system = with_claims(lively(random_system(seed), seed), seed, count=CLAIMS)
        chance = random.Random(seed)
        flows = [number for number, claim in enumerate(system.claims) if claim.kind in claims.FLOWS]
        atoms = name_atoms(system)
        found = known_flows(system, flows)
        asked = [f"run Known{number} {{ {text} }} for 0" for number, text in found.items()]
        for number in flows:
            for count, legs in enumerate(ways(system, system.claims[number], chance)):
                text = shown_flow(system.claims[number], Places.of(number), atoms, legs)
                asked.append(f"run Tried{number}_{count} {{ {text} }} for 0")
        text = main_file(system, (), [*questions(system, (), (resources.alloy() / "properties.als").read_text())])[0]
        texts = {"keystore.als": facts(system), "audit.als": text + "\n".join(asked)}
        answers = outcomes(tmp_path, modules | texts)
        closed = {number for number in flows if answers[f"Claim{number}"]}
        assert set(found) == set(flows) - closed, seed
        assert all(answers[f"Known{number}"] for number in found), seed
        there += len(found)
        for name, instance in answers.items():
            if name.startswith("Tried"):
                number = int(name.removeprefix("Tried").partition("_")[0])
                assert not (instance and number in closed), (seed, name)
                agreed += instance
                refused += not instance
    assert there >= 10
    assert agreed >= 10, agreed
    assert refused >= 100, refused
