"""Sets of numbers, of channels or domains mostly, as integers: number n is in the set if bit n is one."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Final
from weakref import WeakKeyDictionary

from msgspec import Struct

from keystore_audit.keystore.typed import Operation

_FEW: Final = 16
"""Numbers that make a set one by one; the set of more is made in an array."""


def bits(numbers: Iterable[int]) -> int:
    """The set of these numbers."""
    found = numbers if isinstance(numbers, frozenset) else frozenset(numbers)
    if len(found) < _FEW:
        value = 0
        for number in found:
            value |= 1 << number
        return value
    known = _BITS.get(found)
    if known is None:
        array = bytearray(max(found) // 8 + 1)  # a long integer is a new one after each bit
        for number in found:
            array[number >> 3] |= 1 << (number & 7)
        known = _BITS[found] = int.from_bytes(array, "little")
    return known


_BITS: Final = WeakKeyDictionary[frozenset[int], int]()
"""Thousands of rules, of several systems, may be about the same channels."""


def members(value: int) -> Iterable[int]:
    """The numbers in the set, ascending."""
    if value.bit_length() > _MANY_BITS:
        for found in _NOT_EMPTY.finditer(value.to_bytes(value.bit_length() // 8 + 1, "little")):
            start = 8 * found.start()
            yield from (start + low for low in members(int.from_bytes(found[0], "little")))
        return
    while value:
        low = value & -value
        yield low.bit_length() - 1
        value ^= low


def lowest(value: int) -> int:
    """The first number in the set, which is not empty."""
    return (value & -value).bit_length() - 1


def union(sets: Iterable[int]) -> int:
    """The union of these sets."""
    found = 0
    for each in sets:
        found |= each
    return found


_MANY_BITS: Final = 4_096
"""From so many on a set is taken apart piece by piece: a long integer is a new one without each bit."""

_NOT_EMPTY: Final = re.compile(rb"[^\0]{1,7}")


# What somebody can do to the channels of a trust domain.


class Abilities(Struct, frozen=True, kw_only=True):
    """What an enclave can do, as sets of governed channels of the domains that it can join.

    `may_write`: peers take its samples as those of a permitted writer. `may_read`: peers give it their samples and
    keys. `may_relay`: peers give it the keys of their submessages. `overhears`: it reads the payload with the keys of
    any participant, or of a relay. `forges`: it holds every key that authenticates a writer's samples. The keys are
    symmetric (DDS-Security 1.1, 9.5.3.3): whoever can check can forge, unless the metadata kind authenticates the
    origin. Origin authentication of messages does not prevent it (docs/model.md).
    `unannounced`: peers ask it for no permissions there unless it announces its endpoints truthfully. It is in
    `overhears` and `forges`. `writes_at_all`, `reads_at_all`: with those endpoints that honest peers refuse, if it is a
    member: they exist all the same.
    """

    may_write: int
    may_read: int
    may_relay: int
    overhears: int
    forges: int
    writes_at_all: int
    reads_at_all: int
    unannounced: int = 0

    def with_sets(self, made: Callable[[int], int]) -> Abilities:
        """The same with what is made of each set."""
        return Abilities(**{name: made(getattr(self, name)) for name in self.__struct_fields__})

    def by_right(self, operation: Operation) -> int:
        """Channels on which peers let it do this."""
        if operation is Operation.PUBLISH:
            return self.may_write
        return self.may_read if operation is Operation.SUBSCRIBE else self.may_relay

    @property
    def knows(self) -> int:
        """Channels whose samples it learns, as a reader or from packets."""
        return self.may_read | self.overhears
