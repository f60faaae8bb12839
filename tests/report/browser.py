"""Debian's Chromium, without a window and without a network, as a reader of pages that we did not write.

What it says is read from what it writes: the DOM after loading, its log, its log of the network, pictures.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium")
SECONDS = 120
"""After which a browser that hangs is ended; two busy cores load a page in three."""

_OPTIONS = (
    "--headless=new",
    "--no-sandbox",  # tests run as root in containers
    "--disable-gpu",
    "--disable-extensions",
    "--disable-component-update",
    "--disable-background-networking",
    "--disable-sync",
    "--no-first-run",
    "--no-default-browser-check",
    "--hide-scrollbars",
    "--enable-logging=stderr",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)


@dataclass(frozen=True)
class Loaded:
    """What came of loading a page. `console`: what pages said there. `requested`: every address asked for."""

    dom: str
    console: tuple[str, ...]
    requested: tuple[str, ...]


def load(page: Path, scratch: Path, *options: str) -> Loaded:
    """Load a file with its scripts allowed, as a reader's browser would."""
    log = scratch / "net.json"
    run = _run(page, scratch, "--dump-dom", f"--log-net-log={log}", "--net-log-capture-mode=Everything", *options)
    console = tuple(line for line in run.stderr.decode("utf-8", "replace").splitlines() if ":CONSOLE" in line)
    return Loaded(dom=run.stdout.decode("utf-8"), console=console, requested=tuple(_requested(log)))


def screenshot(page: Path, picture: Path, scratch: Path, *options: str, size: tuple[int, int] = (1360, 1400)) -> Path:
    """Write a PNG of the upper part of the page."""
    _run(page, scratch, f"--screenshot={picture}", f"--window-size={size[0]},{size[1]}", *options)
    return picture


def printed(page: Path, document: Path, scratch: Path) -> Path:
    """Write the page as PDF, as the print command does."""
    _run(page, scratch, f"--print-to-pdf={document}", "--no-pdf-header-footer")
    return document


def _run(page: Path, scratch: Path, *options: str) -> subprocess.CompletedProcess[bytes]:
    assert CHROMIUM is not None
    profile = scratch / "profile"
    command = [CHROMIUM, *_OPTIONS, f"--user-data-dir={profile}", *options, page.resolve().as_uri()]
    environment = {**os.environ, "HOME": str(scratch), "XDG_CONFIG_HOME": str(scratch), "TZ": "UTC"}
    return subprocess.run(command, check=True, capture_output=True, timeout=SECONDS, env=environment)


def _requested(log: Path) -> list[str]:
    """The addresses of the pages' requests, and of those that a policy stopped on its way to the network."""
    record: dict[str, Any] = json.loads(log.read_text(encoding="utf-8"))
    kinds = record["constants"]["logEventTypes"]
    begun = kinds["URL_REQUEST_START_JOB"]
    return [event["params"]["url"] for event in record["events"] if event["type"] == begun and "url" in event["params"]]
