"""The program in a process of its own: what it takes, and what it says."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from typing import NamedTuple


class Run(NamedTuple):
    """Seconds by the clock, processor seconds with those of its children, and standard output."""

    clock: float
    cpu: float
    output: bytes


def run(*arguments: str, incomplete: bool = False) -> Run:
    """Run it to its end, which is an exit code of 0 or 1, or if it may be `incomplete` of 4."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run([sys.executable, "-m", "keystore_audit", *arguments], capture_output=True, check=False)
    clock, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in ((0, 1, 4) if incomplete else (0, 1)):
        raise SystemExit(f"{arguments[0]} ended with {done.returncode}: {done.stderr.decode()[:500]}")
    return Run(clock, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout)
