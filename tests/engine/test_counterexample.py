"""Counterexamples speak in the user's names and point at the lines that cause them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit.engine.case import Case, plainest
from keystore_audit.engine.counterexample import describe
from keystore_audit.engine.counterexample_claims import at_hop, describe_claim, hop_ways
from keystore_audit.engine.native import NativeEngine
from keystore_audit.findings import Location
from keystore_audit.keystore.typed import Operation, ProtectionKind
from keystore_audit.model.formal.asked import Attacker, ClaimKind
from keystore_audit.model.formal.system import System
from keystore_audit.properties import BY_ID, PROPERTIES
from keystore_audit.properties.result import Counterexample, Role, Status
from tests.amount import tried
from tests.engine.alloy.flow_builders import THIRD, at, chain, claim, shut_out, weak
from tests.engine.systems import (
    CHATTER,
    GOVERNANCE,
    LISTENER,
    OTHER_TOPIC,
    PERMISSIONS_CA,
    TALKER,
    TALKER_IDENTITY,
    TALKER_PERMISSIONS,
    healthy,
    healthy_builder,
    random_system,
    with_claims,
)

Flags = Mapping[str, Any]


NONE = ProtectionKind.NONE


def tell(system: System, identifier: str, **atoms: int) -> Counterexample:
    return describe(system, BY_ID[identifier], {Role(role): index for role, index in atoms.items()})


def test_the_topic_rule_that_decides_is_named_and_not_one_after_it() -> None:
    b = healthy_builder()
    b.topic_rules[0] = replace(b.topic_rules[0], channels=frozenset({CHATTER}))
    b.topic_rule(0, [CHATTER, OTHER_TOPIC], enable_read_access_control=False)
    told = tell(b.system(), "nobody-reads-without-a-grant", trust_domain=0, enclave=TALKER, channel=OTHER_TOPIC)
    assert [(step.path, step.line) for step in told.steps] == [("0.p7s", 101)]
    assert 'topics such as "any"' in told.text
    assert "enable_read_access_control is false" in told.text


def test_what_could_not_be_read_is_said_to_be_so() -> None:
    b = healthy_builder()
    b.may = True
    b.documents[GOVERNANCE] = replace(b.documents[GOVERNANCE], opaque=True)
    for identifier, atoms in {
        "only-authenticated-participants-join": {"domain": 0},
        "outsiders-cannot-read": {"channel": CHATTER},
        "outsiders-cannot-learn-names": {"channel": CHATTER},
        "grants-are-enforced": {"channel": CHATTER},
        "nobody-writes-without-a-grant": {"enclave": LISTENER, "channel": CHATTER},
    }.items():
        told = tell(b.system(), identifier, trust_domain=0, **atoms)
        assert told.text.startswith("It cannot be ruled out for ")
        assert told.text.endswith(": 0.p7s could not be read.")
        assert told.steps[0].path == "0.p7s"
    b = healthy_builder()
    b.unread(0)
    told = tell(b.system(), "identities-chain-to-the-identity-ca", trust_domain=0, enclave=TALKER)
    assert told.text == "It cannot be ruled out for /talker: 3.p7s, a CA file could not be read."


@pytest.mark.parametrize(
    ("topic", "domain", "flag"),
    [
        ({}, {"enable_join_access_control": False}, "enable_join_access_control"),
        ({"enable_read_access_control": False}, {}, "enable_read_access_control"),
        (
            {"enable_write_access_control": False},
            {"enable_join_access_control": False},
            "enable_join_access_control",
        ),
        ({"enable_write_access_control": False}, {}, "enable_write_access_control"),
    ],
)
def test_the_access_control_that_is_off_is_named(topic: Flags, domain: Flags, flag: str) -> None:
    """Nobody is granted to publish: somebody writes by its own implementation alone, or a grant could not be read."""
    b = healthy_builder()
    b.rules[0] = replace(b.rules[0], publish=frozenset())
    b.enclaves[TALKER] = replace(b.enclaves[TALKER], writes_alone=frozenset({CHATTER}))
    b.topic_rules[0] = replace(b.topic_rules[0], **topic)
    b.domain_rules[0] = replace(b.domain_rules[0], **domain)
    assert f": {flag} is false" in tell(b.system(), "grants-are-enforced", trust_domain=0, channel=CHATTER).text


def test_an_enclave_that_has_the_key_of_the_permissions_ca() -> None:
    b = healthy_builder()
    key = b.certificates[PERMISSIONS_CA].key
    b.certificates[TALKER_IDENTITY] = replace(b.certificates[TALKER_IDENTITY], key=key)
    told = tell(b.system(), "no-enclave-grants-itself-rights", trust_domain=0, enclave=TALKER)
    assert told.text == "/talker can sign its own permissions: its key is the permissions CA's key."


def test_where_there_is_no_authority_nobody_is_said_to_be_another() -> None:
    """A copy of enclaves/ alone: its links to public/ lead nowhere."""
    b = healthy_builder()
    b.trust_domains[0] = replace(b.trust_domains[0], identity_ca=frozenset(), permissions_ca=frozenset())
    told = tell(b.system(), "documents-signed-by-the-permissions-ca", enclave=TALKER, document=TALKER_PERMISSIONS)
    assert told.text.endswith(", and there is no certificate of a permissions CA.")
    told = tell(b.system(), "identities-chain-to-the-identity-ca", enclave=TALKER)
    assert told.text.endswith(": there is no certificate of an identity CA.")


@pytest.mark.parametrize("skips", [True, False])
def test_a_grant_behind_one_out_of_date_is_shown_where_that_one_is_passed_over(skips: bool) -> None:
    b = healthy_builder()
    b.skips_grants_out_of_date = skips
    b.grants[0] = replace(b.grants[0], not_after=1)
    behind = b.grant(TALKER_PERMISSIONS, [TALKER_IDENTITY])
    b.rule(behind, [0], publish=[CHATTER])
    found = Case(b.system(), {Role.TRUST_DOMAIN: 0, Role.CHANNEL: CHATTER}).rights(TALKER, Operation.PUBLISH)
    assert [right.location for right in found] == [b.rules[-1].location] * skips


@pytest.mark.parametrize("seed", range(tried(40)))
def test_any_witness_can_be_told(seed: int) -> None:
    """Even one that no engine would give: an explanation must never be what ends an audit."""
    system = random_system(seed)
    sizes = {
        Role.TRUST_DOMAIN: len(system.trust_domains),
        Role.DOMAIN: len(system.domains),
        Role.ENCLAVE: len(system.enclaves),
        Role.OTHER: len(system.enclaves),
        Role.DOCUMENT: len(system.documents),
        Role.CHANNEL: len(system.channels),
        Role.CERTIFICATE: len(system.certificates),
        Role.OTHER_CERTIFICATE: len(system.certificates),
        Role.OTHER_CHANNEL: len(system.channels),
    }
    for prop in PROPERTIES:
        for turn in range(6):
            told = describe(system, prop, {role: turn % sizes[role] for role in prop.roles})
            assert told.text.endswith(".")
            assert "\n" not in told.text
            for step in told.steps:
                assert step.path is None or Location(path=step.path, line=step.line).path


def test_an_endpoint_that_honest_peers_refuse_is_named_where_there_is_no_other() -> None:
    b = healthy_builder()
    b.rules[0] = replace(b.rules[0], domains=frozenset())
    asked = {"trust_domain": 0, "channel": CHATTER}
    assert [step.enclave for step in tell(b.system(), "outsiders-cannot-read", **asked).steps] == [None, None]
    b.enclaves[TALKER] = replace(b.enclaves[TALKER], writes_alone=frozenset({CHATTER}))
    last = tell(b.system(), "outsiders-cannot-read", **asked).steps[-1]
    assert (last.enclave, last.line) == ("/talker", b.rules[0].location.line)


@pytest.mark.parametrize(("rtps", "why"), [("NONE", "anybody on the network can send it"), ("SIGN", "")])
def test_an_attacker_that_is_let_in_nowhere_sends_as_anybody_can(rtps: str, why: str) -> None:
    none = ProtectionKind.NONE
    b = shut_out(rtps=ProtectionKind(rtps), metadata=none, data=none)
    asked = claim(at(THIRD), at(LISTENER), Attacker.SOURCE)
    system = replace(b.system(), claims=(asked,))
    answer = NativeEngine([system]).answers[0][asked.id]
    assert (answer.status is Status.VIOLATED) == bool(why)
    if why:
        told = describe_claim(system, asked, answer)
        assert f"/third: {why}: rtps_protection_kind is NONE" in told.text
        assert {step.path for step in told.steps} >= {b.topic_rules[0].location.path}


@pytest.mark.parametrize("starts", [{(THIRD, 0)}, {(TALKER, 0), (THIRD, 0)}])
def test_who_joins_and_who_starts_there_by_itself_is_told(starts: set[tuple[int, int]]) -> None:
    """That the other one starts there too, at some time until the claim's end, does not matter: it joins."""
    asked = replace(claim(at(TALKER), at(THIRD), kind=ClaimKind.SEPARATE_DOMAINS), starts=frozenset(starts))
    system = replace(shut_out().system(), claims=(asked,))
    answer = NativeEngine([system]).answers[0][asked.id]
    told = describe_claim(system, asked, answer).text
    assert told.startswith(
        "/talker can join domains 0 to 0. By its own implementation's reading of its permissions, /third"
    )


def test_two_whom_different_peers_let_into_one_domain() -> None:
    """Neither starts there by what its own implementation alone makes of its permissions."""
    b = chain()
    b.trust_domain([b.certificate(authority=True)], [PERMISSIONS_CA], GOVERNANCE)
    b.certificates[-2] = replace(b.certificates[-2], issuers=frozenset({len(b.certificates) - 1}))
    b.enclaves[THIRD] = replace(b.enclaves[THIRD], trust_domain=1)
    asked = claim(at(TALKER), at(THIRD), kind=ClaimKind.SEPARATE_DOMAINS)
    system = replace(b.system(), claims=(asked,))
    told = describe_claim(system, asked, NativeEngine([system]).answers[0][asked.id])
    assert told.text == "/talker and /third can both join domains 0 to 0, but different peers accept each."


def test_every_hop_is_explained() -> None:
    """By a line for each end, whoever attacks and however many trust domains there are."""
    told = 0
    for seed in range(tried(240)):
        system = with_claims(random_system(seed), seed, 6)
        for asked, answer in ((each, NativeEngine([system]).answers[0][each.id]) for each in system.claims):
            for hop in answer.path:
                ends = (hop.sender is not None or not asked.source.channels) + (
                    hop.receiver is not None or not asked.target.channels
                )
                case = at_hop(Case(system, {Role.TRUST_DOMAIN: 0}), hop)
                assert len(hop_ways(asked, case, hop)) == ends, (seed, asked.id, hop)
                told += 1
    assert told > tried(100)


@pytest.mark.parametrize(("kinds", "needs"), [({}, False), (dict.fromkeys(("rtps", "metadata", "data"), NONE), True)])
def test_a_way_that_needs_no_attack_is_told_so_whoever_is_asked_about(
    kinds: dict[str, ProtectionKind], needs: bool
) -> None:
    """Where anybody can send, the shortest way leaves the listener out, as no right does."""
    asked = claim(at(TALKER), at(THIRD))
    system = replace(weak(**kinds).system(), claims=(asked,))
    told = describe_claim(system, asked, NativeEngine([system]).answers[0][asked.id]).text
    assert ("(if some of those named attack)" in told) == needs
    assert ("(no attack is needed)" in told) != needs


def test_what_is_told_to_need_no_attack_needs_none() -> None:
    told = 0
    for seed in range(tried(480)):
        system = with_claims(random_system(seed), seed, 6)
        for asked in system.claims:
            answer = NativeEngine([system]).answers[0][asked.id]
            if answer.path and "no attack is needed" in describe_claim(system, asked, answer).text:
                honest = replace(asked, attacker=Attacker.HONEST)
                alone = replace(system, claims=(honest,))
                assert NativeEngine([alone]).answers[0][honest.id].status is Status.VIOLATED, (seed, asked.id)
                told += asked.attacker is not Attacker.HONEST
    assert told > tried(20)


def test_of_many_witnesses_the_plainest_is_told() -> None:
    """A flip for each preference: the default partition, users' topics, names in documents, no right on it, short."""
    base = healthy()
    channel = base.channels[0]
    names = ("rt/some_longer_name", "rt/b", "rt/rosout", "rq/x", "rt/a", "rt/c")
    channels = tuple(
        channel._replace(topic=name, partition="p" if name == "rt/a" else "", infinite=name == "rt/c") for name in names
    )
    system = replace(base, channels=channels, rules=(), grants=())
    witnesses = [{Role.TRUST_DOMAIN: 0, Role.ENCLAVE: 0, Role.CHANNEL: number} for number in range(len(names))]
    told = []
    while witnesses:
        best = plainest(system, witnesses)
        told.append(names[best[Role.CHANNEL]])
        witnesses.remove(best)
    assert told == ["rt/b", "rt/some_longer_name", "rt/c", "rq/x", "rt/rosout", "rt/a"]
