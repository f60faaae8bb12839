"""Writes what `--help` prints into docs/usage.md, where `<!-- help: COMMAND -->` stands before a block of code.

An option that a command above explains in the same words is only named, behind "As for COMMAND:".
"""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap
from pathlib import Path

USAGE = Path(__file__).resolve().parents[1] / "docs" / "usage.md"
BLOCK = re.compile(r"(<!-- help: (?P<command>[a-z -]*?) -->\n```\n).*?(\n```)", re.DOTALL)
_OPTION = re.compile(r"^  (?:-\w, )?(--[\w-]+).*\n(?: {4,}.*\n)*", re.MULTILINE)


def printed(command: str) -> str:
    """Return what the program prints, 80 columns wide."""
    words = command.removeprefix("keystore-audit").split()  # the program itself stands there by its name
    arguments = [sys.executable, "-m", "keystore_audit", *words, "--help"]
    environment = {"PATH": "", "COLUMNS": "80"}
    done = subprocess.run(arguments, capture_output=True, text=True, check=True, env=environment, cwd=USAGE.parents[1])
    return done.stdout


def shown(command: str, explained: dict[tuple[str, ...], str]) -> str:
    """Return the help of a command. Options that `explained` has by their words are named; it gets all others."""
    named: dict[str, list[str]] = {}

    def own(match: re.Match[str]) -> str:
        above = explained.setdefault(tuple(match[0].split()), command)
        if above == command:
            return match[0]
        named.setdefault(above, []).append(match[1])
        return ""

    text = _OPTION.sub(own, printed(command)).rstrip("\n")
    lines = [f"As for {above}: {', '.join(names)}." for above, names in named.items() if names != ["--help"]]
    return "\n".join([text, *([""] if lines else []), *(_wrapped(line.replace(", --help.", ".")) for line in lines)])


def _wrapped(line: str) -> str:
    return textwrap.fill(line, 78, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)


def written() -> str:
    """Return the page as it has to be."""
    explained: dict[tuple[str, ...], str] = {}
    return BLOCK.sub(
        lambda match: f"{match[1]}{shown(match['command'], explained)}{match[3]}", USAGE.read_text("utf-8")
    )


def main() -> None:
    """Write the file again."""
    USAGE.write_text(written(), "utf-8")


if __name__ == "__main__":
    main()
