"""The tokens of a user's Alloy file: those of a part of Alloy in which nothing means more than it says.

Whatever is not known here is refused, with line and column. So what this module takes for a comment is one to the
Analyzer as well: control characters, which end its comments, and `/**/`, which begins a longer one, are among it.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

NO_NUMBERS: Final = "expected no numbers: they overflow in silence; say `lone`, or `some disj a, b: ...`"
"""Why counting is refused: Alloy's integers are of four bits where a scope says nothing else."""


class Token(NamedTuple):
    """`kind`: word, number, mark, comment or end. `start`: index in the text; line and column count from 1."""

    kind: str
    text: str
    start: int
    line: int
    column: int


class Wrong(Exception):
    """Something that is refused: where it begins, and words to go into a sentence."""

    def __init__(self, token: Token, message: str) -> None:
        """Keep where and what."""
        super().__init__(message)
        self.line = token.line
        self.column = token.column
        self.message = message


_TOKEN: Final = re.compile(
    r"(?P<blank>[ \t\n]+)"
    r"|(?P<comment>(?://|--)[^\n]*|/\*(?!\*/).*?\*/)"
    r"|(?P<word>[A-Za-z_][A-Za-z0-9_]*)"
    r"|(?P<number>[0-9]+)"
    r"|(?P<mark>[\[\]{}()|&+\-*~^.,:=<>!@]|/(?!\*))",
    re.DOTALL | re.ASCII,
)

_CONTROL: Final = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029]")

_REFUSED: Final = {
    **dict.fromkeys(
        ("fact", "sig", "enum", "extends", "abstract", "var"),
        "a file of properties adds no facts and no sigs: it asks about what the keystore says",
    ),
    **dict.fromkeys(
        ("Int", "int", "sum", "seq", "String", "plus", "minus", "mul", "div", "rem"),
        NO_NUMBERS,
    ),
    **dict.fromkeys(
        ("always", "eventually", "after", "before", "once", "historically", "until", "since", "releases", "triggered"),
        "nothing changes with time in these modules: settings have `until` (docs/settings.md)",
    ),
    **dict.fromkeys(("steps", "but", "exactly", "private", "macro"), "expected no such word here"),
}

_MARKS: Final = {
    "#": NO_NUMBERS,
    "'": "nothing changes with time in these modules: settings have `until` (docs/settings.md)",
    ";": "nothing changes with time in these modules: settings have `until` (docs/settings.md)",
    '"': "expected no text: enclaves and topics get names by `//@ enclave Name = /path`",
}


def tokens(text: str) -> list[Token]:
    """Return the tokens of `text`, comments among them, in order. Raises Wrong for what is refused."""
    if control := _CONTROL.search(text):
        raise Wrong(_at(text, control.start(), "mark"), f"expected no control character, found {control[0]!r}")
    found: list[Token] = []
    place = 0
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None or match.lastgroup is None:
            raise _stranger(text, place)
        if match.lastgroup != "blank":
            token = _at(text, place, match.lastgroup, match[0])
            if token.kind == "word" and token.text in _REFUSED:
                raise Wrong(token, f"{token.text!r}: {_REFUSED[token.text]}")
            found.append(token)
        place = match.end()
    return found


def _stranger(text: str, place: int) -> Wrong:
    token = _at(text, place, "mark")
    if text.startswith("/*", place):
        return Wrong(token, "expected a comment with something in it and an end, `/* ... */`")
    return Wrong(token, _MARKS.get(text[place], f"expected Alloy, found {text[place]!r}"))


def _at(text: str, place: int, kind: str, content: str = "") -> Token:
    line = text.count("\n", 0, place) + 1
    return Token(kind, content, place, line, place - text.rfind("\n", 0, place))
