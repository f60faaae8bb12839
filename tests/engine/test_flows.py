"""Flows and claims against their definitions in docs/model.md, taken word by word over explicit sets."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit.engine.native import NativeEngine
from keystore_audit.findings import Location
from keystore_audit.keystore.typed import ProtectionKind
from keystore_audit.model.formal.asked import Attacker, ClaimAtom, ClaimKind, Place
from keystore_audit.model.formal.flow import Leg
from keystore_audit.model.formal.system import System
from keystore_audit.properties import Answer, Status
from tests.amount import tried
from tests.engine.flows_by_hand import OUTSIDER, ByHand, Flow, violated
from tests.engine.systems import (
    CHATTER,
    IDENTITY_CA,
    LISTENER,
    OTHER_TOPIC,
    PERMISSIONS_CA,
    TALKER,
    Builder,
    healthy_builder,
    random_system,
    with_claims,
)


def cases(seeds: Iterable[int]) -> Iterator[System]:
    for seed in seeds:
        yield with_claims(random_system(seed), seed, 12)


@pytest.mark.parametrize("start", range(0, tried(400, 100), 50))
def test_claims_against_their_definitions(start: int) -> None:
    told = {True: 0, False: 0}
    for system in cases(range(start, start + 50)):
        hand = ByHand(system)
        answers = NativeEngine([system]).answers[0]
        for claim in (replace(claim, until=None) for claim in system.claims):
            answer = answers[claim.id] if claim in system.claims else _now(system, claim)
            bad = violated(hand, claim)
            if claim.kind is ClaimKind.NO_FLOW:
                flow = Flow(hand, claim)
                assert len(answer.path) == (flow.shortest() or 0), claim
                _check_path(flow, answer.path)
                _check_attacks(flow, answer.path)
            assert (answer.status is Status.VIOLATED) == bad, claim
            if claim.kind is not ClaimKind.ABLE:
                assert bool(answer.witnesses) == bad
            told[bad] += 1
    assert min(told.values()) > 20


def _now(system: System, claim: ClaimAtom) -> Answer:
    return NativeEngine([replace(system, claims=(claim,))]).answers[0][claim.id]


def _check_path(flow: Flow, path: Sequence[Leg]) -> None:
    """Each hop is one, and each begins where the one before ended."""
    claim = flow.claim
    for number, hop in enumerate(path):
        if number:
            assert hop.sender == path[number - 1].receiver
        sender = OUTSIDER if hop.sender is None else hop.sender
        receiver = OUTSIDER if hop.receiver is None else hop.receiver
        if number == 0 and claim.source.channels:
            assert hop.channel in claim.source.channels
            assert receiver in flow.getters(hop.channel)
        elif number == len(path) - 1 and claim.target.channels:
            assert hop.channel in claim.target.channels & flow.put(sender)
        else:
            assert (sender, hop.channel, receiver) in flow.hops
            if number:
                assert sender not in claim.through - claim.source.enclaves


def _check_attacks(flow: Flow, path: Sequence[Leg]) -> None:
    """Of the flows as short as this one between participants, none has fewer hops that are attacks."""
    claim = flow.claim
    if not path or claim.source.channels or claim.target.channels:
        return
    rightful = Flow(flow.hand, replace(claim, attacker=Attacker.HONEST)).rightful
    fewest = dict.fromkeys(flow.source, 0)
    for last in (*[False] * (len(path) - 1), True):
        passing = {
            (e, f): e_attacks + ((e, f) not in rightful)
            for e, e_attacks in fewest.items()
            for sender, _channel, f in flow.hops
            if sender == e and (f in flow.target if last else f not in claim.through)
        }
        fewest = {f: min(n for (_e, to), n in passing.items() if to == f) for _, f in passing}
    attacks = sum((OUTSIDER if hop.sender is None else hop.sender, hop.receiver) not in rightful for hop in path)
    assert attacks == min(fewest.values()), (claim, path)


def _claim(kind: ClaimKind, attacker: Attacker, **fields: object) -> ClaimAtom:
    usual = {
        "source": Place(enclaves=frozenset({TALKER})),
        "target": Place(enclaves=frozenset({LISTENER})),
        "through": frozenset(),
        "left_out": frozenset(),
        "until": None,
        "location": Location(path="keystore-audit.toml", line=1),
    }
    return ClaimAtom(id="claim", kind=kind, attacker=attacker, **{**usual, **fields})  # type: ignore[arg-type]


@pytest.mark.parametrize("attacker", [Attacker.HONEST, Attacker.SOURCE, Attacker.RELAYS])
def test_a_reader_forges_back_only_where_it_attacks(attacker: Attacker) -> None:
    b = healthy_builder()
    b.topic_rules[0] = replace(b.topic_rules[0], metadata_protection_kind=ProtectionKind.ENCRYPT)
    b.domain_rules[0] = replace(b.domain_rules[0], rtps_protection_kind=ProtectionKind.SIGN)
    b.rule(0, [0], subscribe=[CHATTER])
    there = _claim(ClaimKind.NO_FLOW, attacker)
    back = _claim(ClaimKind.NO_FLOW, attacker, source=there.target, target=there.source)
    assert _now(b.system(), there).status is Status.VIOLATED
    assert (_now(b.system(), back).status is Status.VIOLATED) == (attacker is not Attacker.HONEST)


def test_a_right_that_begins_later_violates_only_what_must_hold_until_then() -> None:
    b = healthy_builder()
    narrow = replace(b.grants[1], not_after=2)
    b.grants[1] = narrow
    wide = b.grant(2, narrow.names)
    b.rule(wide, [0], publish=[OTHER_TOPIC])
    b.grants[0] = replace(b.grants[0], not_after=4)
    b.rule(0, [0], subscribe=[OTHER_TOPIC])
    back = _claim(
        ClaimKind.NO_FLOW,
        Attacker.HONEST,
        source=Place(enclaves=frozenset({LISTENER})),
        target=Place(enclaves=frozenset({TALKER})),
    )
    assert _now(b.system(), back).status is Status.HOLDS
    assert _now(b.system(), replace(back, until=2)).status is Status.HOLDS
    later = _now(b.system(), replace(back, until=3))
    assert (later.status, later.moment) == (Status.VIOLATED, 5)


def test_able_rests_on_an_enclaves_own_document() -> None:
    b = healthy_builder()
    able = _claim(ClaimKind.ABLE, Attacker.HONEST)
    assert _now(b.system(), able).status is Status.HOLDS
    b.enclaves[TALKER] = replace(b.enclaves[TALKER], permissions=frozenset())
    other = _claim(ClaimKind.NO_FLOW, Attacker.HONEST)
    assert _now(b.system(), able).status is Status.VIOLATED
    assert _now(b.system(), other).status is Status.VIOLATED  # it may present the document all the same


FLOWING = (Attacker.HONEST, Attacker.SOURCE, Attacker.RELAYS)


def in_two_trust_domains(own: dict[str, Any], other: dict[str, Any], apart: int) -> Builder:
    """The enclave `apart` is in a trust domain of its own with the flags `own`, the other one in one with `other`."""
    b = healthy_builder()
    b.topic_rules[0] = replace(b.topic_rules[0], **other)
    governance = b.document([PERMISSIONS_CA], label="other governance")
    b.topic_rule(b.domain_rule(governance, [0]), [CHATTER, OTHER_TOPIC], **own)
    b.enclaves[apart] = replace(
        b.enclaves[apart], trust_domain=b.trust_domain([IDENTITY_CA], [PERMISSIONS_CA], governance)
    )
    return b


def test_an_attacker_reads_what_the_trust_domain_of_the_writer_lets_it_whatever_its_own_says() -> None:
    """Read access control is on where the listener is and off where the talker is: its own refuses an honest one."""
    b = in_two_trust_domains({}, {"enable_read_access_control": False}, LISTENER)
    b.rules[1] = replace(b.rules[1], subscribe=frozenset())
    found = {each: _now(b.system(), _claim(ClaimKind.NO_FLOW, each)).status for each in FLOWING}
    assert found == dict(zip(FLOWING, (Status.HOLDS, Status.HOLDS, Status.VIOLATED), strict=True))
    b.topic_rules[0] = replace(b.topic_rules[0], enable_read_access_control=True)
    assert _now(b.system(), _claim(ClaimKind.NO_FLOW, Attacker.RELAYS)).status is Status.HOLDS


def test_able_asks_the_writers_own_trust_domain_too() -> None:
    """Without a grant it does not create the writer, although the reader's trust domain would not ask for one."""
    b = in_two_trust_domains({}, {"enable_write_access_control": False}, TALKER)
    able = _claim(ClaimKind.ABLE, Attacker.HONEST)
    onto = replace(able, target=Place(channels=frozenset({CHATTER})))
    assert [_now(b.system(), each).status for each in (able, onto)] == [Status.HOLDS] * 2
    b.rules[0] = replace(b.rules[0], publish=frozenset())
    assert [_now(b.system(), each).status for each in (able, onto)] == [Status.VIOLATED] * 2


def test_an_opaque_enclave_on_the_way_may_carry_anything() -> None:
    b = healthy_builder()
    b.may = True
    claim = _claim(
        ClaimKind.NO_FLOW, Attacker.HONEST, source=Place(enclaves=frozenset({LISTENER})),
        target=Place(enclaves=frozenset({TALKER})),
    )  # fmt: skip
    assert _now(b.system(), claim).status is Status.HOLDS
    b.enclave(0, None, None, opaque=True)
    assert _now(b.system(), replace(claim, attacker=Attacker.RELAYS)).status is Status.VIOLATED
