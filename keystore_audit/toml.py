"""TOML as Python's own parser reads it, which came with Python 3.11, of keys that it reads in good time.

It takes 8 s for one key of 32,000 parts (measured), so that long keys are refused before it is asked.
"""

from __future__ import annotations

import re
import sys
from typing import Any, Final

if sys.version_info >= (3, 11):
    from tomllib import TOMLDecodeError
    from tomllib import loads as _loads
else:
    from tomli import TOMLDecodeError
    from tomli import loads as _loads

__all__ = ["STRING", "BeyondLimits", "TOMLDecodeError", "loads"]

MAX_PART: Final = 200
"""Characters of one part of a key."""

MAX_PARTS: Final = 20
"""Parts of a key, `a.b.c` having three."""

STRING: Final = r'"""(?:[^\\]|\\.)*?"{3,5}' + r"|'''.*?'{3,5}" + r'|"(?:[^"\\\n]|\\.)*"' + r"|'[^'\n]*'"
"""A string in any of the four forms; of a regular expression in which a dot is any character."""

_TOKEN: Final = re.compile(
    rf"#[^\n]*|(?P<string>{STRING})|(?P<bare>[A-Za-z0-9_-]+)|(?P<blank>[ \t]+)|(?P<dot>\.)|(?P<broken>[\"'])", re.DOTALL
)
_KEY_ENDS: Final = re.compile(r"[ \t]*(?:[.=]|\]+[ \t]*(?:#[^\n]*)?(?:\n|\Z))")
"""What follows a string that is a part of a key; a value of so many characters stands in no list alone."""


class BeyondLimits(ValueError):
    """A key is longer than is read."""


def loads(text: str) -> dict[str, Any]:
    """The document. Raises TOMLDecodeError for what is none, and BeyondLimits before anything is parsed."""
    _check_keys(text)
    return _loads(text)


def _check_keys(text: str) -> None:
    """One pass over words, strings and dots; behind a quote that ends nowhere no parser reads on."""
    parts, end, joined = 0, -1, False
    for token in _TOKEN.finditer(text):
        kind, apart = token.lastgroup, token.start() != end
        end = token.end()
        if kind == "broken":
            return
        if kind == "blank" and not apart:
            continue
        if kind in ("string", "bare"):
            parts = parts + 1 if joined and not apart else 1
            if parts > MAX_PARTS:
                raise BeyondLimits(f"a key of more than {MAX_PARTS} parts{_place(text, token.start())}")
            long = end - token.start() > MAX_PART + (2 if kind == "string" else 0)
            if long and (kind == "bare" or _is_key(text, token)):
                raise BeyondLimits(f"a word of more than {MAX_PART} characters{_place(text, token.start())}")
        joined = kind == "dot"


def _is_key(text: str, token: re.Match[str]) -> bool:
    follows = _KEY_ENDS.match(text, token.end())
    if follows is None or "]" not in follows[0]:
        return follows is not None
    return text[text.rfind("\n", 0, token.start()) + 1 : token.start()].lstrip().startswith("[")


def _place(text: str, at: int) -> str:
    """As Python's parser says it."""
    return f" (at line {text.count(chr(10), 0, at) + 1}, column {at - text.rfind(chr(10), 0, at)})"
