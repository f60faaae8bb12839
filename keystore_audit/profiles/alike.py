"""Results of what reads single peculiarities: one for all rows that answer its questions alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, cast

from keystore_audit.profiles.peculiarities import Access

T = TypeVar("T")


class Alike(Generic[T]):
    """What a computation makes of access rows, equal results being one object.

    It must only read fields of a row. Those that it reads are noted, and rows with the same values of them have the
    same result. So a new peculiarity counts as soon as the computation reads it.
    """

    def __init__(self, compute: Callable[[Access], T]) -> None:
        self._compute = compute
        self._known: list[tuple[dict[str, object], T]] = []

    def of(self, access: Access) -> T:
        """The result for the row."""
        for read, result in self._known:
            if all(getattr(access, name) == value for name, value in read.items()):
                return result
        noted = _Noted(access)
        result = self._compute(cast(Access, noted))
        result = next((known for _read, known in self._known if known == result), result)
        self._known.append((noted.read, result))
        return result


class _Noted:
    """A row that notes what is read of it."""

    def __init__(self, access: Access) -> None:
        self._access = access
        self.read: dict[str, object] = {}

    def __getattr__(self, name: str) -> Any:
        value = self.read[name] = getattr(self._access, name)
        return value
