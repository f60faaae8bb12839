"""What the Analyzer is asked about is smaller than the keystore, and the answers are the same."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy import twins
from keystore_audit.engine.alloy.facts import count_atoms
from keystore_audit.engine.alloy.merging import KEPT, Merged, merge
from keystore_audit.engine.native import MAX_WITNESSES, NativeEngine
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.attacker import TrustDomainView
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.permission import Permissions
from keystore_audit.model.formal.system import System
from keystore_audit.properties import Status
from keystore_audit.properties.result import Answer
from tests.amount import tried
from tests.engine.alloy.cloning import system_with_twins
from tests.engine.alloy_batch import decide_batch, decide_claims
from tests.engine.systems import CHATTER, TALKER, healthy_builder

SYSTEMS = tried(240, 120)
"""Random systems that are decided natively; the seeds are fixed."""

ASKED = tried(8, 3)
"""Of these, systems that the Analyzer is asked about as they are, and merged."""


def answers(system: System) -> dict[str, Answer]:
    return NativeEngine([system]).answers[0]


def statuses(system: System) -> dict[str, Status]:
    return {key: answer.status for key, answer in answers(system).items()}


@pytest.mark.parametrize("start", range(0, SYSTEMS, 120))
def test_merging_changes_no_answer_and_a_counterexample_is_one_of_the_keystore(start: int) -> None:
    fewer_enclaves = fewer_channels = told = 0
    for seed in range(start, start + 120):
        system = system_with_twins(seed)
        merged = merge(system)
        whole, few = answers(system), answers(merged.system)
        assert {key: a.status for key, a in few.items()} == {key: a.status for key, a in whole.items()}, seed
        fewer_enclaves += len(merged.system.enclaves) < len(system.enclaves)
        fewer_channels += len(merged.system.channels) < len(system.channels)
        told += sum(_is_told(merged, answer, whole[key]) for key, answer in few.items())
    assert fewer_enclaves >= 30
    assert fewer_channels >= 30
    assert told >= 100


def _is_told(merged: Merged, few: Answer, whole: Answer) -> bool:
    """Whether there is a counterexample; if so, that it is one of the whole system, and a flow as short as there."""
    if few.status is Status.HOLDS or not few.witnesses:
        return False
    original = merged.original(few)
    if few.path:
        assert len(few.path) == len(whole.path)
    elif len(whole.witnesses) < MAX_WITNESSES:
        assert set(map(_key, original.witnesses)) <= set(map(_key, whole.witnesses))
    return True


def _key(witness: object) -> str:
    return repr(sorted(witness.items()))  # type: ignore[attr-defined]


@pytest.mark.alloy
def test_the_analyzer_says_the_same_of_both() -> None:
    systems = [system for system in map(system_with_twins, range(1000, 1000 + 3 * ASKED)) if _shrinks(system)][:ASKED]
    assert len(systems) == ASKED
    merged = [merge(system).system for system in systems]
    plain = [replace(system, claims=()) for system in systems]
    assert decide_batch(plain) == decide_batch([replace(system, claims=()) for system in merged])
    assert decide_claims(systems) == decide_claims(merged)


def _shrinks(system: System) -> bool:
    merged = merge(system)
    return len(merged.system.enclaves) < len(system.enclaves) and count_atoms(system) < 200


def fleet(size: int) -> System:
    """Enclaves that are alike, each with a topic of its own that a base station subscribes to."""
    b = healthy_builder()
    base = b.grants[1].names
    assert base
    for number in range(size):
        identity = b.certificate([0], label=f"/robot{number}", not_before=number % 2)
        document = b.document([1])
        b.enclave(0, identity, document, label=f"/robot{number}")
        own = b.channel(0, f"rt/robot{number}/status")
        b.rule(b.grant(document, [identity]), [0], publish=[own, CHATTER])
        b.rule(1, [0], subscribe=[own])
    b.topic_rule(0, range(len(b.channels)))
    return b.system()


def test_of_a_fleet_three_robots_remain() -> None:
    small, large = merge(fleet(10)), merge(fleet(200))
    assert len(large.system.enclaves) == 2 + KEPT
    assert count_atoms(large.system) == count_atoms(small.system)
    assert statuses(large.system) == statuses(fleet(200))


def test_a_robot_that_a_claim_names_is_like_no_other() -> None:
    system = fleet(20)
    last = len(system.enclaves) - 1
    claims = system_with_claim(system, last)
    assert last in merge(claims).origin["enclaves"]
    assert last not in merge(system).origin["enclaves"]


def system_with_claim(system: System, target: int) -> System:
    """A claim that nothing flows from the talker to one enclave."""
    from tests.engine.systems import with_claims

    drawn = with_claims(system, 3, count=1).claims[0]
    source = replace(drawn.source, enclaves=frozenset({TALKER}), channels=frozenset(), outsider=False)
    place = replace(drawn.target, enclaves=frozenset({target}), channels=frozenset(), outsider=False)
    return replace(system, claims=(replace(drawn, source=source, target=place),))


def test_every_field_of_a_system_is_merged_or_left_out_on_purpose() -> None:
    """A new field that properties speak of must be merged too; one that they do not is dropped."""
    asked = set(System.__struct_fields__) - {"places", "determinism", "nodes"}
    system = fleet(5)
    merged = merge(system).system
    assert {name for name in asked if getattr(merged, name) == getattr(system, name) or name in CHANGED} == asked


CHANGED = frozenset({"instants", "now", "certificates", "documents", "enclaves", "channels", "grants", "rules"}) | {
    "topic_rules",
    "trust_domains",
    "domain_rules",
}
"""Fields that are renumbered."""


def test_too_many_rules_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(twins, "MAX_MENTIONS", 10)
    system = fleet(20)
    assert len(merge(system).system.enclaves) == len(system.enclaves)


@pytest.mark.parametrize("start", range(0, 40, 40))
def test_the_test_sees_an_enclave_too_few(start: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutants: one enclave of a class instead of three; twins whatever is known of their certificates."""
    monkeypatch.setattr("keystore_audit.engine.alloy.merging.KEPT", 1)
    assert any(statuses(merge(s).system) != statuses(s) for s in map(system_with_twins, range(start, start + 40)))
    monkeypatch.setattr("keystore_audit.engine.alloy.merging.KEPT", KEPT)
    monkeypatch.setattr(twins._Twins, "_trust", lambda *_: None)
    assert any(statuses(merge(s).system) != statuses(s) for s in map(system_with_twins, range(start, start + 40)))


def test_exchanging_two_twins_exchanges_what_they_can_do_and_changes_nothing_else() -> None:
    """What the argument rests on, enclave by enclave and channel by channel, as the native engine works it out."""
    exchanged = 0
    for seed in range(tried(300)):
        system = system_with_twins(seed)
        said = twins.mentions(system)
        assert said is not None
        found = twins._Twins(system, said)
        classes, own_channels = twins.find_twins(system, said)
        able = abilities(system)
        for alike in classes:
            first, last = alike[0], alike[-1]
            if first != last:
                exchanged += 1
                theirs = {found._owned(last, channel): channel for channel in own_channels[last]}
                pairs = [(channel, theirs[found._owned(first, channel)]) for channel in own_channels[first]]
                assert len(pairs) == len(theirs), seed
                assert moved(able, (first, last), pairs) == able, seed
    assert exchanged >= tried(150)


Abilities = dict[tuple[int, int, str], frozenset[int]]
"""By trust domain, enclave and kind of right: channels (domains for `joined`)."""


def abilities(system: System) -> Abilities:
    """All that each enclave is granted and can do in each trust domain."""
    permissions = Permissions(system)
    found: Abilities = {}
    for trust_domain in range(len(system.trust_domains)):
        view = TrustDomainView(system, trust_domain, permissions)
        for enclave in range(len(system.enclaves)):
            able = view.abilities(enclave)
            rights = {
                "write": able.may_write,
                "read": able.may_read,
                "relay": able.may_relay,
                "forge": able.forges,
                "overhear": able.overhears,
                **{operation.value: view.granted(enclave, operation) for operation in Operation},
            }
            for kind, channels in rights.items():
                found[trust_domain, enclave, kind] = frozenset(members(channels))
            found[trust_domain, enclave, "joined"] = frozenset(members(view.joined(enclave)))
    return found


def moved(able: Abilities, enclaves: tuple[int, int], channels: list[tuple[int, int]]) -> Abilities:
    """The same after two enclaves, and pairs of channels, were exchanged."""
    other = dict([enclaves, enclaves[::-1]])
    place = dict([*channels, *(pair[::-1] for pair in channels)])
    return {
        (trust_domain, other.get(enclave, enclave), kind): (
            rights if kind == "joined" else frozenset(place.get(channel, channel) for channel in rights)
        )
        for (trust_domain, enclave, kind), rights in able.items()
    }
