"""Substitutions in launch files written in XML and YAML: `$(var name)`, `$(env NAME default)`, `$(dirname)` and others.

The grammar is launch's own (`launch/frontend/parse_substitution.py`, `grammar.lark`): arguments behind the name, apart
by blanks, in quotes where they hold blanks; a backslash takes the meaning from the sign behind it.
"""

from __future__ import annotations

from typing import Final

from keystore_audit.intent.launch_actions import Part, Reference, Text, Unknown, Variable

MAX_DEPTH: Final = 16
"""Substitutions within each other."""

MAX_SUBSTITUTIONS: Final = 256
"""Substitutions of one text: each is worked out again wherever a file is included."""

RUN: Final = {
    "find-pkg-share": "where a package is installed",
    "find-pkg-prefix": "where a package is installed",
    "find-exec": "where a program is installed",
    "exec-in-pkg": "where a program is installed",
    "command": "the output of a command, which is not run",
    "eval": "the result of an expression, which is not evaluated",
    "anon": "a name with a part that is new each time",
}
_QUOTES: Final = "'\""


class SubstitutionError(ValueError):
    """The text breaks the grammar; the message says how, a sentence without its end."""


def parse(text: str) -> Text:
    """Read a text with substitutions. Raises SubstitutionError."""
    parts, end = _Reader(text).text(0, "", 0)
    assert end == len(text)  # noqa: S101 - without a sign to stop at, it reads to the end
    return parts


def literal(text: Text) -> str | None:
    """Return the text if nothing in it has to be worked out."""
    return "".join(str(part) for part in text) if all(isinstance(part, str) for part in text) else None


class _Reader:
    def __init__(self, text: str) -> None:
        self._text = text
        self._found = 0

    def text(self, at: int, ends: str, depth: int) -> tuple[Text, int]:
        """Read until one of the signs `ends`, or to the end of all; the offset returned is that of the sign."""
        parts: list[Part] = []
        plain: list[str] = []
        while at < len(self._text) and self._text[at] not in ends:
            if self._text.startswith("$(", at):
                if plain:
                    parts.append("".join(plain))
                    plain = []
                part, at = self._substitution(at, depth + 1)
                parts.append(part)
            elif self._text[at] == "\\" and at + 1 < len(self._text):
                plain.append(self._text[at + 1])
                at += 2
            else:
                plain.append(self._text[at])
                at += 1
        if plain:
            parts.append("".join(plain))
        return tuple(parts), at

    def _substitution(self, begin: int, depth: int) -> tuple[Part, int]:
        self._found += 1
        if depth > MAX_DEPTH or self._found > MAX_SUBSTITUTIONS:
            limits = f"more than {MAX_SUBSTITUTIONS} substitutions, or {MAX_DEPTH} within each other"
            raise SubstitutionError(f"{limits}, which are not read")
        arguments: list[Text] = []
        at = self._after_blanks(begin + 2)
        while self._text[at : at + 1] != ")":
            if at >= len(self._text):
                raise SubstitutionError("a substitution '$(' without its ')'")
            argument, at = self._argument(at, depth)
            arguments.append(argument)
            at = self._after_blanks(at)
        if not arguments:
            raise SubstitutionError("a substitution '$()' without a name")
        return _meaning(arguments), at + 1

    def _argument(self, at: int, depth: int) -> tuple[Text, int]:
        quote = self._text[at]
        if quote not in _QUOTES:
            return self.text(at, " \t\r\n)", depth)
        text, at = self.text(at + 1, quote, depth)
        if at >= len(self._text):
            raise SubstitutionError(f"the quote {quote} opened and never closed")
        return text, at + 1

    def _after_blanks(self, at: int) -> int:
        while self._text[at : at + 1] in (" ", "\t", "\r", "\n"):
            at += 1
        return at


def _meaning(arguments: list[Text]) -> Part:
    name = literal(arguments[0])
    if name == "var" and len(arguments) in (2, 3):
        return Reference(variable=Variable.ARGUMENT, name=arguments[1], default=_second(arguments))
    if name in ("env", "optenv") and len(arguments) in (2, 3):
        return Reference(variable=Variable.ENVIRONMENT, name=arguments[1], default=_second(arguments))
    if name == "dirname" and len(arguments) == 1:
        return Reference(variable=Variable.DIRECTORY)
    if name in RUN:
        return Unknown(reason=RUN[name])
    return Unknown(reason=f"a substitution of the sort {name!r}" if name else "a substitution")


def _second(arguments: list[Text]) -> Text | None:
    return arguments[2] if len(arguments) == 3 else None
