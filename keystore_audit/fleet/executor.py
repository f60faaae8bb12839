"""How tasks are carried out: here one after the other, in processes of this machine, or on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from typing import Protocol, TypeVar

from msgspec import Struct

T = TypeVar("T")
R = TypeVar("R")


class Lost(Struct, frozen=True, kw_only=True):
    """A task that has no result, and never will: whoever was at it has ended. `reason`: a sentence."""

    reason: str


class Executor(Protocol):
    """Carries out tasks, each once."""

    def run(self, work: Callable[[T], R], tasks: Iterable[T]) -> Generator[tuple[int, R | Lost], None, None]:
        """Yield the number of each task and its result as they come, in any order.

        `tasks` are taken as they are needed, so that few are there at a time. `work` is a module's function, since
        other processes look it up by its name, and raises nothing. Closing the generator ends what is under way.
        """


class InTurn:
    """One after the other, in this process."""

    def run(self, work: Callable[[T], R], tasks: Iterable[T]) -> Generator[tuple[int, R | Lost], None, None]:
        """Yield in order."""
        for number, task in enumerate(tasks):
            yield number, work(task)
