"""ROS graphs: against the JSON Schema, against `json`, and against the keystores of the same wiring."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.errors import UsageError
from keystore_audit.intent.graph import read_graph
from keystore_audit.intent.intent import Intent, Origin
from keystore_audit.intent.source import MAX_DEPTH, Value, parse_json
from keystore_audit.keystore.defect import Malformed
from keystore_audit.model.names import dds_channels
from tests.schemas import schema
from tests.strategies.mutations import edited
from tools.samples.healthy import TURTLESIM, VEHICLE
from tools.samples.policy import Node

ROOT = Path(__file__).parent.parent.parent
GRAPHS = ROOT / "sample_keystores" / "graphs"
SAMPLES = sorted(GRAPHS.glob("*.graph.json"))
VALIDATOR = schema("graph")

TALKER: dict[str, Any] = {
    "name": "talker",
    "namespace": "/robot",
    "enclave": "/robot/talker",
    "publishers": [{"topic": "/chatter", "type": "std_msgs/msg/String"}],
    "service_clients": [{"service": "/robot/add"}],
    "action_servers": [{"action": "/fly"}],
}


def read(text: str, tmp_path: Path) -> Intent:
    path = tmp_path / "some.graph.json"
    path.write_text(text, "utf-8")
    return read_graph(path)


def granted(nodes: dict[str, Node]) -> set[tuple[str, str, str]]:
    """(enclave, operation, DDS topic) of every rule of the keystore that has this wiring, discovery apart."""
    found = set()
    for enclave, node in nodes.items():
        for written, seen in node.groups():
            found |= {(enclave, "publish", topic) for topic in written} | {(enclave, "subscribe", t) for t in seen}
    return found


def observed(intent: Intent) -> set[tuple[str, str, str]]:
    return {
        (right.enclave, operation.value, topic)
        for right in intent.rights
        for operation, topic in dds_channels(right.action.value, right.name)
    }


@pytest.mark.parametrize(("name", "nodes"), [("turtlesim", TURTLESIM), ("vehicle", VEHICLE)])
def test_a_sample_is_what_its_keystore_grants(name: str, nodes: dict[str, Node]) -> None:
    assert observed(read_graph(GRAPHS / f"{name}.graph.json")) == granted(nodes)
    missing = observed(read_graph(GRAPHS / f"{name}-missing-grant.graph.json"))
    excess = observed(read_graph(GRAPHS / f"{name}-excess-grant.graph.json"))
    assert (len(missing - granted(nodes)), granted(nodes) - missing) == (1, set())
    assert (excess - granted(nodes), len(granted(nodes) - excess)) == (set(), 1)


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda path: path.name)
def test_samples_are_of_the_form(sample: Path) -> None:
    VALIDATOR.validate(json.loads(sample.read_text("utf-8")))
    lines = sample.read_text("utf-8").splitlines()
    intent = read_graph(sample)
    assert intent.origin is Origin.GRAPH
    for right in intent.rights:
        assert right.location.path == str(sample)
        assert json.dumps(right.name) in lines[(right.location.line or 0) - 1]


def test_a_topic_of_two_types_and_nodes_of_one_name_count_once(tmp_path: Path) -> None:
    two = [{"topic": "/chatter", "type": "a"}, {"topic": "/chatter", "type": "b"}]
    intent = read(json.dumps({"schema_version": 1, "nodes": [TALKER | {"publishers": two}, TALKER]}), tmp_path)
    assert [right.name for right in intent.rights] == ["/chatter", "/robot/add", "/fly"]
    assert len(intent.nodes) == 1


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("", 1, "this is not JSON: Expecting value"),
        ("# keystore-audit\n", 1, "this is not JSON: Expecting value"),
        ('{"schema_version": 1}', 1, "'nodes', and there is none"),
        ('{"schema_version": 2, "nodes": []}', 1, "expected schema_version 1"),
        ('{"schema_version": true, "nodes": []}', 1, "expected schema_version 1"),
        ('{"schema_version": 1,\n"nodes": [],\n"more": 1}', 3, "found 'more'"),
        ('{"schema_version": 1,\n"nodes": [],\n"nodes": []}', 3, "the key 'nodes' a second time"),
        ('{"schema_version": 1, "nodes": [\n{}\n]}', 2, "expected a node to have the key 'name'"),
        ('{"schema_version": 1, "nodes": [\n\n7]}', 3, "expected an object for a node"),
        ('{"schema_version": 1, "nodes": [NaN]}', 1, "expected a JSON value"),
        ('{"schema_version": 1, "nodes": [1.5]}', 1, "expected a JSON value"),
        ('{"schema_version": 1, "nodes": [1' + "0" * 20 + "]}", 1, "expected a JSON value"),
        ('{"schema_version": 1, "nodes": ["\\ud800"]}', 1, "surrogate"),
        ('{"schema_version": 1, "nodes": ["a\tb"]}', 1, "this is not JSON: Invalid control character"),
        ('{"schema_version": 1, "nodes": []}\n\n{}', 3, "this is not JSON: Extra data"),
        ('{"schema_version": 1, "nodes": [],}', 1, "this is not JSON"),
        ("[" * 100_000, 1, "deep"),
        ('{"a":' * 100_000, 1, "deep"),
    ],
)
def test_what_is_not_of_the_form_is_refused_with_its_line(text: str, line: int, said: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError) as refused:
        read(text, tmp_path)
    assert refused.value.message.startswith(f"{tmp_path / 'some.graph.json'}:{line}: ")
    assert said in refused.value.message


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "/talker"}, "without its namespace"),
        ({"name": ""}, "without its namespace"),
        ({"namespace": ""}, "a namespace like"),
        ({"namespace": "/robot/"}, "a namespace like"),
        ({"enclave": "talker"}, "an enclave like"),
        ({"enclave": 3}, "an enclave like '/' or '/robot', in quotes"),
        ({"publishers": [{"topic": "chatter"}]}, "fully qualified"),
        ({"publishers": [{"topic": "/a//b"}]}, "fully qualified"),
        ({"publishers": [{"topic": "/*"}]}, "fully qualified"),
        ({"publishers": [{"topic": "/a\n"}]}, "fully qualified"),
        ({"publishers": [{"service": "/a"}]}, "found 'service'"),
        ({"publishers": {"topic": "/a"}}, "an array of publishers"),
        ({"subscribers": [{"topic": "/a", "type": 7}]}, "the name of a type, in quotes"),
        ({"listeners": []}, "found 'listeners'"),
    ],
)
def test_wrong_nodes_are_refused(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    document = {"schema_version": 1, "nodes": [TALKER | change]}
    with pytest.raises(UsageError, match=r":\d+: ") as refused:
        read(json.dumps(document, indent=1), tmp_path)
    assert said in refused.value.message
    assert not VALIDATOR.is_valid(document)


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(b" " * (4 * 1024 * 1024 + 1))
    (tmp_path / "latin").write_bytes(b'{\n"\xe9": 1}')
    for path, said in (
        (tmp_path / "none", "there is no such file"),
        (tmp_path, "a directory, where a file was expected"),
        (tmp_path / "large", "more than the limit"),
        (tmp_path / "latin", "latin:2: expected UTF-8"),
        (tmp_path / "a\0b", "there is no such file"),
    ):
        with pytest.raises(UsageError) as refused:
            read_graph(path)
        assert said in refused.value.message


words = st.sampled_from(["", "/", "/a", "a", "/a/b", "a b", "/a/", "~"])
endpoints = st.lists(
    st.dictionaries(st.sampled_from(["topic", "service", "type"]), st.one_of(words, st.integers(0, 1))), max_size=2
)
nodes = st.fixed_dictionaries(
    {"name": words, "namespace": words, "enclave": words},
    optional={"publishers": endpoints, "service_servers": endpoints, "action_clients": endpoints, "other": words},
)
documents = st.fixed_dictionaries(
    {"schema_version": st.sampled_from([1, 1, 1, 2]), "nodes": st.lists(nodes, max_size=2)}
)


@settings(max_examples=300)
@given(document=documents, indent=st.sampled_from([None, 1]))
def test_the_reader_takes_exactly_what_the_schema_takes(
    document: dict[str, Any], indent: int | None, tmp_path_factory: pytest.TempPathFactory
) -> None:
    text = json.dumps(document, indent=indent)
    try:
        read(text, tmp_path_factory.getbasetemp())
        taken = True
    except UsageError:
        taken = False
    assert taken is VALIDATOR.is_valid(document)


def plain(value: Value) -> object:
    if isinstance(value.content, tuple):
        return [plain(item) for item in value.content]
    if isinstance(value.content, dict):
        return {key: plain(item) for key, item in value.content.items()}
    return value.content


json_values = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(-(10**15) + 1, 10**15 - 1), st.text(max_size=6)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=3), inner, max_size=3)),
    max_leaves=12,
)


@given(json_values, st.sampled_from([None, 0, 2]), st.booleans())
def test_values_are_those_of_json(document: object, indent: int | None, ascii_only: bool) -> None:
    text = json.dumps(document, indent=indent, ensure_ascii=ascii_only)
    assert plain(parse_json(text)) == document
    assert plain(parse_json("\n\t " + text + "\r\n")) == document


@settings(max_examples=500)
@given(edited(json_values.map(lambda document: json.dumps(document, indent=1).encode())))
def test_what_is_read_is_what_json_reads(data: bytes) -> None:
    """Whatever text: where it is read at all, `json` reads the same from it, and nothing but Malformed is raised."""
    text = data.decode("utf-8", "replace")
    refused: int | None = None
    try:
        value = parse_json(text)
    except Malformed as error:
        refused = error.line
    if refused is None:
        assert plain(value) == json.loads(text)
    else:
        assert 1 <= refused <= text.count("\n") + 1


def test_depth_is_bounded() -> None:
    deepest = "[" * MAX_DEPTH + "]" * MAX_DEPTH
    parse_json(deepest)
    with pytest.raises(Malformed, match="deep"):
        parse_json(f"[{deepest}]")


@settings(max_examples=300)
@given(edited(st.sampled_from([path.read_bytes() for path in SAMPLES])))
def test_changed_samples_are_read_or_refused(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "changed.graph.json"
    path.write_bytes(data)
    said = str(path)
    try:
        intent = read_graph(path)
    except UsageError as error:
        said = error.message
    else:
        VALIDATOR.validate(json.loads(data.decode("utf-8-sig")))
        assert all(right.enclave in dict(intent.enclaves) for right in intent.rights)
    assert said.startswith(str(path))


def test_the_example_of_the_documentation_is_of_the_form(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "intent.md").read_text("utf-8")
    (example,) = re.findall(r"```json\n(.*?)```", page, re.DOTALL)
    VALIDATOR.validate(json.loads(example))
    assert [right.name for right in read(example, tmp_path).rights] == ["/chatter", "/talker/get_parameters"]
