"""Workers of a Dask cluster: one that is lost loses nothing, since its tasks go to another."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable, Generator, Iterable
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, TypeVar

from keystore_audit.errors import UsageError
from keystore_audit.fleet.executor import Lost

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")
R = TypeVar("R")

PATIENCE: Final = 20.0
"""Seconds to wait for the scheduler to answer, and for a first worker."""

AHEAD: Final = 3
"""Tasks that a worker has at a time: enough that it never waits for the next."""

COUNTED_EVERY: Final = 5.0
"""Seconds between counts of the workers."""


class Cluster:
    """The workers of a Dask scheduler.

    They need this package in the same version, and the keystores at the same paths.
    """

    def __init__(self, address: str) -> None:
        """Reach the scheduler at `address` (HOST:PORT) and see that there is a worker.

        Raises errors.UsageError if Dask is not installed, or nobody answers.
        """
        self._client = _client(address)
        self._room = 0
        self._asked = -math.inf

    def close(self) -> None:
        """Leave the cluster as it was."""
        self._client.close()

    def run(self, work: Callable[[T], R], tasks: Iterable[T]) -> Generator[tuple[int, R | Lost], None, None]:
        """Yield results as they come.

        A task whose worker is lost is done again by another, and its result is taken once; one that took several
        workers with it (Dask's `allowed-failures`) is lost.
        """
        from distributed import as_completed

        waiting = iter(enumerate(tasks))
        under_way: dict[str, tuple[int, Future[Any]]] = {}
        ended = as_completed(loop=self._client.loop)

        def submit() -> None:
            for number, task in islice(waiting, max(0, self._most() - len(under_way))):
                future = self._client.submit(work, task, pure=False)
                under_way[future.key] = number, future
                ended.add(future)

        try:
            submit()
            for future in ended:
                number, _future = under_way.pop(future.key)
                result = _result(future)
                future.release()
                submit()
                yield number, result
        finally:
            self._client.cancel([future for _number, future in under_way.values()])

    def _most(self) -> int:
        """How many tasks there may be at a time; workers come and go, so they are counted again now and then."""
        now = time.monotonic()
        if now - self._asked > COUNTED_EVERY:
            self._room = AHEAD * max(1, len(self._client.scheduler_info()["workers"]))
            self._asked = now
        return self._room


def _client(address: str) -> Client:
    try:
        from distributed import Client
    except ImportError as error:
        raise UsageError("--executor needs Dask: install keystore-audit[fleet].") from error
    for name in ("distributed", "distributed.client"):  # each has a level of its own, from Dask's configuration
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what is lost is said by the report
    try:
        client = Client(f"tcp://{address}", timeout=PATIENCE, set_as_default=False)
    except (OSError, asyncio.TimeoutError) as error:
        raise UsageError(f"No Dask scheduler answers at {address}.") from error
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except (TimeoutError, asyncio.TimeoutError) as error:
        client.close()
        raise UsageError(f"The Dask scheduler at {address} has no worker.") from error
    return client


def _result(future: Future[Any]) -> Any:
    try:
        return future.result()
    except Exception as error:  # noqa: BLE001 - whatever a cluster raises, this keystore is no pass
        return Lost(reason=f"The cluster has not carried it out ({type(error).__name__}).")
