"""Blast radii against the flows and rights that they sum up, and what keys of authorities open, one change each."""

from __future__ import annotations

import random
from datetime import datetime, timezone
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.governance import ProtectionKind
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model import blast_radius, stolen_key
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.blast_radius import NOTHING, BlastRadius, Ground, Radii, ground, ranked_enclaves, rankings
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.system import System
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.stolen_key import authorities, holding, holding_both, radius, radius_of_enclave
from keystore_audit.profiles import resolve
from tests.amount import tried
from tests.engine.flows_by_hand import ByHand, Flow
from tests.engine.systems import (
    CHATTER,
    GOVERNANCE,
    IDENTITY_CA,
    OTHER_TOPIC,
    PERMISSIONS_CA,
    TALKER_PERMISSIONS,
    Builder,
    healthy_builder,
    random_system,
    stock,
)

AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
FLOWS = Path(__file__).resolve().parents[2] / "sample_keystores/flows"
CHANNELS = (1 << CHATTER) | (1 << OTHER_TOPIC)


def no_flow(attacker: Attacker, source: int, target: int, left_out: frozenset[int]) -> ClaimAtom:
    return ClaimAtom(
        id="x",
        kind=ClaimKind.NO_FLOW,
        attacker=attacker,
        source=Place(enclaves=frozenset({source})),
        target=Place(enclaves=frozenset({target})),
        through=frozenset(),
        left_out=left_out,
        until=None,
        location=Location(path="x"),
    )


@pytest.mark.parametrize("start", range(0, tried(120, 40), 40))
def test_every_enclave_reaches_whom_its_flows_reach(start: int) -> None:
    reached = 0
    for seed in range(start, start + 40):
        system = random_system(seed)
        left_out = frozenset(range(0, len(system.channels), 3)) if seed % 2 else frozenset()
        radii, know = Radii(system, sum(1 << channel for channel in left_out)), ByHand(system)
        for enclave in know.enclaves:
            acting = know.acts_as(enclave)
            for attacker, found in ((Attacker.RELAYS, radii.reached), (Attacker.SOURCE, radii.reached_alone)):
                told = {*members(found(enclave))} - acting
                others = [other for other in know.enclaves if other not in acting]
                flows = {
                    o for o in others if Flow(know, no_flow(attacker, enclave, o, left_out)).shortest() is not None
                }
                assert told == flows, (seed, enclave, attacker)
                reached += len(flows)
    assert reached > 30


@pytest.mark.parametrize("start", range(0, tried(200, 100), 100))
def test_rights_are_those_of_all_that_have_the_key(start: int) -> None:
    for seed in range(start, start + 100):
        system = random_system(seed)
        radii, know = Radii(system, 0), ByHand(system)
        for enclave in know.enclaves:
            every = [(e, realm) for e in know.acts_as(enclave) for realm in range(len(system.realms))]
            written = {c for e, realm in every for c in know.powers(e, realm).writes}
            forged = {c for e, realm in every for c in know.powers(e, realm).forges}
            forged = forged.union(*map(know.unguarded, range(len(system.realms)))) - written
            read = {c for e, realm in every for c in know.powers(e, realm).learns()}
            read = read.union(*map(know.in_clear, range(len(system.realms))))
            told = radii.of(enclave)
            assert ({*members(told.written)}, {*members(told.forged)}, {*members(told.read)}) == (written, forged, read)
            assert told.passes_for == {system.enclaves[e].label for e in know.acts_as(enclave) - {enclave}}


def of_key(system: System, certificate: int) -> BlastRadius:
    key = system.certificates[certificate].key
    return radius(system, 0, holding(system, key), key)


def of_both(system: System, certificate: int) -> BlastRadius:
    key = system.certificates[certificate].key
    return radius(system, 0, holding_both(system, key), key)


def test_an_enclave_has_its_own_rights_alone() -> None:
    found = radius_of_enclave(healthy_builder().system(), 0, "/talker")
    assert (found.written, found.forged, found.read) == (1 << CHATTER, 0, 0)
    assert (found.reached, found.reached_alone, found.passes_for) == ({"/listener"}, {"/listener"}, frozenset())
    assert found.beyond_itself
    back = radius_of_enclave(healthy_builder().system(), 0, "/listener")
    assert (back.reached, back.learns, back.beyond_itself) == (frozenset(), True, True)
    assert radius_of_enclave(healthy_builder().system(), 0, "/nobody") == NOTHING


def test_what_an_enclave_writes_though_honest_peers_refuse_it_is_learnt() -> None:
    """A compromised reader takes it, where the writer's peers concede it the right to read."""
    b = healthy_builder()
    b.rules[0] = replace(b.rules[0], publish=frozenset())
    quiet = radius_of_enclave(b.system(), 0, "/listener")
    b.enclaves[0] = replace(b.enclaves[0], writes_alone=frozenset({CHATTER}))
    assert (quiet.learns, radius_of_enclave(b.system(), 0, "/listener").learns) == (False, True)
    assert radius_of_enclave(b.system(), 0, "/talker").reached == {"/listener"}


@pytest.mark.parametrize("kind", [ProtectionKind.NONE, ProtectionKind.ENCRYPT])
def test_who_is_let_in_nowhere_does_what_anybody_can_on_the_network(kind: ProtectionKind) -> None:
    b = healthy_builder()
    b.grants[0] = replace(b.grants[0], not_after=1)
    plain = {f"{layer}_protection_kind": ProtectionKind.NONE for layer in ("metadata", "data")}
    b.topic_rules[0] = replace(b.topic_rules[0], **plain)
    b.domain_rules[0] = replace(b.domain_rules[0], rtps_protection_kind=kind)
    found = radius_of_enclave(b.system(), 0, "/talker")
    if kind is ProtectionKind.ENCRYPT:
        assert found == NOTHING
        return
    assert (found.written, found.forged, found.read) == (0, CHANNELS, CHANNELS)
    assert found.reached_alone == {"/listener"}


def test_an_identity_authority_is_everybody_but_signs_no_rights() -> None:
    found = of_key(healthy_builder().system(), IDENTITY_CA)
    assert (found.written, found.read) == (1 << CHATTER, 1 << CHATTER)
    assert found.passes_for == {"/talker", "/listener"}
    assert found.reached == {"/listener"}


def test_a_grant_that_names_nobody_here_is_an_identity_authoritys_too() -> None:
    b = healthy_builder()
    left = b.grant(TALKER_PERMISSIONS, [])
    b.rule(left, [0], publish=[OTHER_TOPIC])
    assert of_key(b.system(), IDENTITY_CA).written == CHANNELS
    assert radius_of_enclave(b.system(), 0, "/talker").written == 1 << CHATTER


def test_grants_for_too_many_subjects_are_no_answer() -> None:
    b = healthy_builder()
    for _ in range(stolen_key.MAX_SUBJECTS):
        b.grant(TALKER_PERMISSIONS, [])
    with pytest.raises(BudgetExceeded, match="more identities than can be tried"):
        holding(b.system(), b.certificates[IDENTITY_CA].key)
    assert holding(b.system(), b.certificates[PERMISSIONS_CA].key).enclaves[2:]


def test_a_permissions_authority_alone_is_nobody() -> None:
    system = healthy_builder().system()
    alone, both = of_key(system, PERMISSIONS_CA), of_both(system, PERMISSIONS_CA)
    assert not alone.beyond_itself
    assert (alone.written, alone.read) == (0, 0)
    assert (both.written, both.read) == (CHANNELS, CHANNELS)
    assert both.passes_for == frozenset()


def test_one_authority_for_both_is_everything() -> None:
    system = stock()
    found = of_key(system, 0)
    assert (found.written, found.read) == (CHANNELS, CHANNELS)
    assert found.passes_for == {"/talker", "/listener"}


def below_the_permissions_authority(b: Builder) -> Builder:
    """The identity CA is issued by the permissions CA, as where both are under one root."""
    b.certificates[IDENTITY_CA] = replace(b.certificates[IDENTITY_CA], issuers=frozenset({PERMISSIONS_CA}))
    return b


@pytest.mark.parametrize("pins", [True, False])
def test_where_signers_are_not_pinned_an_authority_below_signs_rights(pins: bool) -> None:
    b = below_the_permissions_authority(healthy_builder())
    b.pins_signer = pins
    assert of_key(b.system(), IDENTITY_CA).written == (1 << CHATTER if pins else CHANNELS)


def test_an_authority_that_may_not_issue_makes_nobody() -> None:
    b = healthy_builder()
    b.certificates[IDENTITY_CA] = replace(b.certificates[IDENTITY_CA], authority=False)
    assert authorities(b.system(), b.certificates[IDENTITY_CA].key) == frozenset()
    assert not of_key(b.system(), IDENTITY_CA).beyond_itself


def test_an_enclave_with_an_authoritys_key_has_what_the_authority_has() -> None:
    b = healthy_builder()
    key = b.certificates[IDENTITY_CA].key
    b.certificates[2] = replace(b.certificates[2], key=key)
    found = radius_of_enclave(b.system(), 0, "/talker")
    assert (found.read, found.passes_for) == (1 << CHATTER, {"/listener"})


def test_a_key_of_two_enclaves_passes_for_the_other() -> None:
    b = healthy_builder()
    b.certificates[3] = replace(b.certificates[3], key=b.certificates[2].key)
    found = radius_of_enclave(b.system(), 0, "/talker")
    assert (found.passes_for, found.read, found.reached) == ({"/listener"}, 1 << CHATTER, frozenset())


def test_keys_of_authorities_open_what_the_keys_below_them_open() -> None:
    """On systems by chance: an identity authority's holder is as strong as each enclave that it vouches for."""
    seen = 0
    for seed in range(tried(150, 50)):
        system = random_system(seed)
        if system.has_doubt:
            continue
        know = ByHand(system)
        for realm in range(len(system.realms)):
            for authority in sorted(system.realms[realm].identity_ca):
                if not system.certificates[authority].authority:
                    continue
                found = of_key(system, authority)
                for number, enclave in enumerate(system.enclaves):
                    if enclave.identity is None or authority not in system.certificates[enclave.identity].issuers:
                        continue
                    view = know.views[realm]
                    if not view.authenticated(number) or view.self_granting(number):
                        continue
                    assert know.powers(number, realm).writes <= {*members(found.written)}, seed
                    assert know.powers(number, realm).reads <= {*members(found.read)}, seed
                    seen += 1
    assert seen > tried(100)


def test_everything_of_the_holder_is_new_and_the_rest_stays() -> None:
    for seed in range(tried(60, 20)):
        system = random_system(seed)
        for certificate in range(len(system.certificates)):
            held = holding_both(system, system.certificates[certificate].key)
            assert held.enclaves[: len(system.enclaves)] == system.enclaves
            assert held.certificates[: len(system.certificates)] == system.certificates
            added = held.enclaves[len(system.enclaves) :]
            assert {held.certificates[e.identity].key for e in added if e.identity is not None} <= {
                system.certificates[certificate].key
            }
            for before, after in zip(system.grants, held.grants, strict=True):
                assert before.names <= after.names
                assert after.names - before.names <= {*range(len(system.certificates), len(held.certificates))}


def test_the_governance_counts_whatever_the_key() -> None:
    b = healthy_builder()
    b.documents[GOVERNANCE] = replace(b.documents[GOVERNANCE], intact=False)
    assert of_key(b.system(), IDENTITY_CA).written == 0
    assert of_both(b.system(), PERMISSIONS_CA).written == 0


def ground_of(sample: str, *, include_ambient: bool = False) -> Ground:
    keystore = read_keystore(FLOWS / sample)
    accesses = AccessViews(documents_of(keystore), AT, None)
    return ground(keystore, resolve(()), AT, accesses, include_ambient=include_ambient)


@pytest.mark.parametrize("sample", ["vehicle_bridged_domain", "chatter_unreadable_enclave", "turtlesim_shared_ca"])
def test_names_are_counted_as_they_are_listed(sample: str) -> None:
    known = ground_of(sample)
    draw = random.Random(sample)
    total = len(known.channels.channels)
    for channels in [(1 << total) - 1, 0, *(draw.getrandbits(total) & draw.getrandbits(total) for _ in range(200))]:
        listed = known.topics(channels)
        assert known.count(channels) == len(listed) == len({topic.name for topic in listed})
        assert sum(len(topic.domains) for topic in listed) == channels.bit_count()
        assert any(topic.name.several for topic in listed) == bool(channels & known.endless)


def test_a_name_stands_once_with_its_domains() -> None:
    known = ground_of("vehicle_bridged_domain")
    every = {topic.name.topic: topic.domains for topic in known.topics((1 << len(known.channels.channels)) - 1)}
    assert every["rt/workshop"] == every["rt/motor_limit"] == ("domain 0", "domain 1")
    infotainment = radius_of_enclave(known.systems[0], known.left_out, "/infotainment")
    written = {topic.name.topic: topic.domains for topic in known.topics(infotainment.written)}
    assert written["rt/workshop"] == ("domain 1",)


def test_ambient_topics_are_left_out_of_flows_alone() -> None:
    known, full = ground_of("vehicle_healthy"), ground_of("vehicle_healthy", include_ambient=True)
    ambient = {topic.name.topic for topic in known.topics(known.left_out)}
    assert ambient == {"rt/clock", "rt/parameter_events", "rt/rosout", "ros_discovery_info"}
    assert full.left_out == 0
    without, with_them = ({one.path: one for one in rankings(each)[0].enclaves} for each in (known, full))
    for path, one in without.items():
        assert one.topics_written == with_them[path].topics_written
        assert one.enclaves_reached <= with_them[path].enclaves_reached


@pytest.mark.parametrize("limit", ["MAX_RANKED", "MAX_VIEWS"])
def test_too_many_enclaves_are_not_ranked(limit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    keystore = read_keystore(FLOWS / "vehicle_healthy")
    accesses = AccessViews(documents_of(keystore), AT, None)
    (ranking,) = ranked_enclaves(keystore, resolve(()), AT, accesses)
    assert len(ranking.enclaves) == len(keystore.enclaves)
    monkeypatch.setattr(blast_radius, limit, 1)
    assert ranked_enclaves(keystore, resolve(()), AT, accesses) == ()


def test_too_many_names_in_partitions_are_not_ranked(monkeypatch: pytest.MonkeyPatch) -> None:
    keystore = read_keystore(FLOWS / "chatter_partition_named")
    accesses = AccessViews(documents_of(keystore), AT, None)
    assert ranked_enclaves(keystore, resolve(()), AT, accesses) != ()
    monkeypatch.setattr(blast_radius, "MAX_NAMES", 1)
    assert ranked_enclaves(keystore, resolve(()), AT, accesses) == ()


def test_too_many_expressions_are_not_ranked(monkeypatch: pytest.MonkeyPatch) -> None:
    keystore = read_keystore(FLOWS / "vehicle_healthy")
    accesses = AccessViews(documents_of(keystore), AT, None)
    monkeypatch.setattr(blast_radius, "MAX_TEXTS_PER_ENCLAVE", 0)
    assert ranked_enclaves(keystore, resolve(()), AT, accesses) != ()
    monkeypatch.setattr(blast_radius, "MAX_TEXTS", 10)
    assert ranked_enclaves(keystore, resolve(()), AT, accesses) == ()
