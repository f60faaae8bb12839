"""Writes what commands print into README.md, where `<!-- output of: COMMAND (begin) -->` stands before the block."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tools.samples.store import copy_with_modes  # noqa: E402

README: Final = ROOT / "README.md"
BLOCK: Final = re.compile(
    r"(<!-- output of: keystore-audit (?P<command>.+?) \(begin\) -->\n```\n).*?(\n```)", re.DOTALL
)

SHOWN: Final = "2026-11-24"
"""The day of the audit that is shown: what is printed must not change from day to day."""

AS_CLONED: Final = 0o644
"""The mode of private keys where git checks them out with the usual umask."""


def written() -> str:
    """Return the README with what its commands print now."""
    return BLOCK.sub(lambda match: match[1] + printed(match["command"]) + match[3], README.read_text("utf-8"))


def printed(command: str) -> str:
    """Return what the program prints, 80 columns wide, about samples as a clone has them.

    The native engine alone: with --quiet nothing tells that from both, and it needs no Java.
    """
    words = command.split()
    with tempfile.TemporaryDirectory() as scratch:
        for word in words:
            if word.startswith("sample_keystores/"):
                copy_with_modes(ROOT / word, Path(scratch) / word, AS_CLONED)
        done = subprocess.run(
            [sys.executable, "-m", "keystore_audit", *words, "--engine", "native"],
            capture_output=True,
            text=True,
            check=False,
            cwd=scratch,
            env={"PATH": os.environ.get("PATH", ""), "PYTHONPATH": str(ROOT), "COLUMNS": "80"},
        )
    return re.sub(r"(enclaves,\s)\d{4}-\d\d-\d\d\)", rf"\g<1>{SHOWN})", done.stdout.rstrip("\n"))


def main() -> None:
    """Write the file again."""
    README.write_text(written(), "utf-8")


if __name__ == "__main__":
    main()
