"""KA63: services and actions as ROS 2 has them, and the usual topics; one change makes a rule speak."""

from __future__ import annotations

import pytest

from keystore_audit.findings import Finding, Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import Rule
from keystore_audit.model.interpret import interpret
from keystore_audit.model.names import PARAMETER_SERVICES
from keystore_audit.model.participants.usability import Usabilities
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
    permissions,
    rules_of,
    topic_rule,
)

OWN = rules_of("ros")
DISCOVERY = allow(["ros_discovery_info"], ["ros_discovery_info"])
USUAL = allow(["rt/rosout", "rt/parameter_events", "rr/*Reply"], ["rt/parameter_events"])
"""All that KA636 asks for in an enclave of nodes without names."""
STOCK = ["rt/*", "rq/*Request", "rr/*Reply"]
SET, SET_REPLY = "rq/arm/set_parametersRequest", "rr/arm/set_parametersReply"
CHANGE, CHANGE_REPLY = "rq/arm/change_stateRequest", "rr/arm/change_stateReply"
PARTS = ("cancel_goal", "get_result", "send_goal")
GOALS = [f"rq/move/_action/{part}Request" for part in PARTS]
RESULTS = [f"rr/move/_action/{part}Reply" for part in PARTS]
STATUS = ["rt/move/_action/feedback", "rt/move/_action/status"]


def two(talker: Rule, listener: Rule | None = None, *more: Rule) -> Keystore:
    """Two enclaves with these rules."""
    own = permissions("enclaves/talker/permissions.p7s", grant("/talker", talker, *more, DISCOVERY))
    listening = listener or allow(["rt/a"])
    other = permissions("enclaves/listener/permissions.p7s", grant("/listener", listening, DISCOVERY))
    return keystore(enclave("/talker", permissions=own), enclave("/listener", permissions=other))


def spoken(store: Keystore, *names: str) -> tuple[Finding, ...]:
    """What these rules say of the keystore, but for what its nodes lack."""
    return tuple(finding for finding in _judged(store, *names) if finding.code != "KA636")


def lacking(store: Keystore, *names: str) -> tuple[Finding, ...]:
    """What is said of topics and services that nodes lack."""
    return tuple(finding for finding in _judged(store, *names) if finding.code == "KA636")


def _judged(store: Keystore, *names: str) -> tuple[Finding, ...]:
    profiles, accesses = chosen(*names), views(store)
    meaning = interpret(store, profiles, AT, accesses, Usabilities(None, accesses))
    return judge(context(store, meaning=meaning, profiles=profiles), OWN).findings


@pytest.mark.parametrize(
    "store",
    [
        two(allow(["rq/addRequest"], ["rr/addReply"]), allow(["rr/addReply"], ["rq/addRequest"])),
        two(allow(GOALS, [*RESULTS, *STATUS]), allow([*RESULTS, *STATUS], GOALS)),
        two(allow([SET, SET_REPLY], [SET, SET_REPLY])),
        two(allow(STOCK, STOCK), allow([SET_REPLY, CHANGE_REPLY], [SET, CHANGE])),
        two(allow(["rq/arm/*Request"], ["rr/arm/*Reply"])),
    ],
)
def test_what_is_whole_and_ones_own_is_no_finding(store: Keystore) -> None:
    assert spoken(store) == ()


@pytest.mark.parametrize(
    ("calls", "answers", "node"),
    [
        ([SET], [SET_REPLY], "/arm"),
        (["rq/*Request"], [SET_REPLY], "/arm"),
        (["rq/arm/*"], ["rr/arm/*Reply"], "/arm/a"),
        (["rq/*/set_parametersRequest"], ["rr/robot[12]/*"], "/robot1"),
        ([SET], ["rr/a*Reply"], "/arm"),
        (["rq/[ab]*/set_parametersRequest"], ["rr/[bc]*Reply"], "/b"),
        (["rq/?/set_*Request"], ["rr/[!a]/*s*Reply"], "/b"),
        (["*"], ["rr/arm/*"], "/arm/a"),
    ],
)
def test_parameters_of_others_by_names_and_by_patterns(calls: list[str], answers: list[str], node: str) -> None:
    found = [f for f in spoken(two(allow(calls), allow(answers))) if f.code == "KA632"]
    assert [(f.severity, f.enclave) for f in found] == [(Severity.HIGH, "/talker")]
    assert f"set parameters of the node {node} in the enclave /listener" in found[0].message
    assert [place.path for place in found[0].locations] == [
        "enclaves/talker/permissions.p7s",
        "enclaves/listener/permissions.p7s",
    ]


def test_a_deny_rule_before_it_takes_the_call_back() -> None:
    denied = allow(["rq/*/set_parameters*"], allows=False)
    owner = allow([SET_REPLY, "rr/leg/*Reply"], [SET, "rq/leg/*Request"])
    calls = [f for f in spoken(two(denied, owner, allow(["rq/*Request"]))) if f.code == "KA632"]
    assert [f.severity for f in calls] == [Severity.LOW]
    only_leg = allow(["rq/arm/*"], allows=False)
    (high,) = (f for f in spoken(two(only_leg, owner, allow(["rq/*Request"]))) if f.code == "KA632")
    assert "set parameters of the node /leg in" in high.message


def test_who_answers_by_a_pattern_what_others_list() -> None:
    listing = allow(["rr/addReply", *RESULTS, *STATUS], ["rq/addRequest", *GOALS])
    store = two(allow(["rr/*Reply"], ["rq/*Request"]), listing)
    (finding,) = (f for f in spoken(store) if f.code == "KA634")
    assert finding.message == "/talker may answer /add and 1 more by a pattern, in the place of /listener."
    assert [place.path for place in finding.locations] == [
        "enclaves/talker/permissions.p7s",
        "enclaves/listener/permissions.p7s",
    ]


@pytest.mark.parametrize(
    ("topics", "severity"),
    [
        (allow(["rt/*_action/status"]), Severity.MEDIUM),
        (allow(["rt/move/*"]), Severity.MEDIUM),
        (allow([], ["rt/move/*"]), Severity.LOW),
        (allow(["rt/arm/*"]), Severity.INFO),
        (allow(["rt/arm/?*"]), Severity.INFO),
        (allow(["rt/move/_action/*"]), None),
        (allow(["rt/camera_?"]), None),
        (allow(["rt/*/image"]), None),
        (allow(STOCK, STOCK), None),
        (allow(["rt/*"]), None),
    ],
)
def test_patterns_that_take_in_actions(topics: Rule, severity: Severity | None) -> None:
    found = [f for f in spoken(two(topics, allow([*RESULTS, *STATUS], GOALS))) if f.code == "KA635"]
    assert [finding.severity for finding in found] == ([severity] if severity else [])
    if severity is Severity.MEDIUM:
        assert "such as /move, which /listener serves" in found[0].message


def test_a_deny_rule_keeps_actions_out() -> None:
    denied = allow(["*/_action/*"], ["*/_action/*"], allows=False)
    assert [f.code for f in spoken(two(denied, None, allow(["rt/arm/*"], ["rt/arm/*"])))] == []


def test_without_discovery_no_node_is_made() -> None:
    def store(*rules: Rule) -> Keystore:
        own = permissions("enclaves/talker/permissions.p7s", grant("/talker", *rules))
        return keystore(enclave("/talker", permissions=own))

    (finding,) = lacking(store(allow(["rt/chatter"])))
    assert (finding.code, finding.severity) == ("KA636", Severity.MEDIUM)
    assert finding.message == (
        "/talker lacks the right to publish ros_discovery_info, subscribe to ros_discovery_info. "
        "No ROS 2 node of it is made."
    )
    assert lacking(store(allow(["square"]))) == (), "no ROS 2 name at all"
    apart = ruled(publish=[(["rt/chatter", "ros_discovery_info"], ["robot1"])])
    assert [each.message for each in lacking(store(apart))] == [finding.message], "ROS 2 is in no partition"
    assert lacking(store(allow(["rt/a", "ros_discovery_*"], ["ros_*"]), USUAL)) == ()
    denied = allow(["ros_*"], allows=False)
    (half,) = lacking(store(denied, allow(["rt/a", "ros_discovery_info"], ["ros_discovery_info"])))
    assert half.message == "/talker lacks the right to publish ros_discovery_info. No ROS 2 node of it is made."
    assert half.profiles == ()


@pytest.mark.parametrize(
    ("open_", "under"),
    [
        ("rt/*", ()),  # none of it is about ros_discovery_info
        ("ros_*", None),
        ("[^x]os_*", ("cyclonedds-0.10", "cyclonedds-11")),  # to whom the range is `^` or `x`
    ],
)
def test_what_the_governance_leaves_open_needs_no_grant(open_: str, under: tuple[str, ...] | None) -> None:
    """Each implementation is asked whether its participant may have ros_discovery_info."""
    free = topic_rule(open_, enable_read_access_control=False, enable_write_access_control=False)
    own = permissions("enclaves/talker/permissions.p7s", grant("/talker", allow(["rt/chatter"]), USUAL))
    said = governance(domain_rule(free, topic_rule("*")))
    found = lacking(keystore(enclave("/talker", permissions=own, governance=said)))
    assert [(f.severity, f.profiles) for f in found] == ([] if under is None else [(Severity.MEDIUM, under)])


@pytest.mark.parametrize(("pattern", "is_ros"), [("Square*", False), ("ros*", False), ("rt/*", True), ("*/a", True)])
def test_patterns_of_plain_dds_make_no_node(pattern: str, is_ros: bool) -> None:
    """An application without ROS 2 has patterns too, and needs no ros_discovery_info."""
    own = permissions("enclaves/talker/permissions.p7s", grant("/talker", allow([pattern], ["Circle"])))
    found = lacking(keystore(enclave("/talker", permissions=own)))
    assert [finding.code for finding in found] == (["KA636"] if is_ros else [])


def _node(*services: str) -> Rule:
    answers = [f"rr/arm/{service}Reply" for service in (*PARAMETER_SERVICES, *services)]
    asked = [f"rq/arm/{service}Request" for service in (*PARAMETER_SERVICES, *services)]
    return allow(["rt/rosout", "rt/parameter_events", *answers], ["rt/parameter_events", *asked])


def test_nodes_since_iron_describe_their_types() -> None:
    """sros2's policies leave the service out; rclcpp throws where it cannot be made."""
    (finding,) = lacking(two(_node(), USUAL))
    assert (finding.code, finding.severity, finding.enclave) == ("KA636", Severity.MEDIUM, "/talker")
    assert finding.profiles == (), "no difference of implementations: columns of them stay together"
    assert finding.message.startswith(
        "/arm lacks the right to answer get_type_description. Since Iron, nodes then fail to start "
    )
    assert lacking(two(_node("get_type_description"), USUAL)) == ()
    assert lacking(two(_node(), USUAL), "fastdds-2.6", "cyclonedds-0.10") == (), "Cyclone DDS 0.10 is Humble's too"
    assert [each.profiles for each in lacking(two(_node(), USUAL), "fastdds-2.14")] == [()]
    denied = allow(["rr/*/get_type*"], ["rq/*/get_type*"], allows=False)
    own = permissions(
        "enclaves/talker/permissions.p7s", grant("/talker", denied, _node("get_type_description"), DISCOVERY)
    )
    assert [each.code for each in lacking(keystore(enclave("/talker", permissions=own)))] == ["KA636"]
    free = topic_rule("r[qr]/*", enable_read_access_control=False, enable_write_access_control=False)
    said = governance(domain_rule(free, topic_rule("*")))
    assert lacking(keystore(enclave("/talker", permissions=own, governance=said))) == (), "needs no grant"


def test_halves_that_are_too_hard_to_tell_are_said() -> None:
    """No right hangs on it, so that the audit is complete all the same."""
    hard = [f"rq/*{letter}*Request" for letter in "abcdefghij"]
    (finding,) = (f for f in spoken(two(allow(hard))) if f.code == "KA630")
    assert finding.severity is Severity.LOW
    assert "could not be worked out" in finding.message


GET, GET_REPLY = "rq/arm/get_parametersRequest", "rr/arm/get_parametersReply"


GET, GET_REPLY = "rq/arm/get_parametersRequest", "rr/arm/get_parametersReply"


def test_reading_parameters_weighs_less() -> None:
    (finding,) = spoken(two(allow([GET], [GET_REPLY]), allow([GET_REPLY], [GET])))
    assert (finding.code, finding.severity) == ("KA632", Severity.LOW)
    assert "read parameters of the node /arm" in finding.message
