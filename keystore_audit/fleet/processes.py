"""Processes of this machine: one that ends loses its task alone."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING, Any, Final, TypeVar

from msgspec import Struct

from keystore_audit.fleet.executor import Lost

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, ForkServerProcess

T = TypeVar("T")
R = TypeVar("R")

PATIENCE: Final = 5.0
"""Seconds that a process gets to end what it started (a Java of its own) before it is killed."""

_PRELOADED: Final = ("keystore_audit.pipeline", "keystore_audit.fleet.task", "keystore_audit.report.text")
"""Loaded once, by the process from which the others are forked: each is then there in milliseconds."""


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Processes:
    """So many processes, each with one task at a time."""

    def __init__(self, count: int) -> None:
        self._count = count

    def run(self, work: Callable[[T], R], tasks: Iterable[T]) -> Generator[tuple[int, R | Lost], None, None]:
        """Yield results as they come. A process that ends unasked is replaced, and its task is lost."""
        waiting = iter(enumerate(tasks))
        with _forkserver() as context:
            workers: list[_Worker] = []
            try:
                for number, task in waiting:
                    workers.append(_Worker.started(context, work))
                    workers[-1].give(number, task)
                    if len(workers) == self._count:
                        break
                while workers:
                    for worker in _ready(workers):
                        number, answer = worker.number, worker.answer()
                        workers.remove(worker)
                        following = next(waiting, None)
                        if following is None or not worker.alive:
                            worker.stop()
                        if following is not None:
                            workers.append(worker if worker.alive else _Worker.started(context, work))
                            workers[-1].give(*following)
                        yield number, answer
            finally:
                for worker in workers:
                    worker.end()
                for worker in workers:
                    worker.stop()


class _Worker(Struct):
    """A process and what it is at."""

    process: ForkServerProcess
    connection: Connection[Any, Any]
    number: int = -1
    alive: bool = True

    @classmethod
    def started(cls, context: ForkServerContext, work: Callable[[Any], Any]) -> _Worker:
        here, there = context.Pipe()
        process = context.Process(target=_serve, args=(there, work, os.getcwd(), gc.get_threshold()), daemon=False)
        process.start()
        there.close()  # so that its end is seen here when it ends
        return cls(process, here)

    def give(self, number: int, task: object) -> None:
        self.number = number
        with suppress(OSError):  # ended already: the answer will say so
            self.connection.send(task)

    def answer(self) -> Any:
        """What it says, or how it ended."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            self.alive = False
            self.process.join(PATIENCE)
            return Lost(reason=f"The process that was at it {_how(self.process.exitcode)}.")

    def end(self) -> None:
        """Ask it to end now."""
        self.process.terminate()

    def stop(self) -> None:
        """Let it end; one that does not is killed."""
        self.connection.close()
        self.process.join(PATIENCE)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()


def _ready(workers: list[_Worker]) -> list[_Worker]:
    """Those that have answered or ended; waits for one."""
    by_connection = {worker.connection: worker for worker in workers}
    return [by_connection[ready] for ready in wait(list(by_connection)) if isinstance(ready, Connection)]


def _how(status: int | None) -> str:
    if status is None or status >= 0:
        return f"ended with status {status}" if status else "ended"
    try:
        name = signal.Signals(-status).name
    except ValueError:
        name = f"signal {-status}"
    return f"was ended by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")


@contextmanager
def _forkserver() -> Iterator[ForkServerContext]:
    """Where processes come from."""
    from multiprocessing.forkserver import ensure_running

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(_PRELOADED))
    with _at_the_root(), _interrupts_ignored():
        ensure_running()
    yield context


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """What is started ignores SIGINT from its first moment, as do its children: an interrupt at the terminal goes to
    this process, which ends them.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kept = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, kept)


@contextmanager
def _at_the_root() -> Iterator[None]:
    """What is started by `python -c` imports from its working directory first, which may be an audited one."""
    before = os.open(".", getattr(os, "O_PATH", os.O_RDONLY))
    try:
        os.chdir("/")
        yield
    finally:
        os.fchdir(before)
        os.close(before)


def _serve(connection: Connection[Any, Any], work: Callable[[Any], Any], directory: str, thresholds: Any) -> None:
    """Do one task after the other until there are no more, or whoever gives them is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # an exception, so that Java is ended too
    os.chdir(directory)
    gc.freeze()
    gc.set_threshold(*thresholds)
    while True:
        try:
            task = connection.recv()
        except (EOFError, OSError):
            return
        try:
            answer = ForkingPickler.dumps(work(task))
        except Exception as error:  # noqa: BLE001 - whatever it is, the others go on and this one is no pass
            answer = ForkingPickler.dumps(Lost(reason=f"It could not be carried out ({type(error).__name__})."))
        try:
            connection.send_bytes(answer)
        except OSError:
            return
