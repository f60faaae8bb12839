"""ROS names and DDS names, compared with sros2's own translation of its policies and with what rmw accepts."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from keystore_audit.intent.intent import is_ros_name
from keystore_audit.model.names import (
    PARAMETER_SERVICES,
    RosKind,
    dds_channels,
    parse_dds_name,
    ros_name,
)

tokens = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
full_names = st.lists(tokens, min_size=1, max_size=4).map(lambda path: "".join(f"/{token}" for token in path))


@pytest.mark.parametrize(
    ("dds", "expected"),
    [
        ("rt/chatter", "/chatter (topic)"),
        ("rt/ns/robot_1/scan", "/ns/robot_1/scan (topic)"),
        ("rq/addRequest", "/add (service request)"),
        ("rr/addReply", "/add (service reply)"),
        ("rq/talker/get_parametersRequest", "/talker/get_parameters (service request)"),
        ("rt/fib/_action/feedback", "/fib (action feedback)"),
        ("rt/fib/_action/status", "/fib (action status)"),
        ("rq/fib/_action/send_goalRequest", "/fib (action send_goal request)"),
        ("rr/ns/fib/_action/get_resultReply", "/ns/fib (action get_result reply)"),
        ("rs/add", "/add (service)"),
        ("ros_discovery_info", "ros_discovery_info (discovery)"),
        # Named like an action's but none: an action has a name, and these five channels only.
        ("rt/_action/feedback", "/_action/feedback (topic)"),
        ("rt/fib/_action/send_goal", "/fib/_action/send_goal (topic)"),
        ("rt/fib/_action/other", "/fib/_action/other (topic)"),
        ("rq/fib/_action/feedbackRequest", "/fib/_action/feedback (service request)"),
        ("rt/a/_action/b/_action/status", "/a/_action/b (action status)"),
        ("rt/addRequest", "/addRequest (topic)"),
    ],
)
def test_ros_name_reads_as_users_of_ros_say_it(dds: str, expected: str) -> None:
    assert ros_name(dds) == expected


@given(name=st.text("/ab_1é \n-", max_size=8))
def test_full_names_are_those_of_rmw(name: str) -> None:
    """The order of rmw's own checks (validate_full_topic_name.c)."""
    refused = (
        not name
        or not name.startswith("/")
        or name.endswith("/")
        or any(character not in "/ab_1" for character in name)
        or "//" in name
        or any(token[:1].isdigit() for token in name.split("/"))
    )
    assert is_ros_name(name) is not refused


@given(name=full_names)
def test_every_right_comes_back_to_its_name(name: str) -> None:
    for operation, kind in [
        ("publish", RosKind.TOPIC),
        ("request", RosKind.SERVICE),
        ("reply", RosKind.SERVICE),
        ("call", RosKind.ACTION),
        ("execute", RosKind.ACTION),
    ]:
        for _, dds in dds_channels(operation, name):
            found = parse_dds_name(dds)
            assert found is not None
            if "_action" not in name:
                assert (found.kind, found.name) == (kind, name)


def test_every_right_has_the_channels_of_the_table() -> None:
    def channels(operation: str) -> dict[str, set[str]]:
        found: dict[str, set[str]] = {}
        for direction, dds in dds_channels(operation, "/f"):
            found.setdefault(direction.value, set()).add(dds)
        return found

    services = ("cancel_goal", "get_result", "send_goal")
    requests = {f"rq/f/_action/{service}Request" for service in services}
    replies = {f"rr/f/_action/{service}Reply" for service in services}
    topics = {"rt/f/_action/feedback", "rt/f/_action/status"}
    assert channels("publish") == {"publish": {"rt/f"}}
    assert channels("subscribe") == {"subscribe": {"rt/f"}}
    assert channels("relay") == {"relay": {"rt/f"}}
    assert channels("request") == {"publish": {"rq/fRequest"}, "subscribe": {"rr/fReply"}}
    assert channels("reply") == {"publish": {"rr/fReply"}, "subscribe": {"rq/fRequest"}}
    assert channels("call") == {"publish": requests, "subscribe": replies | topics}
    assert channels("execute") == {"publish": replies | topics, "subscribe": requests}


Rights = dict[str, set[tuple[str, str]]]
"""Enclave path: (DDS operation, DDS topic)"""


def full_name(name: str, namespace: str, node: str) -> str:
    """As sros2's permissions.xsl does it."""
    if name.startswith("/"):
        return name
    path = [namespace, node, name[1:]] if name.startswith("~") else [namespace, name]
    return "/" + "/".join(part.strip("/") for part in path if part.strip("/"))


def rights_by_policy(path: Path) -> Rights:
    """What `dds_channels` makes of a policy of sros2."""
    tree = etree.parse(path)
    tree.xinclude()
    found: Rights = {}
    for enclave in tree.iter("enclave"):
        rights = found.setdefault(str(enclave.get("path")), set())
        for profile in enclave.iter("profile"):
            namespace, node = str(profile.get("ns")), str(profile.get("node"))
            for group in profile.iter("topics", "services", "actions"):
                for operation in ("publish", "subscribe", "request", "reply", "call", "execute"):
                    if group.get(operation) == "ALLOW":
                        for element in group:
                            full = full_name(str(element.text), namespace, node)
                            rights.update((direction.value, dds) for direction, dds in dds_channels(operation, full))
    return found


def rights_by_permissions(path: Path) -> Rights:
    """What sros2 made of the same policy."""
    return {
        str(grant.findtext("subject_name")).removeprefix("CN="): {
            (str(criterion.tag), str(topic.text))
            for rule in grant.iter("allow_rule")
            for criterion in rule.iter("publish", "subscribe")
            for topic in criterion.iter("topic")
            if topic.text != "ros_discovery_info"
        }
        for grant in etree.parse(path).iter("grant")
    }


@pytest.mark.parametrize("policy", ["talker_listener", "add_two_ints", "minimal_action", "sample"])
def test_channels_are_those_that_sros2_writes(shared: Path, policy: str) -> None:
    folder = shared / "reference" / "policies" / "sros2-rolling"
    expected = rights_by_permissions(folder / "permissions" / policy / "permissions.xml")
    assert expected
    assert rights_by_policy(folder / f"{policy}.policy.xml") == expected


def test_parameter_services_are_those_that_a_stock_node_offers(repository: Path) -> None:
    enclave = repository / "sample_keystores/stock/sample_policy/enclaves/sample_policy/admin"
    (rights,) = rights_by_permissions(enclave / "permissions.xml").values()
    names = [parse_dds_name(dds) for operation, dds in rights if operation == "publish"]
    services = {name.name for name in names if name is not None and name.kind is RosKind.SERVICE}
    assert services == {*(f"/admin/{service}" for service in PARAMETER_SERVICES), "/add_two_ints"}
