"""Writes what commands print into pages: into each block of code that stands right below a block of shell.

A page's blocks of shell that have such an answer run one after the other, in one folder with the samples that it names.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from datetime import datetime, timezone
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tools.samples.store import copy_with_modes  # noqa: E402

PAGES: Final = ("README.md", "docs/quickstart.md", "docs/ci.md", "docs/usage.md", "docs/zenoh.md")
BLOCK: Final = re.compile(r"(^```sh\n(?P<script>(?:(?!```).*\n)+)```\n```(?:toml)?\n)(?:(?!```).*\n)*", re.MULTILINE)

SHOWN: Final = "2026-11-24"
"""The day of the audit that is shown: what is printed must not change from day to day."""

AS_CLONED: Final = 0o644
"""The mode of private keys where git checks them out with the usual umask."""

PROGRAM: Final = """#!/bin/sh
case $1 in access|can|check|diff|explain|flow|model|prove|rules|suggest) ;; *) set -- "$@" --engine native ;; esac
exec '{python}' -m keystore_audit "$@"
"""
"""The native engine alone: with --quiet nothing tells that from both, and it needs no Java."""


def written(page: str) -> str:
    """Return the page with what its commands print now, 80 columns wide."""
    text = (ROOT / page).read_text("utf-8")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for sample in {"graphs", *re.findall(r"\b(?:flows|healthy|networks|stock|zenoh)/\w+", text)}:
            copy_with_modes(ROOT / "sample_keystores" / sample, folder / "sample_keystores" / sample, AS_CLONED)
        program = folder / "bin/keystore-audit"
        program.parent.mkdir()
        program.write_text(PROGRAM.format(python=sys.executable))
        program.chmod(0o755)
        return BLOCK.sub(lambda match: match[1] + printed(match["script"], folder), text)


def printed(script: str, folder: Path) -> str:
    """Return what a script prints in a folder, as if on the day that is shown."""
    path = f"{folder / 'bin'}{os.pathsep}{os.environ.get('PATH', '')}"
    environment = {"PATH": path, "PYTHONPATH": str(ROOT), "COLUMNS": "80", "SAMPLES": "sample_keystores"}
    done = subprocess.run(
        ["sh", "-c", script], capture_output=True, text=True, check=False, cwd=folder, env=environment
    )
    today = datetime.now(timezone.utc).date()
    return re.sub(rf"{today}(T[0-9:]+Z)?", lambda match: SHOWN + ("T12:00:00Z" if match[1] else ""), done.stdout)


def main() -> None:
    """Write the pages again."""
    for page in PAGES:
        (ROOT / page).write_text(written(page), "utf-8")


if __name__ == "__main__":
    main()
