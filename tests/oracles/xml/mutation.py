"""Documents with a few things changed in them, mostly of the sorts that parsers disagree about."""

from __future__ import annotations

import re
from functools import partial

from hypothesis import strategies as st

from tests.keystore.builder import GOVERNANCE
from tests.keystore.documents import PERMISSIONS

_RICH = PERMISSIONS.replace(
    b"<publish>",
    b"<!-- what it says -->\n<subscribe>\n<topics><topic>rt/*</topic>\n<topic>rq/a&amp;b</topic></topics>"
    b"<partitions>\n<partition/></partitions></subscribe>\n<publish>",
).replace(b"<id>0</id>", b"<id>3</id><id_range><min>5</min><max>9</max></id_range>")
_ONE_LINE = PERMISSIONS.split(b"\n", 1)[1].replace(b"\n", b"")
BASES = (PERMISSIONS, GOVERNANCE, _RICH, _ONE_LINE, _RICH.replace(b"\n", b"\r\n"))

_IN_VALUES = (
    *(b"&#x61;", b"&#97;", b"&#0097;", b"&#x1F600;", b"&#xe9;", b"&amp;", b"&amp;lt;", b"&lt;", b"&gt;", b"&quot;"),
    *(b"&apos;", b"&#38;", b"&#60;", b"]]&gt;", b"&#32;", b"&#9;", b"&#10;", b"&#13;", b"&#xA0;", b"&x;", b"&#x0;"),
    *("é".encode(), "😀".encode(), "\u00a0".encode(), "\u3000".encode(), "\u0130".encode(), "\u201c".encode()),
    *(b" ", b"\t", b"\n", b"]]>", b">", b"/", b"'", b'"', b"=", b";", b"-", b"--", b"?", b"!", b"[", b"]", b"&", b"<"),
    *(b"\\", b"%s", b"${HOME}", b"*", b"+", b"-0", b"00", b"9" * 25, b"TRUE", b"A" * 300),
    *(b"<!-- -->", b"<![CDATA[x]]>", b"<?x y?>", b"\x00", b"\x0b", b"\x7f", b"\xc2\x85", b"\xff", b"\xed\xa0\x80"),
)
_BETWEEN_TAGS = (
    *(b" ", b"\n", b"\t", b"\r\n", b"\r", b"<!---->", b"<!-- - -->", b'<!-- <a> & " -->', b"<!-- -- -->", b"&#32;"),
    *(b"<id>0</id>", b"<id>9</id>", b"<topic>a</topic>", b"<topic >a</topic>", b"<topic\n>a</topic>", b"<topic/>"),
    *(b"<topic>a</topic >", b"<topic></topic>", b"<partitions><partition/></partitions>", b"<!-- " + b"x" * 5000),
    *(
        b"<?x y?>",
        b"<?xml version='1.0'?>",
        b"<!DOCTYPE dds>",
        b"<![CDATA[]]>",
        b"x",
        b"\x00",
        b"\xef\xbb\xbf",
        b"<dds/>",
    ),
)
_IN_TAGS = (
    *(b" ", b"\n", b"\t", b"\r\n", b" a='b'", b' name="x"', b" xmlns=''", b' xmlns:y="u"', b"x", b"y:", b"'", b'"'),
    *(b"=", b"/", b" xmlns:xsi='http://www.w3.org/2001/XMLSchema-instance'", b"&amp;", b"&#10;", b"<", b">", b"\x00"),
)
_FREE_TEXT = re.compile(rb"<(?:subject_name|topic|partition|topic_expression)>([^<>]*)</")
_VALUE = re.compile(rb">([^<>\s][^<>]*)</")
_TAG = re.compile(rb"<[^<>]*>")


def _spots(pattern: re.Pattern[bytes], base: bytes) -> tuple[int, ...]:
    return tuple(place for match in pattern.finditer(base) for place in range(match.start(1), match.end(1) + 1))


def _places(base: bytes) -> tuple[tuple[tuple[int, ...], tuple[bytes, ...]], ...]:
    """Offsets of the document, and what is put there; free text several times, for most survives there."""
    free = (_spots(_FREE_TEXT, base), _IN_VALUES)
    tags = tuple(place for match in _TAG.finditer(base) for place in match.span())
    inner = tuple(
        place
        for match in _TAG.finditer(base)
        for place in range(match.start() + 1, match.end())
        if not (base[place - 1 : place].isalnum() and base[place : place + 1].isalnum())
    )
    anywhere = (*_IN_VALUES, *_BETWEEN_TAGS, *_IN_TAGS)
    return (
        *(free, free, free, (_spots(_VALUE, base), _IN_VALUES)),
        *((tags, _BETWEEN_TAGS), (tags, _BETWEEN_TAGS), (inner, _IN_TAGS), (tuple(range(len(base) + 1)), anywhere)),
    )


Edit = tuple[int, int, bytes]
"""Offset, how many octets go, what comes instead."""


def _edits(base: bytes) -> st.SearchStrategy[list[Edit]]:
    anywhere = st.integers(0, len(base))
    pieces = st.sampled_from(_places(base)).flatmap(
        lambda group: st.tuples(st.sampled_from(group[0]), st.just(0), st.sampled_from(group[1]))
    )
    moved = st.tuples(anywhere, anywhere, st.integers(1, 80)).map(lambda t: (t[0], 0, base[t[1] : t[1] + t[2]]))
    other = st.one_of(
        moved,
        st.tuples(anywhere, st.just(1), st.binary(min_size=1, max_size=1)),
        st.tuples(anywhere, st.integers(1, 12), st.just(b"")),
    )
    letter = st.tuples(
        st.sampled_from(_spots(_FREE_TEXT, base)), st.just(0), st.characters(codec="utf-8").map(str.encode)
    )
    return st.lists(st.one_of(pieces, pieces, pieces, pieces, letter, letter, other), min_size=1, max_size=2)


def _edited(base: bytes, edits: list[Edit]) -> bytes:
    for place, gone, instead in sorted(edits, reverse=True):
        base = base[:place] + instead + base[place + gone :]
    return base


def documents() -> st.SearchStrategy[bytes]:
    """A governance or permissions document with one or two edits."""
    return st.one_of([_edits(base).map(partial(_edited, base)) for base in BASES])
