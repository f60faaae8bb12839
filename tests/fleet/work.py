"""Work for processes: module functions, since they are looked up by name."""

from __future__ import annotations

import os
import signal
import threading
import time
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


def end_amid_the_answer(number: int) -> bytes:
    """At three an answer larger than any pipe, killed while it is sent."""
    size = 200_000_000

    def end() -> None:
        while writes_less_than(size):
            time.sleep(0.001)
        os.kill(os.getpid(), signal.SIGKILL)

    if number != 3:
        return b""
    threading.Thread(target=end).start()
    return bytes(size)


def writes_less_than(size: int) -> bool:
    """Whether the first thread of this process is not just in a call whose third argument is `size`."""
    call = Path("/proc/self/syscall").read_text().split()
    return len(call) < 4 or int(call[3], 16) < size
