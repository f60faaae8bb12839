"""`keystore-audit diff --rolling` on the samples below flows/; its text stands in golden/cli/rolling.txt."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.cli.test_flow import AT, SAMPLES, run
from tests.schemas import schema

CLAIMS = ("--settings", str(SAMPLES / "settings/vehicle.toml"))
HALVES = ("flows/vehicle_gateway_reads", "flows/vehicle_gateway_writes")
HONEST = "infotainment-never-reaches-motor-by-rights-alone"
MOVED = ("flows/vehicle_healthy", "flows/vehicle_moved")


def rolling(old: str | Path, new: str | Path, *arguments: str) -> tuple[int, dict[str, Any]]:
    done = run("diff", str(old), str(new), "--rolling", *AT, *arguments, "-f", "json")
    answer = json.loads(done.stdout)
    schema("rolling").validate(answer)
    return done.returncode, answer


def orders(answer: dict[str, Any]) -> dict[str, tuple[list[str], list[str], bool]]:
    return {each["id"]: (each["updated"], each["waiting"], each["lasting"]) for each in answer["passages"]}


def test_two_halves_of_a_way_are_a_way_while_the_old_half_is_valid() -> None:
    """Each keystore keeps the property; the gateway keeps the old document."""
    for each in HALVES:
        audited = run(each, "--engine", "native", *CLAIMS, *AT, "-f", "json")
        status = {each["id"]: each["status"] for each in json.loads(audited.stdout)["properties"]}
        assert status[HONEST] == "holds"
    code, answer = rolling(*HALVES, *CLAIMS)
    assert (code, answer["status"]) == (1, "violated")
    assert orders(answer)[HONEST] == (["/gateway"], [], True)
    told = next(each for each in answer["passages"] if each["id"] == HONEST)
    assert told["until"] == "2100-01-01T00:00:00"
    assert "old:enclaves/gateway/permissions.p7s" in [step["path"] for step in told["counterexample"]["steps"]]


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
@pytest.mark.parametrize("engine", ["both", "auto"])
def test_alloy_says_the_same_where_it_is_asked(engine: str) -> None:
    (code, native), (asked, both) = rolling(*HALVES, *CLAIMS), rolling(*HALVES, *CLAIMS, "--engine", engine)
    assert {name: each["status"] for name, each in both["engines"].items()} == {"native": "ok", "alloy": "ok"}
    assert (asked, both["passages"]) == (code, native["passages"])
    refused = run("diff", *HALVES, "--engine", engine, *AT)
    assert (refused.returncode, "--engine says nothing about" in refused.stderr) == (2, True)


def test_no_change_fails_nothing() -> None:
    code, answer = rolling(HALVES[0], HALVES[0], *CLAIMS)
    assert (code, answer["status"], answer["changing"], answer["passages"]) == (0, "holds", [], [])


def test_another_domain_is_reached_enclave_by_enclave() -> None:
    code, answer = rolling(*MOVED)
    assert code == 1
    updated, waiting, lasting = orders(answer)["no-enclave-bridges-domains"]
    assert (len(updated), len(waiting), lasting) == (1, 1, False)
    assert updated != waiting


def test_what_could_not_be_read_is_unknown(tmp_path: Path) -> None:
    for name in HALVES:
        shutil.copytree(SAMPLES / name, tmp_path / Path(name).name, symlinks=True)
    old, new = (tmp_path / Path(name).name for name in HALVES)
    document = new / "enclaves/motor/permissions.p7s"
    document.write_bytes(document.read_bytes()[:-300])
    code, answer = rolling(old, new, *CLAIMS)
    assert (code, answer["status"]) == (4, "unknown")
    assert {each["reason"] for each in answer["passages"] if each["status"] == "unknown"} == {
        "unknown in OLD or in NEW"
    }


@pytest.mark.parametrize(
    "option", [("--fail-on", "any"), ("--label", "x"), ("--policy", "p.xml"), ("--graph", "g.json"), ("-f", "markdown")]
)
def test_options_about_changes_are_refused(option: tuple[str, str]) -> None:
    done = run("diff", *HALVES, "--rolling", *CLAIMS, *option, *AT)
    assert (done.returncode, "--rolling" in done.stderr) == (2, True)


def test_a_claim_of_what_one_side_lacks_is_wrong_usage(tmp_path: Path) -> None:
    claims = tmp_path / "claims.toml"
    claims.write_text('[[property]]\nname = "apart"\nno_flow = { from = "/nobody", to = "/motor" }\n')
    assert run("diff", *HALVES, "--rolling", "--settings", str(claims), *AT).returncode == 2


def test_names_are_escaped(tmp_path: Path) -> None:
    for name in HALVES:
        shutil.copytree(SAMPLES / name, tmp_path / Path(name).name, symlinks=True)
        (tmp_path / Path(name).name / "enclaves/gateway").rename(tmp_path / Path(name).name / "enclaves/gate\x1b[31m")
    done = run("diff", *(str(tmp_path / Path(name).name) for name in HALVES), "--rolling", *AT)
    assert "gate" in done.stdout
    assert "\x1b" not in done.stdout + done.stderr
