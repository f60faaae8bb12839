"""How far an audit is: on stderr, only on a terminal, and gone when the report comes."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from keystore_audit.text import terminal

if TYPE_CHECKING:
    from types import FrameType, TracebackType

    from rich.console import Console
    from rich.progress import Progress
    from rich.status import Status

BAR_FROM: Final = 20
"""Enclaves; fewer are read before anybody could watch a bar."""

READING: Final = "reading and verifying"


class Watch:
    """Shows the stages of an audit where `visible`, and keeps how long each took in `durations` (seconds)."""

    def __init__(self, *, visible: bool) -> None:
        """Start with the reading of the keystore."""
        self.durations: list[tuple[str, float]] = []
        self._visible = visible
        self._name = READING
        self._since = time.perf_counter()
        self._bar: Progress | None = None
        self._line: Status | None = None

    def __enter__(self) -> Watch:
        """Watch until the block ends."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Clear what is shown."""
        self._clear()
        self._record()

    def stage(self, name: str) -> None:
        """End the stage before and show this one."""
        self._record()
        self._name = name
        self._clear()
        if self._visible:
            self._line = _stderr().status(f"{terminal(name)} …")
            self._line.start()

    def enclaves(self, done: int, total: int) -> None:
        """Show how many enclaves are read."""
        if not self._visible or total <= BAR_FROM:
            return
        if self._bar is None:
            self._bar = _bar("enclaves", total)
        self._bar.update(self._bar.task_ids[0], completed=done)

    def _clear(self) -> None:
        for shown in (self._bar, self._line):
            if shown is not None:
                shown.stop()
        self._bar = self._line = None

    def _record(self) -> None:
        now = time.perf_counter()
        self.durations.append((self._name, now - self._since))
        self._since = now


class FleetWatch:
    """Shows, where `visible`, how far a run over `total` keystores is, how fast, and how long it still takes."""

    def __init__(self, total: int, *, visible: bool) -> None:
        """Show nothing yet."""
        self._total = total
        self._visible = visible
        self._bar: Progress | None = None
        self._name = ""
        self._since = 0.0

    def __enter__(self) -> FleetWatch:
        """Watch until the block ends."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Clear what is shown."""
        if self._bar is not None:
            self._bar.stop()

    def step(self, name: str, done: int) -> None:
        """Show that the step of this name is done with so many keystores."""
        if not self._visible:
            return
        bar = self._bar = self._bar or _bar("keystores", self._total, "{task.fields[rate]}")
        if name != self._name:
            self._name, self._since = name, time.perf_counter()
            bar.reset(bar.task_ids[0], description=name)
        seconds = time.perf_counter() - self._since
        rate = f"{done / seconds:.1f} a second" if seconds > 1 else ""
        bar.update(bar.task_ids[0], completed=done, rate=rate)


def _bar(what: str, total: int, *more: str) -> Progress:
    """A bar that is shown, with `more` columns of text."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    texts = map(TextColumn, more)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), *texts, TimeRemainingColumn())
    bar = Progress(*columns, console=_stderr(), transient=True, redirect_stdout=False)
    bar.add_task(what, total=total, rate="")
    bar.start()
    return bar


def _stderr() -> Console:
    from rich.console import Console

    return Console(stderr=True, markup=False, emoji=False, highlight=False)


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
