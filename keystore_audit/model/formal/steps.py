"""Ordered rules over channels: the first step that is about a channel decides.

Everybody who asks what ordered rules say asks here. Sets of channels are bit sets: channel n is bit n.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Generic, TypeVar

from msgspec import Struct

from keystore_audit.model.formal.bit_sets import union

By = TypeVar("By")


class Step(Struct, Generic[By], frozen=True):
    """Decides about `channels`, unless an earlier step did. `by`: what says so."""

    channels: int
    allow: bool
    by: By


class Difference(Struct, Generic[By], frozen=True):
    """Channels that two lists decide differently about, and the step of each that does."""

    channels: int
    left: Step[By]
    right: Step[By]


def decided(steps: Iterable[Step[By]]) -> Iterator[tuple[Step[By], int]]:
    """The steps that are about anything, each with the channels that it decides about: no earlier one is about them."""
    taken = 0
    for step in steps:
        channels = step.channels
        if channels:  # most rules of thousands are about another operation
            yield step, channels & ~taken if taken else channels
            taken |= channels


def allowed(steps: Iterable[Step[By]]) -> int:
    """The channels that the steps allow."""
    return union(channels for step, channels in decided(steps) if step.allow)


def deciding(steps: Iterable[Step[By]], channel: int) -> Step[By]:
    """The step that decides about a channel; of lists that end with one about all of them."""
    return next(step for step in steps if step.channels >> channel & 1)


def compare(left: Iterable[Step[By]], right: Iterable[Step[By]], channels: int) -> Iterator[Difference[By]]:
    """Of the channels, those that the lists decide differently about, by the two steps that do."""
    theirs = [(step, part & channels) for step, part in decided(right)]
    first = 0
    for one, part in decided(left):
        mine = part & channels
        while first < len(theirs) and not theirs[first][1]:  # both mostly decide in one order, of thousands
            first += 1
        for number in range(first, len(theirs) if mine else 0):
            other, rest = theirs[number]
            both = mine & rest
            if both:
                mine &= ~both
                theirs[number] = other, rest & ~both
                if one.allow is not other.allow:
                    yield Difference(both, one, other)
                if not mine:
                    break
