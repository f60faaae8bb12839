"""Fleets of two implementations: each trust domain judges as its own one does, and reads documents so."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy.merging import merge
from keystore_audit.engine.native import NativeEngine
from keystore_audit.model.formal.asked import Attacker, Place
from keystore_audit.model.formal.flow import Flows
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.properties import Status
from tests.amount import tried
from tests.engine.alloy.cloning import system_with_twins
from tests.engine.alloy.flow_builders import at, claim
from tests.engine.alloy_batch import compare_batch, decide_batch, decide_claims, shipped
from tests.engine.flows_by_hand import ByHand, violated
from tests.engine.systems import (
    CHATTER,
    IDENTITY_CA,
    LISTENER,
    TALKER,
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
        for asked in system.claims:
            assert answers[asked.id] is not violated(hand, asked), (seed, asked)
        uniform = told(some_system(seed))
        matters.update(name for name, holds in answers.items() if holds is not uniform[name])
    assert len(matters) >= 7, f"a lopsided test: {matters}"


def test_merging_changes_no_answer_of_a_mixed_fleet() -> None:
    for seed in range(tried(120)):
        system = mixed(system_with_twins(seed), seed)
        assert told(merge(system).system) == told(system), seed


def reading_alone(b: Builder, reader: int = LISTENER) -> System:
    """The listener has no grant to read to those who judge as its own implementation does, which lets it read."""
    b.rules[-1] = replace(b.rules[-1], subscribe=frozenset())
    b.enclaves[reader] = replace(b.enclaves[reader], reads_alone=frozenset({CHATTER}))
    told_apart = (claim(at(TALKER), at(LISTENER)), claim(Place(channels=frozenset({CHATTER})), at(LISTENER)))
    claims = tuple(replace(each, id=str(number), attacker=Attacker.HONEST) for number, each in enumerate(told_apart))
    return replace(b.system(), claims=claims)


def test_a_reader_gets_what_its_own_implementation_and_the_writers_peers_let_it() -> None:
    """Where all run one, what peers like itself do not concede, nobody concedes."""
    mixed_fleet, uniform = reading_alone(one_authority(1)), reading_alone(healthy_builder())
    mixed_fleet = replace(mixed_fleet, readings=mixed_fleet.readings * 2)
    for system, holds in ((mixed_fleet, False), (uniform, True)):
        answers = told(system)
        assert (answers["0"], answers["1"]) == (holds, holds)
        assert holding_claims(decide_claims([system])[0]) == {"0": holds, "1": holds}


def writing_for_others(b: Builder, default: int = 3) -> System:
    """The talker writes by its default, as the document says to these readings (of the documents from this one on)."""
    b.rules = [replace(each, publish=frozenset()) for each in b.rules]
    b.grants = [replace(each, default_allow=each.document >= default) for each in b.grants]
    asked = replace(claim(at(TALKER), at(LISTENER)), id="kept", attacker=Attacker.HONEST)
    system = replace(b.system(), claims=(asked,))
    return replace(system, readings=system.readings * 2)


def by_itself(system: System) -> System:
    """The talker's own implementation lets it write, whatever it reads in its documents."""
    talker = replace(system.enclaves[TALKER], writes_alone=frozenset({CHATTER}))
    return replace(system, enclaves=tuple(talker if n == TALKER else e for n, e in enumerate(system.enclaves)))


def test_an_honest_writer_has_what_its_own_implementation_lets_it_write() -> None:
    """What peers make of a default does not count where the own one makes nothing of it."""
    theirs, everybodys = (writing_for_others(one_authority(1), default) for default in (3, 0))
    for system, holds in ((theirs, True), (everybodys, False), (by_itself(theirs), False)):
        assert told(system)["kept"] is holds
        assert holding_claims(decide_claims([system])[0]) == {"kept": holds}


def drawn(seed: int) -> System:
    return mixed(some_system(seed), seed)


ALLOY_MUTANTS: dict[str, tuple[str, str, str, Callable[[], System]]] = {
    "what others read is genuine": ("documents.als", "reading & { trust_domain", "{ trust_domain", lambda: drawn(5040)),
    "what others read is obeyed": (
        "documents.als",
        "reading & ({ trust_domain",
        "({ trust_domain",
        lambda: drawn(5000),
    ),
    "an enclave uses what others read": (
        *("properties.als", "enclave.permissions & enclave.in_trust_domain.reading", "enclave.permissions"),
        lambda: drawn(5000),
    ),
    "nobody reads alone": (
        *("information_flow.als", "(takes[receiving] + takes_alone[receiving])", "takes[receiving]"),
        lambda: reading_alone(one_authority(1)),
    ),
    "nobody begins with what it reads alone": (
        *("information_flow.als", "takes[trust_domain] + takes_alone[trust_domain]", "takes[trust_domain]"),
        lambda: reading_alone(one_authority(1)),
    ),
    "what the own implementation does not let it write is sent": (
        *("information_flow.als", " - kept_back }", " }"),
        lambda: writing_for_others(one_authority(1)),
    ),
    "what its own implementation alone lets it write is kept back": (
        *("information_flow.als", "publish_allowed] - emits_alone[trust_domain]", "publish_allowed]"),
        lambda: by_itself(writing_for_others(one_authority(1))),
    ),
    "everybody reads alone": (
        *("information_flow.als", "TrustDomain.reading not in trust_domain.reading", "some TrustDomain"),
        lambda: reading_alone(healthy_builder()),
    ),
}
"""What of the Alloy model makes a fleet mixed: its module, a change of it, and a system that tells of the change."""

NATIVE_MUTANTS: dict[str, tuple[type, str, object, Callable[[], System]]] = {
    "what others read is taken": (
        *(Permissions, "documents"),
        property(lambda self: {key: dict(enumerate(self._system.documents)) for key in range(2)}),
        lambda: drawn(5003),
    ),
    "nobody reads alone": (System, "mixed", property(lambda _self: False), lambda: reading_alone(one_authority(1))),
    "all are let write": (
        *(Flows, "_lets", property(lambda self: [-1] * self.outsider)),
        lambda: writing_for_others(one_authority(1)),
    ),
}


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
@pytest.mark.parametrize("name", ALLOY_MUTANTS)
def test_what_makes_a_fleet_mixed_is_decided_in_alloy(name: str) -> None:
    module, old, new, made = ALLOY_MUTANTS[name]
    text, system = shipped()[module], made()
    if len(system.readings) == 1 and len(system.trust_domains) > 1:
        system = replace(system, readings=system.readings * 2)
    assert text.count(old) == 1
    changed = {module: text.replace(old, new)}
    found = decide_batch([system], changed)[0] | holding_claims(decide_claims([system], changed)[0])
    assert found != told(system)


@pytest.mark.parametrize("name", NATIVE_MUTANTS)
def test_and_natively(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    owner, attribute, wrong, made = NATIVE_MUTANTS[name]
    system = made()
    if len(system.readings) == 1:
        system = replace(system, readings=system.readings * 2)
    right = told(system)
    monkeypatch.setattr(owner, attribute, wrong)
    assert told(system) != right


def holding_claims(statuses: Mapping[str, Status]) -> dict[str, bool]:
    return {name: status is Status.HOLDS for name, status in statuses.items()}


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
