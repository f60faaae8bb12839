"""`keystore-audit-record` among nodes of a real ROS 2 (requirements/ros.txt), and what is made of its recording."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from tests.cli.keystores import AT, answer, keystore, rule, signed_keystore
from tests.oracles.vendors.enclave import publish
from tests.oracles.vendors.pairs import Process, Side
from tests.oracles.xml.parsers import compiled

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("record")]

DOMAIN = 1 + os.getpid() % 100
"""Of this run alone, as far as chance can tell."""

FIRST_PORT = 7400 + 250 * DOMAIN
"""Of the domain (DDSI-RTPS, 9.6.1.1)."""

LOOPBACK = """<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <transport_descriptors><transport_descriptor>
    <transport_id>loopback</transport_id><type>UDPv4</type><maxInitialPeersRange>16</maxInitialPeersRange>
    <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
  </transport_descriptor></transport_descriptors>
  <participant profile_name="loopback" is_default_profile="true"><rtps>
    <userTransports><transport_id>loopback</transport_id></userTransports>
    <useBuiltinTransports>false</useBuiltinTransports>
    <builtin><initialPeersList><locator><udpv4><address>127.0.0.1</address></udpv4></locator></initialPeersList></builtin>
  </rtps></participant>
</profiles>"""
"""No participant leaves this machine. ROS's own setting for that ignores the participants of other vendors."""

PROGRAMS = Path(sys.executable).parent
VENDORS = Path(__file__).parents[1] / "oracles/vendors"


class Ros:
    """ROS's Python, and programs that it runs."""

    def __init__(self, python: Path, repository: Path, folder: Path) -> None:
        self.python = python
        self._repository = repository
        (folder / "loopback.xml").write_text(LOOPBACK)
        own = {
            "ROS_DOMAIN_ID": str(DOMAIN),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
            "FASTRTPS_DEFAULT_PROFILES_FILE": str(folder / "loopback.xml"),
            "ROS_LOG_DIR": str(folder),
        }
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        self.environment = {**kept, **own}

    def record(self, *args: str, **variables: str) -> subprocess.CompletedProcess[str]:
        """Record as a robot would that has this one file of keystore-audit."""
        words = [self.python, self._repository / "keystore_audit/record.py", *args]
        environment = {**self.environment, **variables}
        return subprocess.run(words, capture_output=True, text=True, timeout=120, env=environment)

    @contextmanager
    def robot(self, *args: str) -> Iterator[None]:
        words = [self.python, self._repository / "tests/integration/robot.py", *args]
        pipe = subprocess.PIPE
        with subprocess.Popen(words, stdin=pipe, stdout=pipe, text=True, env=self.environment) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "up\n"
            yield
            process.communicate(timeout=60)


@pytest.fixture(scope="module")
def ros(oracle: Callable[[str], str], repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Ros:
    return Ros(Path(oracle(str(repository / ".venv/ros/bin/python"))), repository, tmp_path_factory.mktemp("ros"))


@pytest.fixture(scope="module")
def recording(ros: Ros, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The four nodes of robot.py."""
    with ros.robot():
        done = ros.record()
    assert (done.returncode, done.stderr) == (0, "")
    path = tmp_path_factory.mktemp("recording") / "robot.graph.json"
    path.write_text(done.stdout)
    return path


def of_tests(node: Mapping[str, Any]) -> dict[str, list[str]]:
    """The names in each list whose type is of robot.py's choosing."""
    lists = {key: value for key, value in node.items() if isinstance(value, list)}
    kept = {
        key: [
            name for entry in value for word, name in entry.items() if word != "type" and "test_msgs" in entry["type"]
        ]
        for key, value in lists.items()
    }
    return {key: names for key, names in kept.items() if names}


def test_each_node_is_recorded_in_its_enclave_with_what_it_does(recording: Path, repository: Path) -> None:
    graph = json.loads(recording.read_text())
    jsonschema.validate(graph, json.loads((repository / "schemas/graph.schema.json").read_text()))
    nodes = {(node["enclave"], node["namespace"], node["name"]): of_tests(node) for node in graph["nodes"]}
    assert nodes == {
        ("/talker", "/", "talker"): {"publishers": ["/chatter"]},
        ("/listener", "/ear", "listener"): {"subscribers": ["/chatter"]},
        ("/arm/server", "/", "server"): {"service_servers": ["/reset"], "action_servers": ["/drive"]},
        ("/arm/client", "/", "client"): {"service_clients": ["/reset"], "action_clients": ["/drive"]},
    }
    every = {entry.get("service") for node in graph["nodes"] for entry in node["service_servers"]}
    assert {"/ear/listener/get_parameters", "/ear/listener/get_type_description"} <= every


def test_what_is_suggested_for_a_recording_lets_its_nodes_run_and_nothing_more(recording: Path, tmp_path: Path) -> None:
    enclaves = [node["enclave"] for node in json.loads(recording.read_text())["nodes"]]
    before = keystore(tmp_path / "before", {path: (rule(("rt/nothing",)),) for path in enclaves})
    suggest = ("suggest", before, "--at", AT, "--graph", recording, "--as", "permissions", "-o", tmp_path / "out")
    assert answer(*suggest)[0] == 0
    documents = {path: (tmp_path / f"out{path}/permissions.xml").read_bytes() for path in enclaves}
    after = signed_keystore(tmp_path / "after", documents)
    less = {**documents, "/talker": documents["/talker"].replace(b"rt/chatter", b"rt/clatter")}
    for root, found in (
        (after, set()),
        (signed_keystore(tmp_path / "less", less), {("KA650", "/talker"), ("KA651", "/talker")}),
    ):
        _code, text = answer("audit", "--engine", "native", "--at", AT, "-f", "json", root, "--graph", recording)
        findings = json.loads(text)["findings"]
        assert {(each["code"], each["enclave"]) for each in findings if each["code"].startswith("KA65")} == found


@contextmanager
def bare(program: Path) -> Iterator[None]:
    """A participant that is none of ROS; it ends by itself after 30 seconds."""
    side = Side(enclave=None, endpoints=(publish("rt/bare"),), domain=DOMAIN)
    process = Process(program, program, side, 9, FIRST_PORT)
    try:
        assert process.started()
        yield
    finally:
        process.end()


def test_what_ros_cannot_attribute_is_told_and_exits_with_4(
    ros: Ros, oracle: Callable[[str], str], tmp_path: Path
) -> None:
    """A node that is called as another, and a participant without any; where there is no node at all, that with 3."""
    program = compiled(oracle("cc"), VENDORS / "cyclonedds_pair.c", tmp_path, "-rdynamic", "-lddsc", "-ldl")
    with bare(program):
        alone = ros.record("--limit", "5")
    with ros.robot("namesake"), bare(program):
        done = ros.record()
    assert (alone.returncode, alone.stdout) == (3, "")
    assert "an endpoint of 'rt/bare' belongs to no node that is known\n" in alone.stderr
    assert (done.returncode, len(json.loads(done.stdout)["nodes"])) == (4, 5)
    assert done.stderr.splitlines() == [
        "2 nodes are called '/talker': ROS reports what one of them does",
        "an endpoint of 'control' belongs to no node that is known",
        "an endpoint of 'control_secure' belongs to no node that is known",
        "an endpoint of 'rt/bare' belongs to no node that is known",
    ]


def test_a_graph_that_does_not_settle_is_incomplete_and_one_of_no_nodes_is_none(ros: Ros) -> None:
    with ros.robot():
        done = ros.record("--settle", "9", "--limit", "3")
    assert (done.returncode, done.stderr) == (4, "the graph changed until the end of 3 seconds\n")
    assert json.loads(done.stdout)["nodes"]
    nobody = ros.record("--limit", "1")
    assert (nobody.returncode, nobody.stdout) == (3, "")
    assert nobody.stderr.startswith("no node was seen")


def test_an_enclave_that_is_not_there_is_said_in_a_line(ros: Ros, tmp_path: Path) -> None:
    security = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}
    refused = ros.record(**security, ROS_SECURITY_KEYSTORE=str(tmp_path))
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr.startswith("ROS refuses: ")
    assert f"'{tmp_path}/enclaves' does not exist" in refused.stderr


def test_the_program_and_the_verb_find_the_python_of_ros(ros: Ros, repository: Path, tmp_path: Path) -> None:
    """Installed apart from ROS, the program is run by a Python without rclpy; the verb is run by ROS's own."""
    program = "from keystore_audit.record import main; raise SystemExit(main())"
    verb = "from argparse import *; from keystore_audit_ros2 import *; RecordVerb().main(args=Namespace(words={!r}))"
    words = ["--limit", "1"]
    folders = {"PYTHONPATH": str(repository / "ros2/keystore_audit_ros2"), "KEYSTORE_AUDIT_BIN": str(PROGRAMS)}
    for command, path, code in (
        ([sys.executable, "-c", program, *words], ros.python.parent, 3),
        ([sys.executable, "-c", program, *words], tmp_path, 2),
        ([ros.python, "-c", verb.format(words)], tmp_path, 3),
    ):
        environment = {**ros.environment, **folders, "PATH": str(path)}
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60)
        assert (done.returncode, done.stdout) == (code, ""), done.stderr
        assert ("cannot import rclpy" in done.stderr) is (code == 2)
