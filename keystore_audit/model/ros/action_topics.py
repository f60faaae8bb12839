"""Patterns for topics that take in topics of actions, though they do not name them.

The feedback and the status of an action are topics below its name: `rt/arm/*` matches `rt/arm/move/_action/status`.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from itertools import islice
from typing import Final

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.typed import Grant, Operation
from keystore_audit.model.matching.coverage import TOPICS, allows_everything, covers, may_cover
from keystore_audit.model.matching.expression import Pattern, has_wildcard, parse
from keystore_audit.model.names import ACTION_PART
from keystore_audit.model.ros.classes import OF_ACTIONS, Affix, classify_ros_names
from keystore_audit.model.semantics import DIRECTIONS
from keystore_audit.profiles import Matcher

STATUS: Final = Affix("rt", f"{ACTION_PART}status")

MAX_ACTIONS: Final = 1_000
"""Actions that a keystore names, of which an example is looked for; without one it is made up."""

_DECISIONS: Final = 64
_DECISIONS_PER_ENCLAVE: Final = 2
"""Questions about all names that are decided for one keystore, some milliseconds each and a tenth of a second at most.
What people write hardly needs any."""

_STATES: Final = 1_000
"""States for such a question about one expression: those that people write need some dozens."""

_PAIRS: Final = 500_000
_PAIRS_PER_ENCLAVE: Final = 1_000
"""Pairs of a topic and a pattern that are compared for one keystore, about half a second, and a millisecond."""


class ActionPattern(Struct, frozen=True, kw_only=True):
    """A grant of an enclave (its path) has patterns that take in topics of actions.

    `expression`: the first; `count`: how many. `action`: one, `owner`: the enclave that publishes its status by name,
    None where no other does. `operation`: publish, if any of them is for publishing. `served`: all that they take in of
    what others serve by name, with who serves it; deny rules do not count.
    """

    enclave: str
    operation: Operation
    expression: str
    count: int
    action: str
    owner: str | None
    served: tuple[tuple[str, str], ...]
    locations: tuple[Location, ...]


def action_patterns(enclaves: Iterable[Enclave]) -> tuple[ActionPattern, ...]:
    """For each enclave's own document. The example takes account of deny rules that come before.

    Patterns that were made to cost time are not searched to the end: some may be missing then, and `count` too low.
    """
    every = list(enclaves)
    effort = _Effort(_DECISIONS + _DECISIONS_PER_ENCLAVE * len(every), _PAIRS + _PAIRS_PER_ENCLAVE * len(every))
    wild = [
        (enclave, grant, found)
        for enclave in every
        for grant in enclave.grants
        if (found := _patterns(grant, effort)) and not allows_everything(grant)
    ]
    if not wild:
        return ()
    named = _Named(dict(islice(_named(every), MAX_ACTIONS)))
    return tuple(filter(None, (_pattern(enclave, grant, found, named, effort) for enclave, grant, found in wild)))


class _Effort(Struct):
    """What may still be spent on one keystore."""

    decisions: int
    pairs: int

    def decide(self) -> bool:
        """Whether one more question about all names may be asked."""
        self.decisions -= 1
        return self.decisions >= 0

    def compare(self, pairs: int) -> bool:
        """Whether so many pairs more may be compared."""
        self.pairs -= pairs
        return self.pairs >= 0


class _Named:
    """The actions that are named, each with the enclave that publishes its status."""

    def __init__(self, owners: Mapping[str, str]) -> None:
        self.owners = owners
        order = {STATUS.topic(name): number for number, name in enumerate(owners)}
        self._topics = sorted(order)
        self._order = order

    def among(self, pattern: Pattern, enclave: str, effort: _Effort) -> Iterator[str]:
        """Actions of other enclaves that the pattern matches."""
        begin, end = bisect_left(self._topics, pattern.prefix), len(self._topics)
        if pattern.prefix:
            end = bisect_right(self._topics, pattern.prefix, begin, key=lambda topic: topic[: len(pattern.prefix)])
        if not effort.compare(end - begin):
            return
        for topic in sorted(self._topics[begin:end], key=self._order.__getitem__):
            name = STATUS.name(topic)
            if name is not None and self.owners[name] != enclave and pattern.matches(topic):
                yield name


def _patterns(grant: Grant, effort: _Effort) -> list[tuple[Operation, Text]]:
    """Patterns of its allow rules for some topics, unless their text is about actions; those for publishing first."""
    found = [
        (criterion.operation, text)
        for criterion in grant.allowed
        if criterion.operation is not Operation.RELAY
        for text in criterion.topics
        if has_wildcard(text.text) and ACTION_PART not in text.text and text.text[:2] not in ("rq", "rr")
    ]
    every = {text for text in {text.text for _operation, text in found} if may_cover(text, TOPICS)}
    # Of those that take in every topic wildcard-grant says as much.
    every = {
        text for text in sorted(every, key=lambda text: (len(text), text)) if effort.decide() and covers(text, TOPICS)
    }
    found = [(operation, text) for operation, text in found if text.text not in every]
    return sorted(found, key=lambda each: each[0] is not Operation.PUBLISH)


def _named(enclaves: Iterable[Enclave]) -> Iterator[tuple[str, str]]:
    """Actions whose status an enclave publishes by name."""
    for enclave in enclaves:
        for text in (text for grant in enclave.grants for text in grant.listed(Operation.PUBLISH)):
            action = STATUS.name(text.text) if text.text.endswith(STATUS.suffix) else None
            if action is not None:
                yield action, enclave.path


def _pattern(
    enclave: Enclave, grant: Grant, found: list[tuple[Operation, Text]], named: _Named, effort: _Effort
) -> ActionPattern | None:
    if enclave.permissions is None:
        return None
    place = enclave.permissions.signed.file.place
    rules = {operation: _Rules(grant, operation) for operation in DIRECTIONS}
    hits: list[tuple[Operation, Text, str]] = []
    served: dict[str, str] = {}
    for operation, text in found:
        pattern = parse(text.text, Matcher.POSIX)
        known = list(named.among(pattern, enclave.path, effort))
        served.update((name, named.owners[name]) for name in known)
        action = known[0] if known else taken_in(text.text, effort.decide)
        if action is not None and rules[operation].reach(pattern, action, effort):
            hits.append((operation, text, action))
    if not hits:
        return None
    # An action that there is says more than one that is made up.
    operation, text, action = min(hits, key=lambda hit: (hit[0] is not Operation.PUBLISH, hit[2] not in named.owners))
    return ActionPattern(
        enclave=enclave.path,
        operation=operation,
        expression=text.text,
        count=len({hit[1].text for hit in hits}),
        action=action,
        owner=named.owners.get(action),
        served=tuple(sorted(served.items())),
        locations=tuple(Location(path=place, line=hit[1].line) for hit in hits),
    )


def taken_in(expression: str, decide: Callable[[], bool] = lambda: True) -> str | None:
    """An action of which the expression matches feedback or status; None where there is none, or it is hard to tell.

    `decide`: whether all names may be searched for one.
    """
    pattern = parse(expression, Matcher.POSIX)
    for name in _likely(pattern):
        if any(affix.name(affix.topic(name)) and pattern.matches(affix.topic(name)) for affix in OF_ACTIONS):
            return name
    if not any(_may_match(pattern, affix) for affix in OF_ACTIONS) or not decide():
        return None
    return _searched(expression)


def _likely(pattern: Pattern) -> Iterator[str]:
    """Names below the place of its first wildcard, and the names that result if each wildcard is one letter."""
    begin = pattern.prefix[2:].rstrip("/")
    yield from (f"{begin}/a", f"{begin}a", "/a")
    if len(pattern.pieces) == 1:
        spelled = "".join(token if isinstance(token, str) else "a" for token in pattern.pieces[0])
        for affix in OF_ACTIONS:
            yield f"/{spelled[len(affix.prefix) + 1 : len(spelled) - len(affix.suffix)]}"


def _may_match(pattern: Pattern, affix: Affix) -> bool:
    """Whether its ends and its length leave room for a topic with this prefix and suffix."""
    prefix, suffix = pattern.prefix, pattern.suffix
    return (
        affix.prefix.startswith(prefix[: len(affix.prefix)])
        and (affix.suffix.endswith(suffix) or suffix.endswith(affix.suffix))
        and (len(pattern.pieces) > 1 or len(pattern.pieces[0]) >= len(affix.topic("/a")))
    )


@lru_cache(maxsize=4096)
def _searched(expression: str) -> str | None:
    """The same, decided over all names."""
    try:
        classes = classify_ros_names([parse(expression, Matcher.POSIX)], OF_ACTIONS, budget=_STATES)
    except BudgetExceeded:
        return None
    return next((each.name for each in classes if any(each.members)), None)


class _Rules:
    """The rules of a grant about one operation, in their order."""

    def __init__(self, grant: Grant, operation: Operation) -> None:
        self._rules: list[tuple[bool, frozenset[str], list[Pattern]]] = []
        for rule in grant.rules:
            texts = {text.text for each in rule.criteria if each.operation is operation for text in each.topics}
            wild = [parse(text, Matcher.POSIX) for text in texts if has_wildcard(text)]
            self._rules.append((rule.allow, frozenset(texts), wild))

    def reach(self, pattern: Pattern, action: str, effort: _Effort) -> bool:
        """Whether a rule lets the grant's holder use feedback or status of the action; `pattern`: one of theirs."""
        for affix in OF_ACTIONS:
            topic = affix.topic(action)
            own = pattern.matches(topic)
            for allow, texts, wild in self._rules:
                found = topic in texts or (own and pattern.text in texts)
                if not found and not effort.compare(len(wild)):
                    return False
                if found or any(each.matches(topic) for each in wild):
                    if allow:
                        return True
                    break
        return False
