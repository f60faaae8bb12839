"""`[enclaves."/arm"]` of settings at the command line: what commands say of a mixed fleet, or that they know none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.keystores import answer
from tests.keystore.builder import sros2
from tests.schemas import schema

STOCK = Path(__file__).parents[2] / "sample_keystores/stock/talker_listener"
AT = ("--at", "2026-11-23T00:00:00Z")
HUMBLE = ("--distro", "humble", "--rmw", "fastdds")
SAID = "/listener on Cyclone DDS 0.10, declared"


@pytest.fixture
def settings(tmp_path: Path) -> tuple[str, str]:
    place = tmp_path / "settings.toml"
    place.write_text('[enclaves."/listener"]\nrmw = "cyclonedds"\n')
    return "--settings", str(place)


def test_the_audit_says_which_fleet_it_judged(settings: tuple[str, str]) -> None:
    """On Fast DDS alone the stock keystore passes; the listener on Cyclone DDS takes what the talker signs itself."""
    assert answer("audit", STOCK, *AT, *HUMBLE)[0] == 0
    code, said = answer("audit", STOCK, *AT, *HUMBLE, *settings, "-f", "json", "--engine", "auto")
    report = json.loads(said)
    assert code == 1
    assert report["engines_agree"] is True
    assert report["scope"] == f"Humble with Fast DDS 2.6; {SAID}"
    assert [*report["enclaves"][0]["profiles"]] == ["fastdds-2.6"]
    [forged] = [each for each in report["properties"] if each["id"] == "no-enclave-grants-itself-rights"]
    assert forged["profiles"]["fastdds-2.6"]["status"] == "violated"
    [cause] = [each["fingerprint"] for each in report["findings"] if each["code"] == "KA222"]
    [found] = [each["explained_by"] for each in report["findings"] if each["code"] == "KA705"]
    assert cause in found, "what the listener runs alone explains what the fleet lets happen"
    code, text = answer("audit", STOCK, *AT, *HUMBLE, *settings, "-v")
    assert f"scope: Humble with Fast DDS 2.6; {SAID}" in text
    assert "not judged here" not in text
    page = answer("audit", STOCK, *AT, *HUMBLE, *settings, "-f", "html")[1]
    assert "not judged here" not in page
    assert "each profile is judged as if all ran it" not in " ".join(text.split())


def test_questions_are_about_that_fleet(settings: tuple[str, str]) -> None:
    """Who runs Cyclone DDS decides as it does; its first line says what it is about."""
    asked = ("can", STOCK, "/talker", "publish", "/other", "--effective", *AT, *HUMBLE)
    assert answer(*asked)[0] == 1
    code, said = answer(*asked, *settings)
    assert (code, SAID in said.splitlines()[0]) == (0, True)
    code, said = answer(*asked, *settings, "-f", "json")
    schema("can").validate(json.loads(said))
    assert json.loads(said)["declared"] == SAID
    assert "declared" not in json.loads(answer(*asked, "-f", "json")[1])
    code, said = answer("access", STOCK, *AT, *HUMBLE, *settings, "-f", "json")
    schema("access").validate(json.loads(said))
    assert json.loads(said)["declared"] == SAID
    assert SAID in " ".join(answer("access", STOCK, *AT, *HUMBLE, *settings)[1].split())
    flow = ("flow", STOCK, "/listener", "/talker", "--attacker", "honest", *AT, *HUMBLE, *settings)
    assert SAID in " ".join(answer(*flow)[1].split())
    said = answer(*flow, "-f", "json")[1]
    schema("flow").validate(json.loads(said))
    assert json.loads(said)["declared"] == SAID


@pytest.mark.parametrize(
    ("others", "accepted"), [({}, False), ({"/other": "cyclonedds"}, True), ({"/talker": "cyclonedds"}, True)]
)
def test_nobody_is_its_own_peer_in_a_mixed_fleet(others: dict[str, str], accepted: bool, tmp_path: Path) -> None:
    """What the listener signs itself is taken on Cyclone DDS 0.10: by another enclave there, if there is one."""
    root = sros2(tmp_path / "keys", ("/listener", "/talker", "/other"))
    place = tmp_path / "settings.toml"
    runs = {"/listener": "cyclonedds", **others}
    place.write_text("".join(f'[enclaves."{path}"]\nrmw = "{rmw}"\n' for path, rmw in runs.items()))
    asked = ("can", root, "/listener", "publish", "/other", "--effective", *AT, *HUMBLE, "--settings", place)
    assert (answer(*asked)[0] == 0) is accepted


def test_who_may_fall_and_what_keys_open_is_asked_of_that_fleet(settings: tuple[str, str]) -> None:
    """What an enclave signs itself the listener takes, on Cyclone DDS 0.10; where all run Fast DDS nobody does."""
    falls = ("flow", STOCK, "/listener", "/talker", "--compromised", "1", *AT, *HUMBLE, "-f", "json")
    stolen = ("flow", STOCK, "--from-compromised", "/talker", *AT, *HUMBLE, "-f", "json")
    (code, said), (opens, key) = answer(*falls, *settings, "--engine", "both"), answer(*stolen, *settings)
    for name, document in (("fallen", said), ("compromise", key)):
        schema(name).validate(json.loads(document))
        assert json.loads(document)["declared"] == SAID
    [found] = json.loads(said)["profiles"]["fastdds-2.6"]["sets"]
    assert (code, found["enclaves"], found["engines"]) == (1, ["/talker"], {"alloy": True, "native": True})
    written = [
        json.loads(each)["keys"][0]["alone"]["fastdds-2.6"]["topics_written"] for each in (key, answer(*stolen)[1])
    ]
    assert (opens, answer(*falls)[0]) == (1, 0)
    assert written[0] != written[1]


@pytest.mark.parametrize(
    "asked",
    [
        ("diff", STOCK, STOCK),
        ("diff", STOCK, STOCK, "--rolling"),
        ("suggest", STOCK, "--policy", "POLICY"),
    ],
)
def test_a_command_that_knows_no_mixed_fleets_refuses(
    asked: tuple[str | Path, ...], settings: tuple[str, str], tmp_path: Path
) -> None:
    policy = tmp_path / "policy.xml"
    policy.write_text('<policy version="0.2.0"><enclaves/></policy>')
    words = [str(policy) if word == "POLICY" else word for word in asked]
    assert answer(*words, *AT, *settings)[0] == 2


def test_what_leaves_open_which_release_runs_is_an_error(settings: tuple[str, str]) -> None:
    """Not so of the specification beside others, as in the default scope."""
    assert answer("audit", STOCK, *AT, *settings, "--profile", "spec")[0] == 2
    code, said = answer("audit", STOCK, *AT, *settings, "--engine", "native")
    assert (code, "/listener on Cyclone DDS 0.10 or Cyclone DDS 11, declared" in " ".join(said.split())) == (1, True)
