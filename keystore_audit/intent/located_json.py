"""JSON of which every value knows its line: `json` tells positions of mistakes alone.

Strict (RFC 8259) and one meaning only: no duplicate keys, no NaN, no lone surrogates, bounded depth and numbers.
"""

from __future__ import annotations

import json
import re
from bisect import bisect_right
from collections.abc import Mapping
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.defect import Malformed

MAX_DEPTH: Final = 32
"""Arrays and objects within each other: a graph has four."""

MAX_VALUES: Final = 200_000
"""Values of one text: 3,000 nodes with twenty endpoints each; 4 MB of empty arrays would be two million."""

MAX_STRING: Final = 4096
"""Characters of a string as it is written: names are shorter, and escapes cost memory."""

_BLANK: Final = re.compile(r"[ \t\r\n]*")
_STRING: Final = re.compile(r'"[^"\\\x00-\x1f]*(?:\\(?:["\\/bfnrt]|u[0-9a-fA-F]{4})[^"\\\x00-\x1f]*)*"')
_NUMBER: Final = re.compile(r"-?(?:0|[1-9][0-9]{0,14})(?![0-9.eE])")
_WORDS: Final[Mapping[str, bool | None]] = {"true": True, "false": False, "null": None}
_BEGINNING: Final = re.compile(r'[\[{"0-9-]|true|false|null')
_WORD: Final = re.compile(r"[A-Za-z]{1,10}")


class Value(Struct, frozen=True, kw_only=True):
    """A value with the line it begins at; what is inside an array or object are Values again."""

    line: int
    content: str | int | bool | tuple[Value, ...] | Mapping[str, Value] | None


def parse(text: str) -> Value:
    """Read a whole JSON text. Raises Malformed."""
    reading = _Reading(text)
    begin = reading.after_blanks(0)
    if not _BEGINNING.match(text, begin):
        raise reading.malformed(begin, "this is not JSON: expected a JSON value, e.g. an object in braces")
    value, end = reading.value(begin, 0)
    if reading.after_blanks(end) != len(text):
        raise reading.malformed(end, "expected the end of the file behind the value")
    return value


class _Reading:
    def __init__(self, text: str) -> None:
        self._text = text
        self._line_ends = [match.start() for match in re.finditer("\n", text)]
        self._values = 0

    def line(self, offset: int) -> int:
        return bisect_right(self._line_ends, offset - 1) + 1

    def malformed(self, offset: int, detail: str) -> Malformed:
        return Malformed(self.line(self.after_blanks(offset)), detail)

    def after_blanks(self, offset: int) -> int:
        match = _BLANK.match(self._text, offset)
        return offset if match is None else match.end()

    def value(self, at: int, depth: int) -> tuple[Value, int]:
        """Read the value at offset `at`; return it and the offset behind it."""
        self._values += 1
        if self._values > MAX_VALUES:
            raise self.malformed(at, f"more than {MAX_VALUES} values, which are not read")
        sign = self._text[at : at + 1]
        if sign in ("{", "["):
            if depth >= MAX_DEPTH:
                raise self.malformed(at, f"arrays and objects more than {MAX_DEPTH} deep, which are not read")
            content, end = self._object(at + 1, depth + 1) if sign == "{" else self._array(at + 1, depth + 1)
            return Value(line=self.line(at), content=content), end
        scalar, end = self._scalar(at)
        return Value(line=self.line(at), content=scalar), end

    def _scalar(self, at: int) -> tuple[str | int | bool | None, int]:
        if self._text[at : at + 1] == '"':
            return self._string(at)
        number = _NUMBER.match(self._text, at)
        if number is not None:
            return int(number[0]), number.end()
        word = _WORD.match(self._text, at)
        if word is not None and word[0] in _WORDS:
            return _WORDS[word[0]], word.end()
        raise self.malformed(at, "expected a JSON value (of numbers, integers of at most 15 digits)")

    def _string(self, at: int) -> tuple[str, int]:
        match = _STRING.match(self._text, at, at + MAX_STRING)
        if match is None:
            limits = f"at most {MAX_STRING} characters, none of them control characters"
            raise self.malformed(at, f"expected a string in double quotes, {limits}")
        string: str = json.loads(match[0])
        if any("\ud800" <= sign <= "\udfff" for sign in string):
            raise self.malformed(at, "half of a surrogate pair, which is no character")
        return string, match.end()

    def _array(self, at: int, depth: int) -> tuple[tuple[Value, ...], int]:
        found: list[Value] = []
        at = self.after_blanks(at)
        if self._text[at : at + 1] == "]":
            return (), at + 1
        while True:
            value, end = self.value(self.after_blanks(at), depth)
            found.append(value)
            at = self._next(end, "]")
            if self._text[at - 1] == "]":
                return tuple(found), at

    def _object(self, at: int, depth: int) -> tuple[Mapping[str, Value], int]:
        found: dict[str, Value] = {}
        at = self.after_blanks(at)
        if self._text[at : at + 1] == "}":
            return found, at + 1
        while True:
            at = self.after_blanks(at)
            key, end = self._string(at)
            if key in found:
                raise self.malformed(at, f"the key {json.dumps(key[:80])} a second time")
            end = self.after_blanks(end)
            if self._text[end : end + 1] != ":":
                raise self.malformed(end, "expected ':' behind the key")
            found[key], end = self.value(self.after_blanks(end + 1), depth)
            at = self._next(end, "}")
            if self._text[at - 1] == "}":
                return found, at

    def _next(self, end: int, closing: str) -> int:
        """The offset behind the comma or the closing sign that has to stand at `end`."""
        at = self.after_blanks(end)
        if self._text[at : at + 1] not in (",", closing):
            raise self.malformed(at, f"expected ',' or '{closing}'")
        return at + 1
