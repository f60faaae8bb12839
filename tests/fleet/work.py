"""Work for processes: module functions, since they are looked up by name."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def square(number: int) -> int:
    return number * number


def where(_number: int) -> tuple[int, str]:
    return os.getpid(), str(Path.cwd())


def end_at_three(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def leave_at_three(number: int) -> int:
    if number == 3:
        os._exit(7)
    return number


def fail_at_three(number: int) -> int:
    if number == 3:
        raise MemoryError
    return number


def unsendable_at_three(number: int) -> object:
    return (lambda: number) if number == 3 else number
