"""Work done aside: by a forked copy of this process, while this one goes on.

A copy sees everything that was there when it was forked, and hands back what its work returns, best little. It opens
no file and decides nothing by itself: where there is no copy, or it ends without an answer, the work is done here.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import threading
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from io import BufferedWriter, BytesIO
from types import TracebackType
from typing import Final, Generic, TypeVar

T = TypeVar("T")

FEW: Final = 100
"""Enclaves, documents or whatever is alike: what has to be done for fewer takes less time than a copy (20 ms)."""


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Pickler(pickle.Pickler):
    """Writes objects that both processes know by their address, which is the same in both."""

    def __init__(self, stream: BufferedWriter, known: Mapping[int, object]) -> None:
        super().__init__(stream, pickle.HIGHEST_PROTOCOL)
        self._known = known

    def persistent_id(self, each: object) -> int | None:
        return id(each) if id(each) in self._known else None


class _Unpickler(pickle.Unpickler):
    """Reads what our own copy wrote into a pipe that nobody else has."""

    def __init__(self, answer: bytes, known: Mapping[int, object]) -> None:
        super().__init__(BytesIO(answer))
        self._known = known

    def persistent_load(self, address: int) -> object:
        return self._known[address]


class Aside(Generic[T]):
    """One piece of work, begun at once; a context manager, behind which no copy is left.

    `work` must not change anything that the caller goes on with: here it may not be seen, there it may be.
    `wanted` False: nothing is begun, and `result` does the work. `known`: objects that what is returned may hold and
    that are handed back as they are, not as copies.
    """

    def __init__(self, work: Callable[[], T], *, wanted: bool = True, known: Iterable[object] = ()) -> None:
        """Begin."""
        self._work = work
        self._known = {id(each): each for each in known} if wanted else {}
        self._pid = 0
        self._pipe = -1
        # What other threads hold would stay locked in the copy for ever.
        if wanted and hasattr(os, "fork") and threading.active_count() == 1:
            self._begin()

    def __enter__(self) -> Aside[T]:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the copy, if nobody asked for its result."""
        if self._pid:
            with suppress(OSError):
                os.kill(self._pid, signal.SIGKILL)
            self._end()

    def result(self) -> T:
        """What the work returned, or raised where it was done here; to be asked for once."""
        answer = self._answer() if self._pid else b""
        try:
            found: T = _Unpickler(answer, self._known).load()
        except (EOFError, pickle.UnpicklingError):  # there was no copy, or it ended early
            return self._work()
        return found

    def _begin(self) -> None:
        try:
            here, there = os.pipe()
        except OSError:
            return
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12, of threads that are not Python's
                self._pid = os.fork()
        except OSError:  # no more processes, no more memory
            os.close(here)
            os.close(there)
            return
        if self._pid == 0:
            os.close(here)
            self._copy(there)
        os.close(there)
        self._pipe = here

    def _copy(self, pipe: int) -> None:
        """All that the copy does; never returns."""
        status = 1
        try:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # the other one tells the user
            gc.disable()
            with open(pipe, "wb") as stream:
                _Pickler(stream, self._known).dump(self._work())
            status = 0
        finally:
            os._exit(status)  # nothing that was to be done at the end of this process is done twice

    def _answer(self) -> bytes:
        with open(self._pipe, "rb") as stream:
            self._pipe = -1
            answer = stream.read()
        return answer if self._end() == 0 else b""

    def _end(self) -> int:
        """Wait for its end and return its status."""
        if self._pipe >= 0:
            os.close(self._pipe)
            self._pipe = -1
        status = 1
        with suppress(ChildProcessError):
            _pid, status = os.waitpid(self._pid, 0)
        self._pid = 0
        return status
