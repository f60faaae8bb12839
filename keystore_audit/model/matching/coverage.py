"""Whether expressions cover every ROS 2 topic or service: decided over all names, not by their text."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from keystore_audit.errors import BudgetExceeded
from keystore_audit.keystore.typed import Grant, Operation
from keystore_audit.model.matching.atoms import classify
from keystore_audit.model.matching.expression import WILDCARDS, has_wildcard, parse
from keystore_audit.profiles import Matcher

TOPICS: Final = "rt/*"
"""Every ROS 2 topic (ROS 2 design, topic and service names: the prefix of topics)."""

EVERYTHING: Final = (TOPICS, "rq/*Request", "rr/*Reply")
"""Every ROS 2 topic and service; actions are made of both."""

_PROBES: Final = {
    "rt/*": ("rt/a", "rt/Z_0/z", "rt/m/_9", "rt/_"),
    "rq/*Request": ("rq/aRequest", "rq/Z_0/zRequest", "rq/m/_9Request", "rq/_Request"),
    "rr/*Reply": ("rr/aReply", "rr/Z_0/zReply", "rr/m/_9Reply", "rr/_Reply"),
}
"""Names of each, as unlike as names get: whatever misses one covers not all, and needs no further thought."""

MAX_PARSED: Final = 64
MAX_CANDIDATES: Final = 16
"""Expressions of one grant and operation that are looked at, and decided over all names, the shortest first. To decide
takes some milliseconds, and what covers everything is short unless somebody made it to cost time."""

_BUDGET: Final = 2_000
"""States for the expressions: those that people write need some dozens."""


@lru_cache(maxsize=4096)
def covers(expression: str, wanted: str) -> bool:
    """Whether `expression` matches every ROS 2 name that `wanted`, one of EVERYTHING, matches; decided over all names.

    False too where that would take too many classes of names.
    """
    return expression == wanted or (may_cover(expression, wanted) and _cover((expression,), wanted))


def may_cover(expression: str, wanted: str) -> bool:
    """The quick question before `covers`, which is False wherever this is."""
    pattern = parse(expression, Matcher.POSIX)
    return all(map(pattern.matches, _PROBES[wanted]))


@lru_cache(maxsize=1024)
def _cover(expressions: tuple[str, ...], wanted: str) -> bool:
    """Whether each of these names is matched by one of the expressions."""
    try:
        classes = classify([parse(text, Matcher.POSIX) for text in (wanted, *expressions)], budget=_BUDGET)
    except BudgetExceeded:
        return False
    return all(len(found.members) > 1 for found in classes if 0 in found.members and found.ros)


@lru_cache(maxsize=256)
def covering(expressions: frozenset[str], wanted: str) -> tuple[str, ...]:
    """Expressions that together match every ROS 2 name that `wanted` (of EVERYTHING) matches; empty: there are none.

    One alone where one does. Of a great many expressions only the shortest are looked at, so that something made to
    cost time may be passed over.
    """
    if wanted in expressions:
        return (wanted,)
    likely = (text for text in expressions if text and (text[0] == wanted[0] or text[0] in WILDCARDS))
    shortest = sorted(filter(has_wildcard, likely), key=lambda text: (len(text), text))[:MAX_PARSED]
    matched = {
        text: [pattern.matches(probe) for probe in _PROBES[wanted]]
        for text, pattern in ((text, parse(text, Matcher.POSIX)) for text in shortest)
    }
    alone = [text for text in shortest if all(matched[text])][:MAX_CANDIDATES]
    for text in alone:
        if covers(text, wanted):
            return (text,)
    together = tuple(shortest[:MAX_CANDIDATES])
    if len(together) > 1 and all(any(hits) for hits in zip(*(matched[text] for text in together), strict=True)):
        return _least(together, wanted) if _cover(together, wanted) else ()
    return ()


def _least(expressions: tuple[str, ...], wanted: str) -> tuple[str, ...]:
    """Those of the expressions that are needed, the first ones left out where others do."""
    needed = expressions
    for text in reversed(expressions):
        rest = tuple(each for each in needed if each != text)
        if rest and _cover(rest, wanted):
            needed = rest
    return needed


def allows_everything(grant: Grant) -> bool:
    """Whether its allow rules cover every ROS 2 topic and service both ways; deny rules are not weighed."""
    published = frozenset(text.text for text in grant.listed(Operation.PUBLISH))
    if not any(map(has_wildcard, published)):
        return False
    subscribed = frozenset(text.text for text in grant.listed(Operation.SUBSCRIBE))
    return all(covering(expressions, wanted) for expressions in (published, subscribed) for wanted in EVERYTHING)
