"""Expressions at random, most of them with brackets, and all short names of a small alphabet."""

from __future__ import annotations

import itertools
import random

from keystore_audit.model.matching.expression import Pattern, parse
from keystore_audit.profiles import Matcher


def short_names(letters: str, longest: int) -> list[str]:
    """Every name of up to so many letters, the empty one apart."""
    return ["".join(name) for size in range(1, longest + 1) for name in itertools.product(letters, repeat=size)]


NAMES = short_names("ab/]", 5)
"""1,364 of them."""
BRACKET_NAMES = [*short_names("ab]-", 4), *short_names("[^!\\", 2), "a^", "c", "a.", ":]", "[a]", "[!a]", "abcab", "1"]
"""For single expressions: what brackets are made of occurs in names too."""

_ALPHABETS = ("[]!^-\\:a.=bz*?", "[]ab*?", "[[]!ab-", "[]ab-^!", "ab*?/", "[]-ab=.:", "*?ab", "\\ab*[]")
_PARTS = ("a", "b", "/", "]", "*", "*", "?", "[ab]", "[!a]", "[]a]", "[a-c]", "[!a-b/]", "\\a", "\\", "[[:alpha:]]")
_ODD_PARTS = ("[^a]", "[a-]", "[!]", "[ab", "[b-a]", "[]-a]", "[a]-b", "[!]a]", "*a", "*ab", "a*", "*b*")


def bracketed(random_: random.Random) -> str:
    """A text of up to ten characters, mostly with brackets, closed or not."""
    alphabet = random_.choice(_ALPHABETS)
    text = "".join(random_.choices(alphabet, k=random_.randint(1, 8)))
    return "[" + text + random_.choice(("]", "]", "", "a", "b]")) if random_.random() < 0.5 else text


def meant(random_: random.Random, matcher: Matcher) -> Pattern:
    """One that is not undefined."""
    while True:
        pattern = parse(bracketed(random_), matcher)
        if not pattern.undefined:
            return pattern


def pattern_set(random_: random.Random, *matchers: Matcher, odd: bool = True) -> list[Pattern]:
    """Up to six expressions with wildcards, and up to four names that those may match."""
    parts = _PARTS + _ODD_PARTS if odd else _PARTS
    patterns = []
    for _ in range(random_.randint(1, 6)):
        text = "".join(random_.choices(parts, k=random_.randint(1, 5)))
        patterns.append(parse(text, random_.choice(matchers)))
    patterns += [parse(name, random_.choice(matchers)) for name in random_.sample(NAMES[:340], random_.randint(0, 4))]
    return [pattern for pattern in patterns if not pattern.undefined]
