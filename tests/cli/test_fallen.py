"""`keystore-audit flow --compromised` on the samples below flows/; its text stands in golden/cli/fallen.txt."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tests.cli.test_flow import AT, MOTOR, flow, found, run
from tests.schemas import schema


def fallen(sample: str, most: int, *arguments: str, **environment: str) -> tuple[int, dict[str, Any]]:
    done = run("flow", f"flows/{sample}", *arguments, "--compromised", str(most), *AT, "-f", "json", **environment)
    answer = json.loads(done.stdout)
    schema("fallen").validate(answer)
    return done.returncode, answer


def sets(answer: dict[str, Any]) -> dict[str, list[tuple[list[str], bool | None]]]:
    return {
        name: [(each["enclaves"], each["flow"]) for each in told["sets"]] for name, told in answer["profiles"].items()
    }


@pytest.mark.parametrize(
    ("sample", "ends"),
    [
        ("vehicle_healthy", MOTOR),
        ("vehicle_plain_grant", MOTOR),
        ("vehicle_compromised_relay", MOTOR),
        ("chatter_unreadable_enclave", ("/talker", "/listener")),
    ],
)
def test_nobody_compromised_is_that_nobody_attacks(sample: str, ends: tuple[str, str]) -> None:
    code, answer = fallen(sample, 0, *ends)
    honest_code, honest = flow(sample, *ends, "--attacker", "honest")
    assert (code, answer["flow"]) == (honest_code, found(honest)["honest"])
    honestly = {name: told["path"] for name, told in honest["attackers"]["honest"]["profiles"].items()}
    for name, told in answer["profiles"].items():
        assert [each["path"] for each in told["sets"]] == ([honestly[name]] if honestly[name] else [])


@pytest.mark.parametrize("source", ["outsider", "/telematics"])
def test_an_outsider_attacks_whoever_is_compromised(source: str) -> None:
    done = run("flow", "flows/vehicle_healthy", source, "/motor", "--compromised", "1", *AT)
    assert ("--compromised, which is about enclaves" in done.stderr) is (source == "outsider")
    assert (done.returncode == 2) is (source == "outsider")


def test_one_more_breaks_it() -> None:
    telematics = ("/telematics", "/motor")
    code, answer = fallen("vehicle_compromised_relay", 1, *telematics)
    assert (code, answer["flow"]) == (0, False)
    assert {each["survives"] for each in answer["profiles"].values()} == {1}
    code, answer = fallen("vehicle_compromised_relay", 2, *telematics)
    assert (code, answer["flow"]) == (1, True)
    assert {name: told for name, told in sets(answer).items() if told != [(["/gateway", "/telematics"], True)]} == {}


def test_profiles_that_differ_have_sets_of_their_own() -> None:
    """One CA for both roles: where signers are not pinned, whoever it certified signs itself any right."""
    code, answer = fallen("turtlesim_shared_ca", 1, "/turtlesim", "/keyboard")
    assert (code, sets(answer)["spec"]) == (1, [])
    assert any((["/keyboard"], True) in told for told in sets(answer).values())


@pytest.mark.alloy
@pytest.mark.parametrize("engine", ["both", "alloy"])
def test_alloy_finds_the_same_sets(engine: str) -> None:
    humble = ("/telematics", "/motor", "--profile", "humble")
    code, answer = fallen("vehicle_compromised_relay", 2, *humble, "--engine", engine)
    _code, native = fallen("vehicle_compromised_relay", 2, *humble)
    assert (code, sets(answer)) == (1, sets(native))
    decided = {name for told in answer["profiles"].values() for each in told["sets"] for name in each["engines"]}
    assert decided == {"alloy", *(["native"] if engine == "both" else [])}


def test_an_engine_that_did_not_answer_says_nothing_survives() -> None:
    none = ("--engine", "alloy", "--offline", "--profile", "spec")
    code, answer = fallen("vehicle_healthy", 1, *MOTOR, *none, PATH="/nowhere", JAVA_HOME="/nowhere", HOME="/nowhere")
    assert (code, answer["flow"], answer["engines"]["alloy"]["status"]) == (4, None, "missing")
    assert answer["profiles"] == {"spec": {"survives": None, "sets": [UNDECIDED]}}


UNDECIDED = {"enclaves": [], "flow": None, "engines": {}, "path": None}


def test_names_are_escaped() -> None:
    done = run("flow", "flows/vehicle_healthy", "/\x1b[31m", "/motor", "--compromised", "1", *AT)
    assert "\x1b" not in done.stdout + done.stderr
