"""Quick answers from the texts of a grant, where they are certain, and the lines of a document that people look for."""

from __future__ import annotations

from functools import cached_property
from typing import Final

from keystore_audit.findings import Location
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.permissions import Grant, Operation
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.matching.pattern_index import PatternIndex
from keystore_audit.model.names import ACTION_PART, ACTION_SERVICES, ACTION_TOPICS
from keystore_audit.model.ros.classes import REPLY, REQUEST
from keystore_audit.profiles import Matcher

_ENDS: Final = tuple(ACTION_PART + service for service in ACTION_SERVICES)


class Lines:
    """The lines of a grant that list topics in allow rules. Thousands may be asked for, of as many expressions."""

    def __init__(self, grant: Grant) -> None:
        self._grant = grant

    @cached_property
    def _listed(self) -> dict[Operation, tuple[dict[str, Text], PatternIndex, list[Text]]]:
        """By operation: the first that has each text, all of these as patterns, by their numbers, and in order."""
        listed: dict[Operation, tuple[dict[str, Text], PatternIndex, list[Text]]] = {}
        for operation in Operation:
            first: dict[str, Text] = {}
            for text in self._grant.listed(operation):
                first.setdefault(text.text, text)
            patterns = ((number, parse(text, Matcher.POSIX)) for number, text in enumerate(first))
            listed[operation] = first, PatternIndex(patterns), list(first.values())
        return listed

    def of(self, operation: Operation, topic: str) -> int | None:
        """The line of the expression that matches the topic; one that is no pattern comes first."""
        first, patterns, texts = self._listed[operation]
        if topic in first:
            return first[topic].line
        matching = [number for number, pattern in patterns.candidates(topic) if pattern.matches(topic)]
        return texts[min(matching)].line if matching else None


class DocumentLines:
    """The same of an enclave's permissions."""

    def __init__(self, enclave: Enclave) -> None:
        file = enclave.permissions
        self._path = enclave.files.directory if file is None else file.signed.file.place
        self._grants = [Lines(grant) for grant in enclave.grants]

    def of(self, operation: Operation, topic: str) -> Location:
        """The first line that lists the topic; else the document."""
        for lines in self._grants:
            line = lines.of(operation, topic)
            if line is not None:
                return Location(path=self._path, line=line)
        return Location(path=self._path)


def is_surely_whole(grant: Grant, *, rewinds: bool) -> bool:
    """Whether it allows every service and action, that it allows a part of, as a whole: by the texts alone.

    False where a closer look is needed. Only allow rules without partitions, for the same domains, whose expressions
    have no wildcards but `*`: then what each expression allows is allowed, and the texts of the two halves of a service
    differ in prefix and suffix alone. `rewinds`: whether all implementations search behind a `*` (`expression`).
    """
    if grant.default_allow or len({tuple((d.low, d.high) for d in rule.domains) for rule in grant.rules}) > 1:
        return False
    listed: dict[Operation, set[str]] = {operation: set() for operation in Operation}
    for rule in grant.rules:
        for criterion in rule.criteria:
            if not rule.allow or criterion.partitions is not None:
                return False
            listed[criterion.operation].update(text.text for text in criterion.topics)
    published, subscribed = listed[Operation.PUBLISH], listed[Operation.SUBSCRIBE]
    everything = "\n".join(published | subscribed)
    if any(wildcard in everything for wildcard in "?[\\"):
        return False
    if "*" in everything and not (rewinds and all(map(_is_of_one_kind, published | subscribed))):
        return False
    client, server = REQUEST.between(published), REPLY.between(published)
    if client != REPLY.between(subscribed) or server != REQUEST.between(subscribed):
        return False
    if ACTION_PART not in everything and "*" not in everything:
        return True
    return (
        _whole_actions(client, subscribed) and _whole_actions(server, published) and _are_served(published, by=server)
    )


def _is_of_one_kind(text: str) -> bool:
    """Whether the expression, if it has wildcards, matches topics, requests or replies alone."""
    return "*" not in text or text.startswith("rt/") or (text[:3] in _PREFIXES and text.endswith(("Request", "Reply")))


_PREFIXES: Final = frozenset(("rq/", "rr/"))


def _whole_actions(services: set[str], listed: set[str]) -> bool:
    """Whether no action has a part of these services, or lacks a topic among those that are listed."""
    actions = [{name[: -len(end)] for name in services if name.endswith(end)} for end in _ENDS]
    if any(each != actions[0] for each in actions):
        return False
    if any(f"rt{name}{ACTION_PART}{topic}" not in listed for name in actions[0] for topic in ACTION_TOPICS):
        return False
    return all(ACTION_PART not in name or name.endswith(_ENDS) for name in services)


def _are_served(published: set[str], *, by: set[str]) -> bool:
    """Whether the topics of actions that are listed by name belong to actions that are served by these services."""
    actions = {name[: -len(_ENDS[0])] for name in by if name.endswith(_ENDS[0])}
    named = {text for text in published if text.startswith("rt/") and ACTION_PART in text and "*" not in text}
    return named <= {f"rt{name}{ACTION_PART}{topic}" for name in actions for topic in ACTION_TOPICS}
