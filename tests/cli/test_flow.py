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


@pytest.mark.parametrize(
    ("profile", "attacker", "told"),
    [("cyclonedds-11", "relays", True), ("cyclonedds-11", "honest", False), ("fastdds-3.6", "relays", False)],
)
def test_what_an_attacker_is_assumed_to_announce_is_in_json(profile: str, attacker: str, told: bool) -> None:
    _code, answer = flow("vehicle_healthy", *MOTOR, "--profile", profile, "--attacker", attacker)
    names = {each["name"] for each in answer["assumptions"]}
    assert names == {"nothing-else-certified", *(["truthful-announcements"] if told else [])}


NEVER = {"honest": False, "source": False, "relays": False}
ALWAYS = {"honest": True, "source": True, "relays": True}


@pytest.mark.parametrize(
    ("sample", "ends", "expected"),
    [
        ("vehicle_healthy", MOTOR, NEVER),
        ("vehicle_plain_grant", MOTOR, ALWAYS),
        ("vehicle_governance_flag", MOTOR, ALWAYS),
        ("vehicle_compromised_relay", MOTOR, {**NEVER, "relays": True}),
        ("vehicle_bridged_domain", MOTOR, ALWAYS),
        ("turtlesim_healthy", ("/random", "/turtlesim", "--through", "/multiplexer"), NEVER),
        ("turtlesim_healthy", ("/random", "topic:/move_turtle"), ALWAYS),
        ("turtlesim_healthy", ("topic:/low_priority", "/turtlesim", "--through", "/multi*"), NEVER),
        ("turtlesim_healthy", ("outsider", "/*"), {"source": False, "relays": False}),
        ("turtlesim_healthy", ("/*", "outsider"), NEVER),
        ("../rules/KA412-payload-in-clear/bad", ("/talker", "outsider"), ALWAYS),
        ("../rules/KA412-payload-in-clear/bad", ("topic:/chatter", "outsider"), ALWAYS),
        ("../rules/KA412-payload-in-clear/good", ("/talker", "outsider"), NEVER),
        (
            "../rules/KA414-samples-unauthenticated/bad",
            ("outsider", "topic:/chatter"),
            {"source": True, "relays": True},
        ),
        ("turtlesim_random_moves_turtle", ("/random", "/turtlesim", "--through", "/multiplexer"), ALWAYS),
        ("chatter_partition_pattern", ("/listener", "/talker", "--profile", "spec"), ALWAYS),
        ("chatter_partition_named", ("/listener", "/talker", "--profile", "spec"), NEVER),
        ("chatter_other_domain", ("/listener", "/talker", "--profile", "fastdds"), {**ALWAYS, "honest": False}),
        ("chatter_other_domain", ("/listener", "/talker", "--profile", "cyclonedds"), NEVER),
        ("chatter_same_domain", ("/listener", "/talker", "--profile", "cyclonedds"), ALWAYS),
        ("chatter_written_elsewhere", ("/listener", "/talker", "--profile", "fastdds"), {**NEVER, "relays": True}),
        ("chatter_written_elsewhere", ("/listener", "/talker", "--profile", "cyclonedds"), NEVER),
        ("chatter_written_elsewhere", ("/listener", "topic:/map", "--profile", "fastdds"), {**NEVER, "relays": True}),
        ("chatter_written_here", ("/listener", "/talker", "--profile", "fastdds"), ALWAYS),
    ],
)
def test_who_has_to_attack(sample: str, ends: tuple[str, ...], expected: dict[str, bool]) -> None:
    code, answer = flow(sample, *ends)
    assert found(answer) == expected
    assert answer["flow"] is any(expected.values())
    assert code == int(any(expected.values()))


def test_each_hop_has_a_name_and_the_line_that_grants_it() -> None:
    _code, answer = flow("vehicle_plain_grant", *MOTOR, "--attacker", "honest")
    path = answer["attackers"]["honest"]["profiles"]["spec"]["path"]
    assert path["text"].startswith("/infotainment -> /media_state (topic) in domain 0 -> /gateway -> /motor_limit")
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


@pytest.mark.parametrize(
    ("sample", "ends", "attacker", "profile", "said", "places"),
    [
        (
            "vehicle_governance_flag",
            MOTOR,
            "honest",
            "spec",
            "/infotainment: enable_write_access_control is false.",
            ["enclaves/governance.p7s", "enclaves/motor/permissions.p7s"],
        ),
        (
            "vehicle_compromised_relay",
            MOTOR,
            "relays",
            "spec",
            "/gateway: with the keys that it holds, since rtps_protection_kind is SIGN",
            ["enclaves/infotainment/permissions.p7s", "enclaves/gateway/permissions.p7s"],
        ),
        (
            "chatter_written_elsewhere",
            ("/listener", "/talker"),
            "relays",
            "fastdds-3.6",
            "/listener: its own implementation lets it write there; honest peers would not take it, but who attacks",
            ["enclaves/listener/permissions.p7s", "enclaves/talker/permissions.p7s"],
        ),
        (
            "turtlesim_shared_ca",
            ("/random", "/turtlesim", "--through", "/multiplexer"),
            "relays",
            "cyclonedds-0.10",
            "(if some of those named attack). /random: it can sign itself permissions that its peers accept.",
            ["enclaves/random/cert.pem", "enclaves/turtlesim/cert.pem"],
        ),
    ],
)
def test_what_is_no_grant_of_the_permissions_ca_is_said(
    sample: str, ends: tuple[str, ...], attacker: str, profile: str, said: str, places: list[str]
) -> None:
    _code, answer = flow(sample, *ends)
    path = answer["attackers"][attacker]["profiles"][profile]["path"]
    assert said in path["text"]
    assert [step["path"] for step in path["steps"]][: len(places)] == places


def test_a_right_that_begins_later_is_told_by_the_line_that_gives_it_then() -> None:
    done = run(
        "flows/vehicle_expiring_grant", "--settings", "settings/vehicle.toml", "--engine", "native", *AT, "-f", "json"
    )
    told = next(each for each in json.loads(done.stdout)["findings"] if each["code"] == "KA740")
    assert "after 2027-03-01T00:00:00Z)." in told["message"]
    assert "enclaves/infotainment/permissions.p7s:102" in [f"{at['path']}:{at['line']}" for at in told["locations"]]


def test_an_implementation_in_which_everybody_signs_rights_for_itself() -> None:
    ends = ("/random", "/turtlesim", "--through", "/multiplexer")
    profiles = ("--profile", "cyclonedds-0.10", "--profile", "cyclonedds-11")
    for attacker, signs in (("honest", False), ("relays", True)):
        code, answer = flow("turtlesim_shared_ca", *ends, *profiles, "--attacker", attacker)
        by_profile = {name: each["flow"] for name, each in answer["attackers"][attacker]["profiles"].items()}
        assert (code, by_profile["cyclonedds-0.10"]) == (int(signs), signs)
    assert flow("turtlesim_split_cas", *ends, *profiles)[0] == 0


@pytest.mark.parametrize(
    ("at", "profile", "expected"),
    [("2026-11-21", "fastdds", 0), ("2027-03-03", "fastdds", 1), ("2027-03-03", "cyclonedds", 0)],
)
def test_a_grant_that_ends_makes_way_for_a_wider_one(at: str, profile: str, expected: int) -> None:
    done = run("flow", "flows/vehicle_expiring_grant", *MOTOR, "--at", at, "--profile", profile)
    assert done.returncode == expected
    assert f"As of {at}T00:00:00Z: dates may change it" in done.stdout, "no flow today is none for ever"


@pytest.mark.parametrize("doubt", ["unreadable", "ambiguous", "linked_away"])
def test_an_enclave_that_cannot_be_read_leaves_it_open(doubt: str) -> None:
    code, answer = flow(f"chatter_{doubt}_enclave", "/listener", "/talker")
    assert code == 4
    assert answer["flow"] is None
    text = run("flow", f"flows/chatter_{doubt}_enclave", "/listener", "/talker", *AT).stdout
    assert "UNKNOWN" in text
    assert "It depends on what could not be read: enclaves/" in text


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        (("/nobody", "/motor"), "'/nobody' names no enclave of this keystore"),
        (("/moto", "/motor"), "the nearest is '/motor'"),
        (("motor", "/motor"), "expected enclaves"),
        (("/motor", "topic:/motor_limt"), "no permissions document grants anything"),
        (("/motor", "/brake", "--through", "/brak"), "'/brak' names no enclave"),
        (("/motor", "/moto?"), "'/motor' is on both sides, and nothing else"),
        (("outsider", "outsider"), "the outsider is on both sides"),
        (("outsider", "/motor", "--attacker", "honest"), "nothing can get from the outsider as long as nobody attacks"),
        (("topic:/motor_limit", "topic:/motor_limit"), "'rt/motor_limit' is on both sides"),
        (("/motor", "/brake", "--attacker", "all"), "not one of honest, source, relays"),
    ],
)
def test_places_that_are_not_there_are_wrong_usage(ends: tuple[str, ...], said: str) -> None:
    done = run("flow", "flows/vehicle_healthy", *ends, *AT)
    assert done.returncode == 2
    assert said in done.stderr.replace("\n", " ")
    assert done.stdout == ""


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


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            'only_publish = { topic = ["/move_turtle",\n "/cmd_vl"], enclaves = "/keyboard" }\n',
            "4: no permissions",
        ),
        ('only_publish = { topic = "/move_turtle", enclaves = "/keybord" }\n', "4: '/keybord' names no enclave"),
        ('deterministic = { low = "/move_turtl", high = "/random" }\n', "4: no permissions document grants"),
        ('deterministic = { low = "/low_priority", high = "/randm" }\n', "4: '/randm' names no enclave"),
        (
            'no_flow = { from = "outsider", to = "/turtlesim", attacker = "honest" }\n',
            "4: nothing can get from the outsider as long as nobody attacks",
        ),
    ],
)
def test_what_names_nothing_is_told_where_it_stands(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "s.toml").write_text(f'\n[[property]]\nname = "x"\n{text}')
    done = audit(str(SAMPLES / "flows/turtlesim_healthy"), "--settings", "s.toml", at=tmp_path)
    assert done[0] == 2
    assert f"s.toml:{said}" in done[1]["stderr"]


def test_a_misspelt_place_is_named_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text('\n[[property]]\nname = "x"\nable = { from = "/keybord", to = "/turtlesim" }\n')
    code, said = audit(str(SAMPLES / "flows/turtlesim_healthy"), "--settings", "s.toml", at=tmp_path)
    assert code == 2
    assert "s.toml:4: '/keybord' names no enclave of this keystore; the nearest is '/keyboard'" in said["stderr"]


@pytest.mark.parametrize(
    "form",
    [
        'no_flow = { from = "/keyboard", to = ["topic:/move_turtle", "topic:/mov_turtle"] }',
        'only_publish = { topic = ["/move_turtle", "/mov_turtle"], enclaves = "/multiplexer" }',
        'encrypted = { topic = ["/move_turtle", "/mov_turtle"] }',
    ],
)
def test_a_misspelt_topic_beside_others_is_no_part_of_what_holds(tmp_path: Path, form: str) -> None:
    (tmp_path / "s.toml").write_text(f'[[property]]\nname = "x"\n{form}\n')
    code, said = audit(str(SAMPLES / "flows/turtlesim_healthy"), "--settings", "s.toml", at=tmp_path)
    assert code == 2
    assert "no permissions document grants anything on the DDS topic 'rt/mov_turtle'" in said["stderr"]


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


def test_the_same_way_has_its_lines_once() -> None:
    """A flow without any attack is one whoever attacks; another way has lines of its own."""
    same = run("flow", "flows/turtlesim_random_any_priority", "/random", "/turtlesim", *AT).stdout
    place = "(/random, rt/high_priority by rt/*_priority)"
    assert (same.count("FLOW"), " ".join(same.split()).count(place)) == (3, 1)
    assert same.count("by the same lines as above") == 2
    other = run("flow", "flows/vehicle_compromised_relay", *MOTOR, *AT).stdout
    assert "FLOW" in other
    assert "by the same lines as above" not in other


def test_lines_are_no_wider_than_80_columns() -> None:
    done = run("flow", "flows/turtlesim_healthy", "/random", "/turtlesim", *AT)
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert "enclaves/multiplexer/permissions.p7s:35" in done.stdout
