"""Where Python lacks what only POSIX has: every module loads, help is there, and an audit says why it cannot be."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from keystore_audit.cli.types import COMMANDS

WITHOUT = """
import importlib.abc, os, pkgutil, runpy, sys
class Block(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name in ("fcntl", "resource", "pwd", "grp", "termios", "syslog"):
            raise ModuleNotFoundError(name, name=name)
for name in ("fcntl", "resource", "pwd", "grp", "termios", "syslog"):
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Block())
for name in ("O_NOFOLLOW", "O_DIRECTORY", "O_CLOEXEC", "O_NONBLOCK", "O_PATH", "fchmod", "getuid", "geteuid", "killpg"):
    if hasattr(os, name):
        delattr(os, name)
os.supports_dir_fd = set()
"""
"""What Windows has not."""


def run(program: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", f"{WITHOUT}{program}", *words], capture_output=True, text=True, check=False, timeout=120
    )


def test_every_module_loads(repository: Path) -> None:
    done = run(
        "import keystore_audit\n"
        "found = [each.name for each in pkgutil.walk_packages(keystore_audit.__path__, 'keystore_audit.')]\n"
        "[__import__(name) for name in found if not name.endswith('__main__')]\nprint(len(found))"
    )
    assert done.stderr == ""
    assert int(done.stdout) == len(list((repository / "keystore_audit").rglob("*.py"))) - 1, (
        "all but the package itself"
    )


PROGRAM = "runpy.run_module('keystore_audit', run_name='__main__')"


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_there(command: str) -> None:
    done = run(PROGRAM, command, "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("Usage: ")


def test_an_audit_says_in_a_line_why_it_cannot_be(repository: Path) -> None:
    done = run(PROGRAM, os.fspath(repository / "sample_keystores/healthy/turtlesim"), "--engine", "native")
    assert (done.returncode, done.stdout) == (4, "")
    assert done.stderr == (
        "keystore-audit: This system cannot open files below a directory without following links, so nothing is "
        "decided: run it on Linux or macOS.\n"
    )
