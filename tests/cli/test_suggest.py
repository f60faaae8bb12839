"""`suggest`: the least policy for what nodes do; whatever it prints is read again by our own readers."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta
from pathlib import Path

import pytest
from lxml import etree

from keystore_audit.intent.intent import Action, IntendedRight
from keystore_audit.intent.policy import read_policy
from tests.cli.keystores import AT, answer, keystore, rule, signed_keystore

MARK = "<!-- usual: every node has these, whatever it is for -->"

TALKS = """<policy version="0.2.0"><enclaves><enclave path="/talker"><profiles><profile ns="/" node="talker">
{lists}
</profile></profiles></enclave></enclaves></policy>
"""
GRAPH = '{{"schema_version": 1, "nodes": [{{"name": "{0}", "namespace": "/", "enclave": "/{0}", {1}}}]}}'


@pytest.fixture(scope="module")
def samples(repository: Path) -> Path:
    return repository / "sample_keystores"


def suggested(*args: str | Path, code: int = 0) -> str:
    done, text = answer("suggest", "--at", AT, *args)
    assert done == code
    return text


def rights(text: str, directory: Path) -> tuple[IntendedRight, ...]:
    """Of a policy, as the reader of `--policy` has them."""
    path = directory / "suggested.policy.xml"
    path.write_text(text)
    return read_policy(path).intent.rights


def meant(text: str, directory: Path) -> set[tuple[str, Action, str]]:
    return {(right.enclave, right.action, right.name) for right in rights(text, directory) if right.allow}


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def policy(directory: Path, lists: str) -> Path:
    return written(directory / "own.policy.xml", TALKS.format(lists=lists))


def talking(directory: Path, *rules: str) -> Path:
    """A keystore with /talker, by rules of the test's choosing."""
    return keystore(directory / "keys", {"/talker": rules or (rule(("rt/chatter",)),)})


# TurtleSim


@pytest.mark.parametrize("story", ["turtlesim", "vehicle"])
def test_a_sample_policy_means_what_is_suggested_of_it(story: str, samples: Path, tmp_path: Path) -> None:
    source = samples / f"policies/{story}.policy.xml"
    text = suggested(samples / "healthy" / story, "--policy", source)
    original = {(right.enclave, right.action, right.name) for right in read_policy(source).intent.rights}
    assert meant(text, tmp_path) == original


# Round trips


def graph_of(policies: Mapping[str, str]) -> str:
    """A graph of nodes called like their enclaves."""
    nodes = (
        f'{{"name": "{name}", "namespace": "/", "enclave": "/{name}", {lists}}}' for name, lists in policies.items()
    )
    return f'{{"schema_version": 1, "nodes": [{", ".join(nodes)}]}}'


EVERYTHING = """
    "publishers": [{{"topic": "/map"}}], "subscribers": [{{"topic": "/scan"}}],
    "service_servers": [{{"service": "/{0}/reset"}}], "service_clients": [{{"service": "/plan"}}],
    "action_servers": [{{"action": "/{0}/drive"}}], "action_clients": [{{"action": "/dock"}}]
"""


def test_permissions_that_were_suggested_show_no_drift_and_let_the_nodes_run(tmp_path: Path) -> None:
    nodes = {name: EVERYTHING.format(name) for name in ("arm", "base")}
    graph = written(tmp_path / "robot.graph.json", graph_of(nodes))
    before = keystore(tmp_path / "before", {f"/{name}": (rule(("rt/nothing",)),) for name in nodes})
    suggested(before, "--graph", graph, "--as", "permissions", "-o", tmp_path / "out")
    documents = {f"/{name}": (tmp_path / "out" / name / "permissions.xml").read_bytes() for name in nodes}
    after = signed_keystore(tmp_path / "after", documents)
    own = written(tmp_path / "robot.policy.xml", suggested(before, "--graph", graph))
    _code, report = answer("audit", "--engine", "native", "--at", AT, after, "--policy", own, "--graph", graph)
    for code in ("KA50", "KA64", "KA65"):
        assert code not in report, report
    _code, report = answer("audit", "--engine", "native", "--at", AT, before, "--policy", own, "--graph", graph)
    assert "KA64" in report, "the keystore of before does drift"
    assert "KA650" in report


@pytest.mark.parametrize("story", ["turtlesim", "vehicle"])
@pytest.mark.parametrize("kind", ["graphs/{}.graph.json", "launch/{}.launch.xml"])
def test_what_is_suggested_for_a_sample_is_what_its_nodes_need(
    story: str, kind: str, samples: Path, tmp_path: Path
) -> None:
    source = samples / kind.format(story)
    option = "--graph" if kind.startswith("graphs") else "--launch"
    root = samples / "healthy" / story
    suggested(root, option, source, "--as", "permissions", "-o", tmp_path / "out")
    documents = {f"/{path.parent.name}": path.read_bytes() for path in (tmp_path / "out").rglob("permissions.xml")}
    own = written(tmp_path / "own.policy.xml", suggested(root, option, source))
    remade = signed_keystore(tmp_path / "remade", documents)
    _code, report = answer("audit", "--engine", "native", "--at", AT, remade, option, source, "--policy", own)
    assert "KA64" not in report, report
    assert "KA65" not in report, report


# Launch files


# Policies


ALLOW = '<topics publish="ALLOW"><topic>/a</topic><topic>/b</topic></topics>'


def test_a_policy_means_the_same_as_what_is_suggested_of_it(tmp_path: Path) -> None:
    """Drift is by meaning: the permissions of one against the policy of the other."""
    lists = (
        ALLOW
        + '<topics publish="DENY"><topic>/b</topic></topics><services request="ALLOW"><service>~/s</service></services>'
    )
    source = policy(tmp_path, lists)
    text = suggested(talking(tmp_path), "--policy", source, "--as", "permissions")
    remade = signed_keystore(tmp_path / "remade", {"/talker": text.encode()})
    _code, report = answer("audit", "--engine", "native", "--at", AT, remade, "--policy", source)
    assert "KA64" not in report, report


# Permissions


def test_permissions_have_subject_and_dates_of_the_certificate_and_domains_of_the_governance(tmp_path: Path) -> None:
    from tests.keystore.builder import END, GOVERNANCE, START

    ranges = b"<id>3</id><id_range><min>7</min><max>9</max></id_range>"
    governance = GOVERNANCE.replace(b"<id>0</id>", ranges)
    root = keystore(tmp_path / "keys", {"/talker": (rule(("rt/a",)),)}, governance=governance)
    graph = written(tmp_path / "g.json", GRAPH.format("talker", '"publishers": [{"topic": "/chatter"}]'))
    document = etree.fromstring(suggested(root, "--graph", graph, "--as", "permissions").encode())
    assert document.findtext(".//subject_name") == "CN=/talker"
    assert document.findtext(".//not_before") == f"{START - timedelta(days=1):%Y-%m-%dT%H:%M:%S}"
    assert document.findtext(".//not_after") == f"{END:%Y-%m-%dT%H:%M:%S}"
    assert document.findtext(".//default") == "DENY"
    for domains in document.iter("domains"):
        assert [etree.tostring(each, with_tail=False).split() and each.tag for each in domains] == ["id", "id_range"]
    first = document.find(".//allow_rule/publish")
    assert first is not None
    assert [topic.text for topic in first.iter("topic")] == ["rt/chatter"]
    named = suggested(root, "--graph", graph, "--as", "permissions", "--domain", "4")
    assert {each.text for each in etree.fromstring(named.encode()).iter("id", "min")} == {"4"}


def test_permissions_for_a_certificate_of_today_are_in_force_in_every_zone(tmp_path: Path) -> None:
    """Implementations that read dates in the robot's zone take those of the next hours for past or to come."""
    from tests.keystore.builder import START

    before = keystore(tmp_path / "before", {"/talker": (rule(("rt/a",)),)})
    graph = written(tmp_path / "g.json", GRAPH.format("talker", '"publishers": [{"topic": "/chatter"}]'))
    made = suggested(before, "--graph", graph, "--as", "permissions")
    soon = ("audit", "--engine", "native", "--at", f"{START + timedelta(hours=1):%Y-%m-%dT%H:%M:%SZ}", "-f", "json")
    for document, decided in ((made, True), (made.replace("2023-12-31T", "2024-01-01T"), False)):
        root = signed_keystore(tmp_path / str(decided), {"/talker": document.encode()})
        assert (answer(*soon, root)[0] != 4) is decided


def test_several_enclaves_are_written_below_a_directory_and_never_into_the_keystore(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = keystore(tmp_path / "keys", {"/a/b": (rule(("rt/a",)),), "/c": (rule(("rt/a",)),)})
    nodes = '{{"name": "{}", "namespace": "/", "enclave": "{}"}}'
    content = f'{{"schema_version": 1, "nodes": [{nodes.format("b", "/a/b")}, {nodes.format("c", "/c")}]}}'
    args = ("suggest", "--at", AT, root, "--graph", written(tmp_path / "g.json", content), "--as", "permissions")
    assert answer(*args)[0] == 2
    assert "choose one with --enclave, or name -o DIR" in capsys.readouterr().err
    assert answer(*args, "-o", root / "new")[0] == 2
    assert not (root / "new").exists()
    assert answer(*args, "-o", tmp_path / "out")[0] == 0
    assert sorted(path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.xml")) == [
        "a/b/permissions.xml",
        "c/permissions.xml",
    ]
    assert answer(*args, "--enclave", "/c")[1] == (tmp_path / "out/c/permissions.xml").read_text()


def test_a_policy_is_written_to_a_file_outside_of_the_keystore(tmp_path: Path) -> None:
    root, graph = talking(tmp_path), written(tmp_path / "g.json", GRAPH.format("talker", '"publishers": []'))
    assert suggested(root, "--graph", graph, "-o", tmp_path / "new.xml") == ""
    assert (tmp_path / "new.xml").read_text() == suggested(root, "--graph", graph)
    assert MARK in (tmp_path / "new.xml").read_text()
    suggested(root, "--graph", graph, "-o", root / "new.xml", code=2)
    assert not (root / "new.xml").exists()


# Usage
