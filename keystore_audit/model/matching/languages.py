"""The pattern languages of the implementations, as tokens: POSIX fnmatch, and two that are no fnmatch."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Final

from keystore_audit.model.matching.tokens import (
    ANY_CHARACTER,
    LAST_CHARACTER,
    NO_CHARACTER,
    CharSet,
    Reading,
    Single,
    scanned,
)
from keystore_audit.profiles import Matcher, doing, told

_DIFFERENTLY: Final = "which implementations read differently"
_NOTHING_CLOSES: Final = f"has a [ that nothing closes, {_DIFFERENTLY}"
_EMPTY_RANGE: Final = "has a range in brackets that ends before it begins, which is empty or an error"
_ODD_RANGE_END: Final = f"has a range in brackets that ends in [: or [=, {_DIFFERENTLY}"
_ODD_CLASS: Final = f"has [: in brackets without a class name and :] after it, {_DIFFERENTLY}"
_UNKNOWN_CLASS: Final = "names a character class that does not exist, so its brackets match nothing more"
_ODD_EQUIVALENCE: Final = f"has [= in brackets without one character and =] after it, {_DIFFERENTLY}"
_ODD_SYMBOL: Final = "has [. in brackets without one character and .] after it, so its brackets match nothing more"

_UPPER: Final = (ord("A"), ord("Z"))
_LOWER: Final = (ord("a"), ord("z"))
_DIGIT: Final = (ord("0"), ord("9"))
_CLASSES: Final[Mapping[str, tuple[tuple[int, int], ...]]] = {
    # The C locale's (ISO C, 7.4.1): ASCII only.
    "alnum": (_UPPER, _LOWER, _DIGIT),
    "alpha": (_UPPER, _LOWER),
    "blank": ((0x09, 0x09), (0x20, 0x20)),
    "cntrl": ((0x01, 0x1F), (0x7F, 0x7F)),
    "digit": (_DIGIT,),
    "graph": ((0x21, 0x7E),),
    "lower": (_LOWER,),
    "print": ((0x20, 0x7E),),
    "punct": ((0x21, 0x2F), (0x3A, 0x40), (0x5B, 0x60), (0x7B, 0x7E)),
    "space": ((0x09, 0x0D), (0x20, 0x20)),
    "upper": (_UPPER,),
    "xdigit": (_DIGIT, (ord("A"), ord("F")), (ord("a"), ord("f"))),
}
_CLASS_NAME: Final = re.compile("[a-y]*:]")  # glibc takes no z for part of a class name
_LONG_NAME: Final = re.compile("[a-y]{200}")  # glibc gives up on a long one, but how long it may be has changed
_SPECIAL: Final = re.compile(r"[*?\[\\\0]")


def parse_posix(text: str, *, escapes: bool) -> Reading:
    """Read `text`. `escapes`: whether a backslash takes the next character's meaning away, as without FNM_NOESCAPE."""
    if not _SPECIAL.search(text):
        return Reading(tokens=text)
    brackets = _Brackets(text, escapes=escapes)
    tokens, faults = scanned(text, brackets.read, escapes=escapes)
    return Reading(tokens=tokens, malformed=next(iter(faults), None), undefined=brackets.undefined)


class _Brackets:
    """Reads bracket expressions of one text, each from behind its `[`, all of them in linear time."""

    def __init__(self, text: str, *, escapes: bool) -> None:
        self._text = text
        self._escapes = escapes
        # Places from which items run to the end of the text: `[[:alpha:][[:alpha:]…` is not scanned again for every
        # `[`. Also a place behind which no `]` follows. A text that may kill its brackets is always scanned.
        self._unclosed: set[int] = set()
        self._last_close = len(text) if text.endswith("-") or "[." in text else text.rfind("]")
        self.undefined = False
        self._begin(0)

    def _begin(self, place: int) -> None:
        self._place = place
        self._ranges: list[tuple[int, int]] = []
        self._fault: str | None = None
        self._is_dead = False  # something was met after which glibc's brackets take no further character

    def read(self, place: int) -> tuple[Single, int, str | None]:
        """Return what the brackets take, the place behind their `]`, and what is malformed in them.

        Where nothing closes them that is a plain `[` and `place` itself.
        """
        if place > self._last_close:
            return "[", place, _NOTHING_CLOSES
        negated = self._text.startswith(("!", "^"), place)
        self._begin(place + 1 if negated else place)
        visited: list[int] = []
        while not visited or not self._text.startswith("]", self._place):  # a first `]` stands for itself
            if self._place >= len(self._text) or self._place in self._unclosed:
                self._unclosed.update(visited)
                if self._is_dead:  # the whole expression is (or not: `[[-`); to read on could take quadratic time
                    self.undefined = True
                    return NO_CHARACTER, len(self._text), self._fault
                return "[", place, self._fault or _NOTHING_CLOSES
            visited.append(self._place)
            self._item()
        if self._is_dead and negated:
            return NO_CHARACTER, self._place + 1, self._fault
        return CharSet.of(self._ranges, negated=negated), self._place + 1, self._fault

    def _item(self) -> None:
        """Take one character, range, class or equivalence class."""
        if self._text.startswith("[:", self._place) and self._class():
            return
        if self._text.startswith("[=", self._place) and self._equivalence():
            return
        is_symbol = self._text.startswith("[.", self._place)
        begin = self._end_point()
        if begin is None:
            return
        if not self._text.startswith("-", self._place):
            self._add([(ord(begin), ord(begin))])
        elif self._text.startswith("-]", self._place):
            if not is_symbol:  # glibc forgets the symbol in `[[.a.]-]`
                self._add([(ord(begin), ord(begin))])
        else:
            self._place += 1
            self._range(begin)

    def _range(self, begin: str) -> None:
        if self._text.startswith(("[:", "[="), self._place):
            self._malformed(_ODD_RANGE_END)
            self.undefined = True
        end = self._end_point()
        if end is None:
            return
        if begin > end:
            self._malformed(_EMPTY_RANGE)
        self._add([(ord(begin), ord(end))])

    def _class(self) -> bool:
        name = _CLASS_NAME.match(self._text, self._place + 2)
        self.undefined |= _LONG_NAME.match(self._text, self._place + 2) is not None
        if name is None:
            self._malformed(_ODD_CLASS)
            return False
        self._place = name.end()
        ranges = _CLASSES.get(name.group()[:-2])
        if ranges is None:
            self._die(_UNKNOWN_CLASS)
        else:
            self._add(ranges)
        return True

    def _equivalence(self) -> bool:
        """Take `[=a=]`: in the C locale a character is equivalent to itself only."""
        if not self._text.startswith("=]", self._place + 3):
            self._malformed(_ODD_EQUIVALENCE)
            self.undefined = True
            return False
        member = ord(self._text[self._place + 2])
        self._place += 5
        self._add([(member, member)])
        return True

    def _end_point(self) -> str | None:
        """Take one character, plain, escaped or as a collating symbol `[.a.]`; None where there is none."""
        if self._text.startswith("[.", self._place):
            close = self._text.find(".]", self._place + 2)
            symbol = self._text[self._place + 2 : close] if close >= 0 else ""
            self._place = close + 2 if close >= 0 else len(self._text)
            if len(symbol) != 1:
                self._die(_ODD_SYMBOL)
                return None
            return symbol
        if self._escapes and self._text.startswith("\\", self._place):
            self._place += 1
        if self._place >= len(self._text):
            self._die(_NOTHING_CLOSES)
            return None
        self._place += 1
        return self._text[self._place - 1]

    def _add(self, ranges: Iterable[tuple[int, int]]) -> None:
        if not self._is_dead:
            self._ranges.extend(ranges)

    def _malformed(self, fault: str) -> None:
        self._fault = self._fault or fault

    def _die(self, fault: str) -> None:
        self._is_dead = True
        self._malformed(fault)


# Expressions as Cyclone DDS reads them: `*`, `?`, `[…]` and `[!…]`, with brackets of its own.
#
# Read in access_control_utils.c (ac_fnmatch, the same from 0.7 to 11.0), measured on the plugin of 0.10.2 by
# tests/oracles/fnmatch/test_plugins.py. Its brackets are not those of POSIX:
#
# - a `]` closes them and is a member too, or the beginning of a range if a `-` follows: `[ab]-c` is one set;
# - they cannot be empty: a `]` in first place is not passed over but taken for the next character of the text;
# - a range has to have both ends, and `]` cannot be the second: what nothing closes, and `[a-]`, never match;
# - `^` and backslashes are members like any other, and there are no character classes.
#
# It works on octets: in brackets a character beyond ASCII stands for each of its octets, and `?` takes one of them.


_NEVER: Final = told("matcher", {Matcher.SIMPLE_BRACKETS}, "which {who} never [matches|match]")
_TAKES: Final = told("matcher", {Matcher.SIMPLE_BRACKETS}, "which {who} [takes|take]")
_NO_CLOSING_BRACKET: Final = f"has a [ that nothing closes, {_NEVER}"
_EMPTY: Final = f"has brackets with nothing in them, {_NEVER}"
_ALL_BUT_NOTHING: Final = f"has [!] with nothing in it, {_TAKES} for any character and then a ]"
_NO_RANGE_END: Final = f"has a range in brackets that ends in ] or not at all, {_NEVER}"
_EMPTY_BRACKET_RANGE: Final = "has a range in brackets that ends before it begins, which is empty"
_RANGE_FROM_CLOSE: Final = f"has a - behind the ] of its brackets, {_TAKES} for a range from ] on"
_SPECIAL_IN_SIMPLE: Final = re.compile(r"[*?\[\0]")


def parse_simple_brackets(text: str) -> Reading:
    """Read `text`."""
    if not _SPECIAL_IN_SIMPLE.search(text):
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
            return NO_CHARACTER, place, _NO_CLOSING_BRACKET
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
            fault = fault or _EMPTY_BRACKET_RANGE
        ranges.append((ord(low), ord(high)))
    return CharSet.of(ranges, negated=negated), place, fault


# Expressions as OpenDDS reads them: ACE::wild_match, case-sensitive and with brackets.
#
# Read in ACE.cpp of ACE_TAO, measured on the library of ACE 7.0.8 by tests/oracles/fnmatch/test_libraries.py; that
# OpenDDS calls it so is read in its AccessControlBuiltInImpl.cpp. A backslash escapes outside of brackets. In brackets
# `!` negates, a first `]` stands for itself, and there are no character classes. A range that does not end behind its
# beginning loses its `-`: `[z-a]` is z or a.
#
# Its search is special. Behind a `*` it takes the text up to the next one at the first place where it fits. Where that
# fails halfway it goes on behind the character that did not fit, not from the place after the one where it began. At
# the end of the text it does the same. So `*ab` does not match `aab`, nor `*_tf` the name `a_tf_tf`.


_WHO: Final = doing("matcher", Matcher.SINGLE_TRY)
_READS_BEYOND: Final = (
    f"has a [ that nothing closes: {_WHO} reads on in the memory behind it, so nobody can say what it matches"
)
_NOT_BEHIND: Final = f"has a range in brackets that does not end behind its beginning, of which {_WHO} takes both ends"
_ENDS_IN_DELETE: Final = f"has a range in brackets that ends in the character DEL, which {_WHO} takes for any character"
_DELETE: Final = "\x7f"
_SPECIAL_IN_SINGLE: Final = re.compile(r"[*?\[\\\0]")


def parse_single_try(text: str) -> Reading:
    """Read `text`; its stars are to be taken as the module says: that is `Pattern.rewinds`."""
    if not _SPECIAL_IN_SINGLE.search(text):
        return Reading(tokens=text)
    tokens, faults = scanned(text, partial(_single_brackets, text), escapes=True)
    if _READS_BEYOND in faults:
        return Reading(tokens=tokens, malformed=_READS_BEYOND, undefined=True)
    return Reading(tokens=tokens, malformed=next(iter(faults), None))


def _single_brackets(text: str, place: int) -> tuple[Single, int, str | None]:
    """Read from behind a `[`: what the brackets take, where the text goes on, and what is malformed in them."""
    negated = text.startswith("!", place)
    place += negated
    ranges: list[tuple[int, int]] = []
    fault: str | None = None
    first = place
    while place < len(text):
        character = text[place]
        if character == "]" and place > first:
            return CharSet.of(ranges, negated=negated), place + 1, fault
        end = text[place + 1 : place + 2]
        if character == "-" and place > first and end != "]":
            low = text[place - 1]
            if end <= low:
                fault = fault or _NOT_BEHIND
                place += 1
                continue
            if end == _DELETE:  # its loop counts in a char, which is never greater
                fault = fault or _ENDS_IN_DELETE
                ranges.append((1, LAST_CHARACTER))
            ranges.append((ord(low) + 1, ord(end)))
            place += 2
        else:
            ranges.append((ord(character), ord(character)))
            place += 1
    return NO_CHARACTER, place, _READS_BEYOND
