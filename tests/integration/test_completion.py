"""What a shell offers: asked of the program as the shell's script asks it, and of bash itself."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest


def offered(words: str, place: int) -> list[str]:
    environment = {"_KEYSTORE_AUDIT_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(place)}
    command = [sys.executable, "-m", "keystore_audit"]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment})
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.split()


@pytest.mark.parametrize(
    ("words", "place", "wanted"),
    [
        ("keystore-audit", 1, ["dir,", "plain,audit", "plain,can", "plain,diff"]),
        ("keystore-audit ex", 1, ["dir,ex", "plain,explain"]),
        ("keystore-audit --versi", 1, ["plain,--version"]),
        ("keystore-audit audit rob", 2, ["dir,rob"]),
        ("keystore-audit ./keys --fail", 2, ["plain,--fail-on"]),
        ("keystore-audit ./keys --fail-on hi", 3, ["plain,high"]),
        ("keystore-audit flow key", 2, ["dir,key"]),
        ("keystore-audit engine ", 2, ["plain,install"]),
        ("keystore-audit --fail", 1, ["plain,--fail-on"]),
        ("keystore-audit ./keys --profile opendds", 3, ["plain,opendds"]),
        ("keystore-audit ./keys --distro ja", 3, ["plain,jazzy"]),
        ("keystore-audit can --rmw cyc", 3, ["plain,cyclonedds"]),
        ("keystore-audit ./keys --select ka22", 3, ["plain,KA220", "plain,KA221", "plain,KA222"]),
        ("keystore-audit explain KA222", 2, ["plain,KA222"]),
    ],
)
def test_commands_directories_options_and_words(words: str, place: int, wanted: list[str]) -> None:
    found = offered(words, place)
    assert set(wanted) <= set(found)
    assert len(wanted) > 2 or found == wanted


@pytest.mark.parametrize("instruction", ["bash_source", "bash_complete", "zsh_source", "fish_source", "nonsense"])
def test_beside_a_command_line_nothing_is_offered_and_the_audit_is_made(instruction: str, repository: Path) -> None:
    variables = [f"{name}={instruction}" for name in ("_KEYSTORE_AUDIT_COMPLETE", "")]
    command = [sys.executable, "-m", "keystore_audit", "--engine", "native", "sample_keystores/stock/talker_listener"]
    done = subprocess.run(["env", *variables, *command], capture_output=True, text=True, cwd=repository)
    assert (done.returncode, done.stderr) == (1, "")
    assert "FAIL" in done.stdout


def test_bash_completes(oracle: Callable[[str], str], tmp_path: Path) -> None:
    (tmp_path / "robots").mkdir()
    script = """
    eval "$(_KEYSTORE_AUDIT_COMPLETE=bash_source keystore-audit)"
    complete -p keystore-audit
    COMP_WORDS=(keystore-audit ./robots --engine na) COMP_CWORD=3
    compopt() { :; }
    _keystore_audit_completion keystore-audit na --engine
    echo "${COMPREPLY[@]}"
    """
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    done = subprocess.run(
        [oracle("bash"), "-c", script], capture_output=True, text=True, cwd=tmp_path, env={**os.environ, "PATH": path}
    )
    assert done.stderr == ""
    registered, *replies = done.stdout.splitlines()
    assert registered.endswith("keystore-audit")
    assert replies == ["native"]
