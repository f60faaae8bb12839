"""KA4: one change to a governance makes a rule speak, and no other."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.typed import DomainRule, ProtectionKind
from keystore_audit.rules.governance import domain_rules
from tests.cli.keystores import AT, answer, rule
from tests.cli.keystores import keystore as built
from tests.keystore.builder import GOVERNANCE
from tests.rules.evidence import (
    Change,
    allow,
    becomes,
    both,
    defect,
    domain_rule,
    enclave,
    findings,
    governance,
    grant,
    healthy,
    judged,
    keystore,
    open_codes,
    permissions,
    signed,
    topic_rule,
)

P7S = "enclaves/governance.p7s"
NONE, SIGN, ENCRYPT = ProtectionKind.NONE, ProtectionKind.SIGN, ProtectionKind.ENCRYPT


def governed(*rules: DomainRule, **more: Any) -> Change:
    return both(governance=governance(*rules, **more))


def kinds(rtps: ProtectionKind, metadata: ProtectionKind, data: ProtectionKind, **more: Any) -> Change:
    topic = topic_rule(metadata_protection_kind=metadata, data_protection_kind=data)
    return governed(domain_rule(topic, rtps_protection_kind=rtps, **more))


def test_signing_hides_nothing_in_discovery() -> None:
    signed = ProtectionKind.SIGN_WITH_ORIGIN_AUTHENTICATION
    assert becomes(kinds(signed, ENCRYPT, ENCRYPT, discovery_protection_kind=SIGN)) == ["KA408", "KA409"]


@pytest.mark.parametrize(
    ("expression", "told"),
    [
        ("*", {}),
        ("rt/*", {(): True}),
        # A class of characters to POSIX, which holds the r; to Cyclone DDS a set, and a ] behind it.
        ("[[:lower:]]*", {("fastdds-3.6",): False, ("cyclonedds-11",): True}),
    ],
)
def test_topics_without_a_rule_are_told_for_each_reading(
    expression: str, told: dict[tuple[str, ...], bool], tmp_path: Path
) -> None:
    """`told`: by profiles, whether ros_discovery_info is among them."""
    text = GOVERNANCE.replace(b"<topic_expression>*<", f"<topic_expression>{expression}<".encode())
    root = built(tmp_path / "k", {"/talker": (rule(("rt/chatter", "ros_discovery_info")),)}, governance=text)
    profiles = [part for name in ("fastdds-3.6", "cyclonedds-11") for part in ("--profile", name)]
    _code, out = answer("audit", root, "--engine", "native", "--format", "json", "--at", AT, *profiles)
    found = [each for each in json.loads(out)["findings"] if each["code"] == "KA418"]
    assert {tuple(each["profiles"]): "'ros_discovery_info'" in each["message"] for each in found} == told
    assert len({each["fingerprint"] for each in found}) == len(told)


def test_nothing_is_open_in_a_document_that_nobody_takes() -> None:
    """An invalid XML under a bad signature: every implementation refuses it before it looks."""
    for kind in (Kind.SCHEMA_INVALID, Kind.XML_AMBIGUOUS, Kind.EMPTY_TOPIC):
        broken = signed(P7S, defects=(defect(Kind.NO_TEXT_PLAIN, P7S),))
        change = governed(signed=broken, defects=(defect(kind, P7S),))
        assert len(becomes(change)) == 2
        assert open_codes(change(healthy())) == set()


@given(
    rtps=st.sampled_from(ProtectionKind),
    metadata=st.sampled_from(ProtectionKind),
    data=st.sampled_from([NONE, SIGN, ENCRYPT]),
)
def test_what_the_kinds_say_together(rtps: ProtectionKind, metadata: ProtectionKind, data: ProtectionKind) -> None:
    """Stated anew from who holds which key: nobody, every participant, or those that may read (docs/model.md)."""
    found = set(becomes(kinds(rtps, metadata, data)))
    outsider_reads = not (rtps.encrypts or metadata.encrypts or data.encrypts)
    participant_reads = not (metadata.encrypts or data.encrypts)
    outsider_forges = rtps is NONE and metadata is NONE and data is NONE
    assert ("KA412" in found) is outsider_reads
    assert ("KA413" in found) is (participant_reads and not outsider_reads)
    assert ("KA414" in found) is outsider_forges
    assert ("KA411" in found) is (metadata is NONE and not outsider_forges)
    assert ("KA415" in found) is (metadata.encrypts and not data.encrypts)
    assert {"KA407", "KA408"} & found == ({"KA407"} if rtps is NONE else set() if rtps.encrypts else {"KA408"})


@pytest.mark.parametrize(
    ("low", "high", "says"), [(3, None, "only domain 3"), (None, 5, "no <min>"), (None, None, "no bounds")]
)
def test_what_an_open_range_means_to_whom(low: int | None, high: int | None, says: str) -> None:
    found = findings("KA419", judged(governed(domain_rule(domains=[(low, high), (0, 0)]))(healthy())))
    assert says in found[0].message


@pytest.mark.parametrize(("highest", "profiles"), [(230, None), (232, ("cyclonedds-0.10", "cyclonedds-11")), (233, ())])
def test_permissions_name_domains_too(highest: int, profiles: tuple[str, ...] | None) -> None:
    document = permissions("enclaves/talker/permissions.p7s", grant("/talker", allow(["rt/a"], domains=[(0, highest)])))
    found = findings("KA420", judged(keystore(enclave("/talker", permissions=document))))
    assert [finding.profiles for finding in found] == ([] if profiles is None else [profiles])


def unread(kind: Kind) -> Change:
    return governed(defects=(defect(kind, P7S),))


@given(
    ranges=st.lists(st.tuples(st.integers(0, 12), st.integers(0, 12)), min_size=1, max_size=5),
)
def test_the_domain_rules_that_decide_are_those_that_come_first_somewhere(ranges: list[tuple[int, int]]) -> None:
    rules = [domain_rule(domains=[(low, max(low, high))]) for low, high in ranges]
    first = {
        next(n for n, (low, high) in enumerate(ranges) if low <= domain <= max(low, high))
        for domain in range(13)
        if any(low <= domain <= max(low, high) for low, high in ranges)
    }
    found = [next(n for n, rule in enumerate(rules) if rule is alive) for alive in domain_rules(governance(*rules))]
    assert found == sorted(first)


def test_outcomes_of_a_document_that_could_not_be_read_are_no_pass() -> None:
    outcomes = {
        o.rule: o.outcome.value for o in judged(unread(Kind.SCHEMA_INVALID)(healthy())).outcomes if o.subject == P7S
    }
    assert outcomes["KA401"] == "open"
    assert outcomes["KA403"] == outcomes["KA414"] == "notApplicable"
