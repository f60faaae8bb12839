"""Rules about anomalies: one cause makes one of them speak, and what is in order has no finding."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from keystore_audit.findings import Finding, Result, Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import ProtectionKind
from keystore_audit.model.anomalies.find import anomalies
from keystore_audit.model.divergence.find import divergences
from keystore_audit.profiles import DEFAULT
from keystore_audit.rules.judge import judge
from tests.rules.divergent import chosen, ruled, views
from tests.rules.evidence import (
    AT,
    allow,
    context,
    domain_rule,
    enclave,
    governance,
    grant,
    keystore,
    meaning,
    permissions,
    rules_of,
    topic_rule,
)

OWN = rules_of("anomaly", "anomaly_names")
SIGNED = {"metadata_protection_kind": ProtectionKind.SIGN}
WORDS = [f"rt/*{word}*" for word in ("arm", "base", "camera", "door", "elbow", "finger", "gear", "hand", "imu")]
CHATTER = allow(["rt/chatter"], ["rt/chatter"])


def judged(store: Keystore, *names: str) -> tuple[Finding, ...]:
    """What the rules find, with what implementations read differently already said."""
    profiles, accesses = chosen(*names), views(store)
    known = meaning(
        divergences=divergences(store, profiles, AT, accesses, None), anomalies=anomalies(store, profiles, accesses)
    )
    return judge(context(store, profiles=profiles, meaning=known), OWN).findings


def codes(store: Keystore, *names: str) -> list[str]:
    return sorted(finding.code for finding in judged(store, *names))


def alone(*rules: Any, **more: Any) -> Keystore:
    """A keystore of the talker alone, whose peers are elsewhere."""
    own = permissions("enclaves/talker/permissions.p7s", grant("/talker", *rules, **more))
    return keystore(enclave("/talker", permissions=own))


def governed(*rules: Any) -> Keystore:
    return keystore(enclave("/talker", governance=governance(*rules)))


CASES: dict[str, tuple[Keystore, list[str], Severity]] = {
    "KA422": (governed(domain_rule(topic_rule("rt/*", **SIGNED), topic_rule("rt/a"))), ["KA422"], Severity.HIGH),
    "KA423": (governed(domain_rule(), domain_rule()), ["KA423"], Severity.LOW),
    "KA627": (alone(allow(WORDS[::2], allows=False), allow(WORDS[1::2])), ["KA627"], Severity.MEDIUM),
}


IN_ORDER = {
    "as ros2 security writes": (allow(["rt/a", "rq/addRequest"], ["rr/addReply"]), allow(["ros_discovery_info"])),
    "everything": (allow(["rt/*", "rq/*Request", "rr/*Reply"], ["rt/*"]), allow(["ros_discovery_info"])),
    "repeats within one rule": (allow(["rt/*", "rt/a", "rt/arm/_action/status", "rt/a"]),),
    "discovery in a wider rule": (allow(["*"], ["*"]), allow(["ros_discovery_info"], ["ros_discovery_info"])),
    "expressions that others cover": (allow(["rt/a", "rt/b"]), allow(["rt/a", "rt/c"])),
    "plain DDS": (allow(["Square", "Circle"]),),
    "usual topics": (allow(["rt/rosout", "rt/parameter_events", "rr/n/get_parametersReply"], ["rt/clock"]),),
}


@pytest.mark.parametrize("rules", IN_ORDER.values(), ids=IN_ORDER)
def test_what_is_in_order_has_no_finding(rules: Sequence[Any]) -> None:
    assert codes(alone(*rules)) == []


def test_a_rule_that_is_void_to_some_is_told_with_their_names() -> None:
    """A deny rule for a partition is one for all to Fast DDS, and comes too late; nobody meant to deny more."""
    deny = ruled(allows=False, publish=((("rt/a",), ("lab",)),))
    store = alone(allow(["rt/a"]), deny)
    fast = [name for name in DEFAULT if name.startswith("fastdds")]
    void, same = judged(store)
    assert (void.code, void.severity, list(void.profiles)) == ("KA617", Severity.MEDIUM, fast)
    assert (same.code, list(same.profiles)) == ("KA622", [name for name in DEFAULT if name not in fast])
    assert [(each.code, each.severity, each.profiles) for each in judged(store, "fastdds-3.6")] == [
        ("KA617", Severity.MEDIUM, ())
    ]


@pytest.mark.parametrize(
    ("profile", "domain", "partition", "told"),
    [
        ("fastdds-3.6", 5, None, False),
        ("cyclonedds-11", 5, None, True),
        ("cyclonedds-0.10", 5, None, True),
        ("cyclonedds-0.10", 0, ("lab",), False),
    ],
)
def test_a_denial_changes_something_that_keeps_its_holder_from_endpoints_of_its_own(
    profile: str, domain: int, partition: tuple[str, ...] | None, told: bool
) -> None:
    """Fast DDS goes by it in another domain, Cyclone DDS 0.10 in another partition: without it they exist."""
    own = ((("rt/cmd_vel",), None),)
    later = ruled(domains=((domain, domain),), line=43, publish=((("rt/cmd_vel",), partition),))
    store = alone(ruled(allows=False, publish=own), CHATTER, later)
    assert ("KA622" in codes(store, profile)) is told


def test_a_typing_error_in_a_deny_rule_is_high_where_it_opens_the_topic() -> None:
    (found, *_rest) = judged(alone(allow(["/secret"], allows=False), allow(["rt/*"])))
    assert (found.code, found.severity) == ("KA625", Severity.HIGH)
    assert "'rt/secret'" in found.message
    assert codes(alone(allow(["/secret"], allows=False), CHATTER)) == ["KA622", "KA625"]


def test_too_much_to_compare_leaves_the_audit_incomplete_only_where_a_denial_may_be_void() -> None:
    def outcomes(store: Keystore) -> set[Result]:
        profiles, accesses = chosen(), views(store)
        about = context(store, profiles=profiles, meaning=meaning(anomalies=anomalies(store, profiles, accesses)))
        return {each.outcome for each in judge(about, OWN).outcomes if each.rule == "KA627"}

    assert Result.OPEN in outcomes(CASES["KA627"][0])
    allowing = alone(allow(WORDS[::2]), allow(WORDS[1::2]))
    assert codes(allowing) == ["KA627"]
    assert Result.OPEN not in outcomes(allowing)
