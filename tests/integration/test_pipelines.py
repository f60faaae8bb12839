"""The hook of pre-commit and the action, as far as they can be run without the services that they are for."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

PROGRAMS = Path(sys.executable).parent


def loaded(path: Path) -> Any:
    return yaml.safe_load(path.read_text())


@pytest.mark.parametrize(("sample", "code"), [("healthy", 0), ("stock", 1)])
def test_the_hook_audits_what_is_in_the_working_directory(
    repository: Path, tmp_path: Path, sample: str, code: int
) -> None:
    (hook,) = loaded(repository / ".pre-commit-hooks.yaml")
    shutil.copytree(repository / "sample_keystores" / sample / "talker_listener", tmp_path / "src/keys", symlinks=True)
    command = [*hook["entry"].split(), *hook["args"]]
    done = subprocess.run([PROGRAMS / command[0], *command[1:]], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (code, "")
    assert hook["pass_filenames"] is False  # a keystore is judged as a whole
    assert hook["always_run"] is True  # by names alone, nothing would see links that changed, and files that are gone


def action(repository: Path, tmp_path: Path, **inputs: str) -> tuple[int, dict[str, str], str]:
    """The exit code of the action's step, what it gives to later ones, and its summary."""
    document = loaded(repository / "action.yml")
    (step,) = (step for step in document["runs"]["steps"] if step.get("id") == "audit")
    values = {name: str(each.get("default", "")) for name, each in document["inputs"].items()} | inputs
    given = {
        name: re.sub(r"\$\{\{ inputs\.(\w+) \}\}", lambda match: values[match[1]], text)
        for name, text in step["env"].items()
    }
    (tmp_path / "keystore-audit").mkdir(exist_ok=True)
    with_programs = tmp_path / "keystore-audit/bin"
    if not with_programs.exists():
        with_programs.symlink_to(PROGRAMS)
    files = {name: str(tmp_path / name) for name in ("GITHUB_OUTPUT", "GITHUB_STEP_SUMMARY")}
    environment = {**os.environ, **given, **files, "RUNNER_TEMP": str(tmp_path), "CI": "true"}
    command = ["bash", "--noprofile", "--norc", "-e", "-o", "pipefail", "-c", step["run"]]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=repository)
    assert "Traceback" not in done.stderr
    outputs = dict(line.split("=", 1) for line in Path(files["GITHUB_OUTPUT"]).read_text().splitlines())
    summary = Path(files["GITHUB_STEP_SUMMARY"])
    return done.returncode, outputs, summary.read_text() if summary.exists() else ""


@pytest.mark.parametrize(("sample", "code"), [("healthy/turtlesim", 0), ("stock/turtlesim", 1)])
def test_the_action_says_what_the_audit_says(repository: Path, tmp_path: Path, sample: str, code: int) -> None:
    keystore = f"sample_keystores/{sample}"
    found, outputs, summary = action(repository, tmp_path, keystores=f"{keystore}\n", alloy="false")
    assert (found, outputs["exit-code"]) == (code, str(code))
    assert '"version": "2.1.0"' in Path(outputs["sarif"]).read_text()
    assert f"## keystore-audit: {'PASS' if code == 0 else 'FAIL'}" in summary


@pytest.mark.parametrize(("alloy", "engine"), [("false", "native"), ("true", "both"), ("True", "both"), ("no", "both")])
def test_the_action_leaves_alloy_out_where_it_is_told_to_alone(repository: Path, alloy: str, engine: str) -> None:
    said = []
    for step in loaded(repository / "action.yml")["runs"]["steps"]:
        (line,) = (line for line in step["run"].splitlines() if "$ALLOY" in line)
        calls = "keystore-audit() { echo called; }; RUNNER_TEMP=; "
        script = calls + line.replace('"$RUNNER_TEMP/keystore-audit/bin/keystore-audit"', "keystore-audit")
        done = subprocess.run(
            ["bash", "-c", f"{script}; echo ${{engine:-}}"], env={"ALLOY": alloy}, capture_output=True, text=True
        )
        said.append(done.stdout.split())
    assert said == [["called"] if engine == "both" else [], [engine]]


def test_the_action_runs_nothing_that_its_inputs_say(repository: Path, tmp_path: Path) -> None:
    hostile = f"$(touch {tmp_path}/ran)\n`touch {tmp_path}/ran`; touch {tmp_path}/ran\n--help"
    code, outputs, _summary = action(repository, tmp_path, keystores=hostile, alloy="false")
    assert (code, outputs) == (3, {"exit-code": "3"})
    assert not (tmp_path / "ran").exists()
    arguments = "--profile=humble\r\n\n--ignore=KA105\n"
    named = "sample_keystores/healthy/turtlesim"
    assert action(repository, tmp_path, keystores=named, arguments=arguments, alloy="false")[0] == 0
    assert action(repository, tmp_path, keystores="", alloy="false")[0] == 2
    code, outputs, _summary = action(repository, tmp_path, keystores=named, arguments="--help", alloy="false")
    assert (code, outputs["exit-code"]) == (4, "4")


def test_the_action_installs_what_is_locked(repository: Path) -> None:
    install = loaded(repository / "action.yml")["runs"]["steps"][0]["run"]
    assert "--require-hashes" in install
    for name in re.findall(r"\$GITHUB_ACTION_PATH/([\w./]+)", install):
        assert (repository / name).exists()


def test_the_action_runs_no_module_of_what_it_audits(repository: Path, tmp_path: Path) -> None:
    install = loaded(repository / "action.yml")["runs"]["steps"][0]["run"]
    (tmp_path / "venv.py").write_text("raise SystemExit('hostile')\n")
    (line,) = (line for line in install.splitlines() if " -m venv " in line)
    line += " --without-pip"
    for script, code in ((line, 0), (line.replace(" -I ", " "), 1)):
        environment = {**os.environ, "RUNNER_TEMP": str(tmp_path / "temp")}
        done = subprocess.run(["bash", "-c", script], cwd=tmp_path, env=environment, capture_output=True)
        assert done.returncode == code, done.stderr


def test_the_image_is_made_of_what_is_there(repository: Path) -> None:
    """The image itself is built by hand (docs/integrations.md says how it was tried)."""
    ignored = (repository / ".dockerignore").read_text().splitlines()
    for line in (repository / "Dockerfile").read_text().splitlines():
        if line.startswith("COPY ") and "--from" not in line:
            for name in line.split()[1:-1]:
                assert (repository / name).exists()
                assert f"!{name}" in ignored
