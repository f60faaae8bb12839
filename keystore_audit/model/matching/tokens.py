"""What an expression is made of once a matcher has read it: characters, sets of characters and stars."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from typing import Final, NamedTuple, TypeAlias

from msgspec import Struct

LAST_CHARACTER: Final = 0x10FFFF


class CharSet(NamedTuple):
    """Takes one character out of a set.

    `ranges`: sorted, disjoint, not adjacent, closed intervals of code points. NUL is in none: no name holds it. A
    tuple, since hostile documents have 100,000s of them, which are compared again and again.
    """

    ranges: tuple[tuple[int, int], ...]

    def takes(self, character: str) -> bool:
        """Whether the character is in it."""
        code = ord(character)
        place = bisect_right(self.ranges, (code, LAST_CHARACTER))  # of hundreds that a hostile document lists
        return place > 0 and code <= self.ranges[place - 1][1]

    @classmethod
    def of(cls, ranges: Iterable[tuple[int, int]], *, negated: bool = False) -> CharSet:
        """Return the set of the characters in `ranges` (any order, overlaps allowed), or of all others."""
        merged: list[tuple[int, int]] = []
        for low, high in sorted((max(low, 1), high) for low, high in ranges):
            if low > high:
                continue
            if merged and low <= merged[-1][1] + 1:
                merged[-1] = (merged[-1][0], max(merged[-1][1], high))
            else:
                merged.append((low, high))
        return cls(tuple(_complement(merged)) if negated else tuple(merged))


class Star(Enum):
    """`*`: any characters, any number of them, `/` and a leading `.` included.

    STAR: as POSIX and common sense have it. SEARCH: what follows is taken where it first fits, from behind the
    character on which it failed before (`opendds_pattern`).
    """

    STAR = "*"
    SEARCH = "search"


STAR: Final = Star.STAR
SEARCH: Final = Star.SEARCH
ANY_CHARACTER: Final = CharSet(((1, LAST_CHARACTER),))
"""`?`"""
NO_CHARACTER: Final = CharSet(())
"""Takes no character: an expression with it matches nothing."""

Single: TypeAlias = str | CharSet
"""What takes one character: that character itself, or a set (in normal form never a set of exactly one)."""
Token: TypeAlias = Single | Star
Piece: TypeAlias = str | tuple[Single, ...]
"""What stands between two stars; a plain str where it has no set, since `str.find` is fast."""


class Reading(Struct, frozen=True, kw_only=True):
    """A text as a matcher reads it; `malformed` and `undefined` as `expression.Pattern` has them."""

    tokens: Iterable[Token]
    malformed: str | None = None
    undefined: bool = False


_NUL: Final = "holds a NUL character, which no name has, so it never matches"
_TRAILING_BACKSLASH: Final = "ends in a backslash with nothing to escape, so it never matches"


def scanned(
    text: str, brackets: Callable[[int], tuple[Single, int, str | None]], *, escapes: bool
) -> tuple[list[Token], list[str]]:
    """The tokens of an expression, and all that is malformed in it.

    `brackets`: from the place behind a `[` what they take, where the text goes on, and what is malformed in them.
    `escapes`: whether a backslash takes the next character's meaning away.
    """
    tokens: list[Token] = []
    faults: list[str | None] = []
    place = 0
    while place < len(text):
        character = text[place]
        place += 1
        if character == "*":
            tokens.append(STAR)
        elif character == "?":
            tokens.append(ANY_CHARACTER)
        elif character == "\0":
            tokens.append(NO_CHARACTER)
            faults.append(_NUL)
        elif character == "[":
            token, place, fault = brackets(place)
            tokens.append(token)
            faults.append(fault)
        elif character == "\\" and escapes:
            tokens.append(text[place] if place < len(text) else NO_CHARACTER)
            faults.append(_TRAILING_BACKSLASH if place == len(text) else None)
            place += 1
        else:
            tokens.append(character)
    return tokens, [fault for fault in faults if fault is not None]


def pieces(tokens: Iterable[Token]) -> tuple[Piece, ...]:
    """Split `tokens` at the stars, in normal form: equal pieces match equal names."""
    if isinstance(tokens, str):
        return (tokens,)
    found: list[list[Single]] = [[]]
    after_star = False
    for token in tokens:
        if token is ANY_CHARACTER and not after_star:  # said early, since hostile texts have thousands of them
            found[-1].append(ANY_CHARACTER)
        elif isinstance(token, Star):
            if not after_star:
                found.append([])
            after_star = True
        elif after_star and token == ANY_CHARACTER:
            found[-2].append(token)  # `*?` is `?*`
        else:
            found[-1].append(_lone_character(token))
            after_star = False
    return tuple(_piece(singles) for singles in found)


def split_at_stars(tokens: Iterable[Token]) -> tuple[Piece, ...]:
    """Split `tokens` at the stars and leave what stands between them as it is."""
    if isinstance(tokens, str):
        return (tokens,)
    found: list[list[Single]] = [[]]
    for token in tokens:
        if not isinstance(token, Star):
            found[-1].append(_lone_character(token))
        elif found[-1] or len(found) == 1:
            found.append([])
    return tuple(_piece(singles) for singles in found)


def _piece(singles: list[Single]) -> Piece:
    characters = [single for single in singles if isinstance(single, str)]
    return "".join(characters) if len(characters) == len(singles) else tuple(singles)


def _lone_character(token: Single) -> Single:
    """Return a set of exactly one character as that character: `[a]` and `a` are one expression."""
    if isinstance(token, CharSet) and len(token.ranges) == 1 and token.ranges[0][0] == token.ranges[0][1]:
        return chr(token.ranges[0][0])
    return token


def _complement(ranges: Iterable[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    begin = 1
    for low, high in ranges:
        if begin < low:
            yield begin, low - 1
        begin = high + 1
    if begin <= LAST_CHARACTER:
        yield begin, LAST_CHARACTER
