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

MAX_PARTS: Final = 20
"""Parts of a key, `a.b.c` having three."""

STRING: Final = r'"""(?:[^\\]|\\.)*?"{3,5}' + r"|'''.*?'{3,5}" + r'|"(?:[^"\\\n]|\\.)*"' + r"|'[^'\n]*'"
"""A string in any of the four forms; of a regular expression in which a dot is any character."""

_STRING_OR_COMMENT: Final = re.compile(rf"{STRING}|#[^\n]*", re.DOTALL)
_LONG_KEY: Final = re.compile(r"(?<![\w-])[\w-]+(?:[ \t]*\.[ \t]*[\w-]+){" + str(MAX_PARTS) + "}")


class BeyondLimits(ValueError):
    """A key is longer than is read."""


def loads(text: str) -> dict[str, Any]:
    """The document. Raises TOMLDecodeError for what is none, and BeyondLimits before anything is parsed."""
    bare = _STRING_OR_COMMENT.sub(lambda found: "s" + "\n" * found[0].count("\n"), text)
    if long := _LONG_KEY.search(bare):
        line = bare.count("\n", 0, long.start()) + 1
        raise BeyondLimits(f"a key of more than {MAX_PARTS} parts (at line {line})")
    return _loads(text)
