"""Time and scenarios: the temporal modules, against statuses and rights at each moment, worked out one by one."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy import export
from keystore_audit.engine.alloy.export import write_model
from keystore_audit.engine.alloy.facts import KEYSTORE, facts
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.asked import ClaimAtom, ClaimKind
from keystore_audit.model.formal.attacker import TrustDomainView
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from tests.engine.alloy_batch import outcomes, shipped
from tests.engine.flows_by_hand import ByHand, violated
from tests.engine.systems import (
    CHATTER,
    IDENTITY_CA,
    LISTENER,
    TALKER,
    Builder,
    healthy_builder,
    lively,
    random_system,
    with_claims,
)

pytestmark = [pytest.mark.alloy, pytest.mark.slow, pytest.mark.xdist_group("alloy")]

SEEDS = (0, 1, 10, 14, 32, 50, 148, 196, 278, 699)
"""Of random systems in which rights begin (few do), end or stay, with claims violated at once, later or never."""

LASTING = {"AuthoritiesOutliveIdentities", "NoRightBegins"}
"""What holds of a healthy keystore: everything in it ends on one day."""


def files(system: System) -> dict[str, str]:
    timed = export.timed(system)
    modules = shipped()
    return modules | {KEYSTORE: facts(timed, moving=True), export.EXPIRY: export.write_expiry(timed)}


def failing(system: System, directory: Path) -> set[str]:
    """The commands about time whose answer is bad news: checks with a counterexample, claims without a compartment."""
    found = outcomes(directory, files(system), export.EXPIRY)
    assert found[export.TIME_EXERCISED]
    return {name for name, instance in found.items() if instance is (name in export.TIMED)}


def narrow_grant_first(b: Builder) -> None:
    """A grant of nothing that ends before the talker's and stands before it."""
    b.grants.insert(0, replace(b.grants[0], not_after=3))
    b.rules[:] = [replace(rule, grant=rule.grant + 1) for rule in b.rules]


def begins_later(b: Builder) -> None:
    b.grants[0] = replace(b.grants[0], not_before=4)


def stops_at_grants_out_of_date(b: Builder) -> None:
    narrow_grant_first(b)
    b.skips_grants_out_of_date = False


def authority_ends_first(b: Builder) -> None:
    b.certificates[IDENTITY_CA] = replace(b.certificates[IDENTITY_CA], not_after=3)


def test_what_time_brings_and_takes(tmp_path: Path) -> None:
    found = {}
    for change in (narrow_grant_first, begins_later, stops_at_grants_out_of_date, authority_ends_first):
        b = healthy_builder()
        change(b)
        found[change.__name__] = set(export.TIMED) - failing(b.system(), tmp_path)
    assert failing(healthy_builder().system(), tmp_path) == set(export.TIMED) - LASTING
    assert found == {
        "narrow_grant_first": LASTING - {"NoRightBegins"},
        "begins_later": LASTING - {"NoRightBegins"},
        "stops_at_grants_out_of_date": LASTING,
        "authority_ends_first": LASTING - {"AuthoritiesOutliveIdentities"},
    }


def test_with_fewer_steps_than_instants_time_is_not_exercised(tmp_path: Path) -> None:
    b = healthy_builder()
    narrow_grant_first(b)
    modules = files(b.system())
    steps = re.search(r"(\d+)\.\.\1 steps", modules[export.EXPIRY])
    assert steps is not None
    modules[export.EXPIRY] = modules[export.EXPIRY].replace(steps[0], f"1..{int(steps[1]) - 1} steps")
    found = outcomes(tmp_path, modules, export.EXPIRY)
    assert found == dict.fromkeys([export.TIME_EXERCISED, *export.TIMED], False)


def test_the_moving_clock_agrees_with_each_moment_looked_at_alone(tmp_path: Path) -> None:
    """Rights that begin and end, and claims that hold always, in random systems."""
    seen: set[tuple[str, bool]] = set()
    for seed in SEEDS:
        system = with_claims(lively(random_system(seed), seed), seed, 2)
        claims = tuple(claim for claim in system.claims if claim.kind is ClaimKind.NO_FLOW)
        found = failing(system, tmp_path)
        moments = range(2 * system.now, 2 * len(system.instants))
        rights = [_rights(system, moment) for moment in moments]
        expected = {
            "NoRightBegins": any(later - earlier for earlier, later in pairwise(rights)),
            "NoRightEnds": any(earlier - later for earlier, later in pairwise(rights)),
        }
        hands = [ByHand(system, moment) for moment in moments]
        for number, claim in enumerate(claims):
            expected[f"Claim{number}Always"] = any(violated(hand, claim) for hand in hands)
        assert {name: name in found for name in expected} == expected, seed
        seen |= {("Always" if name.endswith("Always") else name, fails) for name, fails in expected.items()}
        seen |= {("Later", True) for claim in claims if violated_later_only(hands, claim)}
    assert seen == {(name, fails) for name in ("NoRightBegins", "NoRightEnds", "Always") for fails in (True, False)} | {
        ("Later", True)
    }


def violated_later_only(hands: list[ByHand], claim: ClaimAtom) -> bool:
    return not violated(hands[0], claim) and any(violated(hand, claim) for hand in hands)


def _rights(system: System, moment: int) -> set[tuple[object, ...]]:
    permissions = Permissions(system, moment)
    return {
        (trust_domain, enclave, operation, channel)
        for trust_domain in range(len(system.trust_domains))
        for enclave in range(len(system.enclaves))
        for operation in (Operation.PUBLISH, Operation.SUBSCRIBE)
        for channel in range(len(system.channels))
        if TrustDomainView(system, trust_domain, permissions).presentable(enclave, operation) >> channel & 1
    }


def test_an_exported_model_of_time_runs_as_it_is(tmp_path: Path) -> None:
    b = healthy_builder()
    narrow_grant_first(b)
    write_model([b.system()], tmp_path / "model")
    folder = tmp_path / "model" / "expiry"
    found = outcomes(tmp_path, {path.name: path.read_text() for path in folder.iterdir()}, export.EXPIRY)
    assert (found["NoRightBegins"], found[export.TIME_EXERCISED]) == (True, True)


def command(b: Builder, directory: Path, wired: str) -> dict[str, bool]:
    """Whether a command of the talker can arrive at the listener, and whether a fair behaviour exists in which not."""
    modules = shipped()
    modules[KEYSTORE] = facts(b.system())
    modules["scenario.als"] = f"""\
module scenario
open scenarios
fun talker: set Enclave {{ E{TALKER}_talker }}
fun listener: set Enclave {{ E{LISTENER}_listener }}
run CanArrive {{ can_arrive[talker, listener, {wired}] }} for 0 but 1..4 steps
check FairDelivery {{ arrives_fairly[talker, listener, {wired}] }} for 0 but 1..4 steps
"""
    return outcomes(directory, modules, "scenario.als")


def test_what_is_permitted_and_wired_arrives_and_without_a_right_there_is_a_lasso(tmp_path: Path) -> None:
    arrives, lost = {"CanArrive": True, "FairDelivery": False}, {"CanArrive": False, "FairDelivery": True}
    wired = f"T{CHATTER}_chatter"
    assert command(healthy_builder(), tmp_path, wired) == arrives
    assert command(healthy_builder(), tmp_path, "Channel - " + wired) == lost
    for right in ("publish", "subscribe"):
        b = healthy_builder()
        b.rules[:] = [replace(rule, **{right: frozenset()}) for rule in b.rules]
        assert command(b, tmp_path, wired) == lost
