"""Policies are read as sros2 reads them, with file and line; what is none is one clear error; nothing else is read."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from keystore_audit.errors import UsageError
from keystore_audit.intent.intent import Action, Origin
from keystore_audit.intent.policy import Policy, expand, read_policy
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.intended.drift_rights import policy_grant
from keystore_audit.resources import schemas
from tests.model.drifting import listed_in

ROOT = Path(__file__).resolve().parents[2]
OWN = ROOT / "sample_keystores/policies"
SHARED = ROOT.parent / "shared/reference"
XI = 'xmlns:xi="http://www.w3.org/2001/XInclude"'

needs_references = pytest.mark.skipif(not SHARED.exists(), reason="the reference policies are not there")


def written(folder: Path, text: str, name: str = "a.policy.xml") -> Path:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, "utf-8")
    return file


def policy(folder: Path, profile: str, *, ns: str = "/", version: str = "0.2.0") -> Path:
    """A policy with what `profile` lists for one node, each piece on a line of its own."""
    one = f'<profile ns="{ns}" node="talker">\n{profile}\n</profile>'
    if version == "0.1.0":
        return written(folder, f'<policy version="0.1.0" {XI}><profiles>{one}</profiles></policy>')
    enclave = f'<enclave path="/talker"><profiles>{one}</profiles></enclave>'
    return written(folder, f'<policy version="{version}" {XI}><enclaves>{enclave}</enclaves></policy>')


def refused(file: Path, *words: str, include: Path | None = None) -> str:
    """The message, which names all of the words; no other error comes out."""
    with pytest.raises(UsageError) as raised:
        read_policy(file, include)
    for word in words:
        assert word in raised.value.message
    return raised.value.message


def rights(found: Policy) -> list[tuple[str, str, bool]]:
    return [(right.action.value, right.name, right.allow) for right in found.intent.rights]


# What it says


@pytest.mark.parametrize(
    ("ns", "name", "full"),
    [
        ("/", "chatter", "/chatter"),
        ("/", "/chatter", "/chatter"),
        ("/", "~/chatter", "/talker/chatter"),
        ("/", "~chatter", "/talkerchatter"),
        ("/", "~", "/talker"),
        ("/robot", "chatter", "/robot/chatter"),
        ("/robot/", "chatter", "/robot/chatter"),
        ("/robot", "~/chatter", "/robot/talker/chatter"),
        ("", "chatter", "/chatter"),
        ("/", "sensors/*", "/sensors/*"),
    ],
)
def test_names_are_expanded_as_permissions_xsl_does(ns: str, name: str, full: str, tmp_path: Path) -> None:
    file = policy(tmp_path, f'<topics publish="ALLOW"><topic>{name}</topic></topics>', ns=ns)
    assert rights(read_policy(file)) == [("publish", full, True)]


@pytest.mark.parametrize(
    ("name", "full"), [("~chatter", "/r/talker/chatter"), ("~/chatter", "/r/talker/chatter"), ("x", "/r/x")]
)
def test_private_names_of_the_older_version(name: str, full: str, tmp_path: Path) -> None:
    file = policy(tmp_path, f'<topics publish="ALLOW"><topic>{name}</topic></topics>', ns="/r", version="0.1.0")
    found = read_policy(file)
    assert rights(found) == [("publish", full, True)]
    assert [each.enclave for each in found.profiles] == ["/r/talker"]


def test_every_action_with_its_qualifier_and_line(tmp_path: Path) -> None:
    file = policy(
        tmp_path,
        '<topics publish="ALLOW" subscribe="DENY">\n<topic>t</topic></topics>'
        '<services request="ALLOW" reply="DENY">\n<service>s</service></services>'
        '<actions call="DENY" execute="ALLOW">\n<action>a</action>\n<action>b</action></actions>'
        "<topics><topic>nothing</topic></topics>",
    )
    found = read_policy(file).intent
    assert found.origin is Origin.POLICY
    assert {(r.action, r.name, r.allow, r.location.line) for r in found.rights} == {
        (Action.PUBLISH, "/t", True, 3),
        (Action.SUBSCRIBE, "/t", False, 3),
        (Action.REQUEST, "/s", True, 4),
        (Action.REPLY, "/s", False, 4),
        (Action.CALL, "/a", False, 5),
        (Action.EXECUTE, "/a", True, 5),
        (Action.CALL, "/b", False, 6),
        (Action.EXECUTE, "/b", True, 6),
    }
    assert {(r.node, r.enclave, r.location.path, r.location.beside) for r in found.rights} == {
        ("/talker", "/talker", str(file), True)
    }
    assert [(node.name, node.location.line) for node in found.nodes] == [("/talker", 1)]
    assert [(path, place.line) for path, place in found.enclaves] == [("/talker", 1)]


def test_several_profiles_of_one_enclave_are_lost_but_the_first(tmp_path: Path) -> None:
    one = '<profiles type="{}"><profile ns="/" node="{}"/></profiles>\n'
    twice = f'<enclave path="/a">\n{one.format("dds", "x")}{one.format("dds", "y")}</enclave>'
    again = f'<enclave path="/a">{one.format("", "z")}</enclave><enclave path="/b">{one.format("", "w")}</enclave>'
    found = read_policy(written(tmp_path, f'<policy version="0.2.0"><enclaves>{twice}{again}</enclaves></policy>'))
    assert [(each.nodes[0].name, bool(each.lost)) for each in found.profiles] == [
        ("/x", False),
        ("/y", True),
        ("/z", True),
        ("/w", False),
    ]
    assert "grants" in found.profiles[1].lost
    assert "<enclave>" in found.profiles[2].lost


def test_an_action_is_eight_topics_and_denials_come_first(tmp_path: Path) -> None:
    file = policy(
        tmp_path,
        '<actions call="ALLOW"><action>a</action></actions><services reply="DENY"><service>s</service></services>',
    )
    made = policy_grant(read_policy(file).profiles[0]).grant
    assert [rule.allow for rule in made.rules] == [False, True, True]
    listed = [{(c.operation, topic.text) for c in rule.criteria for topic in c.topics} for rule in made.rules]
    assert listed[0] == {(Operation.PUBLISH, "rr/sReply"), (Operation.SUBSCRIBE, "rq/sRequest")}
    assert listed[1] == {
        *((Operation.PUBLISH, f"rq/a/_action/{part}Request") for part in ("cancel_goal", "get_result", "send_goal")),
        *((Operation.SUBSCRIBE, f"rr/a/_action/{part}Reply") for part in ("cancel_goal", "get_result", "send_goal")),
        *((Operation.SUBSCRIBE, f"rt/a/_action/{part}") for part in ("feedback", "status")),
    }
    assert listed[2] == {(operation, "ros_discovery_info") for operation in (Operation.PUBLISH, Operation.SUBSCRIBE)}


@needs_references
@pytest.mark.parametrize("name", ["sample", "single_context", "minimal_action", "talker_listener", "add_two_ints"])
def test_what_sros2_makes_of_it(name: str) -> None:
    """Name by name, the permissions that the real tool made."""
    folder = SHARED / "policies/sros2-rolling"
    found = read_policy(folder / f"{name}.policy.xml")
    expected = listed_in(folder / "permissions" / name / "permissions.xml")
    assert [each.enclave for each in found.profiles] == list(expected)
    for each in found.profiles:
        *rules, _discovery = policy_grant(each).grant.rules
        for rule, listed in zip(rules, expected[each.enclave], strict=True):
            assert rule.allow is listed.allows
            for criterion in rule.criteria:
                assert {topic.text for topic in criterion.topics} == set(listed.topics(criterion.operation.value))


# What it includes


def test_places_are_in_the_file_that_says_so(tmp_path: Path) -> None:
    written(tmp_path, f'<p {XI}>\n<xi:include href="deep/b.xml" xpointer="xpointer(/p/*)"/></p>', "common/a.xml")
    written(tmp_path, '<p><topics\npublish="ALLOW">\n<topic>x</topic></topics></p>', "common/deep/b.xml")
    file = policy(
        tmp_path,
        '<xi:include href="common/a.xml" xpointer="xpointer(/p/*)"/><topics publish="ALLOW"><topic>y</topic></topics>',
    )
    places = {right.name: (right.location.path, right.location.line) for right in read_policy(file).intent.rights}
    assert places == {"/x": (str(tmp_path / "common/deep/b.xml"), 3), "/y": (str(file), 2)}


def test_as_libxml2_includes_where_both_do() -> None:
    """Our own policies, expanded by libxml2 as sros2 has it done: the same names in the same order."""
    for name in ("talker_listener", "turtlesim", "vehicle"):
        file = OWN / f"{name}.policy.xml"
        tree = etree.parse(str(file))
        tree.xinclude()
        theirs = [(str(entry.tag), str(entry.text)) for entry in tree.iter("topic", "service", "action")]
        expanded = expand(file).root
        assert [(str(entry.tag), str(entry.text)) for entry in expanded.iter("topic", "service", "action")] == theirs
        assert len(theirs) > 10


def test_include_directories(tmp_path: Path) -> None:
    """Beside the policy, or below the directory that was named; links are followed within it alone."""
    written(tmp_path, '<p><topics publish="ALLOW"><topic>x</topic></topics></p>', "common/x.xml")
    file = policy(tmp_path / "robots", '<xi:include href="../common/x.xml" xpointer="xpointer(/p/*)"/>')
    refused(file, ":2:", "is not below")
    assert rights(read_policy(file, tmp_path)) == [("publish", "/x", True)]
    refused(file, "is not below", include=tmp_path / "robots")
    (tmp_path / "robots/inside.xml").symlink_to("../common/x.xml")
    by_link = policy(tmp_path / "robots", '<xi:include href="inside.xml" xpointer="xpointer(/p/*)"/>')
    refused(by_link, "leads out of")
    assert rights(read_policy(by_link, tmp_path)) == [("publish", "/x", True)]
    refused(file, "directory", include=tmp_path / "missing")


def test_a_policy_by_a_link_includes_from_where_it_is(tmp_path: Path) -> None:
    written(tmp_path, '<p><topics publish="ALLOW"><topic>x</topic></topics></p>', "real/x.xml")
    file = policy(tmp_path / "real", '<xi:include href="x.xml" xpointer="xpointer(/p/*)"/>')
    (tmp_path / "link.xml").symlink_to(file)
    assert rights(read_policy(tmp_path / "link.xml")) == [("publish", "/x", True)]


INCLUDES = {
    "address": ('href="http://example.org/x.xml"', "relative path"),
    "file address": ('href="file:///etc/passwd"', "relative path"),
    "absolute": ('href="/etc/passwd"', "relative path"),
    "upwards": ('href="../../../../../../etc/passwd"', "is not below"),
    "upwards, encoded": ('href="%2e%2e/%2e%2e/etc/passwd"', "relative path"),
    "missing": ('href="missing.xml"', "no such file"),
    "directory": ('href="common"', "directory"),
    "nothing": ("", "relative path"),
    "text": ('href="x.xml" parse="text"', "href and xpointer alone"),
    "other pointer": ('href="x.xml" xpointer="element(/1/2)"', "path of child elements"),
    "predicate": ('href="x.xml" xpointer="xpointer(/p/*[1])"', "path of child elements"),
    "descendants": ('href="x.xml" xpointer="xpointer(//topics)"', "path of child elements"),
    "no match": ('href="x.xml" xpointer="xpointer(/q/*)"', "matches nothing"),
    "over an include": ('href="more.xml" xpointer="xpointer(/p/topics)"', "leads over an inclusion"),
    "itself": ('href="a.policy.xml"', "includes itself"),
    "circle": ('href="circle.xml"', "includes itself"),
    "not XML": ('href="broken.xml"', "broken.xml:2"),
    "document type": ('href="dtd.xml"', "document type"),
    "fragment": ('href="x.xml#p"', "relative path"),
    "attribute": ('href="x.xml" accept="a"', "href and xpointer alone"),
}


@pytest.mark.parametrize("case", INCLUDES)
def test_an_inclusion_that_is_not_followed_is_an_error(case: str, tmp_path: Path) -> None:
    attributes, words = INCLUDES[case]
    written(tmp_path, "<p><topics><topic>x</topic></topics></p>", "x.xml")
    written(tmp_path, f'<p {XI}><topics/><xi:include href="x.xml"/></p>', "more.xml")
    written(tmp_path, f'<p {XI}><xi:include href="circle.xml"/></p>', "circle.xml")
    written(tmp_path, "<p>\n<topics></p>", "broken.xml")
    written(tmp_path, '<!DOCTYPE p [<!ENTITY e SYSTEM "file:///etc/passwd">]><p>&e;</p>', "dtd.xml")
    (tmp_path / "common").mkdir()
    message = refused(policy(tmp_path, f"<xi:include {attributes}/>"), words)
    assert re.match(rf"{re.escape(str(tmp_path))}/[\w.]+:\d+: ", message)


def test_a_fallback_is_not_taken(tmp_path: Path) -> None:
    inner = "<xi:fallback><topics><topic>x</topic></topics></xi:fallback>"
    refused(policy(tmp_path, f'<xi:include href="x.xml">{inner}</xi:include>'), "fallback")


@pytest.mark.parametrize("files", [12, 20])
def test_inclusions_that_multiply_end(files: int, tmp_path: Path) -> None:
    """Files that include the next one ten times each: twenty are a hundred million million million elements."""
    for number in range(files):
        many = f'<xi:include href="{number + 1}.xml" xpointer="xpointer(/p/*)"/>' * 10
        written(tmp_path, f"<p {XI}>{many}</p>", f"{number}.xml")
    written(tmp_path, '<p><topics publish="ALLOW"><topic>x</topic></topics></p>', f"{files}.xml")
    refused(policy(tmp_path, '<xi:include href="0.xml" xpointer="xpointer(/p/*)"/>'), "not followed")


def test_inclusions_of_much_text_end(tmp_path: Path) -> None:
    """A file of 2 MB, in few elements, a hundred times."""
    written(tmp_path, f"<p><!--{'x' * (2 << 20)}--><topics><topic>x</topic></topics></p>", "big.xml")
    include = '<xi:include href="big.xml"/>'
    refused(policy(tmp_path, include * 100), "bytes put in")
    written(tmp_path, f"<p {XI}>{include}</p>", "holder.xml")
    refused(policy(tmp_path, '<xi:include href="holder.xml"/>' * 100), "bytes put in")


def test_a_long_policy_with_a_fault_at_its_end_is_answered(tmp_path: Path) -> None:
    many = "<topic>x</topic>" * 90_000
    file = policy(tmp_path, f'<topics publish="ALLOW">{many}<service>s</service></topics>')
    refused(file, ":2: ", "service")


def test_files_that_are_none(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    refused(tmp_path / "fifo", "regular file")
    refused(tmp_path, "directory")
    refused(tmp_path / "missing.xml", "no such file")
    refused(tmp_path / "no/where.xml", "no such file")
    refused(written(tmp_path, "x" * (4 * 1024 * 1024 + 1)), "more than the limit")
    refused(written(tmp_path, ""), ":1:")


# What is no policy


POLICIES = {
    "another root": ("<dds/>", "no SROS2 policy"),
    "version": ('<policy version="0.3.0"><enclaves/></policy>', "no SROS2 policy"),
    "form": ('<policy version="0.2.0"><profiles><profile ns="/" node="x"/></profiles></policy>', "expected <enclaves>"),
    "no enclave": ('<policy version="0.2.0"><enclaves/></policy>', "no SROS2 policy"),
    "relative enclave": (
        (
            '<policy version="0.2.0"><enclaves><enclave path="x">'
            '<profiles><profile ns="/" node="x"/></profiles></enclave></enclaves></policy>'
        ),
        "path of an enclave",
    ),
    "namespaced": ('<policy xmlns="urn:x" version="0.2.0"><enclaves/></policy>', "no SROS2 policy"),
    "entity": ('<!DOCTYPE policy [<!ENTITY x "y">]><policy version="0.2.0"/>', "document type"),
    "UTF-16": ('<?xml version="1.0" encoding="UTF-16"?><policy/>', "UTF-8"),
    "YAML": ("nodes:\n  talker:\n    topics:\n      chatter:\n        allow: p\n", "no well-formed XML"),
}


@pytest.mark.parametrize("case", POLICIES)
def test_what_is_no_policy_is_said(case: str, tmp_path: Path) -> None:
    content, words = POLICIES[case]
    refused(written(tmp_path, content), words)


def test_a_policy_in_yaml_is_of_a_distribution_that_is_gone(tmp_path: Path) -> None:
    refused(written(tmp_path, "nodes:\n", "a.policy.yaml"), "Ardent")


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        ('<topics publish="MAYBE"><topic>x</topic></topics>', "MAYBE"),
        ('<topics publish="ALLOW"><service>x</service></topics>', "service"),
        ('<topics publish="ALLOW"></topics>', "topic"),
        ('<topics publish="ALLOW"><topic> x </topic></topics>', "without blanks"),
        ('<topics publish="ALLOW"><topic></topic></topics>', "without blanks"),
        ('<topics publish="ALLOW"><topic>/a\u202eb</topic></topics>', "without blanks"),
        ('<topics request="ALLOW"><topic>x</topic></topics>', "request"),
        (f'<topics publish="ALLOW"><topic>{"x" * 2000}</topic></topics>', "without blanks"),
    ],
)
def test_what_is_wrong_in_a_policy_has_its_line(profile: str, words: str, tmp_path: Path) -> None:
    file = policy(tmp_path, profile)
    assert refused(file, words).startswith(f"{file}:2: ")


def test_a_fault_in_an_included_file_is_said_to_be_there(tmp_path: Path) -> None:
    written(tmp_path, '<p>\n\n<topics publish="MAYBE"><topic>x</topic></topics></p>', "x.xml")
    file = policy(tmp_path, '<xi:include href="x.xml" xpointer="xpointer(/p/*)"/>')
    assert refused(file, "MAYBE").startswith(f"{tmp_path}/x.xml:3: ")


@pytest.mark.skipif(not SHARED.exists(), reason="the reference schemas are not there")
@pytest.mark.parametrize("change", [
    lambda text: text,
    lambda text: text.replace('publish="ALLOW"', 'publish="DENY"'),
    lambda text: text.replace('publish="ALLOW"', 'publish="allow"'),
    lambda text: text.replace("<topic>chatter</topic>", ""),
    lambda text: text.replace('node="talker"', ""),
    lambda text: text.replace('ns="/"', 'ns="/" type="x"'),
    lambda text: text.replace("</profile>", '</profile><metadata a="b"><any/>thing</metadata>'),
    lambda text: text.replace("</profile>", "</profile><metadata/><metadata/>"),
    lambda text: text.replace("<profiles>", '<profiles type="dds">'),
    lambda text: text.replace("<profile ns", '<profile xml:base="x" ns'),
    lambda text: text.replace("<topics ", '<topics xml:base="x" '),
    lambda text: text.replace("topics", "services").replace("topic>", "service>").replace("publish", "reply"),
    lambda text: text.replace("topics", "actions").replace("topic>", "action>").replace("publish", "call"),
    lambda text: text.replace("</topics>", "</topics><topics><topic>y</topic></topics>"),
])  # fmt: skip
def test_our_schema_accepts_what_that_of_sros2_does(change: object) -> None:
    text = (
        '<policy version="0.2.0"><enclaves><enclave path="/a"><profiles><profile ns="/" node="talker">'
        '<topics publish="ALLOW"><topic>chatter</topic></topics></profile></profiles></enclave></enclaves></policy>'
    )
    assert callable(change)
    document = etree.fromstring(change(text))
    folder = SHARED / "xsd/sros2-rolling"
    # Its import of xml.xsd by address is given a place on this disk.
    schema = (folder / "policy.xsd").read_text("utf-8")
    local = re.sub(r'schemaLocation="[^"]*xml\.xsd"', f'schemaLocation="{(folder / "xml.xsd").as_uri()}"', schema)
    theirs = etree.XMLSchema(etree.fromstring(local.encode()))
    ours = etree.XMLSchema(etree.parse(str(schemas() / "policy.xsd")))
    assert ours.validate(document) == theirs.validate(document)


@settings(
    max_examples=200, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_whatever_bytes_come_it_is_a_policy_or_an_error(data: st.DataObject, tmp_path: Path) -> None:
    content = bytearray((OWN / data.draw(st.sampled_from(("turtlesim.policy.xml", "common/node.xml")))).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        end = at + data.draw(st.integers(0, 40))
        content[at:end] = data.draw(
            st.binary(max_size=6) | st.sampled_from((b"<", b"/>", b'"', b"..", b"&#0;", b"<xi:include/>"))
        )
    (tmp_path / "common").mkdir(exist_ok=True)
    (tmp_path / "common/node.xml").write_bytes((OWN / "common/node.xml").read_bytes())
    file = tmp_path / "fuzzed.xml"
    file.write_bytes(content)
    message = ""
    try:
        assert read_policy(file).profiles
    except UsageError as error:
        message = error.message
    assert not message or str(tmp_path) in message
