"""What is known of one question, and of a set: the one way to say that something is unknown (docs/model.md)."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

from msgspec import Struct


class Truth(Enum):
    """Whether something is so. UNKNOWN: what could not be read decides. The value is what JSON says."""

    YES = True
    NO = False
    UNKNOWN = None

    @property
    def may(self) -> bool:
        """Whether it is not certain that it is not so."""
        return self is not Truth.NO

    @property
    def must(self) -> bool:
        """Whether it is certain."""
        return self is Truth.YES

    @property
    def negated(self) -> Truth:
        """Whether it is not so."""
        return Truth.UNKNOWN if self is Truth.UNKNOWN else Truth(not self.value)


def all_of(parts: Iterable[Truth]) -> Truth:
    """Whether all is so; yes of nothing."""
    found = {*parts}
    return Truth.NO if Truth.NO in found else Truth.UNKNOWN if Truth.UNKNOWN in found else Truth.YES


def any_of(parts: Iterable[Truth]) -> Truth:
    """Whether some of it is so; no of nothing."""
    return all_of(part.negated for part in parts).negated


class Bounds(Struct, frozen=True):
    """A set (bits) of which not everything is known: what is in it for certain (`must`), and what may be (`may`)."""

    must: int
    may: int

    @classmethod
    def exact(cls, numbers: int) -> Bounds:
        """A set without doubt."""
        return cls(numbers, numbers)

    @property
    def unknown(self) -> int:
        """What may be in it or not."""
        return self.may & ~self.must

    def but(self, unclear: int) -> Bounds:
        """The same, these numbers apart, of which nothing is known."""
        return Bounds(self.must & ~unclear, self.may | unclear)

    def holds(self, number: int) -> Truth:
        """Whether the number is in it."""
        if self.must >> number & 1:
            return Truth.YES
        return Truth.UNKNOWN if self.may >> number & 1 else Truth.NO
