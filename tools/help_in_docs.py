"""Writes what `--help` prints into docs/usage.md, where `<!-- help: COMMAND -->` stands before a block of code.

Options that read the same for `audit` are printed there alone: other blocks end with their names.
"""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap
from pathlib import Path

USAGE = Path(__file__).resolve().parents[1] / "docs" / "usage.md"
BLOCK = re.compile(r"(<!-- help: (?P<command>[a-z -]*?) -->\n```\n)(?P<shown>.*?)(\n```)", re.DOTALL)
_OPTION = re.compile(r"^  (?:-\w, )?(--[\w-]+).*\n(?: {4,}.*\n)*", re.MULTILINE)
_FULL = "audit"


def printed(command: str) -> str:
    """Return what the program prints, 80 columns wide."""
    words = command.removeprefix("keystore-audit").split()  # the program itself stands there by its name
    arguments = [sys.executable, "-m", "keystore_audit", *words, "--help"]
    environment = {"PATH": "", "COLUMNS": "80"}
    done = subprocess.run(arguments, capture_output=True, text=True, check=True, env=environment, cwd=USAGE.parents[1])
    return done.stdout


def _explained(text: str) -> set[tuple[str, ...]]:
    """Return the words about each option, whatever the columns."""
    return {tuple(match[0].split()) for match in _OPTION.finditer(text)}


def shown(command: str, full: str) -> str:
    """Return the help of a command, without what `full`, the help of `audit`, explains in the same words."""
    text = printed(command)
    if command == _FULL:
        return text.rstrip("\n")
    shared: list[str] = []

    def own(match: re.Match[str]) -> str:
        if tuple(match[0].split()) not in _explained(full):
            return match[0]
        shared.append(match[1])
        return ""

    text = _OPTION.sub(own, text).rstrip("\n")
    named = [name for name in shared if name != "--help"]
    if not named:
        return text
    line = f"As for {_FULL}: {', '.join(named)}."
    return f"{text}\n\n{textwrap.fill(line, 78, initial_indent='  ', subsequent_indent='  ', break_on_hyphens=False)}"


def written() -> str:
    """Return the page as it has to be."""
    full = printed(_FULL)
    text = USAGE.read_text("utf-8")
    return BLOCK.sub(lambda match: f"{match[1]}{shown(match['command'], full)}{match[4]}", text)


def main() -> None:
    """Write the file again."""
    USAGE.write_text(written(), "utf-8")


if __name__ == "__main__":
    main()
