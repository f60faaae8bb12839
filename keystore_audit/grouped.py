"""Things by what they have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

_T = TypeVar("_T")
_K = TypeVar("_K")


def grouped(things: Iterable[_T], by: Callable[[_T], _K]) -> dict[_K, list[_T]]:
    """The things with one key together, all in the order in which they come."""
    groups: dict[_K, list[_T]] = {}
    for thing in things:
        groups.setdefault(by(thing), []).append(thing)
    return groups


def gathered(pairs: Iterable[tuple[_K, _T]]) -> dict[_K, list[_T]]:
    """By key its values, all in the order in which they come."""
    values: dict[_K, list[_T]] = {}
    for key, value in pairs:
        values.setdefault(key, []).append(value)
    return values
