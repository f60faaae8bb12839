"""Classes of names: those that no expression tells apart, each with its shortest name.

An expression is a small automaton: one bit for each place in it, all expressions side by side in one number.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from functools import cache
from string import ascii_letters, digits

from keystore_audit.certificate.errors import CannotTell

MAX_STATES = 100_000
"""Combinations of places that are looked at: some seconds."""


class Expressions:
    """Expressions of `*` (any characters), `?` (any one character) and characters that stand for themselves."""

    def __init__(self, texts: Iterable[str]) -> None:
        """Raises CannotTell for brackets, backslashes and all else that is no plain character of ASCII."""
        self.ends: dict[str, int] = {}
        """By expression, the bit of a name that is read to its end."""
        self._stars = self._any = self._starts = 0
        self._letters: dict[str, int] = {}
        place = 0
        for text in sorted(set(texts)):
            if not text or any(not "!" <= letter <= "~" or letter in "[]\\;" for letter in text):
                raise CannotTell(f"the expression {text!r} is not made of plain characters, * and ?")
            self._starts |= 1 << place
            before = ""
            for letter in text:
                if letter == before == "*":
                    continue
                if letter == "*":
                    self._stars |= 1 << place
                elif letter == "?":
                    self._any |= 1 << place
                else:
                    self._letters[letter] = self._letters.get(letter, 0) | 1 << place
                before, place = letter, place + 1
            self.ends[text] = 1 << place
            place += 1
        self._every_end = sum(self.ends.values())

    def _closed(self, state: int) -> int:
        """The places, with those behind stars, since a star may match nothing; no star follows another."""
        return state | (state & self._stars) << 1

    def _next(self, state: int, letter: str) -> int:
        passing = state & (self._letters.get(letter, 0) | self._any)
        return self._closed(passing << 1 | state & self._stars)

    def matched(self, name: str) -> int:
        """The ends of the expressions that match the name."""
        state = self._closed(self._starts)
        for letter in name:
            state = self._next(state, letter)
        return state & self._every_end

    def classes(self) -> Mapping[int, str]:
        """By the ends of the expressions that match, a shortest name that they match. Raises CannotTell."""
        other = next((each for each in ascii_letters + digits if each not in self._letters), None)
        if other is None:
            raise CannotTell("the expressions use every letter and digit")
        start = self._closed(self._starts)
        seen, found, waiting = {start}, dict[int, str](), deque([(start, "")])
        while waiting:
            state, name = waiting.popleft()
            for letter in (*sorted(self._letters), other):
                after = self._next(state, letter)
                found.setdefault(after & self._every_end, name + letter)
                if after not in seen:
                    seen.add(after)
                    waiting.append((after, name + letter))
            if len(seen) > MAX_STATES:
                raise CannotTell(f"the expressions make more than {MAX_STATES:,} combinations")
        return found


@cache
def matches(expression: str, name: str) -> bool:
    """Whether the expression matches the name. Raises CannotTell."""
    return bool(Expressions([expression]).matched(name))
