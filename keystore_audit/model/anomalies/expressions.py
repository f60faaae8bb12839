"""Expressions that match no name, or none that ROS 2 produces."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from functools import lru_cache
from typing import Final

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.anomalies.classes import Effort
from keystore_audit.model.matching.atoms import classify
from keystore_audit.model.matching.expression import Pattern, parse
from keystore_audit.model.names import DISCOVERY_TOPIC, REPLY_SUFFIX, REQUEST_SUFFIX, SUFFIX_OF, is_ros_dds_name
from keystore_audit.profiles import Matcher

_STATES: Final = 256
"""States for one expression: one with ten stars has some hundred."""

_COST: Final = 4
"""States of the keystore's effort that asking about one character of an expression takes."""

_NOT_OF_NAMES: Final = re.compile(r"[^A-Za-z0-9_/\n]")
_NOT_OF_TOKENS: Final = re.compile(r"/[0-9]")
_BROKEN: Final = ("//", "/\n", f"/{REQUEST_SUFFIX}\n", f"/{REPLY_SUFFIX}\n")
_PROBES: Final = ("", "a", "/a", "a/b", "t/a", "rt/a")
"""What is tried for each star: most expressions that match a ROS 2 name match one of these."""


def void(texts: Iterable[str], matchers: Collection[Matcher], effort: Effort) -> set[str]:
    """Those that are about nothing to all matchers: no name matches, or they are malformed and no ROS 2 name does.

    Raises errors.BudgetExceeded.
    """
    found = set()
    for text in texts:
        if "[" in text or "\\" in text:
            patterns = [parse(text, matcher) for matcher in matchers]
            if all(_is_void(pattern, effort) for pattern in patterns):
                found.add(text)
    return found


def _is_void(pattern: Pattern, effort: Effort) -> bool:
    if pattern.undefined:
        return False
    return matches_nothing(pattern) or (pattern.malformed is not None and not _has_ros_name(pattern, effort))


def matches_nothing(pattern: Pattern) -> bool:
    """Whether no name matches: a character is asked for that there is not, or only the empty name would do."""
    return pattern.literal == "" or any(
        not isinstance(piece, str) and any(not isinstance(each, str) and not each.ranges for each in piece)
        for piece in pattern.pieces
    )


def foreign(texts: Collection[str], matchers: Collection[Matcher], effort: Effort) -> set[str]:
    """Those that match no name of ROS 2 under any of the matchers. Raises errors.BudgetExceeded."""
    return {
        text
        for text in texts
        if not is_ros_dds_name(text) and not any(_has_ros_name(parse(text, matcher), effort) for matcher in matchers)
    }


def are_ros_names(texts: Collection[str]) -> bool:
    """Whether all are for certain; the quick question for 100,000s of names."""
    whole = "\n".join(texts) + "\n"
    if _NOT_OF_NAMES.search(whole) or _NOT_OF_TOKENS.search(whole) or any(broken in whole for broken in _BROKEN):
        return False
    for text in texts:
        suffix = SUFFIX_OF.get(text[:3])
        if suffix is None:
            if text != DISCOVERY_TOPIC:
                return False
        elif suffix and not text.endswith(suffix):
            return False
    return True


def _has_ros_name(pattern: Pattern, effort: Effort) -> bool:
    """Whether a name of ROS 2 matches; the empty name and NUL are in no name."""
    if pattern.literal is not None:
        return is_ros_dds_name(pattern.literal)
    prefix = pattern.prefix
    starts = (*SUFFIX_OF, DISCOVERY_TOPIC)
    if not any(start.startswith(prefix) or prefix.startswith(start) for start in starts):
        return False
    if any(isinstance(piece, str) and _NOT_OF_NAMES.search(piece) for piece in pattern.pieces):
        return False
    if _probed(pattern):
        return True
    effort.states -= _COST * len(pattern.text)
    if effort.states < 0:
        raise BudgetExceeded("there are too many expressions to be held against the names of ROS 2")
    return _decided(pattern.text, pattern.matcher)


def _probed(pattern: Pattern) -> bool:
    """Whether one of a few names that the expression matches is of ROS 2."""
    if len(pattern.pieces) == 1:
        name = "rt/".ljust(len(pattern.pieces[0]), "a")
        return is_ros_dds_name(name) and pattern.matches(name)
    if not all(isinstance(piece, str) for piece in pattern.pieces):
        return False
    pieces = [str(piece) for piece in pattern.pieces]
    names = (probe.join(pieces) for probe in _PROBES)
    return any(is_ros_dds_name(name) and pattern.matches(name) for name in names)


@lru_cache(maxsize=4096)
def _decided(text: str, matcher: Matcher) -> bool:
    """Whether it is so, decided over all names; said where that takes too many states, since nothing is then wrong."""
    try:
        classes = classify((parse(text, matcher),), budget=_STATES)
    except BudgetExceeded:
        return True
    return any(each.ros for each in classes if each.members)
