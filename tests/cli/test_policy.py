"""`audit --policy`: real keystores and the policies that they were, or were not, made from."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from tests.cli.keystores import run_at

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "sample_keystores"
POLICIES = SAMPLES / "policies"
REFERENCES = ROOT.parent / "shared/reference/policies"
AT = ("--at", "2026-11-21T12:00:00Z", "--engine", "native", "--format", "json")
DRIFT = tuple(f"KA{number}" for number in range(640, 647))


def audit(*words: str | Path) -> CompletedProcess[str]:
    done = run_at(ROOT, *map(str, words))
    assert "Traceback" not in done.stdout + done.stderr
    return done


def drift(done: CompletedProcess[str]) -> list[tuple[str, str]]:
    """Codes and enclaves of the findings of drift."""
    findings = json.loads(done.stdout)["findings"]
    return [(finding["code"], finding["enclave"]) for finding in findings if finding["code"] in DRIFT]


@pytest.mark.parametrize("name", ["talker_listener", "turtlesim", "vehicle"])
def test_a_keystore_and_its_policy(name: str) -> None:
    done = audit(SAMPLES / "healthy" / name, *AT, "--policy", POLICIES / f"{name}.policy.xml")
    assert (done.stderr, drift(done)) == ("", [])
    report = json.loads(done.stdout)
    assert {(each["rule"], each["outcome"]) for each in report["outcomes"] if each["rule"] in DRIFT} == {
        (code, "pass") for code in DRIFT
    }


@pytest.mark.skipif(not REFERENCES.exists(), reason="the reference policies are not there")
def test_what_the_real_tool_made_of_its_sample_policy() -> None:
    policy = REFERENCES / "sros2-rolling/sample.policy.xml"
    done = audit(SAMPLES / "stock/sample_policy", *AT, "--policy", policy)
    assert drift(done) == []


def test_include_directory(tmp_path: Path) -> None:
    shutil.copytree(POLICIES / "common", tmp_path / "common")
    robots = tmp_path / "robots"
    robots.mkdir()
    text = (POLICIES / "turtlesim.policy.xml").read_text("utf-8")
    (robots / "a.xml").write_text(text.replace('href="common', 'href="../common'), "utf-8")
    keystore = SAMPLES / "healthy/turtlesim"
    refused = audit(keystore, *AT, "--policy", robots / "a.xml")
    assert (refused.returncode, refused.stdout) == (2, "")
    assert f"{robots}/a.xml:7: " in refused.stderr
    done = audit(keystore, *AT, "--policy", robots / "a.xml", "--policy-include", tmp_path)
    assert (done.stderr, drift(done)) == ("", [])
