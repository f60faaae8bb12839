"""KA64x: what a policy says and the keystore does not grant, and the reverse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from keystore_audit.findings import Finding, Severity
from keystore_audit.intent.policy import Policy, read_policy
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.rules.judge import Judgement, judge
from tests.model.drifting import compared, policy_of
from tests.rules.divergent import chosen, ruled
from tests.rules.evidence import allow, context, defect, enclave, grant, keystore, permissions, rules_of, text

POLICIES = Path(__file__).resolve().parents[2] / "sample_keystores/policies"
P7S = "enclaves/talker/permissions.p7s"
TALKER = "talker"
BOTH = "talker_and_listener"


def granted(*rules: Any, **more: Any) -> Keystore:
    """The talker alone, granted these rules."""
    return keystore(enclave("/talker", permissions=permissions(P7S, grant("/talker", *rules, **more))))


CHATTER = allow(["rt/chatter"])
UNCLEAR = permissions(P7S, defects=(defect(Kind.XML_AMBIGUOUS, P7S),))
LISTENER = enclave(
    "/listener",
    permissions=permissions("enclaves/listener/permissions.p7s", grant("/listener", allow([], ["rt/chatter"]))),
)


def policy(name: str) -> Policy:
    return read_policy(POLICIES / f"{name}.policy.xml")


def judged(store: Keystore, meant: Policy | str, *profiles: str, domain: int | None = None) -> Judgement:
    said = policy(meant) if isinstance(meant, str) else meant
    about = context(store, profiles=chosen(*profiles), drift=compared(said, store, *profiles, domain=domain))
    return judge(about, rules_of("drift"))


def spoken(store: Keystore, meant: Policy | str, *profiles: str) -> tuple[Finding, ...]:
    return judged(store, meant, *profiles).findings


@pytest.mark.parametrize("held", [permissions(P7S, grant("/listener", allow([], ["rt/chatter"]))), UNCLEAR, None])
def test_an_enclave_that_nobody_reviewed_is_high_whatever_it_may_do(held: Any) -> None:
    talker = enclave("/talker", permissions=permissions(P7S, grant("/talker", CHATTER)))
    found = spoken(keystore(talker, enclave("/listener", permissions=held)), TALKER)
    assert [each.severity for each in found if each.code == "KA644"] == [Severity.HIGH]
    assert "KA644" not in {each.code for each in spoken(keystore(talker), TALKER)}


@pytest.mark.parametrize(
    ("rules", "words"),
    [
        ([allow(["rt/chatter", "rt/map"])], "publish /map (topic), but its permissions let it."),
        ([allow(["rt/chatter"], ["rt/chatter"])], "subscribe to /chatter (topic)"),
        ([allow(["rt/chatter", "rt/m*"])], "publish names like /m (topic)"),
        ([allow(["rt/chatter", "map"])], 'publish "map"'),
        ([ruled(publish=[(["rt/chatter"], ["", "lab"])])], "in partition 'lab'"),
    ],
)
def test_what_goes_beyond_the_policy(rules: list[Any], words: str) -> None:
    (finding,) = spoken(granted(*rules), TALKER)
    assert (finding.code, finding.severity) == ("KA641", Severity.HIGH)
    assert words in finding.message
    assert finding.locations[-1].path.endswith("talker.policy.xml")


def test_a_default_that_allows_goes_beyond_any_policy() -> None:
    (finding,) = spoken(granted(CHATTER, default_allow=True), TALKER, "spec")
    assert (finding.code, finding.severity, finding.locations[0].line) == ("KA641", Severity.HIGH, 50)


def test_no_grant_and_no_permissions_are_told_apart() -> None:
    other = permissions(P7S, grant("/somebody", CHATTER))
    (finding,) = spoken(keystore(enclave("/talker", permissions=other)), TALKER)
    assert finding.message.endswith("its permissions hold no grant for it.")
    found = spoken(keystore(enclave("/talker", permissions=None), LISTENER), BOTH)
    assert [each.message.rpartition(", but ")[2] for each in found] == ["it has no permissions."]


def test_implementations_that_differ_are_told_apart() -> None:
    """An old grant before the one in force: Cyclone DDS 11 stops at the first, out of date or not."""
    old = grant("/talker", allow(["rt/map"]), not_after=text("2021-01-01T00:00:00", 41))
    store = keystore(enclave("/talker", permissions=permissions(P7S, old, grant("/talker", CHATTER))))
    found = spoken(store, TALKER, "fastdds-3.6", "cyclonedds-11")
    assert sorted((finding.code, finding.profiles) for finding in found) == [
        ("KA640", ("cyclonedds-11",)),
        ("KA641", ("cyclonedds-11",)),
    ]


def test_a_right_by_the_document_of_another_is_said_of_those_who_take_it(tmp_path: Path) -> None:
    """A keystore as sros2 makes it of the very policy: Cyclone DDS alone takes /arm/left's document from /arm."""
    wants = '<profiles><profile node="n" ns="/"><topics publish="ALLOW"><topic>{}</topic></topics></profile></profiles>'
    meant = policy_of(tmp_path, wants.format("chatter"), "/arm", "/arm/left")

    def found(*profiles: str, other: str = "/arm/left") -> dict[str, set[tuple[str, ...]]]:
        held = [
            enclave(path, permissions=permissions(f"enclaves{path}/permissions.p7s", grant(path, rights)))
            for path, rights in (("/arm", CHATTER), (other, allow(["rt/chatter", "rt/map"])))
        ]
        by_enclave: dict[str, set[tuple[str, ...]]] = {}
        for each in spoken(keystore(*held), meant, *profiles):
            if each.code == "KA641" and each.enclave is not None:
                by_enclave.setdefault(each.enclave, set()).add(each.profiles)
        return by_enclave

    assert found("fastdds-3.6", "cyclonedds-11") == {"/arm": {("cyclonedds-11",)}, "/arm/left": {()}}
    assert found("cyclonedds-11") == {"/arm": {()}, "/arm/left": {()}}
    assert found("fastdds-3.6") == {"/arm/left": {()}}
    assert "/arm" not in found("fastdds-3.6", "cyclonedds-11", other="/leg")


@pytest.mark.parametrize("others", [("/left",), ("/left", "/right", "/rear")])
def test_what_an_enclave_can_present_is_one_finding(others: tuple[str, ...], tmp_path: Path) -> None:
    """Cyclone DDS finds all parts of `CN=/` in every subject; that this is so is told once."""
    nothing = '<profiles><profile node="n" ns="/"/></profiles>'
    held = [
        enclave(path, permissions=permissions(f"enclaves{path}/permissions.p7s", grant(path, CHATTER)))
        for path in ("/", *others)
    ]
    found = spoken(keystore(*held), policy_of(tmp_path, nothing, "/", *others), "cyclonedds-11")
    told = [
        each.message for each in found if each.code == "KA641" and each.enclave == "/" and "present" in each.message
    ]
    more = "'enclaves/left/permissions.p7s' and 2 more, which it can present, let" if others[1:] else "present, lets"
    assert [more in each for each in told] == [True]
