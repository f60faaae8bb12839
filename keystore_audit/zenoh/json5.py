"""JSON5 (spec.json5.org) as Rust's json5 reads it, of which every value knows its line and no key is lost."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from keystore_audit.intent.source import MAX_DEPTH, MAX_VALUES, Value, shown
from keystore_audit.keystore.defect import Malformed

_BLANK: Final = r"[\t\n\v\f\r\u00a0\u2028\u2029\ufeff ]+|[\u1680\u2000-\u200a\u202f\u205f\u3000]+"
_ESCAPED: Final = r"\\u[0-9A-Fa-f]{4}"
_TOKEN: Final = re.compile(
    rf"""(?P<blank>{_BLANK}|//[^\n\r\u2028\u2029]*|/\*(?s:.*?)\*/)
    |(?P<sign>[][{{}}:,])
    |(?P<text>"(?:[^"\\\n\r\u2028\u2029]|\\(?:\r\n|(?s:.)))*"|'(?:[^'\\\n\r\u2028\u2029]|\\(?:\r\n|(?s:.)))*')
    |(?P<number>[+-]?(?:0[xX][0-9A-Fa-f]+|Infinity|NaN|(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)
      (?![\w$.]))
    |(?P<word>(?:[^\W\d]|\$|{_ESCAPED})(?:\w|\$|{_ESCAPED})*)""",
    re.VERBOSE,
)
_ESCAPE: Final = re.compile(r"\\(x[0-9A-Fa-f]{2}|u[0-9A-Fa-f]{4}|\r\n|(?s:.))")
_ESCAPES: Final = {
    **dict(zip("bfnrtv0", "\b\f\n\r\t\v\0", strict=True)),
    **dict.fromkeys(("\n", "\r", "\r\n", "\u2028", "\u2029"), ""),
}
_WORDS: Final = {"true": True, "false": False, "null": None}
_CLOSING: Final = {"[": "]", "{": "}"}
_LARGEST: Final = 2**63 - 1


class Unclear(Exception):
    """A text of which it is not known here how it is read; the message is the reason."""


def find(value: Value | None, *path: str) -> Value | None:
    """The value at the path below `value`; None where there is none, or null."""
    for name in path:
        content = value.content if value is not None else None
        value = content.get(name) if isinstance(content, Mapping) else None
    return value if value is not None and value.content is not None else None


def items(value: Value | None) -> tuple[Value, ...]:
    """Those of a list; none of what is no list."""
    return value.content if value is not None and isinstance(value.content, tuple) else ()


class _Open:
    """An array or object that has begun. `waits`: what may stand next."""

    def __init__(self, sign: str, line: int) -> None:
        self.sign, self.line = sign, line
        self.values: list[Value] = []
        self.found: dict[str, Value] = {}
        self.repeated: list[Value] = []
        self.key: Value | None = None
        self.waits = "key" if sign == "{" else "value"
        self.empty = True

    def add(self, value: Value) -> None:
        """A value that is whole."""
        if self.key is None:
            self.values.append(value)
        else:
            name = str(self.key.content)
            if name in self.found:
                self.repeated.append(self.key)
            self.found[name] = value
            self.key = None
        self.waits, self.empty = "comma", False

    def closes(self, sign: str) -> bool:
        """Whether it may end so here: behind a value, or behind a comma that is not alone."""
        return sign == _CLOSING.get(self.sign) and self.waits in ("comma", "key" if self.sign == "{" else "value")

    def whole(self) -> Value:
        """All of it."""
        content = self.found if self.sign == "{" else tuple(self.values)
        return Value(line=self.line, content=content, repeated=tuple(self.repeated))


def parse_json5(text: str) -> Value:
    """Read a whole text. A key that stands twice has the last value, and the key is among the object's `repeated`.

    Raises Malformed for what is no JSON5, with the line, and Unclear for what is deep, long or half a character.
    """
    line, position, count = 1, 0, 0
    inside = [_Open("", 1)]
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            raise Malformed(line, f"this is no JSON5: {shown(text[position : position + 20])}")
        position, count = match.end(), count + 1
        if len(inside) > MAX_DEPTH or count > 8 * MAX_VALUES:
            raise Unclear(f"more than {MAX_DEPTH} deep or {MAX_VALUES} values, which are not read")
        if match.lastgroup != "blank":
            _take(match, line, inside)
        line += match[0].count("\n")
    if len(inside) > 1 or inside[0].empty:
        raise Malformed(line, "the text ends too soon")
    return inside[0].values[0]


def _take(match: re.Match[str], line: int, inside: list[_Open]) -> None:
    """The next token."""
    here, word = inside[-1], match[0]
    if here.closes(word):
        inside.pop()
        inside[-1].add(here.whole())
    elif here.waits == "comma" and word == "," and here.sign:
        here.waits = "key" if here.sign == "{" else "value"
    elif here.waits == "colon" and word == ":":
        here.waits = "value"
    elif here.waits == "key" and match.lastgroup in ("text", "word"):
        here.key, here.waits = Value(line=line, content=_text(word, line)), "colon"
    elif here.waits == "value" and word in _CLOSING:
        inside.append(_Open(word, line))
    elif here.waits == "value" and (match.lastgroup in ("text", "number") or word in _WORDS):
        here.add(Value(line=line, content=_scalar(match, line)))
    else:
        raise Malformed(line, f"this is no JSON5: expected a {here.waits}, found {shown(word)}")


def _scalar(match: re.Match[str], line: int) -> str | float | bool | None:
    word = match[0]
    if match.lastgroup == "text":
        return _text(word, line)
    if word in _WORDS:
        return _WORDS[word]
    sign, digits = (-1 if word.startswith("-") else 1), word.lstrip("+-")
    if "Infinity" in word or word.endswith("NaN"):
        return None  # what becomes of them as Zenoh reads them
    if not digits.isdecimal() and digits[:2] not in ("0x", "0X"):
        return sign * float(digits)
    if len(digits) > 20 or int(digits, 0) > _LARGEST:
        raise Malformed(line, "an integer that does not fit into 64 bits")
    return sign * int(digits, 0)


def _text(word: str, line: int) -> str:
    """A string without its quotes, or a key without any."""
    body = word[1:-1] if word[:1] in ('"', "'") else word

    def meant(escape: re.Match[str]) -> str:
        code = escape[1]
        if code[0] in "xu" and len(code) > 1:
            return chr(int(code[1:], 16))
        if code in "123456789xu":
            raise Malformed(line, f"this is no JSON5: the escape {shown(escape[0])}")
        return _ESCAPES.get(code, code)

    read = _ESCAPE.sub(meant, body)
    if any("\ud800" <= character <= "\udfff" for character in read):
        raise Unclear(f"line {line}: a surrogate pair by escapes, which is not read")
    return read
