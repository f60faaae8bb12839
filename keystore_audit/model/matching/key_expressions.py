"""Key expressions of routed middleware: chunks between `/`, `*` one of them, `**` any number, `$*` a part of one.

Source: the language's specification (Roadmap of the implementation, RFC "Key Expressions"), and the implementation
itself, which tests/oracles/zenoh asks about random pairs. A chunk that begins with `@` is verbatim: only itself
matches it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

EVERYTHING: Final = "**"
"""Every key without verbatim chunks."""
_ONE: Final = "*"
_PART: Final = "$*"
VERBATIM: Final = "@"
"""Begins a chunk that no wildcard stands for."""


def wrong_with(expression: str) -> str:
    """Why the text is no key expression in its one canonical form, the rest of a sentence; empty where it is one."""
    chunks = expression.split("/")
    if not all(chunks):
        return "it has an empty chunk"
    for before, chunk in zip(["", *chunks], chunks, strict=False):
        if wrong := _wrong_chunk(before, chunk):
            return wrong
    return ""


def _wrong_chunk(before: str, chunk: str) -> str:
    if "#" in chunk or "?" in chunk:
        return "# and ? are forbidden characters"
    if chunk in (_ONE, EVERYTHING):
        return f"** before {chunk} is no canonical form" if before == EVERYTHING else ""
    literal = chunk.split(_PART)
    if any("*" in each for each in literal):
        return "* may only stand alone between two /, or behind $"
    if any("$" in each for each in literal):
        return "$ is only allowed in $*"
    return "$* alone, or twice, is no canonical form" if chunk == _PART or "" in literal[1:-1] else ""


def includes(wide: str, narrow: str) -> bool:
    """Whether the implementation takes every key of `narrow` for one of `wide`; a key is an expression, too.

    It never answers yes where a key is left out; of some pairs, as `*/**` and `**/x`, it answers no though none is.
    """
    return _compared(wide, narrow, both=False)


def intersects(left: str, right: str) -> bool:
    """Whether some key is one of both."""
    return _compared(left, right, both=True)


@lru_cache(maxsize=65536)
def _compared(left: str, right: str, *, both: bool) -> bool:
    """Chunk by chunk: `met` has how much of `right` fits what was read of `left`; `both`: where `right` may stand for
    more than one key.
    """
    chunks = right.split("/")
    met = _skipping({0}, chunks) if both else {0}
    for chunk in left.split("/"):
        if chunk == EVERYTHING:
            for at in range(len(chunks)):
                if at in met and not chunks[at].startswith(VERBATIM):
                    met.add(at + 1)
        else:
            met = {to for at in met if at < len(chunks) for to in _after(chunk, chunks[at], at, both=both)}
        met = _skipping(met, chunks) if both else met
    return len(chunks) in met


def _skipping(met: set[int], chunks: list[str]) -> set[int]:
    """With what is behind each `**`, which may stand for nothing."""
    for at, chunk in enumerate(chunks):
        if at in met and chunk == EVERYTHING:
            met.add(at + 1)
    return met


def _after(left: str, right: str, at: int, *, both: bool) -> tuple[int, ...]:
    """Where to go on behind a chunk that is no `**`, the other being the one at `at`."""
    if right == EVERYTHING:
        return (at,) if both and not left.startswith(VERBATIM) else ()
    if left == right:
        return (at + 1,)
    if left.startswith(VERBATIM) or right.startswith(VERBATIM):
        return ()
    if _ONE in (left, right):
        return (at + 1,) if both or left == _ONE else ()
    return (at + 1,) if _parts_fit(left.replace(_PART, _ONE), right.replace(_PART, _ONE), both=both) else ()


def _parts_fit(left: str, right: str, *, both: bool) -> bool:
    """Whether two chunks with `*` for `$*` fit, as expressions do with characters for chunks."""
    met = _behind_parts({0}, right) if both else {0}
    for sign in left:
        if sign == _ONE:
            met = {*range(min(met, default=len(right) + 1), len(right) + 1)}
        else:
            stays = {at for at in met if both and right[at : at + 1] == _ONE}
            met = stays | {at + 1 for at in met if right[at : at + 1] == sign}
        met = _behind_parts(met, right) if both else met
    return len(right) in met


def _behind_parts(met: set[int], right: str) -> set[int]:
    for at, sign in enumerate(right):
        if at in met and sign == _ONE:
            met.add(at + 1)
    return met
