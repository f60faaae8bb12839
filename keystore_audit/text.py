"""The one place that escapes untrusted names: whoever made the keystore chose them.

File names, distinguished names, topics and grants reach terminals, web pages, spreadsheets and Alloy files.
Each target has one function here; all but `percent_path` and `shorten` begin with `terminal`, so an invisible
or direction-changing character becomes visible everywhere. JSON needs none of them: `json` escapes by itself.

Escape last: a text that is cut or joined with markup after escaping is no longer safe (`shorten` first).
Numbers of things (`counted`), instants, which are our own, and hints for misspelt words are put into words here, too.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from datetime import datetime, timezone
from typing import Final

MAX_EXPRESSION: Final = 60
"""Characters of an expression in a sentence."""

MAX_COMMENT_LENGTH: Final = 200
"""Characters of one name in an Alloy comment: enough for a path and a subject, and a model stays readable."""

PLAIN_PATH: Final = re.compile(r"\w[\w.-]*(?:/\w[\w.-]*)*", re.ASCII)
"""Paths in which no shell reads anything otherwise, and no program an option: those may stand in commands."""

_HIDDEN_RANGES: Final = (
    # Code points that a reader cannot see or that change how the rest is shown. Fixed here, not asked of
    # `unicodedata`, whose answer changes with the Python version: same keystore, same report.
    (0x00, 0x1F),  # C0: escape sequences, newlines
    (0x7F, 0xA0),  # DEL, C1 (U+009B starts a control sequence), no-break space
    (0xAD, 0xAD),  # soft hyphen
    (0x034F, 0x034F),  # combining grapheme joiner
    (0x0600, 0x0605),  # Arabic number signs, format characters
    (0x061C, 0x061C),  # Arabic letter mark (bidi)
    (0x06DD, 0x06DD),
    (0x070F, 0x070F),
    (0x0890, 0x0891),
    (0x08E2, 0x08E2),
    (0x115F, 0x1160),  # Hangul fillers
    (0x1680, 0x1680),  # Ogham space
    (0x17B4, 0x17B5),  # Khmer inherent vowels, invisible
    (0x180B, 0x180F),  # Mongolian variation selectors and vowel separator
    (0x2000, 0x200F),  # spaces of all widths, zero-width ones, direction marks
    (0x2028, 0x202F),  # line and paragraph separator, bidi embeddings and overrides, narrow no-break space
    (0x205F, 0x206F),  # mathematical space, word joiner, invisible operators, bidi isolates
    (0x2800, 0x2800),  # blank Braille pattern
    (0x3000, 0x3000),  # ideographic space
    (0x3164, 0x3164),  # Hangul filler
    (0xD800, 0xDFFF),  # lone surrogates: no encoder takes them
    (0xFDD0, 0xFDEF),  # noncharacters
    (0xFE00, 0xFE0F),  # variation selectors
    (0xFEFF, 0xFEFF),  # byte order mark
    (0xFFA0, 0xFFA0),  # halfwidth Hangul filler
    (0xFFF0, 0xFFFB),  # unassigned ignorables, interlinear annotation
    (0xFFFE, 0xFFFF),  # noncharacters, not allowed in XML either
    (0x110BD, 0x110BD),
    (0x110CD, 0x110CD),
    (0x13430, 0x1343F),  # Egyptian hieroglyph format controls
    (0x1BCA0, 0x1BCA3),  # shorthand format controls
    (0x1D173, 0x1D17A),  # musical format controls
    (0xE0000, 0xE0FFF),  # tags, variation selectors supplement
)
_HIDDEN: Final = re.compile(
    "[" + "".join(f"{chr(low)}-{chr(high)}" for low, high in _HIDDEN_RANGES) + "]|:(?=:)|#(?=#)"
)
_NOT_PRINTABLE_ASCII: Final = re.compile(r"[^ -~]")
_MARKDOWN_PUNCTUATION: Final = re.compile(r"[!-.:-@\[-`{-~]")  # all of ASCII's but `/`, which is inert
_FORMULA_START: Final = frozenset("=+-@\uff1d\uff0b\uff0d\uff20")  # full-width forms are taken too


def _visible(match: re.Match[str]) -> str:
    code = ord(match.group())
    if code <= 0xFF:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"


def terminal(text: str) -> str:
    r"""Return `text` as one line that steers no terminal: each hidden character as `\x1b`, `\u202e` or so.

    Hidden are C0, DEL, C1, every space but U+0020, bidi controls, zero-width and other ignorable characters, line and
    paragraph separators, lone surrogates and noncharacters. Of `::` and `##` it hides all signs but the last, since
    runners of pipelines take these for commands. A backslash stays as it is, so escaping twice changes nothing; the
    escape is for eyes, not for reversing. For rich, wrap it: `Text(terminal(name))`. Never put it in markup, whose own
    escape is wrong for a name that ends in a backslash or in an open tag.
    """
    if text.isascii() and text.isprintable() and "::" not in text and "##" not in text:
        return text
    return _HIDDEN.sub(_visible, text)


def markdown(text: str) -> str:
    """Return `text` as Markdown that renders as `terminal(text)`, in paragraphs, list items and table cells.

    A backslash before each punctuation character (CommonMark 0.31, 2.4) leaves no link, image, HTML,
    emphasis, code, heading, list, table border or autolink.
    """
    escaped = _MARKDOWN_PUNCTUATION.sub(r"\\\g<0>", terminal(text))
    if escaped.startswith(" "):  # four of them would begin a code block
        escaped = "&#32;" + escaped[1:]
    return escaped


def html(text: str) -> str:
    """Return `text` for HTML element content and quoted attribute values; not for scripts, styles or URLs."""
    from html import escape  # for pages alone

    return escape(terminal(text), quote=True)


def csv_cell(text: str) -> str:
    """Return `text` as a cell that no spreadsheet runs as a formula; separators and quotes are `csv`'s work.

    A text that begins like a formula, blanks ignored, gets an apostrophe in front (OWASP, "CSV Injection").
    """
    escaped = terminal(text)
    return f"'{escaped}" if escaped.lstrip()[:1] in _FORMULA_START else escaped


def alloy_comment(text: str) -> str:
    """Return `text` for a line comment of an Alloy module, at most `MAX_COMMENT_LENGTH` printable ASCII.

    Neither `/*` nor `*/` is left in it, so it is harmless inside a block comment too.
    """
    escaped = _NOT_PRINTABLE_ASCII.sub(_visible, terminal(text))
    escaped = escaped.replace("*/", "*\\x2f").replace("/*", "\\x2f*")
    return shorten(escaped, MAX_COMMENT_LENGTH, ellipsis="...")


def percent_path(path: bytes | str) -> str:
    """Return a POSIX path relative to the keystore in the report's form (design section 5).

    Valid UTF-8 stays; every other byte, `%` and the bytes of hidden characters become `%XX`. The result is
    safe on a terminal, and `urllib.parse.unquote_to_bytes` gives the bytes back, so two files never share a
    name. A `str` is taken as the operating system's interface gave it (`os.fsencode`).
    """
    raw = path if isinstance(path, bytes) else _path_bytes(path)
    return _HIDDEN.sub(_percent, raw.replace(b"%", b"%25").decode("utf-8", "surrogateescape"))


def _path_bytes(path: str) -> bytes:
    try:
        return os.fsencode(path)
    except UnicodeEncodeError:  # not from the file system: a surrogate that stands for no byte
        return path.encode("utf-8", "surrogatepass")


def _percent(match: re.Match[str]) -> str:
    return "".join(f"%{byte:02X}" for byte in match.group().encode("utf-8", "surrogateescape"))


def shorten(text: str, limit: int, *, ellipsis: str = "…") -> str:
    """Return `text` in at most `limit` characters, cut in the middle, since names often differ at their ends.

    Raises ValueError if `limit` is not larger than the ellipsis. Shorten before escaping for markup.
    """
    if limit <= len(ellipsis):
        raise ValueError(f"limit {limit} leaves no room beside the ellipsis")
    if len(text) <= limit:
        return text
    kept = limit - len(ellipsis)
    tail = kept // 2
    return text[: kept - tail] + ellipsis + text[len(text) - tail :]


def counted(number: int, noun: str, plural: str = "") -> str:
    """`1 file`, `1,200 files`."""
    return f"{number:,} {noun if number == 1 else plural or noun + 's'}"


def meant(word: str, known: Iterable[str], hint: str = " Did you mean {}?") -> str:
    """The `hint` with that of the `known` words which a misspelt one is most like; nothing where it is like none."""
    from difflib import get_close_matches  # for mistakes alone

    return "".join(map(hint.format, get_close_matches(word, known, n=1)))


def some(names: Iterable[str], most: int) -> str:
    """`a, b and 3 more`: the first of the names, and how many there are beside them; the last one has room always."""
    every = list(names)
    shown = len(every) if len(every) <= most + 1 else most
    return ", ".join(every[:shown]) + (f" and {len(every) - shown} more" if len(every) > shown else "")


def instant(moment: datetime) -> str:
    """An aware instant as `YYYY-MM-DDThh:mm:ssZ`, fractions of a second cut off."""
    return moment.astimezone(timezone.utc).replace(tzinfo=None).isoformat(timespec="seconds") + "Z"
