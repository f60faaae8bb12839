"""Expressions as OpenDDS reads them: ACE::wild_match, case-sensitive and with brackets.

Read in ACE.cpp of ACE_TAO, measured on the library of ACE 7.0.8 by tests/oracles/fnmatch/test_opendds.py; that OpenDDS
calls it so is read in its AccessControlBuiltInImpl.cpp. A backslash escapes outside of brackets. In brackets `!`
negates, a first `]` stands for itself, there are no character classes, and the `-` of a range that does not end behind
its beginning is left out: `[z-a]` is z or a.

What is special is how it searches: behind a `*` it takes the text up to the next one at the first place where it fits,
and where that fails halfway it goes on behind the character that did not fit, instead of from the place after the one
where it began. At the end of the text it does the same. So `*ab` does not match `aab`, nor `*_tf` the name `a_tf_tf`.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Final

from keystore_audit.model.matching.tokens import LAST_CHARACTER, NO_CHARACTER, CharSet, Reading, Single, scanned
from keystore_audit.profiles import Matcher, doing

_WHO: Final = doing("matcher", Matcher.SINGLE_TRY)
_READS_BEYOND: Final = (
    f"has a [ that nothing closes: {_WHO} reads on in the memory behind it, so nobody can say what it matches"
)
_NOT_BEHIND: Final = f"has a range in brackets that does not end behind its beginning, of which {_WHO} takes both ends"
_ENDS_IN_DELETE: Final = f"has a range in brackets that ends in the character DEL, which {_WHO} takes for any character"
_DELETE: Final = "\x7f"
_SPECIAL: Final = re.compile(r"[*?\[\\\0]")


def parse_single_try(text: str) -> Reading:
    """Read `text`; its stars are to be taken as the module says: that is `Pattern.rewinds`."""
    if not _SPECIAL.search(text):
        return Reading(tokens=text)
    tokens, faults = scanned(text, partial(_brackets, text), escapes=True)
    if _READS_BEYOND in faults:
        return Reading(tokens=tokens, malformed=_READS_BEYOND, undefined=True)
    return Reading(tokens=tokens, malformed=next(iter(faults), None))


def _brackets(text: str, place: int) -> tuple[Single, int, str | None]:
    """Read from behind a `[`: what the brackets take, where the text goes on, and what is malformed in them."""
    negated = text.startswith("!", place)
    place += negated
    ranges: list[tuple[int, int]] = []
    fault: str | None = None
    first = place
    while place < len(text):
        character = text[place]
        if character == "]" and place > first:
            return CharSet.of(ranges, negated=negated), place + 1, fault
        end = text[place + 1 : place + 2]
        if character == "-" and place > first and end != "]":
            low = text[place - 1]
            if end <= low:
                fault = fault or _NOT_BEHIND
                place += 1
                continue
            if end == _DELETE:  # its loop counts in a char, which is never greater
                fault = fault or _ENDS_IN_DELETE
                ranges.append((1, LAST_CHARACTER))
            ranges.append((ord(low) + 1, ord(end)))
            place += 2
        else:
            ranges.append((ord(character), ord(character)))
            place += 1
    return NO_CHARACTER, place, _READS_BEYOND
