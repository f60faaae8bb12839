"""Patterns for topics that take in topics of actions, though they do not name them.

The feedback and the status of an action are topics below its name: `rt/arm/*` matches `rt/arm/move/_action/status`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.governance import Text
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.permissions import Grant, Operation
from keystore_audit.model.coverage import TOPICS, allows_everything, covers, has_wildcard
from keystore_audit.model.expression import Matcher, parse
from keystore_audit.model.names import ACTION_PART, ACTION_TOPICS
from keystore_audit.model.ros_classes import Affix, classify_ros_names

STATUS: Final = Affix("rt", f"{ACTION_PART}status")
_AFFIXES: Final = tuple(Affix("rt", ACTION_PART + topic) for topic in ACTION_TOPICS)

MAX_ACTIONS: Final = 1_000
"""Actions that a keystore names, of which an example is looked for; without one it is made up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionPattern:
    """A grant of an enclave (its path) has patterns that take in topics of actions.

    `expression`: the first; `count`: how many. `action`: one, `owner`: the enclave that publishes its status by name,
    None where no other does. `operation`: publish, if any of them is for publishing.
    """

    enclave: str
    operation: Operation
    expression: str
    count: int
    action: str
    owner: str | None
    locations: tuple[Location, ...]


def action_patterns(enclaves: Iterable[Enclave]) -> tuple[ActionPattern, ...]:
    """Of each enclave's own document. Rules that deny before them are weighed by the example."""
    every = list(enclaves)
    wild = [(enclave, grant, found) for enclave in every for grant in _grants(enclave) if (found := _patterns(grant))]
    if not wild:
        return ()
    named = dict(list(_named(every))[:MAX_ACTIONS])
    return tuple(filter(None, (_pattern(enclave, grant, found, named) for enclave, grant, found in wild)))


def _grants(enclave: Enclave) -> tuple[Grant, ...]:
    document = enclave.permissions.permissions if enclave.permissions else None
    return document.grants if document is not None else ()


def _patterns(grant: Grant) -> list[tuple[Operation, Text]]:
    """Patterns of its allow rules for some topics, not by their text about actions; those for publishing first."""
    found = [
        (criterion.operation, text)
        for rule in grant.rules
        if rule.allow
        for criterion in rule.criteria
        if criterion.operation is not Operation.RELAY
        for text in criterion.topics
        if has_wildcard(text.text) and ACTION_PART not in text.text and text.text[:2] not in ("rq", "rr")
        if not covers(text.text, TOPICS)  # of which wildcard-grant says as much
    ]
    return sorted(found, key=lambda each: each[0] is not Operation.PUBLISH)


def _named(enclaves: Iterable[Enclave]) -> Iterator[tuple[str, str]]:
    """Actions whose status an enclave publishes by name."""
    for enclave in enclaves:
        for grant in _grants(enclave):
            for rule in grant.rules:
                for criterion in rule.criteria if rule.allow else ():
                    for text in criterion.topics if criterion.operation is Operation.PUBLISH else ():
                        action = STATUS.name(text.text) if text.text.endswith(STATUS.suffix) else None
                        if action is not None:
                            yield action, enclave.path


def _pattern(
    enclave: Enclave, grant: Grant, found: list[tuple[Operation, Text]], named: dict[str, str]
) -> ActionPattern | None:
    if enclave.permissions is None or allows_everything(grant):
        return None
    place = enclave.permissions.signed.file.place
    hits: list[tuple[Operation, Text, str]] = []
    for operation, text in found:
        pattern = parse(text.text, Matcher.POSIX)
        others = (name for name, owner in named.items() if owner != enclave.path)
        known = next((name for name in others if pattern.matches(STATUS.topic(name))), None)
        action = known or taken_in(text.text)
        if action is not None and _reaches(grant, operation, action):
            hits.append((operation, text, action))
    if not hits:
        return None
    # An action that there is says more than one that is made up.
    operation, text, action = min(hits, key=lambda hit: (hit[0] is not Operation.PUBLISH, hit[2] not in named))
    return ActionPattern(
        enclave=enclave.path,
        operation=operation,
        expression=text.text,
        count=len({hit[1].text for hit in hits}),
        action=action,
        owner=named.get(action),
        locations=tuple(Location(path=place, line=hit[1].line) for hit in hits),
    )


@lru_cache(maxsize=4096)
def taken_in(expression: str) -> str | None:
    """An action of which the expression matches feedback or status; None where there is none, or it is hard to tell."""
    pattern = parse(expression, Matcher.POSIX)
    begin = pattern.prefix[2:].rstrip("/")
    for name in (f"{begin}/a", f"{begin}a", "/a"):
        if any(affix.name(affix.topic(name)) and pattern.matches(affix.topic(name)) for affix in _AFFIXES):
            return name
    try:
        classes = classify_ros_names([pattern], _AFFIXES)
    except BudgetExceeded:
        return None
    return next((each.name for each in classes if any(each.members)), None)


def _reaches(grant: Grant, operation: Operation, action: str) -> bool:
    """Whether a rule lets the grant's holder use feedback or status of the action."""
    for affix in _AFFIXES:
        topic = affix.topic(action)
        for rule in grant.rules:
            if any(
                criterion.operation is operation and _any_matches(criterion.topics, topic)
                for criterion in rule.criteria
            ):
                if rule.allow:
                    return True
                break
    return False


def _any_matches(texts: Iterable[Text], topic: str) -> bool:
    return any(
        text.text == topic or (has_wildcard(text.text) and parse(text.text, Matcher.POSIX).matches(topic))
        for text in texts
    )
