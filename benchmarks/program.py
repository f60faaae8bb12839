"""A process of its own, and what it takes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from resource import struct_rusage
from typing import NamedTuple

LIMIT = 300.0
"""Seconds by the clock for one process."""

PATIENCE = 10.0
"""Seconds that one gets to end what it started, Java among it."""

INCOMPLETE = 4
_COMPLETE = (0, 1)
"""Exit codes of audits."""


class NotDecided(Exception):
    """Why there is no answer, in words."""


class Run(NamedTuple):
    """Processor seconds and the largest resident set in MB, with those of children, and seconds by the clock."""

    cpu: float
    memory: float
    clock: float

    def __str__(self) -> str:
        return f"{self.cpu:.2f} s ({self.clock:.2f} s)"


def measured(command: Sequence[str], limit: float = LIMIT) -> Run:
    """Run it to its end. Raises NotDecided if it takes more than so many seconds, or if its answer is incomplete."""
    with tempfile.TemporaryFile() as said:
        start = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said, start_new_session=True)
        code, used = _awaited(process.pid, start + limit)
        process.returncode = code
        clock = time.perf_counter() - start
        if clock > limit:
            raise NotDecided(f"not decided in {limit:.0f} s")
        if code == INCOMPLETE:
            raise NotDecided(f"not decided: exit code 4 in {clock:.1f} s")
        if code not in _COMPLETE:
            said.seek(0)
            raise SystemExit(f"{' '.join(command)} ended with {code}: {said.read(500).decode()}")
    return Run(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, clock)


def _awaited(process: int, deadline: float) -> tuple[int, struct_rusage]:
    """How it ended and what it used; after the deadline it is interrupted, and killed if that does not help."""
    ended, status, used = os.wait4(process, os.WNOHANG)
    interrupted = False
    while not ended:
        time.sleep(0.005)
        late = time.perf_counter() - deadline
        if late > 0 and (not interrupted or late > PATIENCE):
            os.killpg(process, signal.SIGKILL if interrupted else signal.SIGINT)
            interrupted = True
        ended, status, used = os.wait4(process, os.WNOHANG)
    return os.waitstatus_to_exitcode(status), used


def audit(*arguments: str | os.PathLike[str], limit: float = LIMIT) -> Run:
    """An audit with these options and places."""
    return measured([sys.executable, "-m", "keystore_audit", "audit", *map(os.fspath, arguments)], limit)
