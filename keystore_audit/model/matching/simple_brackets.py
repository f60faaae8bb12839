"""Expressions as Cyclone DDS reads them: `*`, `?`, `[…]` and `[!…]`, with brackets of its own.

Read in access_control_utils.c (ac_fnmatch, the same from 0.7 to 11.0), measured on the plugin of 0.10.2 by
tests/oracles/fnmatch/test_plugins.py. Its brackets are not those of POSIX:

- a `]` closes them and is a member too, or the beginning of a range if a `-` follows: `[ab]-c` is one set;
- they cannot be empty: a `]` in first place is not passed over but taken for the next character of the text;
- a range has to have both ends, and `]` cannot be the second: what nothing closes, and `[a-]`, never match;
- `^` and backslashes are members like any other, and there are no character classes.

It works on octets: in brackets a character beyond ASCII stands for each of its octets, and `?` takes one of them.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Final

from keystore_audit.model.matching.tokens import ANY_CHARACTER, NO_CHARACTER, CharSet, Reading, Single, scanned
from keystore_audit.profiles import Matcher, told

_NEVER: Final = told("matcher", {Matcher.SIMPLE_BRACKETS}, "which {who} never [matches|match]")
_TAKES: Final = told("matcher", {Matcher.SIMPLE_BRACKETS}, "which {who} [takes|take]")
_NOTHING_CLOSES: Final = f"has a [ that nothing closes, {_NEVER}"
_EMPTY: Final = f"has brackets with nothing in them, {_NEVER}"
_ALL_BUT_NOTHING: Final = f"has [!] with nothing in it, {_TAKES} for any character and then a ]"
_NO_RANGE_END: Final = f"has a range in brackets that ends in ] or not at all, {_NEVER}"
_EMPTY_RANGE: Final = "has a range in brackets that ends before it begins, which is empty"
_RANGE_FROM_CLOSE: Final = f"has a - behind the ] of its brackets, {_TAKES} for a range from ] on"
_SPECIAL: Final = re.compile(r"[*?\[\0]")


def parse_simple_brackets(text: str) -> Reading:
    """Read `text`."""
    if not _SPECIAL.search(text):
        return Reading(tokens=text)
    tokens, faults = scanned(text, partial(_brackets, text), escapes=False)
    return Reading(tokens=tokens, malformed=next(iter(faults), None))


def _brackets(text: str, place: int) -> tuple[Single, int, str | None]:
    """Read from behind a `[`: what the brackets take, where the text goes on, and what is malformed in them.

    Where they never match, nothing behind them counts, and to read on could take quadratic time.
    """
    negated = text.startswith("!", place)
    place += negated
    if text.startswith("]", place):
        return (ANY_CHARACTER, place, _ALL_BUT_NOTHING) if negated else (NO_CHARACTER, len(text), _EMPTY)
    ranges: list[tuple[int, int]] = []
    fault: str | None = None
    low = ""
    while low != "]":
        if place == len(text):
            return NO_CHARACTER, place, _NOTHING_CLOSES
        low = high = text[place]
        place += 1
        if text.startswith("-", place):
            if low == "]":
                fault = fault or _RANGE_FROM_CLOSE
            if place + 1 == len(text) or text[place + 1] == "]":
                return NO_CHARACTER, len(text), _NO_RANGE_END
            high = text[place + 1]
            place += 2
        if low > high:
            fault = fault or _EMPTY_RANGE
        ranges.append((ord(low), ord(high)))
    return CharSet.of(ranges, negated=negated), place, fault
