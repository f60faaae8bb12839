"""`keystore-audit flow`, and what settings assert, on the samples below flows/."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.cli.keystores import run_at
from tests.schemas import schema

SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"
AT = ("--at", "2026-11-21T12:00:00Z")


def run(*arguments: str, at: Path = SAMPLES, **environment: str) -> subprocess.CompletedProcess[str]:
    return run_at(at, *arguments, **environment)


def flow(sample: str, *arguments: str) -> tuple[int, dict[str, Any]]:
    done = run("flow", f"flows/{sample}", *arguments, *AT, "-f", "json")
    answer = json.loads(done.stdout)
    schema("flow").validate(answer)
    return done.returncode, answer


def found(answer: dict[str, Any]) -> dict[str, bool | None]:
    return {attacker: each["flow"] for attacker, each in answer["attackers"].items()}


MOTOR = ("/infotainment", "/motor")


def test_each_hop_has_a_name_and_the_line_that_grants_it() -> None:
    _code, answer = flow("vehicle_plain_grant", *MOTOR, "--attacker", "honest")
    path = answer["attackers"]["honest"]["profiles"]["spec"]["path"]
    assert path["text"].startswith("/infotainment -> /media_state (domain 0) -> /gateway -> /motor_limit")
    hops = [(step["enclave"], step["witness"]) for step in path["steps"]]
    assert hops == [
        ("/infotainment", "rt/media_state"),
        ("/gateway", "rt/media_state"),
        ("/gateway", "rt/motor_limit"),
        ("/motor", "rt/motor_limit"),
    ]
    for step in path["steps"]:
        line = (SAMPLES / "flows/vehicle_plain_grant" / step["path"]).read_text().splitlines()[step["line"] - 1]
        assert line.strip() == f"<topic>{step['witness']}</topic>"


def test_a_right_that_begins_later_is_told_by_the_line_that_gives_it_then() -> None:
    done = run(
        "flows/vehicle_expiring_grant", "--settings", "settings/vehicle.toml", "--engine", "native", *AT, "-f", "json"
    )
    told = next(each for each in json.loads(done.stdout)["findings"] if each["code"] == "KA740")
    assert "after 2027-03-01T00:00:00Z)." in told["message"]
    assert "enclaves/infotainment/permissions.p7s:102" in [f"{at['path']}:{at['line']}" for at in told["locations"]]


def test_names_are_escaped() -> None:
    done = run("flow", "flows/vehicle_healthy", "/motor", "topic:/\x1b[31m*", *AT)
    assert "\x1b" not in done.stdout + done.stderr


def audit(keystore: str, *arguments: str, at: Path, **environment: str) -> tuple[int, dict[str, Any]]:
    done = run("audit", keystore, "--engine", "native", "-f", "json", *AT, *arguments, at=at, **environment)
    return done.returncode, json.loads(done.stdout) if done.stdout else {"stderr": done.stderr}


def test_settings_of_the_working_directory_count_save_in_ci_and_with_deployed(tmp_path: Path) -> None:
    keystore = str(SAMPLES / "flows/turtlesim_random_moves_turtle")
    shutil.copy(SAMPLES / "settings/turtlesim.toml", tmp_path / "keystore-audit.toml")
    code, report = audit(keystore, at=tmp_path)
    assert (code, report["settings"]["path"]) == (1, "keystore-audit.toml")
    asserted = {each["id"]: each["status"] for each in report["properties"]}
    assert asserted["random-reaches-turtlesim-only-through-multiplexer"] == "violated"
    assert asserted["keyboard-moves-the-turtle"] == "holds"
    passed_over = {
        "the variable CI is set": audit(keystore, at=tmp_path, CI="true")[1],
        "--deployed is given": audit(keystore, "--deployed", at=tmp_path)[1],
        "a statement is written": audit(keystore, "-o", "svr=s.json", at=tmp_path)[1],
        "the variable CI is set and --deployed is given": audit(keystore, "--deployed", at=tmp_path, CI="1")[1],
    }
    for why, unasked in passed_over.items():
        assert unasked["settings"] is None
        said = f"./keystore-audit.toml was not used, since {why}; name it with --settings"
        assert said in unasked["weakened"]
    code, report = audit(keystore, "--settings", "keystore-audit.toml", at=tmp_path, CI="true")
    assert (code, report["settings"]["path"]) == (1, "keystore-audit.toml")
    for used in (report, audit(keystore, at=tmp_path / "..", CI="true")[1]):
        assert not any("was not used" in reason for reason in used["weakened"])


def test_settings_inside_of_the_keystore_are_refused(tmp_path: Path) -> None:
    shutil.copytree(SAMPLES / "flows/turtlesim_healthy", tmp_path / "keys", symlinks=True)
    shutil.copy(SAMPLES / "settings/turtlesim.toml", tmp_path / "keys/keystore-audit.toml")
    for at, arguments in ((tmp_path, ("keys", "--settings", "keys/keystore-audit.toml")), (tmp_path / "keys", (".",))):
        code, said = audit(*arguments, at=at)
        assert code == 2
        assert "would judge itself" in said["stderr"]


def test_when_an_asserted_property_ends_is_told() -> None:
    code, report = audit(
        "flows/vehicle_expiring_grant", "--settings", "settings/vehicle.toml", "--profile", "fastdds", at=SAMPLES
    )
    assert code == 1
    told = [each for each in report["findings"] if each["code"] == "KA740"]
    assert told
    assert all("after 2027-03-01T" in each["message"] for each in told)
    code, report = audit(
        "flows/vehicle_expiring_grant", "--settings", "settings/vehicle.toml", "--profile", "cyclonedds", at=SAMPLES
    )
    assert [each for each in report["findings"] if each["code"] == "KA740"] == []


@pytest.mark.parametrize(
    ("until", "zone", "holds"),
    [
        ("2027-02-27", (), True),
        ("2027-02-28", (), False),  # it may be March in the robot's zone
        ("2027-02-28", ("--time-zone", "UTC"), True),
        ("2027-03-01", ("--time-zone", "UTC"), False),
    ],
)
def test_a_date_in_a_zone_that_nobody_told_comes_14_hours_early(
    tmp_path: Path, until: str, zone: tuple[str, ...], holds: bool
) -> None:
    flow_form = 'no_flow = { from = "/infotainment", to = "/motor" }'
    (tmp_path / "s.toml").write_text(f'[[property]]\nname = "never"\nuntil = {until}\n{flow_form}\n')
    keystore = str(SAMPLES / "flows/vehicle_expiring_grant")
    _code, report = audit(keystore, "--settings", "s.toml", "--profile", "fastdds", *zone, at=tmp_path)
    (asserted,) = (each for each in report["properties"] if each["id"] == "never")
    assert (asserted["status"] == "holds") is holds


def test_safe_until_counts_what_is_asserted(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(
        '[[property]]\nname = "never"\nno_flow = { from = "/infotainment", to = "/motor" }\n'
    )
    keystore = str(SAMPLES / "flows/vehicle_expiring_grant")
    arguments = ("--settings", "s.toml", "--profile", "fastdds", "--time-zone", "UTC", "--engine", "native", "-v")
    done = run("audit", keystore, *AT, *arguments, at=tmp_path)
    assert "Changes at 2027-03-01T00:00:01Z: never: violated." in " ".join(done.stdout.split())
