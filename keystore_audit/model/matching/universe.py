"""The names that a question is about, as small automata over the character classes of an `Alphabet`.

Two universes, always both: every DDS name (anybody's attack surface) and those that ROS 2's mangling can produce.
"""

from __future__ import annotations

import string
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.model.matching.alphabet import Alphabet, Budget
from keystore_audit.model.matching.tokens import CharSet, Token
from keystore_audit.model.names import DISCOVERY_TOPIC, REPLY_SUFFIX, REQUEST_SUFFIX, SUFFIX_OF

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

    `moves[state]`: the next state by character class, DEAD or not, and that of every other class in `classes`;
    characters of a class that is not in `classes` are in no name. `classes`: in order of number.
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
    # No suffix begins again within itself, so a broken one can only begin anew with this character.
    return suffix, int(bool(suffix) and character == suffix[0])


def _may_end(place: _Place) -> bool:
    if isinstance(place, str):
        return place == DISCOVERY_TOPIC
    suffix, progress = place
    return progress == len(suffix)
