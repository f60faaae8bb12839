"""Interrupts at a moment that suits."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def interrupts_later() -> Iterator[None]:
    """Keep SIGINT from the block, which is short; KeyboardInterrupt is raised at its end.

    Outside of the main thread, which alone hears of signals, nothing is done.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard = False

    def remember(_number: int, _frame: FrameType | None) -> None:
        nonlocal heard
        heard = True

    kept = signal.signal(signal.SIGINT, remember)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, kept)
    if heard:
        raise KeyboardInterrupt
