"""What the finished tool finds in a sample, in the form that stands in the sample's `.toml`."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .store import copy_with_modes
from .story import read_description

SAMPLES = Path(__file__).resolve().parents[2] / "sample_keystores"
"""Where an audit runs: files that options name, policies and graphs, are relative to it."""


def audit(sample: Path) -> Mapping[str, Any]:
    """Audit a copy of `sample` with the modes that it was built with: `exit_code` and `findings`.

    Raises ValueError where the tool does not answer with a report.
    """
    about = read_description(sample)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / sample.name
        copy_with_modes(sample, copy, int(about["key_mode"], 8))
        return audit_directory(copy, at=about["at"], options=tuple(about["options"]))


def audit_directory(directory: Path, *, at: str, options: tuple[str, ...] = ()) -> Mapping[str, Any]:
    """Run the native audit on `directory`; raises ValueError where the tool does not answer with a report."""
    arguments = [*with_engine(options), "--format", "json", "--at", at, str(directory)]
    command = [sys.executable, "-m", "keystore_audit", "audit", *arguments]
    run = subprocess.run(command, capture_output=True, check=False, text=True, timeout=120, cwd=SAMPLES)
    try:
        report = json.loads(run.stdout)
    except ValueError as error:
        raise ValueError(f"{directory}: no report, exit {run.returncode}: {run.stderr[-2000:]}") from error
    return {"exit_code": run.returncode, "findings": sorted(finding_line(f) for f in report["findings"])}


def with_engine(options: Sequence[str], engine: str = "native") -> list[str]:
    """Return the options, with who decides where they name nobody."""
    return [*options] if "--engine" in options else ["--engine", engine, *options]


def finding_line(finding: Mapping[str, Any]) -> str:
    """`CODE severity enclave path:line` of a finding of the JSON report; `-` for what it has not.

    ` accepted` follows where settings or a baseline accept it.
    """
    path, line = "-", None
    if finding["locations"]:
        path, line = finding["locations"][0]["path"], finding["locations"][0]["line"]
    place = f"{path}:{'-' if line is None else line}"
    accepted = " accepted" if finding["suppressed"] else ""
    return f"{finding['code']} {finding['severity']} {finding['enclave'] or '-'} {place}{accepted}"
