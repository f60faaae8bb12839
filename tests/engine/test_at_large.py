"""Identities at large: what they break, and that both engines say the same of them."""

from __future__ import annotations

import random
from collections.abc import Collection

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy.atoms import GROUP
from keystore_audit.engine.alloy.facts import fact_modules, facts
from keystore_audit.engine.alloy.merging import merge
from keystore_audit.engine.native import NativeEngine
from keystore_audit.model.formal.system import ParticipantKind, System
from keystore_audit.properties import Status
from tests.amount import tried
from tests.engine.alloy_batch import compare_batch
from tests.engine.systems import IDENTITY_CA, Builder, healthy, healthy_builder, random_system
from tests.engine.test_agreement import holding, some_system

TALKERS_KEY, LISTENERS_KEY = 102, 103
KEY, SUBJECT = "no-identity-serves-two-enclaves", "no-subject-serves-two-enclaves"


def at_large(
    b: Builder,
    key: int | None = None,
    grants: Collection[int] = (),
    not_after: int = 4,
    issuers: Collection[int] = (IDENTITY_CA,),
) -> None:
    """`grants`: those that name it, the talker's (0) or the listener's (1)."""
    identity = b.certificate(issuers, key=key, not_after=not_after)
    number = b.enclave(0, identity, None, label=f"CN=/{identity} (x.pem, no enclave)")
    b.enclaves[number] = replace(b.enclaves[number], kind=ParticipantKind.UNMANAGED)
    for grant in grants:
        b.grants[grant] = replace(b.grants[grant], names=b.grants[grant].names | {identity})


def with_some(*several: dict[str, object]) -> System:
    b = healthy_builder()
    for each in several:
        at_large(b, **each)  # type: ignore[arg-type]
    return b.system()


CASES: dict[str, tuple[System, set[str]]] = {
    "none": (healthy(), set()),
    "one": (with_some({}), set()),
    "one that is over is no enclave that does not start": (with_some({"not_after": 1}), set()),
    "one that a grant names, in nobody's hands": (with_some({"grants": [0]}), set()),
    "two of one key": (with_some({"key": 7}, {"key": 7, "grants": [0]}), set()),
    "two that one grant names": (with_some({"grants": [0]}, {"grants": [0]}), set()),
    "of an enclave's key": (with_some({"key": TALKERS_KEY}), {KEY}),
    "of an enclave's key, named by its own grant: it was renewed": (
        with_some({"key": TALKERS_KEY, "grants": [0]}),
        set(),
    ),
    "the same of another issuer": (with_some({"key": TALKERS_KEY, "grants": [0], "issuers": [1]}), {KEY}),
    "of an enclave's key, named by its own grant and another": (
        with_some({"key": TALKERS_KEY, "grants": [0, 1]}),
        {KEY, SUBJECT},
    ),
    "of an enclave's key, named by another's grant": (with_some({"key": TALKERS_KEY, "grants": [1]}), {KEY, SUBJECT}),
    "two, of which one has an enclave's key": (
        with_some({"grants": [1]}, {"key": LISTENERS_KEY, "grants": [1]}),
        set(),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_what_an_identity_at_large_breaks(name: str) -> None:
    system, broken = CASES[name]
    answers = NativeEngine([system]).answers[0]
    assert {each for each, answer in answers.items() if answer.status is Status.VIOLATED} == broken


def large(system: System, seed: int) -> System:
    """Some of its enclaves are none, which have the keys of others now and then."""
    chance = random.Random(seed)
    enclaves = [
        replace(each, kind=ParticipantKind.UNMANAGED) if chance.random() < 0.4 and each.identity is not None else each
        for each in system.enclaves
    ]
    certificates = list(system.certificates)
    for each in enclaves:
        if each.unmanaged and each.identity is not None and chance.random() < 0.6:
            key = certificates[chance.choice([e.identity for e in enclaves if e.identity is not None])].key
            certificates[each.identity] = replace(certificates[each.identity], key=key)
    return replace(system, enclaves=tuple(enclaves), certificates=tuple(certificates))


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_the_engines_agree_on_them() -> None:
    systems = [*(system for system, _broken in CASES.values()), *(large(some_system(n), n) for n in range(tried(16)))]
    native = [NativeEngine([system]).answers[0] for system in systems]
    assert list(compare_batch(systems, [holding(answers) for answers in native])) == [[]] * len(systems)
    assert len({answers[name].status for answers in native for name in (KEY, SUBJECT)}) == 2


def test_what_is_left_out_for_the_analyzer_changes_no_answer() -> None:
    twins = [{"key": 7 + number} for number in range(9)]
    for system in (with_some(*twins), *(large(random_system(seed), seed) for seed in range(tried(60)))):
        answers, smaller = (NativeEngine([each]).answers[0] for each in (system, merge(system).system))
        assert {name: each.status for name, each in answers.items()} == {n: each.status for n, each in smaller.items()}
    assert len(merge(with_some(*twins)).system.enclaves) < len(with_some(*twins).enclaves)


@pytest.mark.parametrize("count", [1, 3, GROUP + 3])
def test_the_facts_tell_them_from_enclaves(count: int) -> None:
    system = with_some(*[{}] * count)
    written = facts(system)
    assert written.count(" extends Unmanaged {}") == (count if count <= GROUP else 2)
    assert "Unmanaged" not in facts(healthy())
    many = "\n".join(fact_modules(with_some(*[{}] * 300)).values())
    assert "one sig E0_talker_ extends Enclave {}" in many
    assert many.count(" extends Unmanaged {}") == 300 // GROUP
