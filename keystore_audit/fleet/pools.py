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
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, TypeVar

from msgspec import Struct

from keystore_audit.errors import UsageError

if TYPE_CHECKING:
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
"""Seconds between counts of the workers."""

_PRELOADED: Final = ("keystore_audit.pipeline", "keystore_audit.fleet.task", "keystore_audit.report.text")
"""Loaded once, by the process from which the others are forked: each is then there in milliseconds."""


class Lost(Struct, frozen=True, kw_only=True):
    """A task that has no result, and never will: whoever was at it has ended. `reason`: a sentence."""

    reason: str


def _error(future: Future[Any]) -> BaseException | None:
    """Why it has no result; not raised: it may be the exit of another process."""
    try:
        return future.exception()
    except CancelledError as cancelled:
        return cancelled


class Processes:
    """So many processes of this machine, each a pool of its own: one that ends loses its task alone."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._idle: list[Executor] = []
        self._busy: dict[Future[Any], Executor] = {}
        self._context: ForkServerContext | None = None

    def room(self) -> int:
        """One for each process."""
        return self._count

    def submit(self, work: Callable[[Any], Any], task: object) -> Future[Any]:
        """Hand it to a process that has none."""
        while True:
            pool = self._idle.pop() if self._idle else self._started()
            try:
                future = pool.submit(work, task)
            except BrokenProcessPool:  # it has ended while it had nothing to do
                continue
            self._busy[future] = pool
            return future

    def result(self, future: Future[Any]) -> Any:
        """What it says, or that it ended; of the others the process is free again."""
        pool, error = self._busy.pop(future), _error(future)
        if isinstance(error, BrokenProcessPool):
            pool.shutdown()
            return Lost(reason="The process that was at it ended before its time (killed, or out of memory).")
        self._idle.append(pool)
        if error is not None:
            return Lost(reason=f"It could not be carried out ({type(error).__name__}).")
        return future.result()

    def close(self) -> None:
        """Let those that are idle go; ask the others to end, and kill those that do not."""
        for pool in (*self._idle, *self._busy.values()):
            pool.shutdown(wait=False, cancel_futures=True)
        processes = multiprocessing.active_children()
        for process in processes if self._busy else ():
            process.terminate()
        for process in processes:
            process.join(PATIENCE)
            process.kill()
        self._idle, self._busy = [], {}

    def _started(self) -> Executor:
        self._context = self._context or _forkserver()
        about = (os.getcwd(), gc.get_threshold())
        return ProcessPoolExecutor(1, mp_context=self._context, initializer=_begin, initargs=about)


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


def _begin(directory: str, thresholds: tuple[int, int, int]) -> None:
    """Make this process one that works where the command does, and ends when it is asked to, or the command is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # an exception, so that Java is ended too
    os.chdir(directory)
    gc.freeze()
    gc.set_threshold(*thresholds)
    threading.Thread(target=_end_with_the_command, daemon=True).start()


def _end_with_the_command() -> None:
    command = multiprocessing.parent_process()
    if command is not None:
        command.join()
    while True:  # the first ends what is being done, the next one the wait for more
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(PATIENCE)


class Cluster:
    """The workers of a Dask scheduler at `address` (HOST:PORT): one that is lost loses nothing, others do its tasks.

    They need this package in the same version, and the keystores at the same paths. Raises errors.UsageError if Dask is
    not installed, nobody answers, or there is no worker.
    """

    def __init__(self, address: str) -> None:
        self._client = _client(address)
        self._executor: Executor = self._client.get_executor()
        self._room = 0
        self._asked = -math.inf

    def room(self) -> int:
        """Some for each worker; workers come and go, so they are counted again now and then."""
        now = time.monotonic()
        if now - self._asked > COUNTED_EVERY:
            self._room = AHEAD * max(1, len(self._client.scheduler_info()["workers"]))
            self._asked = now
        return self._room

    def submit(self, work: Callable[[Any], Any], task: object) -> Future[Any]:
        """Hand it to the scheduler."""
        return self._executor.submit(work, task)

    def result(self, future: Future[Any]) -> Any:
        """What a worker says; a task that took several workers with it (Dask's `allowed-failures`) is lost."""
        error = _error(future)
        if error is not None:
            return Lost(reason=f"The cluster has not carried it out ({type(error).__name__}).")
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
