"""What of an XML text has to be looked at closely: nearly always nothing, which its skeleton tells sooner.

The skeleton is the text without the printable characters that say nothing. A pattern that allows for their absence
finds there whatever it finds in the text, and at times more: then the text itself has to be looked at.
"""

from __future__ import annotations

import re
from typing import Final

_SILENT: Final = bytes(code for code in range(0x21, 0x7F) if code not in b"<>/=&'\"")
_BROKEN_VALUE: Final = re.compile(rb"""=\s*(?:"[^"<]*[\t\r\n]|'[^'<]*[\t\r\n])""")
_REMARKABLE_VALUE: Final = re.compile(rb">(?<!/>)[/=>]*[^/=<>][^<]*</")
"""Behind the end of a tag that is neither an end tag nor one of an empty element: those end in `/>` here."""


class Skeleton:
    """The skeleton of a text without comments."""

    __slots__ = ("_left",)

    def __init__(self, text: bytes = b"") -> None:
        """Take out what says nothing."""
        self._left = text.translate(None, _SILENT)

    @property
    def odd(self) -> bool:
        """Whether there may be a blank in an end tag, a character reference or a broken value of an attribute."""
        left = self._left
        return b"&" in left or left.count(b"</") != left.count(b"</>") or self.broken

    @property
    def broken(self) -> bool:
        """Whether a value of an attribute may have a tab or line end in it."""
        return _BROKEN_VALUE.search(self._left) is not None

    @property
    def remarkable(self) -> bool:
        """Whether between a start tag and an end tag there may be blanks, quotes or signs beyond ASCII.

        Of a text in which there are no attributes that hold `<`, no comments, instructions and CDATA sections.
        """
        return _REMARKABLE_VALUE.search(self._left) is not None
