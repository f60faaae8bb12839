"""`keystore-audit flow --from-compromised` on the samples below flows/."""

from __future__ import annotations

import json
from datetime import datetime, timezone
from typing import Any

import pytest

from keystore_audit.circumstances import Circumstances
from keystore_audit.flow import FlowQuestion, find_blast_radius, find_flow
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.profiles import resolve
from keystore_audit.properties.result import Status
from tests.cli.test_flow import AT, SAMPLES, run
from tests.schemas import schema


def opened(sample: str, who: str, *arguments: str) -> tuple[int, dict[str, Any]]:
    done = run("flow", f"flows/{sample}", "--from-compromised", who, *AT, "-f", "json", *arguments)
    answer = json.loads(done.stdout)
    schema("compromise").validate(answer)
    return done.returncode, answer


def names(topics: list[dict[str, Any]]) -> set[str]:
    return {topic["topic"] for topic in topics if topic["topic"].startswith("rt/")}


def test_an_enclave_key_in_full() -> None:
    code, answer = opened("vehicle_compromised_relay", "/gateway")
    (key,) = answer["keys"]
    assert (code, answer["beyond_itself"], answer["enclaves"]) == (1, True, 5)
    assert (key["of"], key["path"], key["with_an_enclave"]) == ("enclave", "enclaves/gateway/cert.pem", None)
    found = key["alone"]["spec"]
    assert found["certain"]
    assert {"rt/motor_limit", "rt/media_state"} <= names(found["topics_forged"])
    assert "rt/motor_limit" not in names(found["topics_written"])
    assert "/motor" in found["enclaves_reached_alone"]
    assert all(topic["domains"] == ["domain 0"] for topic in found["topics_read"])


def test_what_a_key_reaches_only_over_others_that_are_compromised() -> None:
    _code, answer = opened("vehicle_compromised_relay", "/infotainment")
    found = answer["keys"][0]["alone"]["spec"]
    assert "/motor" in found["enclaves_reached"]
    assert "/motor" not in found["enclaves_reached_alone"]
    text = run("flow", "flows/vehicle_compromised_relay", "--from-compromised", "/infotainment", *AT).stdout
    assert "if all on the way are compromised too: also " in " ".join(text.split())


def test_the_identity_ca_is_everybody_and_the_permissions_ca_nobody_alone() -> None:
    code, answer = opened("vehicle_healthy", "identity-ca")
    (key,) = answer["keys"]
    found = key["alone"]["spec"]
    assert (code, key["name"], key["path"]) == (1, "CN=identityCA", "public/identity_ca.cert.pem")
    assert len(found["passes_for"]) == len(found["enclaves_reached"]) == answer["enclaves"]
    assert not any(topic["several"] for topic in found["topics_written"])
    code, answer = opened("vehicle_healthy", "permissions-ca")
    (key,) = answer["keys"]
    assert (code, key["name"]) == (1, "CN=permissionsCA")
    alone, both = key["alone"]["spec"], key["with_an_enclave"]["spec"]
    assert not any(alone[each] for each in alone if each != "certain")
    assert any(topic["several"] for topic in both["topics_written"])
    assert len(both["enclaves_reached"]) == answer["enclaves"]


def test_one_ca_for_both_roles_opens_everything() -> None:
    for who in ("identity-ca", "permissions-ca"):
        _code, answer = opened("turtlesim_shared_ca", who)
        found = answer["keys"][0]["alone"]["fastdds-3.6"]
        assert any(topic["several"] for topic in found["topics_written"])
        assert len(found["passes_for"]) == answer["enclaves"]


def test_an_enclave_that_signs_rights_for_itself_under_one_implementation() -> None:
    _code, answer = opened("turtlesim_shared_ca", "/random")
    by_profile = answer["keys"][0]["alone"]
    assert "rt/move_turtle" in names(by_profile["cyclonedds-0.10"]["topics_written"])
    assert "rt/move_turtle" not in names(by_profile["cyclonedds-11"]["topics_written"])
    text = run("flow", "flows/turtlesim_shared_ca", "--from-compromised", "/random", *AT).stdout
    assert "under cyclonedds-0.10\n" in text
    assert max(map(len, text.splitlines())) <= 80


def test_ambient_topics_reach_everybody_where_they_count() -> None:
    _code, without = opened("turtlesim_healthy", "/turtlesim")
    _code, with_them = opened("turtlesim_healthy", "/turtlesim", "--include-ambient")
    reached = [answer["keys"][0]["alone"]["spec"]["enclaves_reached"] for answer in (without, with_them)]
    assert len(reached[0]) < len(reached[1]) == with_them["enclaves"] - 1


@pytest.mark.parametrize("doubt", ["unreadable", "ambiguous", "linked_away"])
def test_what_cannot_be_read_leaves_it_open(doubt: str) -> None:
    code, answer = opened(f"chatter_{doubt}_enclave", "/listener")
    assert (code, answer["beyond_itself"]) == (4, None)
    text = run("flow", f"flows/chatter_{doubt}_enclave", "--from-compromised", "/listener", *AT).stdout
    assert "UNKNOWN" in text
    assert "It depends on what could not be read: enclaves/" in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--from-compromised", "/gatway"), "'/gatway' is no enclave of this keystore; the nearest is '/gateway'"),
        (("--from-compromised", "ca"), "expected its path, identity-ca or permissions-ca"),
        (("/motor", "/brake", "--from-compromised", "/motor"), "give no FROM and TO"),
        (("/motor",), "Expected FROM and TO, or --from-compromised"),
        ((), "Expected FROM and TO, or --from-compromised"),
        (("--from-compromised", "/motor", "--attacker", "honest"), "--attacker says nothing about"),
        (("--from-compromised", "/motor", "--alloy-jar", __file__), "--alloy-jar says nothing about"),
        (("--from-compromised", "/motor", "--engine", "both"), "worked out natively"),
    ],
)
def test_wrong_usage(arguments: tuple[str, ...], said: str) -> None:
    done = run("flow", "flows/vehicle_healthy", *arguments, *AT)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in " ".join(done.stderr.replace("│", " ").split())


def test_the_variable_of_the_jar_is_no_wrong_usage() -> None:
    """The container sets it for all commands."""
    done = run(
        "flow", "flows/vehicle_healthy", "--from-compromised", "/motor", *AT, KEYSTORE_AUDIT_ALLOY_JAR=str(__file__)
    )
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.parametrize(("profile", "told"), [("cyclonedds-11", True), ("fastdds-3.6", False)])
def test_what_an_attacker_is_assumed_to_announce_is_said(profile: str, told: bool) -> None:
    done = run("flow", "flows/vehicle_healthy", "--from-compromised", "/motor", *AT, "--profile", profile)
    assert ("announce endpoints truthfully" in done.stdout) == told


def test_names_are_escaped() -> None:
    done = run("flow", "flows/vehicle_healthy", "--from-compromised", "/\x1b[31m", *AT)
    assert "\x1b" not in done.stdout + done.stderr


def test_a_report_ranks_keys() -> None:
    done = run("audit", "flows/turtlesim_shared_ca", "--engine", "native", "-f", "json", *AT)
    report = json.loads(done.stdout)
    schema("report").validate(report)
    most, other = report["blast_radius"]
    assert (len(most["profiles"]), other["profiles"]) == (6, ["cyclonedds-0.10"])
    assert all(each["endless"] and each["enclaves_reached"] == 3 for each in other["enclaves"])
    assert not any(each["endless"] for each in most["enclaves"])
    told = opened("turtlesim_shared_ca", "/random")[1]["keys"][0]["alone"]["spec"]
    (random,) = (each for each in most["enclaves"] if each["enclave"] == "/random")
    for key in ("topics_written", "topics_forged", "topics_read", "enclaves_reached", "enclaves_reached_alone"):
        assert random[key] == len(told[key]), key
    sizes = [(-each["enclaves_reached"], -each["enclaves_reached_alone"]) for each in most["enclaves"]]
    assert sizes == sorted(sizes)
    text = run("audit", "flows/turtlesim_shared_ca", "--engine", "native", "-v", *AT).stdout
    assert "Blast radius, what the private key of an enclave opens\n" in text
    assert f"{most['enclaves'][0]['enclave']}: reaches 2 enclaves" in text


@pytest.mark.parametrize("sample", ["vehicle_compromised_relay", "turtlesim_shared_ca"])
def test_whom_a_key_reaches_is_what_flows_say(sample: str) -> None:
    at, profiles = datetime(2026, 11, 21, 12, tzinfo=timezone.utc), resolve(("humble",))
    keystore = SAMPLES / "flows" / sample
    paths = [enclave.path for enclave in read_keystore(keystore).enclaves]
    told = {True: 0, False: 0}
    for source in paths:
        alone = find_blast_radius(keystore, source, Circumstances(profiles=profiles, at=at)).keys[0].alone
        for target in (path for path in paths if path != source):
            question = FlowQuestion(source=source, target=target, attackers=(Attacker.SOURCE, Attacker.RELAYS))
            for attacker, result in find_flow(keystore, question, Circumstances(profiles=profiles, at=at)).results:
                for name, answer in result.profiles.items():
                    radius = alone[name].radius
                    reached = radius.reached if attacker is Attacker.RELAYS else radius.reached_alone
                    assert (target in reached) == (answer.status is Status.VIOLATED), (source, target, attacker, name)
                    told[target in reached] += 1
    assert min(told.values()) > 5


@pytest.mark.parametrize(("sample", "reached"), [("partition_pattern", ["/talker"]), ("partition_named", [])])
def test_a_reader_in_a_partition_that_is_a_pattern_is_reached(sample: str, reached: list[str]) -> None:
    _code, answer = opened(f"chatter_{sample}", "/listener", "--profile", "spec")
    assert answer["keys"][0]["alone"]["spec"]["enclaves_reached_alone"] == reached
