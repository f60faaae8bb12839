"""Blast radii against the flows and rights that they sum up, and what keys of authorities open, one change each."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model import blast_radius, stolen_key
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.blast_radius import BlastRadius, Radii, ranked_enclaves
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.system import System
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.stolen_key import holding, radius
from keystore_audit.profiles import resolve
from tests.amount import tried
from tests.engine.flows_by_hand import ByHand, Flow
from tests.engine.systems import (
    IDENTITY_CA,
    PERMISSIONS_CA,
    TALKER_PERMISSIONS,
    healthy_builder,
    random_system,
)

AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
FLOWS = Path(__file__).resolve().parents[2] / "sample_keystores/flows"


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
            every = [
                (e, trust_domain) for e in know.acts_as(enclave) for trust_domain in range(len(system.trust_domains))
            ]
            written = {c for e, trust_domain in every for c in know.powers(e, trust_domain).writes}
            forged = {c for e, trust_domain in every for c in know.powers(e, trust_domain).forges}
            forged = forged.union(*map(know.unguarded, range(len(system.trust_domains)))) - written
            read = {c for e, trust_domain in every for c in know.powers(e, trust_domain).learns()}
            read = read.union(*map(know.in_clear, range(len(system.trust_domains))))
            told = radii.of(enclave)
            assert ({*members(told.written)}, {*members(told.forged)}, {*members(told.read)}) == (written, forged, read)
            assert told.passes_for == {system.enclaves[e].label for e in know.acts_as(enclave) - {enclave}}


def of_key(system: System, certificate: int) -> BlastRadius:
    key = system.certificates[certificate].key
    return radius(system, 0, holding(system, key), key)


def test_grants_for_too_many_subjects_are_no_answer() -> None:
    b = healthy_builder()
    for _ in range(stolen_key.MAX_SUBJECTS):
        b.grant(TALKER_PERMISSIONS, [])
    with pytest.raises(BudgetExceeded, match="more identities than can be tried"):
        holding(b.system(), b.certificates[IDENTITY_CA].key)
    assert holding(b.system(), b.certificates[PERMISSIONS_CA].key).enclaves[2:]


def test_keys_of_authorities_open_what_the_keys_below_them_open() -> None:
    """On systems by chance: an identity authority's holder is as strong as each enclave that it vouches for."""
    seen = 0
    for seed in range(tried(150, 50)):
        system = random_system(seed)
        if system.has_doubt:
            continue
        know = ByHand(system)
        for trust_domain in range(len(system.trust_domains)):
            for authority in sorted(system.trust_domains[trust_domain].identity_ca):
                if not system.certificates[authority].authority:
                    continue
                found = of_key(system, authority)
                for number, enclave in enumerate(system.enclaves):
                    if enclave.identity is None or authority not in system.certificates[enclave.identity].issuers:
                        continue
                    view = know.views[trust_domain]
                    if not view.authenticated(number) or view.self_granting(number):
                        continue
                    assert know.powers(number, trust_domain).writes <= {*members(found.written)}, seed
                    assert know.powers(number, trust_domain).reads <= {*members(found.read)}, seed
                    seen += 1
    assert seen > tried(100)


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
