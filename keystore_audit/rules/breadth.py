"""KA5: how far grants reach (DDS-Security 1.1, 9.4.1.3; ROS 2 design, SROS2 access control policies)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Any, Final

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location, Severity
from keystore_audit.keystore.governance import Text
from keystore_audit.keystore.permissions import Grant, Operation
from keystore_audit.model.atoms import classify
from keystore_audit.model.expression import Matcher, parse
from keystore_audit.model.profiles import VARIANTS
from keystore_audit.rules.context import Context
from keystore_audit.rules.permissions import SIGN_AGAIN, WRITE_AGAIN, about, all_grants
from keystore_audit.rules.registry import Rule, Violation, rule
from keystore_audit.rules.subjects import PermissionsUse, speaks
from keystore_audit.rules.wording import listed, places, quoted, sole

TOPICS: Final = "rt/*"
"""Every ROS 2 topic (ROS 2 design, topic and service names: the prefix of topics)."""

EVERYTHING: Final = (TOPICS, "rq/*Request", "rr/*Reply")
"""Every ROS 2 topic and service; actions are made of both."""

_PROBES: Final = {
    "rt/*": ("rt/a", "rt/Z_0/z"),
    "rq/*Request": ("rq/aRequest", "rq/Z_0/zRequest"),
    "rr/*Reply": ("rr/aReply", "rr/Z_0/zReply"),
}
"""Two names of each, as unlike as names get: whatever misses one covers not all, and needs no further thought."""

MAX_PARSED: Final = 64
MAX_CANDIDATES: Final = 16
"""Expressions of one grant and operation that are looked at, and that are decided over all names, the shortest first:
deciding takes some milliseconds, and what covers everything is short unless it was made to cost time."""

_WILDCARDS: Final = frozenset("*?[\\")

_BUDGET: Final = 2_000
"""States for two expressions: those that people write need some dozens."""


@lru_cache(maxsize=4096)
def covers(expression: str, wanted: str) -> bool:
    """Whether `expression` matches every ROS 2 name that `wanted`, one of EVERYTHING, matches; decided over all names.

    False too where that would take too many classes of names.
    """
    if expression == wanted:
        return True
    try:
        classes = classify([parse(text, Matcher.POSIX) for text in (expression, wanted)], budget=_BUDGET)
    except BudgetExceeded:
        return False
    return all(0 in found.members for found in classes if 1 in found.members and found.ros)


def _covering(texts: Iterable[Text], wanted: str) -> Text | None:
    """One of the expressions that covers all of `wanted`."""
    distinct = {text.text: text for text in texts}
    if wanted in distinct:
        return distinct[wanted]
    patterns = (text for text in distinct if text and (text[0] == wanted[0] or text[0] in _WILDCARDS))
    shortest = sorted(filter(_has_wildcard, patterns), key=lambda text: (len(text), text))[:MAX_PARSED]
    likely = [text for text in shortest if all(parse(text, Matcher.POSIX).matches(name) for name in _PROBES[wanted])]
    return next((distinct[text] for text in likely[:MAX_CANDIDATES] if covers(text, wanted)), None)


def _has_wildcard(text: str) -> bool:
    return "*" in text or "?" in text or "[" in text or "\\" in text


def _allowed(grant: Grant, operation: Operation) -> tuple[Text, ...]:
    """The expressions of the grant's allow rules for an operation, in any domain and partition."""
    return tuple(
        text
        for permission_rule in grant.rules
        if permission_rule.allow
        for criterion in permission_rule.criteria
        if criterion.operation is operation
        for text in criterion.topics
    )


def _allows_everything(grant: Grant) -> bool:
    if not any(_has_wildcard(text.text) for text in _allowed(grant, Operation.PUBLISH)):
        return False
    return all(
        _covering(_allowed(grant, operation), wanted) is not None
        for operation in (Operation.PUBLISH, Operation.SUBSCRIBE)
        for wanted in EVERYTHING
    )


@rule(
    "KA509",
    "default-allow",
    Severity.HIGH,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3 (default); measured",
    remedy=f"Write <default>DENY</default> and allow what is needed: {WRITE_AGAIN}",
    applies=speaks,
)
def default_allow(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """What no rule of the grant names is allowed, in every domain.

    Cyclone DDS and OpenDDS do as it says; Fast DDS reads the element and never uses it, so that there what no rule
    names is denied (measured).
    """
    for grant in all_grants(use):
        if grant.default_allow:
            message = (
                f"<default> is ALLOW, expected DENY: {quoted(grant.subject_name.text)} may do whatever no rule denies "
                "(Fast DDS denies it all the same)."
            )
            line = grant.default_line if grant.default_line is not None else grant.line
            others = tuple(name for name in VARIANTS if not name.startswith("fastdds"))
            yield about(use, grant, line, message, profiles=others)


@rule(
    "KA510",
    "wildcard-grant",
    Severity.MEDIUM,
    on=PermissionsUse,
    clause="DDS-Security 1.1, 9.4.1.3 (topic expressions); ROS 2 design, SROS2 access control policies (wildcards)",
    remedy=f"Name each topic: {WRITE_AGAIN}",
    applies=speaks,
)
def wildcard_grant(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """An allow rule covers names by a pattern, and so names that nobody has thought of.

    `*` crosses `/`. High where one pattern covers every ROS 2 topic. Deny rules before it may take some of the names
    out again; that is not weighed here. A grant that allows everything is allow-everything-permissions, and only
    that.
    """
    for grant in all_grants(use):
        for operation in Operation:
            found = [text for text in _allowed(grant, operation) if _is_pattern(text.text)]
            if not found or _allows_everything(grant):
                continue
            every = _covering(found, TOPICS)
            names = list(dict.fromkeys(text.text for text in found))
            reach = (
                f"{quoted(every.text)} covers every topic" if every is not None else "names nobody has thought of too"
            )
            yield Violation(
                message=f"{quoted(grant.subject_name.text)} may {operation.value} on "
                f"{listed(quoted(name) for name in names)}: {reach}.",
                locations=places(Location(path=use.signed.file.place, line=text.line) for text in found),
                enclave=sole(use.enclaves),
                severity=Severity.HIGH if every is not None else None,
                # The expressions are part of it: a new wildcard is not hidden by what was accepted before.
                key="\n".join((grant.subject_name.text, operation.value, *sorted(names))),
            )


def _is_pattern(text: str) -> bool:
    """Whether the expression is no single name. What begins its wildcards with `*` or `?` needs no parsing."""
    if not _has_wildcard(text):
        return False
    first = next(character for character in text if character in _WILDCARDS)
    return first in "*?" or parse(text, Matcher.POSIX).literal is None


@rule(
    "KA511",
    "allow-everything-permissions",
    Severity.HIGH,
    on=PermissionsUse,
    clause="ROS 2 design, SROS2 access control policies; ros2/sros2, policy/defaults (what create_enclave writes)",
    remedy="Write a policy for the enclave, `ros2 security generate_policy policy.xml` from a running system. "
    f"{SIGN_AGAIN}",
    applies=speaks,
)
def allow_everything_permissions(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """The grant allows every topic and service both ways: what `ros2 security create_enclave` writes by itself.

    Whoever takes this enclave has the whole robot. Running create_enclave again puts it back in the place of a policy.
    Judged by what the allow rules cover, not by their text; deny rules before them are not weighed.
    """
    for grant in all_grants(use):
        if _allows_everything(grant):
            message = (
                f"{quoted(grant.subject_name.text)} may publish and subscribe to everything, the default of "
                "create_enclave; expected the topics that its nodes use."
            )
            yield about(use, grant, grant.line, message)


BREADTH: tuple[Rule[Any], ...] = (default_allow, wildcard_grant, allow_everything_permissions)
