"""How long a solver stays that was started for a question: as long as the run that asks it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

T = TypeVar("T")


class Kept:
    """What is kept, by what it was asked for with."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self._found: dict[object, Any] = {}

    def get(self, key: object, make: Callable[[], AbstractContextManager[T]]) -> T:
        """What was made for `key`: now, if it was not before."""
        if key not in self._found:
            self._found[key] = self._stack.enter_context(make())
        found: T = self._found[key]
        return found


CURRENT: ContextVar[Kept | None] = ContextVar("kept", default=None)
"""What is kept now."""


@contextmanager
def kept() -> Iterator[Kept]:
    """Keep what is made inside until the outermost of these ends: around a run, around each of its audits."""
    outer = CURRENT.get()
    if outer is not None:
        yield outer
        return
    with ExitStack() as stack:
        mine = Kept(stack)
        stack.callback(CURRENT.reset, CURRENT.set(mine))
        yield mine
