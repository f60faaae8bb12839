"""Debian's Chromium, without a window, as a reader of pages that we did not write.

A page is served by a server of the test's own, so that everything which the page asks for is seen; no other host can
be found. Nothing is asked of the browser but what it says by itself: the DOM after loading, its console, its log of
the network, pictures.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from msgspec import Struct

SECONDS = 240
"""After which a browser that hangs is ended; two busy cores load a page in three."""

DARK = "--blink-settings=preferredColorScheme=0"

_OPTIONS = (
    "--headless=new",
    "--no-sandbox",  # tests run as root in containers
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    "--disable-component-update",
    "--disable-background-networking",
    "--disable-sync",
    "--no-first-run",
    "--no-default-browser-check",
    "--hide-scrollbars",
    "--enable-logging=stderr",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
)


_OWN = (".google.com", ".googleapis.com")
"""Hosts that Chromium looks for of its own accord, whatever page is loaded, and does not find here."""


class Loaded(Struct, frozen=True):
    """What came of loading a page. `console`: what was said there. `asked`: the paths that the server was asked for.

    `elsewhere`: addresses of other hosts that something asked for.
    """

    dom: str
    console: tuple[str, ...]
    asked: tuple[str, ...]
    elsewhere: tuple[str, ...]


def load(page: str, scratch: Path, *options: str) -> Loaded:
    """Load a page with scripts allowed, as a reader's browser would."""
    log = scratch / "net.json"
    with served(page) as (address, asked):
        options = (*options, "--dump-dom", f"--log-net-log={log}", "--virtual-time-budget=3000")
        run = _run(address, scratch, *options)
    console = tuple(line for line in run.stderr.decode("utf-8", "replace").splitlines() if ":CONSOLE" in line)
    elsewhere = tuple(url for url in _requested(log) if not url.startswith(address.removesuffix("/page.html")))
    return Loaded(dom=run.stdout.decode("utf-8"), console=console, asked=tuple(asked), elsewhere=elsewhere)


def screenshot(page: str, picture: Path, scratch: Path, *options: str, size: tuple[int, int] = (1360, 1400)) -> None:
    """Write a PNG of the upper part of the page."""
    with served(page) as (address, _asked):
        _run(address, scratch, f"--screenshot={picture}", f"--window-size={size[0]},{size[1]}", *options)


def printed(page: str, document: Path, scratch: Path) -> None:
    """Write the page as PDF, as the print command does."""
    with served(page) as (address, _asked):
        _run(address, scratch, f"--print-to-pdf={document}", "--no-pdf-header-footer")


@contextmanager
def served(page: str) -> Iterator[tuple[str, list[str]]]:
    """Serve the page, and nothing else, on this machine; gives its address and a list of what is asked for."""
    asked: list[str] = []
    content = page.encode("utf-8")

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            there = self.path == "/page.html"
            self.send_response(200 if there else 404)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write(content if there else b"")

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name that is overridden
            """Say nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/page.html", asked
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def _run(address: str, scratch: Path, *options: str) -> subprocess.CompletedProcess[bytes]:
    chromium = shutil.which("chromium")
    assert chromium is not None, "the fixture `oracle` is asked for it first"
    command = [chromium, *_OPTIONS, f"--user-data-dir={scratch / 'profile'}", *options, address]
    environment = {**os.environ, "HOME": str(scratch), "XDG_CONFIG_HOME": str(scratch), "TZ": "UTC"}
    return subprocess.run(command, check=True, capture_output=True, timeout=SECONDS, env=environment)


def _requested(log: Path) -> list[str]:
    """The addresses that went to the network, or would have."""
    record: dict[str, Any] = json.loads(log.read_text(encoding="utf-8"))
    begun = record["constants"]["logEventTypes"]["URL_REQUEST_START_JOB"]
    found = (event.get("params", {}).get("url", "") for event in record["events"] if event["type"] == begun)
    network = (url for url in found if url.startswith(("http:", "https:", "ws:", "wss:", "ftp:")))
    return [url for url in network if not (urlsplit(url).hostname or "").endswith(_OWN)]
