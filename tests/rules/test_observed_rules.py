"""KA65x: a right that nodes need and lack, one that they have and never use, and what cannot be told."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit.findings import Finding, Result, Severity
from keystore_audit.intent.intent import IntendedNode
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.layout import LayoutKind, Role
from keystore_audit.model.decision import Decision, LocalRights
from tests.rules.divergent import ruled
from tests.rules.evidence import (
    absent,
    allow,
    domain_rule,
    enclave,
    governance,
    grant,
    healthy,
    keystore,
    laid_out,
    permissions,
)
from tests.rules.observed import (
    does,
    granted,
    graph,
    judged,
    launch,
    log,
    node,
    place,
    spoken,
    uses,
    usual_rules,
    variable,
)

CHATTER = allow(["rt/chatter"])
P7S = "enclaves/talker/permissions.p7s"
TALKS = graph(log("/talker"), does("/talker", "publish", "/chatter"))


def codes(findings: tuple[Finding, ...]) -> list[str]:
    return [finding.code for finding in findings]


@pytest.mark.parametrize(
    ("name", "value", "severity"),
    [
        ("ROS_SECURITY_ENABLE", "true", None),
        ("ROS_SECURITY_ENABLE", "false", Severity.CRITICAL),
        ("ROS_SECURITY_ENABLE", "", Severity.CRITICAL),
        ("ROS_SECURITY_ENABLE", None, Severity.CRITICAL),
        ("ROS_SECURITY_STRATEGY", "Enforce", None),
        ("ROS_SECURITY_STRATEGY", "Permissive", Severity.HIGH),
        ("ROS_SECURITY_KEYSTORE", "/other", Severity.MEDIUM),
        ("ROS_DOMAIN_ID", "42", Severity.HIGH),
        ("ROS_DOMAIN_ID", "0", Severity.LOW),
        ("ROS_DOMAIN_ID", "", Severity.LOW),
        ("ROS_DOMAIN_ID", "9999999999999", Severity.MEDIUM),
        ("ROS_DOMAIN_ID", "two", Severity.MEDIUM),
        ("ROS_DOMAIN_ID", None, Severity.MEDIUM),
        ("RMW_IMPLEMENTATION", "", None),
        ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp", None),
        ("RMW_IMPLEMENTATION", None, Severity.HIGH),
    ],
)
def test_what_a_launch_file_makes_of_security(name: str, value: str | None, severity: Severity | None) -> None:
    spoke = spoken(granted(CHATTER), launch(uses("/talker", "/chatter"), variables=(variable(name, value),)))
    assert [each.severity for each in spoke] == ([severity] if severity is not None else [])
    assert all(each.undecided is (value is None) for each in spoke)


def test_who_accepts_one_process_without_security_does_not_accept_another() -> None:
    off = [replace(variable("ROS_SECURITY_ENABLE", "no"), node="", started=run) for run in ("env -i date", "env -i x")]
    (one,), (other,) = (spoken(granted(CHATTER), launch(variables=(each,))) for each in off)
    assert one.message == other.message
    assert one.fingerprint != other.fingerprint


def test_what_is_not_read_and_speaks_of_security_leaves_the_audit_open_once_a_file() -> None:
    (finding,) = spoken(granted(CHATTER), launch(uses("/talker", "/chatter"), speaking=("One", "Two")))
    assert (finding.code, finding.severity, finding.undecided) == ("KA655", Severity.HIGH, True)
    assert finding.message == "One (and 1 more like it)."
    assert [(each.line, each.beside) for each in finding.locations] == [(7, True), (8, True)]


def test_a_domain_that_is_covered_and_where_one_may_do_nothing() -> None:
    own = permissions(P7S, grant("/talker", allow(["rt/chatter"], domains=((5, 5),))))
    elsewhere = keystore(enclave("/talker", permissions=own), enclave("/listener"))
    (finding,) = spoken(elsewhere, launch(variables=(variable("ROS_DOMAIN_ID", "0"),)))
    assert (finding.code, finding.severity) == ("KA655", Severity.MEDIUM)


def test_a_reason_is_asked_for_once_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """It goes through all that a grant lists: for each right and implementation it took minutes for a hundred nodes."""
    asked: list[object] = []
    decide = LocalRights.decide

    def counted(*args: Any) -> Decision:
        asked.append(args)
        return decide(*args)

    monkeypatch.setattr(LocalRights, "decide", counted)
    store = granted(CHATTER, usual=False)
    (finding,) = spoken(store, TALKS, launch(nodes=(node("/talker"),)), names=("spec", "cyclonedds-0.10"))
    assert "The nearest that may be published is 'rt/chatter'" in finding.message
    assert len(asked) == 1


def test_discovery_is_needed_always() -> None:
    own = permissions(P7S, grant("/talker", CHATTER, *usual_rules("/talker")))
    (finding,) = spoken(keystore(enclave("/talker", permissions=own)), TALKS)
    assert (finding.code, finding.severity) == ("KA650", Severity.HIGH)
    assert "publishes and subscribes to ros_discovery_info" in finding.message


def test_denied_in_one_of_two_domains_is_medium_and_names_it() -> None:
    two = governance(domain_rule(domains=((0, 0), (5, 5))))
    both = [(0, 0), (5, 5)]
    discovery = allow(["ros_discovery_info", "rt/rosout"], ["ros_discovery_info"], domains=both)
    own = permissions(P7S, grant("/talker", allow(["rt/chatter"]), discovery))
    store = keystore(enclave("/talker", permissions=own, governance=two))
    (finding,) = spoken(store, TALKS, names=("spec",))
    assert (finding.code, finding.severity) == ("KA650", Severity.MEDIUM)
    assert "may not in domain 5: " in finding.message
    assert spoken(store, TALKS, names=("spec",), domain=0) == ()
    assert spoken(store, TALKS, names=("spec",), domain=5)[0].severity is Severity.HIGH


def test_an_enclave_that_does_not_start_is_another_rules_matter() -> None:
    store = granted(allow(["rt/map"]), not_after=place_date())
    assert spoken(store, TALKS) == ()


def place_date() -> object:
    from tests.rules.evidence import text

    return text("2021-01-01T00:00:00", 41)


def test_what_cannot_be_read_leaves_the_audit_incomplete() -> None:
    files = {Role.PERMISSIONS: absent(P7S, Status.TOO_LARGE, "it is larger than 4 MB")}
    store = keystore(enclave("/talker", permissions=None, files=files))
    judgement = judged(store, TALKS)
    assert codes(judgement.findings) == ["KA654"]
    assert {each.rule for each in judgement.outcomes if each.outcome is Result.OPEN} == {"KA654"}


# Excess


@pytest.mark.parametrize("rule", [allow(["rt/*"]), allow([], ["rt/arm_?*"])])
def test_a_wildcard_has_no_end(rule: object) -> None:
    (finding,) = spoken(granted(CHATTER, rule), TALKS)
    assert finding.code == "KA651"
    assert "are not bounded by 'robot.graph.json'" in finding.message or "are not bounded by robot" in finding.message
    assert "and infinitely many more." in finding.message


@pytest.mark.parametrize(
    ("topic", "partitions", "excess"),
    [
        ("rt/chatte?", None, "publish /chattea (topic), for one."),
        ("rt/chatte[rz]", None, "publish /chattez (topic), for one."),
        ("rt/chatter", ("ar[m]",), "publish /chatter (topic) in partition 'arm', for one."),
        ("rt/chatte[r]", None, ""),
        ("rt/chatter", ("",), ""),
    ],
)
def test_an_expression_is_an_excess_where_it_names_what_is_not_used(
    topic: str, partitions: tuple[str, ...] | None, excess: str
) -> None:
    wide = ruled(publish=(((topic,), partitions),))
    said = spoken(granted(CHATTER, wide), TALKS, names=("spec",))
    assert codes(said) == ["KA651"] * bool(excess)
    assert all(finding.message.endswith(excess) for finding in said)


def test_nothing_is_excess_where_a_file_could_not_be_worked_out() -> None:
    store = granted(allow(["rt/chatter", "rt/map"]))
    intent = launch(uses("/talker", "/chatter"), nodes=(node("/talker"),), unresolved=("a loop is not run",))
    (finding,) = spoken(store, intent)
    assert (finding.code, finding.severity) == ("KA654", Severity.INFO)
    assert finding.message.startswith("A loop is not run. Nodes may need more than 'robot.graph.json' shows")


def test_a_launch_file_that_names_nothing_shows_no_excess() -> None:
    store = granted(allow(["rt/chatter", "rt/map"]))
    assert spoken(store, launch(nodes=(node("/talker"),))) == ()
    (finding,) = spoken(store, launch(uses("/talker", "/chatter"), nodes=(node("/talker"),)))
    assert finding.message.endswith("check whether a node uses them by their own names.")


# Enclaves and names


def test_one_more_node_in_an_unknown_enclave_is_another_finding() -> None:
    nodes = node("/nav", "/nav/planner"), node("/nav", "/nav/brake")
    one, two, swapped = (spoken(healthy(), launch(nodes=each)) for each in (nodes[:1], nodes, nodes[::-1]))
    assert {each.code for each in (*one, *two, *swapped)} == {"KA652"}
    assert one[0].fingerprint != two[0].fingerprint == swapped[0].fingerprint


def test_a_node_without_a_name_is_compared_with_its_enclave() -> None:
    """What every node needs has to be there, and the enclave itself."""
    unnamed = launch(nodes=(IntendedNode(enclave="/", name="", location=place(1)),))
    (unknown,) = spoken(healthy(), unnamed)
    assert (unknown.code, unknown.severity) == ("KA652", Severity.HIGH)
    assert unknown.message.startswith("A node whose name the file does not say runs in the enclave '/' (it names none)")
    assert spoken(granted(CHATTER, path="/"), unnamed) == ()
    (missing,) = spoken(granted(CHATTER, path="/", usual=False), unnamed)
    assert missing.code == "KA650"
    assert "/rosout" in missing.message


def test_before_foxy_a_node_without_a_name_is_in_some_folder() -> None:
    flat = laid_out(kind=LayoutKind.FLAT)(granted(CHATTER))
    for name, found in (("", False), ("/other", True)):
        nodes = (IntendedNode(enclave="/", name=name, location=place(1)),)
        assert ("KA652" in codes(spoken(flat, launch(nodes=nodes)))) is found


def test_before_foxy_the_enclave_is_the_node() -> None:
    flat = laid_out(kind=LayoutKind.FLAT)(granted(CHATTER))
    assert spoken(flat, graph(log("/"), nodes=(node("/", "/talker"),))) != ()
    assert "KA652" not in codes(spoken(flat, launch(nodes=(node("/", "/talker"),))))


def test_the_folder_of_one_enclave_says_nothing_of_others() -> None:
    one = laid_out(kind=LayoutKind.ENCLAVE)(granted(CHATTER))
    assert spoken(one, graph(*TALKS.rights, log("/somewhere"))) == ()


def test_a_middleware_that_no_profile_speaks_of() -> None:
    """One that is not known here leaves the audit open."""
    for value, undecided in (("rmw_zenoh_cpp", True), ("rmw_fastrtps_cpp", False)):
        files = launch(uses("/talker", "/chatter"), variables=(variable("RMW_IMPLEMENTATION", value),))
        (finding,) = spoken(granted(CHATTER), files, names=("cyclonedds-0.10",))
        assert (finding.code, finding.severity, finding.undecided) == ("KA655", Severity.HIGH, undecided)


@pytest.mark.parametrize("action", ["request", "reply", "call", "execute"])
def test_half_of_a_service_or_action_is_not_enough(action: str) -> None:
    asked = allow(["rq/addRequest", "rr/addReply", *(f"rq/add/_action/{each}Request" for each in ("send_goal", "a"))])
    store = granted(CHATTER, asked)
    intent = graph(*TALKS.rights, does("/talker", action, "/add"))
    (missing,) = (finding for finding in spoken(store, intent) if finding.code == "KA650")
    assert "/add" in missing.message
