"""Where the keys and values of a TOML document stand, which Python's parsers do not tell.

For documents that a parser has taken already: nothing is checked here. Compared with that parser in the tests.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from keystore_audit import toml

Path = tuple[str | int, ...]
"""Keys and indices from the root to a value."""


class Position(NamedTuple):
    """Line and column, both from 1; columns count characters."""

    line: int
    column: int


_BLANK: Final = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_SPACES: Final = re.compile(r"[ \t]*")
_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")
_STRING: Final = re.compile(toml.STRING, re.DOTALL)
_SCALAR: Final = re.compile(r"[^,\]}#\r\n]*")


def positions(text: str) -> dict[Path, Position]:
    """For each key, and each item of an array, where it begins."""
    return _Scan(text).document()


class _Scan:
    """One pass over a document."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._found: dict[Path, Position] = {}
        self._tables: dict[Path, int] = {}  # arrays of tables: how many there are so far
        self._line, self._counted = 1, 0

    def document(self) -> dict[Path, Position]:
        """All positions."""
        table: Path = ()
        self._skip(_BLANK)
        while self._at < len(self._text):
            if self._text.startswith("[", self._at):
                table = self._header()
            else:
                self._pair(table)
            self._skip(_BLANK)
        return self._found

    def _header(self) -> Path:
        """The table that `[a.b]` or `[[a.b]]` begins."""
        position = self._position()
        several = self._text.startswith("[[", self._at)
        self._at += 2 if several else 1
        path: Path = ()
        keys = self._keys()
        for number, (key, _position) in enumerate(keys):
            path = (*path, key)
            if several and number == len(keys) - 1:
                self._tables[path] = self._tables.get(path, 0) + 1
                self._found.setdefault(path, position)
            if path in self._tables:
                path = (*path, self._tables[path] - 1)
            self._found.setdefault(path, position)
        self._at += 2 if several else 1
        return path

    def _pair(self, table: Path) -> None:
        """`key = value` in a table."""
        path = table
        for key, position in self._keys():
            path = (*path, key)
            self._found.setdefault(path, position)
        self._at += 1  # =
        self._skip(_SPACES)
        self._value(path)

    def _keys(self) -> list[tuple[str, Position]]:
        """The parts of a dotted key, each with its place, and the space after it."""
        keys = []
        while True:
            self._skip(_SPACES)
            position = self._position()
            if match := _BARE.match(self._text, self._at):
                keys.append((match[0], position))
            else:
                match = _STRING.match(self._text, self._at)
                if match is None:
                    raise AssertionError("a key of a valid document is not found")
                keys.append((toml.loads(f"key = {match[0]}")["key"], position))
            self._at = match.end()
            self._skip(_SPACES)
            if not self._text.startswith(".", self._at):
                return keys
            self._at += 1

    def _value(self, path: Path) -> None:
        if self._text.startswith("[", self._at):
            self._array(path)
        elif self._text.startswith("{", self._at):
            self._inline_table(path)
        elif match := _STRING.match(self._text, self._at):
            self._at = match.end()
        else:
            self._skip(_SCALAR)

    def _array(self, path: Path) -> None:
        self._at += 1
        self._skip(_BLANK)
        number = 0
        while not self._text.startswith("]", self._at):
            item: Path = (*path, number)
            self._found[item] = self._position()
            self._value(item)
            number += 1
            self._separator()
        self._at += 1

    def _inline_table(self, path: Path) -> None:
        self._at += 1
        self._skip(_BLANK)
        while not self._text.startswith("}", self._at):
            self._pair(path)
            self._separator()
        self._at += 1

    def _separator(self) -> None:
        self._skip(_BLANK)
        if self._text.startswith(",", self._at):
            self._at += 1
            self._skip(_BLANK)

    def _skip(self, what: re.Pattern[str]) -> None:
        match = what.match(self._text, self._at)
        if match is not None:
            self._at = match.end()

    def _position(self) -> Position:
        self._line += self._text.count("\n", self._counted, self._at)
        self._counted = self._at
        return Position(self._line, self._at - self._text.rfind("\n", 0, self._at))
