"""Characters in classes that no wildcard of a set of expressions tells apart."""

from __future__ import annotations

import string
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Collection, Container, Iterable, Iterator, Mapping, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.matching.tokens import ANY_CHARACTER, LAST_CHARACTER, CharSet, Token
from keystore_audit.model.names import DISCOVERY_TOPIC, REPLY_SUFFIX, REQUEST_SUFFIX, SUFFIX_OF

_LETTERS: Final = string.ascii_lowercase.replace("st", "ts")  # of `rs/a` and `rt/a`, the second says something
_NAME_LIKE: Final = _LETTERS + "_/" + string.digits + string.ascii_uppercase
_READABLE: Final = _NAME_LIKE + "".join(chr(c) for c in range(0x21, 0x7F) if chr(c) not in _NAME_LIKE) + " "
_RANK: Final = {character: rank for rank, character in enumerate(_READABLE)}
_FIRST_PRINTABLE_BEYOND_ASCII: Final = 0xA1
_SURROGATES: Final = range(0xD800, 0xE000)


class Budget:
    """Counts down the work that one question may take; one unit is what the smallest step of it takes."""

    def __init__(self, units: int, message: str) -> None:
        self._left = units
        self._message = message

    def spend(self, units: int) -> None:
        """Raise BudgetExceeded, with the message of this budget, once more was spent than there was."""
        self._left -= units
        if self._left < 0:
            raise BudgetExceeded(self._message)


class Alphabet:
    """All characters but NUL in classes, numbered from the most readable one on.

    Two characters are in one class iff the same sets, of the expressions and `more`, hold both and neither is a token
    of its own. `rest` is the class that the fewest sets hold: usually the characters that no expression mentions.
    `representatives`: the most readable character of every class.
    """

    def __init__(self, expressions: Iterable[Iterable[Token]], budget: Budget, more: Iterable[Token]) -> None:
        tokens = set(more).union(*expressions) - {ANY_CHARACTER}
        sets = [token for token in tokens if isinstance(token, CharSet)]
        intervals = [(ord(token), ord(token)) for token in tokens if isinstance(token, str)]
        bounds = {1}
        for low, high in [*intervals, *(interval for charset in sets for interval in charset.ranges)]:
            bounds.update((low, high + 1))
        self._starts = sorted(bounds - {LAST_CHARACTER + 1})
        signatures: list[list[int]] = [[] for _ in self._starts]
        for number, charset in enumerate(sets):
            for low, high in charset.ranges:
                covered = self._positions(low, high)
                budget.spend(len(covered) // 8)
                for position in covered:
                    signatures[position].append(number)
        for number, (low, _) in enumerate(sorted(intervals), len(sets)):
            signatures[bisect_left(self._starts, low)].append(number)
        self._number_classes(signatures)
        self._class_of_character: dict[str, int] = {}
        self.representatives = [self.character(number) or "" for number in range(self.size)]

    def _number_classes(self, signatures: list[list[int]]) -> None:
        """Number the classes, one for each signature: the sets that hold it, and itself if it is a single."""
        members: dict[tuple[int, ...], list[tuple[int, int]]] = {}
        ends = [*(start - 1 for start in self._starts[1:]), LAST_CHARACTER]
        for signature, start, end in zip(map(tuple, signatures), self._starts, ends, strict=True):
            members.setdefault(signature, []).append((start, end))
        ranked = sorted(members, key=lambda signature: min(map(_best_rank, members[signature])))
        numbers = {signature: number for number, signature in enumerate(ranked)}
        self._class_at = [numbers[tuple(signature)] for signature in signatures]
        self._members = [members[signature] for signature in ranked]
        self.rest = min(range(len(ranked)), key=lambda number: (len(ranked[number]), -number))

    @property
    def size(self) -> int:
        """How many classes there are."""
        return len(self._members)

    def class_of(self, character: str) -> int:
        """Return the class that holds `character`, which is not NUL."""
        number = self._class_of_character.get(character)
        if number is None:
            number = self._class_at[bisect_right(self._starts, ord(character)) - 1]
            self._class_of_character[character] = number
        return number

    def split(self, charset: CharSet) -> tuple[bool, frozenset[int]]:
        """Return whether `charset`, one of the sets, holds `rest`; if not, which classes it holds, else which not."""
        inside = {self._class_at[position] for low, high in charset.ranges for position in self._positions(low, high)}
        if self.rest not in inside:
            return False, frozenset(inside)
        return True, frozenset(set(range(self.size)) - inside)

    def character(self, number: int, excluded: Container[str] = ()) -> str | None:
        """Return the most readable character of class `number` that is not `excluded`; None if there is none."""
        return next((character for character in self._readable_first(number) if character not in excluded), None)

    def _positions(self, low: int, high: int) -> range:
        return range(bisect_left(self._starts, low), bisect_right(self._starts, high))

    def _readable_first(self, number: int) -> Iterator[str]:
        for character in _READABLE:
            if self.class_of(character) == number:
                yield character
        for passes in (_is_printable, lambda code: not _is_printable(code)):
            for low, high in self._members[number]:
                for code in range(low, high + 1):
                    if passes(code) and chr(code) not in _RANK:
                        yield chr(code)


def _is_printable(code: int) -> bool:
    return code >= _FIRST_PRINTABLE_BEYOND_ASCII and code not in _SURROGATES


def _best_rank(interval: tuple[int, int]) -> int:
    """The rank of the most readable character of an interval."""
    low, high = interval
    ranks = [_RANK[chr(code)] for code in range(max(low, 0x20), min(high, 0x7E) + 1)]
    if ranks:
        return min(ranks)
    beyond = max(low, _FIRST_PRINTABLE_BEYOND_ASCII)
    if beyond <= high and beyond not in _SURROGATES:
        return len(_RANK) + beyond
    return len(_RANK) + LAST_CHARACTER + low


# The names that a question is about, as small automata over the character classes of an `Alphabet`.
#
# Two universes, always both: every DDS name (anybody's attack surface) and those that ROS 2's mangling can produce.


DEAD: Final = -1
"""No state: no name of the universe goes on like this."""

_FIXED_STARTS: Final = frozenset(
    text[:length] for text in (*SUFFIX_OF, DISCOVERY_TOPIC) for length in range(len(text) + 1)
)
_TOKEN_START: Final = string.ascii_letters + "_"
_WORD: Final = _TOKEN_START + string.digits

_ROS_TOKENS: Final = (
    *"".join((*SUFFIX_OF, DISCOVERY_TOPIC, REQUEST_SUFFIX, REPLY_SUFFIX)),
    *(CharSet.of((ord(each), ord(each)) for each in characters) for characters in (_TOKEN_START, string.digits)),
)
"""Characters, and sets of them, that the universe of ROS 2 names tells from all others."""


class Universe(Struct, frozen=True, kw_only=True):
    """A set of names. State 0 is where every name begins, `accepting` where one may end.

    `moves[state]`: the next state by character class, DEAD or not, and that of every other class in `classes`. No name
    has characters of other classes. `classes`: in order of number.
    """

    classes: Collection[int]
    accepting: Sequence[bool]
    moves: Sequence[tuple[Mapping[int, int], int]]


def ros_alphabet(expressions: Iterable[Iterable[Token]], budget: Budget) -> Alphabet:
    """An alphabet for expressions, given by their tokens, and for the universe of ROS 2 names."""
    return Alphabet(expressions, budget, _ROS_TOKENS)


def dds_names(alphabet: Alphabet) -> Universe:
    """All names but the empty one: any characters but NUL."""
    return Universe(classes=range(alphabet.size), accepting=(True,), moves=(({}, 0),))


def ros_names(alphabet: Alphabet) -> Universe:
    """The names of `names.parse_dds_name`; `alphabet` is a `ros_alphabet`."""
    classes = dict.fromkeys(sorted({alphabet.class_of(character) for character in _WORD + "/"}))
    numbers: dict[_Place, int] = {"": 0}
    places: list[_Place] = [""]
    moves: list[tuple[Mapping[int, int], int]] = []
    for place in places:  # grows while it is walked
        targets = {}
        for number in classes:
            after = _step(place, alphabet.representatives[number])
            if after is not None and after not in numbers:
                numbers[after] = len(places)
                places.append(after)
            targets[number] = DEAD if after is None else numbers[after]
        default = Counter(targets.values()).most_common(1)[0][0]
        moves.append(({number: target for number, target in targets.items() if target != default}, default))
    return Universe(classes=classes, accepting=[_may_end(place) for place in places], moves=moves)


_Place = str | tuple[str, int]
"""How far a name has come: a beginning of a fixed text, or (suffix that it must have, progress in its last token).

Progress is -1 behind a slash, else how many characters of the suffix the token ends in, its first character apart.
"""


def _step(place: _Place, character: str) -> _Place | None:
    if isinstance(place, str):
        text = place + character
        if text in SUFFIX_OF:
            return SUFFIX_OF[text], -1
        return text if text in _FIXED_STARTS else None
    suffix, progress = place
    if progress < 0:
        return (suffix, 0) if character in _TOKEN_START else None
    if character == "/":
        return suffix, -1
    if character not in _WORD:
        return None
    if suffix and progress < len(suffix) and character == suffix[progress]:
        return suffix, progress + 1
    # No suffix begins again within itself, so a broken one can only start over with this character.
    return suffix, int(bool(suffix) and character == suffix[0])


def _may_end(place: _Place) -> bool:
    if isinstance(place, str):
        return place == DISCOVERY_TOPIC
    suffix, progress = place
    return progress == len(suffix)
