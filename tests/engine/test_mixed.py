"""Fleets of two implementations: each trust domain judges as its own one does, and reads documents so."""

from __future__ import annotations

from collections import Counter

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy.merging import merge
from keystore_audit.engine.native import NativeEngine
from keystore_audit.model.formal.system import System
from tests.amount import tried
from tests.engine.alloy.cloning import system_with_twins
from tests.engine.alloy_batch import compare_batch
from tests.engine.flows_by_hand import ByHand, violated
from tests.engine.systems import (
    IDENTITY_CA,
    LISTENER,
    Builder,
    healthy_builder,
    mixed,
    with_claims,
)
from tests.engine.test_agreement import holding, some_system

SEEDS = range(5000, 5000 + tried(400))


def told(system: System) -> dict[str, bool]:
    return holding(NativeEngine([system]).answers[0])


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_the_engines_agree_on_fleets_of_two_implementations() -> None:
    """And so does enumeration by hand, of claims; no system is uniform in all that is asked."""
    systems = [mixed(some_system(seed), seed) for seed in SEEDS]
    native = [told(system) for system in systems]
    for seed, differing in zip(SEEDS, compare_batch(systems, native), strict=True):
        assert differing == [], seed
    matters: Counter[str] = Counter()
    for seed, system, answers in zip(SEEDS, systems, native, strict=True):
        hand = ByHand(system)
        for claim in system.claims:
            assert answers[claim.id] is not violated(hand, claim), (seed, claim)
        uniform = told(some_system(seed))
        matters.update(name for name, holds in answers.items() if holds is not uniform[name])
    assert len(matters) >= 7, f"a lopsided test: {matters}"


def test_merging_changes_no_answer_of_a_mixed_fleet() -> None:
    for seed in range(tried(120)):
        system = mixed(system_with_twins(seed), seed)
        assert told(merge(system).system) == told(system), seed


def as_two(system: System) -> System:
    """The same fleet, of two implementations that do the same in everything."""
    made = mixed(system, 0)
    count = {sort: len(getattr(system, sort)) for sort in ("documents", "grants", "rules")}
    for sort, number in count.items():
        first = getattr(made, sort)[:number]
        again = (
            replace(
                one,
                **{field: getattr(other, field) for field in ("reading", "document", "grant") if hasattr(one, field)},
            )
            for one, other in zip(first, getattr(made, sort)[number:], strict=True)
        )
        made = replace(made, **{sort: (*first, *again)})
    return replace(made, readings=(*system.readings, *system.readings))


def test_two_implementations_that_do_the_same_are_as_one() -> None:
    for seed in range(tried(200)):
        system = with_claims(some_system(seed), seed, 6)
        assert told(as_two(system)) == told(system), seed


def one_authority(listener: int) -> Builder:
    """Talker and listener under one CA for both roles; the listener's implementation is of this reading."""
    b = healthy_builder()
    trust = replace(b.trust_domains[0], permissions_ca=frozenset({IDENTITY_CA}))
    b.trust_domains = [trust, replace(trust, reading=1, governance=3)]
    b.documents = [replace(each, signers=frozenset({IDENTITY_CA})) for each in b.documents]
    b.enclaves = [
        replace(each, permissions=each.permissions | {n + 3 for n in each.permissions}) for each in b.enclaves
    ]
    b.documents += [replace(each, reading=1) for each in b.documents]
    b.domain_rules.append(replace(b.domain_rules[0], document=3))
    b.topic_rules.append(replace(b.topic_rules[0], domain_rule=1))
    b.grants += [replace(each, document=each.document + 3) for each in b.grants]
    b.rules += [replace(each, grant=each.grant + 2) for each in b.rules]
    b.enclaves[LISTENER] = replace(b.enclaves[LISTENER], trust_domain=listener)
    return b


@pytest.mark.parametrize("pinning", ["all", "the talker's", "the listener's", "none"])
def test_who_signs_itself_permissions_is_let_in_by_those_alone_whose_implementation_does_not_pin(pinning: str) -> None:
    system = one_authority(1).system()
    readings = [
        replace(system.readings[0], pins_signer=pinning in ("all", "the talker's")),
        replace(system.readings[0], pins_signer=pinning in ("all", "the listener's")),
    ]
    system = replace(system, readings=tuple(readings))
    witnesses = NativeEngine([system]).answers[0]["no-enclave-grants-itself-rights"].witnesses
    expected = {"all": set(), "the talker's": {1}, "the listener's": {0}, "none": {0, 1}}
    trusting = {trust for witness in witnesses for role, trust in witness.items() if role.value == "trust_domain"}
    assert trusting == expected[pinning]
