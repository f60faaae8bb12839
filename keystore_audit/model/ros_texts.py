"""Quick answers from the texts of a grant, where they are certain, and the lines of a document that people look for."""

from __future__ import annotations

from typing import Final

from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.permissions import Grant, Operation
from keystore_audit.model.expression import Matcher, parse
from keystore_audit.model.names import ACTION_PART, ACTION_SERVICES, ACTION_TOPICS

_ENDS: Final = tuple(ACTION_PART + service for service in ACTION_SERVICES)


def line_of(enclave: Enclave, operation: Operation, topic: str) -> Location:
    """The line of the enclave's permissions that lists the topic in an allow rule; else the document."""
    if enclave.permissions is None:
        return Location(path=enclave.files.directory)
    place = enclave.permissions.signed.file.place
    document = enclave.permissions.permissions
    for grant in document.grants if document else ():
        line = line_in(grant, operation, topic)
        if line is not None:
            return Location(path=place, line=line)
    return Location(path=place)


def line_in(grant: Grant, operation: Operation, topic: str) -> int | None:
    """The line of the expression that matches the topic in an allow rule; one that is no pattern comes first."""
    matching = None
    for rule in grant.rules:
        for criterion in rule.criteria if rule.allow else ():
            for text in criterion.topics if criterion.operation is operation else ():
                if text.text == topic:
                    return text.line
                if matching is None and parse(text.text, Matcher.POSIX).matches(topic):
                    matching = text.line
    return matching


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
    client = _names(published, "rq/", "Request")
    server = _names(published, "rr/", "Reply")
    if client != _names(subscribed, "rr/", "Reply") or server != _names(subscribed, "rq/", "Request"):
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


def _names(texts: set[str], prefix: str, suffix: str) -> set[str]:
    """What stands between, with the slash."""
    end = -len(suffix)
    return {text[2:end] for text in texts if text[:3] == prefix and text[end:] == suffix}


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
