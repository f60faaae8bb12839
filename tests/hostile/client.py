"""Asks the server of tests/hostile/server.py, and watches what nobody may open."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
from ctypes import CDLL, get_errno
from pathlib import Path
from typing import Any, Final

AT: Final = "2025-06-01T00:00:00Z"
IN_OPEN, IN_CLOEXEC, IN_NONBLOCK = 0x20, 0o2000000, 0o4000


class Server:
    """The process of tests/hostile/server.py."""

    def __init__(self, repository: Path) -> None:
        kept = {name: value for name, value in os.environ.items() if name not in {"NO_COLOR", "COLUMNS", "CI"}}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.hostile.server"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            cwd=repository,
            env={**kept, "PYTHONPATH": str(repository), "PYTHONSAFEPATH": "", "LC_ALL": "C.UTF-8"},
        )

    def ask(self, **request: Any) -> dict[str, Any]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(request).encode() + b"\n")
        self._process.stdin.flush()
        answer: dict[str, Any] = json.loads(self._process.stdout.readline())
        return answer

    def close(self) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait(timeout=20)
        self._process.stdout.close()


class Guard:
    """Sees every open of the files beside the keystore by anybody, libraries too: inotify(7)."""

    def __init__(self, folder: Path) -> None:
        libc = CDLL(None, use_errno=True)
        self.descriptor = libc.inotify_init1(IN_CLOEXEC | IN_NONBLOCK)
        for path in (folder, *(each for each in folder.rglob("*") if each.is_dir())):
            assert libc.inotify_add_watch(self.descriptor, os.fsencode(path), IN_OPEN) >= 0, os.strerror(get_errno())

    def seen(self) -> bytes:
        ready, _, _ = select.select([self.descriptor], [], [], 0)
        return os.read(self.descriptor, 1 << 16) if ready else b""

    def close(self) -> None:
        os.close(self.descriptor)
