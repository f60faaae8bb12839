"""Expressions: the patterns in topic and partition elements, as a given matcher reads them.

DDS-Security 1.1 (9.4.1.2, 9.4.1.3) gives expressions the syntax of POSIX `fnmatch()` (IEEE 1003.2-1992, B.6) and
says nothing about its flags. So one text has different meanings in different implementations, and none without its
`Matcher`. Python's own `fnmatch` is none of them.

We work on characters. A libc in the C locale works on bytes: a `?` or brackets take one byte of a non-ASCII character.
With such wildcards the answer on non-ASCII names depends on the locale of the process. ROS 2 names are ASCII;
`str.isascii` tells which expressions are not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache, partial
from typing import Final

from msgspec import Struct

from keystore_audit.keystore.document import Text
from keystore_audit.keystore.typed import Operation, Rule
from keystore_audit.model.matching.languages import parse_posix, parse_simple_brackets, parse_single_try
from keystore_audit.model.matching.tokens import (
    ANY_CHARACTER,
    SEARCH,
    STAR,
    Piece,
    Reading,
    Single,
    Token,
    pieces,
    split_at_stars,
)
from keystore_audit.profiles import Matcher

WILDCARDS: Final = frozenset("*?[\\")
"""What an expression that is no plain name has at least one of, whatever its matcher."""

UNESCAPED_WILDCARDS: Final = WILDCARDS - {"\\"}
"""The same where no backslash escapes: what names have that an implementation takes for expressions (`Local`)."""


_PARSERS: Final[Mapping[Matcher, Callable[[str], Reading]]] = {
    Matcher.POSIX: partial(parse_posix, escapes=True),
    Matcher.POSIX_NOESCAPE: partial(parse_posix, escapes=False),
    Matcher.SIMPLE_BRACKETS: parse_simple_brackets,
    Matcher.SINGLE_TRY: parse_single_try,
}


class Pattern(Struct, frozen=True, kw_only=True):
    """An expression as one matcher reads it.

    `malformed`: what is wrong with the text, a sentence without its subject ("has a [ that nothing closes, …"), None
    if nothing. Such a text still has one meaning, but hardly two matchers agree on it. `undefined`: its meaning is not
    known, because the implementation reads beyond its end, or its brackets may end in two places. What is decided with
    it is unknown; what it matches then is one possibility.

    `pieces`: what is between the stars. `rewinds`: whether a piece behind a star is looked for at every place, as with
    all but `Matcher.SINGLE_TRY`. Then the pieces are a normal form, and equal ones match equal names.
    """

    text: str
    matcher: Matcher
    malformed: str | None
    undefined: bool = False
    pieces: tuple[Piece, ...]
    rewinds: bool = True

    @property
    def literal(self) -> str | None:
        """The one name it matches; None where it has wildcards or can match nothing."""
        first = self.pieces[0]
        return first if len(self.pieces) == 1 and isinstance(first, str) else None

    @property
    def meaning(self) -> object:
        """Equal for patterns that match equal names."""
        return self.rewinds, self.pieces

    def agrees(self, other: Pattern) -> bool:
        """Whether it matches the same names, and it is as certain that these are all."""
        return self.meaning == other.meaning and self.undefined == other.undefined

    @property
    def tokens(self) -> tuple[Token, ...]:
        """Token by token; equal ones match equal names. In a run of `*` and `?` every `?` comes first, if it rewinds.

        If it does not, every star but one at the end is a SEARCH.
        """
        tokens: list[Token] = list(self.pieces[0])
        for piece in self.pieces[1:]:
            tokens.append(STAR if self.rewinds or not piece else SEARCH)
            tokens.extend(piece)
        return tuple(tokens)

    @property
    def prefix(self) -> str:
        """The characters before its first wildcard; every name that it matches begins with them."""
        return _leading_characters(self.pieces[0])

    @property
    def suffix(self) -> str:
        """The characters behind its last wildcard; every name that it matches ends in them."""
        return _leading_characters(self.pieces[-1][::-1])[::-1]

    def matches(self, name: str) -> bool:
        """Return whether it matches the whole of `name`, in time of at most the product of both lengths.

        A direct matcher that shares nothing with the automata of `atoms`. It takes each piece between two stars at the
        first place behind the piece before it.
        """
        if not self.rewinds:
            return _matches_without_rewinding(self.pieces, name)
        first, last = self.pieces[0], self.pieces[-1]
        if len(self.pieces) == 1:
            return len(name) == len(first) and _fits(first, name, 0)
        begin, end = len(first), len(name) - len(last)
        if isinstance(first, str) and not name.startswith(first):  # said early, since it is nearly always so
            return False
        if begin > end or not _fits(first, name, 0) or not _fits(last, name, end):
            return False
        for piece in self.pieces[1:-1]:
            place = _find(piece, name, begin, end)
            if place < 0:
                return False
            begin = place + len(piece)
        return True


@lru_cache(maxsize=4_096)
def parse(text: str, matcher: Matcher) -> Pattern:
    """Parse `text` as `matcher` reads it, in linear time. Every text has a meaning: nothing is raised."""
    reading = _PARSERS[matcher](text)
    searched = split_at_stars(reading.tokens) if matcher is Matcher.SINGLE_TRY else ()
    rewinds = not any(searched[1:])
    return Pattern(
        text=text,
        matcher=matcher,
        malformed=reading.malformed,
        undefined=reading.undefined,
        pieces=pieces(reading.tokens) if rewinds else searched,
        rewinds=rewinds,
    )


def has_wildcard(text: str) -> bool:
    """Whether the expression may match more than one name."""
    return "*" in text or "?" in text or "[" in text or "\\" in text


def naming(rule: Rule, operation: Operation, name: str, matcher: Matcher) -> Text | None:
    """The topic expression of the rule that is the name, or else the first that matches it. Those of the operation come
    before all others: some implementations read what a rule lists for relaying as a right to subscribe.
    """
    for own in (True, False):
        texts = [text for each in rule.criteria if (each.operation is operation) is own for text in each.topics]
        found = next((text for text in texts if text.text == name), None)
        found = found or next((text for text in texts if parse(text.text, matcher).matches(name)), None)
        if found is not None:
            return found
    return None


def any_matches(texts: Iterable[str], name: str, matcher: Matcher) -> bool:
    """Whether one of the expressions matches the name."""
    return any(parse(text, matcher).matches(name) for text in texts)


def _leading_characters(piece: Piece) -> str:
    if isinstance(piece, str):
        return piece
    count = next((index for index, token in enumerate(piece) if not isinstance(token, str)), len(piece))
    return "".join(str(token) for token in piece[:count])


def _matches_without_rewinding(pieces: Sequence[Piece], name: str) -> bool:
    """Whether they match with a single try: the character on which a piece fails is passed over."""
    at, taken = 0, 0
    for character in name:
        if taken == len(pieces[at]) and at + 1 < len(pieces):
            at, taken = at + 1, 0
            if not pieces[at]:
                return True
        piece = pieces[at]
        if taken < len(piece) and _takes(piece[taken], character):
            taken += 1
        elif at:
            taken = 0
        else:
            return False
    return taken == len(pieces[at]) and not any(pieces[at + 1 :])


def _takes(token: Single, character: str) -> bool:
    return character == token if isinstance(token, str) else token.takes(character)


def _fits(piece: Piece, name: str, place: int) -> bool:
    """Whether the piece takes the characters of `name` from `place` on, of which there are enough."""
    if isinstance(piece, str):
        return name.startswith(piece, place)
    for index, token in enumerate(piece, place):  # not `all`: hostile pieces have thousands of wildcards
        if token is not ANY_CHARACTER and not _takes(token, name[index]):
            return False
    return True


def _find(piece: Piece, name: str, begin: int, end: int) -> int:
    """The first place at which the piece fits within `name[begin:end]`, or -1."""
    if isinstance(piece, str):
        return name.find(piece, begin, end)
    return next((place for place in range(begin, end - len(piece) + 1) if _fits(piece, name, place)), -1)
