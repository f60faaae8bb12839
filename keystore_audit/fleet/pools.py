"""How tasks are carried out: here one after the other, in processes of this machine, or by the workers of a cluster."""

from __future__ import annotations

import asyncio
import gc
import logging
import math
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from itertools import islice
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING, Any, Final, TypeVar

from msgspec import Struct

from keystore_audit.engine.alloy.kept import kept
from keystore_audit.errors import UsageError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import ForkServerContext

    from distributed import Client

T = TypeVar("T")
R = TypeVar("R")

PATIENCE: Final = 5.0
"""Seconds that a process gets to end what it started (a Java of its own) before it is killed."""

SCHEDULER_PATIENCE: Final = 20.0
"""Seconds to wait for the scheduler of a cluster to answer, and for a first worker."""

AHEAD: Final = 3
"""Tasks that a worker of a cluster has at a time: enough that it never waits for the next."""

COUNTED_EVERY: Final = 5.0
"""Seconds between two counts of the workers."""

_PRELOADED: Final = ("keystore_audit.pipeline", "keystore_audit.fleet.task", "keystore_audit.report.text")
"""Loaded once, by the process from which the others are forked: each then starts in milliseconds."""


class Lost(Struct, frozen=True, kw_only=True):
    """A task that will never have a result, because its process has ended. `reason`: a sentence."""

    reason: str


def _failed(error: Exception) -> Lost:
    return Lost(reason=f"It could not be carried out ({type(error).__name__}).")


class _Worker:
    """A process that carries out one task at a time.

    Its pipe is its own, and this process holds only one end. So its end is always noticed, even amid an answer.
    (A concurrent.futures.ProcessPoolExecutor holds both, and waits for ever for the rest of such an answer.)
    """

    def __init__(self, context: ForkServerContext) -> None:
        self._pipe, theirs = context.Pipe()
        about = (theirs, os.getcwd(), gc.get_threshold())
        self._process = context.Process(target=_work, args=about, daemon=True)
        self._process.start()
        theirs.close()

    def is_alive(self) -> bool:
        return self._process.is_alive()

    def answer(self, work: Callable[[Any], Any], task: object) -> Any:
        """Its answer. Raises EOFError or OSError if it ends."""
        self._pipe.send((work, task))
        return self._pipe.recv()

    def let_go(self) -> None:
        """Tell the waiting process that no task will come."""
        self._pipe.close()

    def stop(self) -> None:
        self._process.terminate()

    def await_end(self) -> None:
        self._process.join(PATIENCE)
        self._process.kill()


class Processes:
    """A number of processes on this machine; one that ends loses only its own task."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._threads = ThreadPoolExecutor(count)  # each waits for one process
        self._idle: list[_Worker] = []
        self._busy: dict[Future[Any], _Worker] = {}
        self._context: ForkServerContext | None = None

    def room(self) -> int:
        """One task for each process."""
        return self._count

    def submit(self, work: Callable[[Any], Any], task: object) -> Future[Any]:
        """Hand the task to an idle process."""
        self._context = self._context or _forkserver()
        worker = self._idle.pop() if self._idle else None
        if worker is None or not worker.is_alive():  # it may have ended while it had nothing to do
            worker = _Worker(self._context)
        future = self._threads.submit(worker.answer, work, task)
        self._busy[future] = worker
        return future

    def result(self, future: Future[Any]) -> Any:
        """Its answer, or that it ended; in the first case the process is free again."""
        worker = self._busy.pop(future)
        try:
            said = future.result()
        except (EOFError, OSError):
            worker.await_end()
            return Lost(reason="Its worker process ended early (killed, or out of memory).")
        except Exception as error:  # noqa: BLE001 - what cannot be sent or read is one task's: the next has a new process
            worker.stop()
            return _failed(error)
        self._idle.append(worker)
        return said

    def close(self) -> None:
        """Let those that are idle go; ask the others to end, and kill those that do not."""
        for worker in self._idle:
            worker.let_go()
        for worker in self._busy.values():
            worker.stop()
        for worker in (*self._idle, *self._busy.values()):
            worker.await_end()
        self._threads.shutdown()
        self._idle, self._busy = [], {}


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _forkserver() -> ForkServerContext:
    """Where processes come from.

    It ignores SIGINT from its first moment, as do its children: an interrupt at the terminal goes to this process,
    which ends them. And it starts at the root: `python -c` imports from its working directory first, which may be an
    audited one.
    """
    from multiprocessing.forkserver import ensure_running

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(_PRELOADED))
    hears = threading.current_thread() is threading.main_thread()
    kept = signal.signal(signal.SIGINT, signal.SIG_IGN) if hears else None
    before = os.open(".", getattr(os, "O_PATH", os.O_RDONLY))
    try:
        os.chdir("/")
        ensure_running()
    finally:
        os.fchdir(before)
        os.close(before)
        if hears:
            signal.signal(signal.SIGINT, kept)
    return context


def _work(tasks: Connection, directory: str, thresholds: tuple[int, int, int]) -> None:
    """Carry out what comes, where the command works; end when asked to, or when the command is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # an exception, so that Java is ended too
    os.chdir(directory)
    gc.freeze()
    gc.set_threshold(*thresholds)
    threading.Thread(target=_end_with_the_command, daemon=True).start()
    with suppress(EOFError, OSError), kept():
        while True:
            work, task = tasks.recv()
            try:
                said = ForkingPickler.dumps(work(task))
            except Exception as error:  # noqa: BLE001 - it is told, and the next one may do
                said = ForkingPickler.dumps(_failed(error))
            tasks.send_bytes(said)


def _end_with_the_command() -> None:
    command = multiprocessing.parent_process()
    if command is not None:
        command.join()
    while True:  # the first ends what is being done, the next one the wait for more
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(PATIENCE)


class Cluster:
    """The workers of a Dask scheduler at `address` (HOST:PORT). A lost worker loses nothing: others do its tasks.

    They need this package in the same version, and the keystores at the same paths. Raises errors.UsageError if Dask is
    not installed, nobody answers, or there is no worker.
    """

    def __init__(self, address: str) -> None:
        self._client = _client(address)
        self._executor: Executor = self._client.get_executor()
        self._room = 0
        self._asked = -math.inf

    def room(self) -> int:
        """Some tasks for each worker; workers come and go, so they are counted again now and then."""
        now = time.monotonic()
        if now - self._asked > COUNTED_EVERY:
            self._room = AHEAD * max(1, len(self._client.scheduler_info()["workers"]))
            self._asked = now
        return self._room

    def submit(self, work: Callable[[Any], Any], task: object) -> Future[Any]:
        """Hand the task to the scheduler."""
        return self._executor.submit(work, task)

    def result(self, future: Future[Any]) -> Any:
        """A worker's answer; a task that took several workers with it (Dask's `allowed-failures`) is lost."""
        try:
            error = future.exception()  # not raised: it may be the exit of another process
        except CancelledError as cancelled:
            error = cancelled
        if error is not None:
            return Lost(reason=f"The cluster did not carry it out ({type(error).__name__}).")
        return future.result()

    def close(self) -> None:
        """Leave the cluster as it was."""
        self._executor.shutdown(wait=False)
        self._client.close()


Pool = Processes | Cluster
"""Who carries out tasks beside this process, each a function of a module that is looked up there by its name."""


def carried_out(
    pool: Pool | None, work: Callable[[T], R], tasks: Iterable[T]
) -> Generator[tuple[int, R | Lost], None, None]:
    """Yield the number of each task and its result as they come, in any order; `pool` None: here, one after the other.

    `tasks` are taken as they are needed, so that few are there at a time. Closing the generator closes the pool.
    """
    if pool is None:
        for number, task in enumerate(tasks):
            yield number, work(task)
        return
    waiting = iter(enumerate(tasks))
    under_way: dict[Future[Any], int] = {}

    def hand_over() -> None:
        for number, task in islice(waiting, max(0, pool.room() - len(under_way))):
            under_way[pool.submit(work, task)] = number

    try:
        hand_over()
        while under_way:
            for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                number, result = under_way.pop(future), pool.result(future)
                hand_over()
                yield number, result
    finally:
        if under_way:
            pool.close()


def _client(address: str) -> Client:
    try:
        from distributed import Client
    except ImportError as error:
        raise UsageError("--executor needs Dask: install keystore-audit[fleet].") from error
    for name in ("distributed", "distributed.client"):  # each has a level of its own, from Dask's configuration
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what is lost is said by the report
    try:
        client = Client(f"tcp://{address}", timeout=SCHEDULER_PATIENCE, set_as_default=False)
    except (OSError, asyncio.TimeoutError) as error:
        raise UsageError(f"No Dask scheduler answers at {address}.") from error
    try:
        client.wait_for_workers(1, timeout=SCHEDULER_PATIENCE)
    except (TimeoutError, asyncio.TimeoutError) as error:
        client.close()
        raise UsageError(f"The Dask scheduler at {address} has no worker.") from error
    return client
