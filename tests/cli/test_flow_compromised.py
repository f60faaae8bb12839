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


def test_the_variable_of_the_jar_is_no_wrong_usage() -> None:
    """The container sets it for all commands."""
    done = run(
        "flow", "flows/vehicle_healthy", "--from-compromised", "/motor", *AT, KEYSTORE_AUDIT_ALLOY_JAR=str(__file__)
    )
    assert (done.returncode, done.stderr) == (1, "")


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
    sizes = [-each["topics_written"] - each["topics_forged"] for each in most["enclaves"]]
    assert sizes == sorted(sizes)
    text = run("audit", "flows/turtlesim_shared_ca", "--engine", "native", "-v", *AT).stdout
    assert "Blast radius, what the private key of an enclave opens\n" in text
    assert f"{most['enclaves'][0]['enclave']}: reaches " in text


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
