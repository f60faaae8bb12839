"""Writes what `--help` prints into docs/usage.md, where `<!-- help: COMMAND -->` stands before a block of code."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

USAGE = Path(__file__).resolve().parents[1] / "docs" / "usage.md"
BLOCK = re.compile(r"(<!-- help: (?P<command>[a-z -]*?) -->\n```\n).*?(\n```)", re.DOTALL)


def printed(command: str) -> str:
    """Return what the program prints, 80 columns wide."""
    words = command.removeprefix("keystore-audit").split()  # the program itself stands there by its name
    arguments = [sys.executable, "-m", "keystore_audit", *words, "--help"]
    environment = {"PATH": "", "COLUMNS": "80"}
    done = subprocess.run(arguments, capture_output=True, text=True, check=True, env=environment, cwd=USAGE.parents[1])
    return done.stdout.rstrip("\n")


def main() -> None:
    """Write the file again."""
    text = BLOCK.sub(lambda match: match[1] + printed(match["command"]) + match[3], USAGE.read_text("utf-8"))
    USAGE.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
