"""KA5: how far grants reach (DDS-Security 1.1, 9.4.1.3; ROS 2 design, SROS2 access control policies)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from keystore_audit.findings import Severity
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.matching.coverage import TOPICS, allows_everything, covering
from keystore_audit.model.matching.expression import WILDCARDS, has_wildcard, parse
from keystore_audit.profiles import VARIANTS, Matcher
from keystore_audit.rules.permissions import about
from keystore_audit.rules.registry import Violation, either, listed, quoted, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.subjects import PermissionsUse, speaks


@rule(
    "KA509",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.3 (default); measured",
    in_permissions("Write <default>DENY</default>, and allow what is needed"),
    applies=speaks,
)
def default_allow(use: PermissionsUse) -> Iterator[Violation]:
    """The grant allows everything that none of its rules names, in every domain.

    Cyclone DDS and OpenDDS obey <default>. Fast DDS reads the element and never uses it, so it denies such names
    (measured).
    """
    for grant in use.document.grants:
        if grant.default_allow:
            message = (
                f"{quoted(grant.subject_name.text)} may publish, subscribe and relay whatever no rule denies: "
                "<default> is ALLOW, expected DENY."
            )
            line = grant.default_line if grant.default_line is not None else grant.line
            honouring = tuple(name for name, profile in VARIANTS.items() if profile.access.honours_default)
            yield about(use, grant, line, message, profiles=honouring)


@rule(
    "KA510",
    Severity.MEDIUM,
    "DDS-Security 1.1, 9.4.1.3 (topic expressions); ROS 2 design, SROS2 access control policies (wildcards)",
    in_permissions("Name each topic"),
    applies=speaks,
)
def wildcard_grant(use: PermissionsUse) -> Iterator[Violation]:
    """An allow rule covers names by a pattern, and so names that nobody has thought of.

    `*` crosses `/`. High if one pattern, or several together, cover every ROS 2 topic. Earlier deny rules are not
    weighed. For a grant that allows everything, see allow-everything-permissions.
    """
    for grant in use.document.grants:
        for operation in Operation:
            found = [text for text in grant.listed(operation) if _is_pattern(text.text)]
            if not found or allows_everything(grant):
                continue
            names = list(dict.fromkeys(text.text for text in found))
            every = covering(frozenset(names), TOPICS)
            reach = f"{_together(every)} every topic" if every else "names nobody has thought of too"
            yield Violation(
                f"{quoted(grant.subject_name.text)} may {operation.value} on "
                f"{listed(quoted(name) for name in names)}: {reach}.",
                [use.at(text.line) for text in found],
                severity=Severity.HIGH if every else None,
                # The expressions are part of it: a new wildcard is not hidden by what was accepted before.
                key="\n".join((grant.subject_name.text, operation.value, *sorted(names))),
            )


def _together(expressions: Sequence[str]) -> str:
    if len(expressions) == 1:
        return f"{quoted(expressions[0])} covers"
    return f"{either([quoted(text) for text in expressions])} together cover"


def _is_pattern(text: str) -> bool:
    """Whether the expression is no single name. What begins its wildcards with `*` or `?` needs no parsing."""
    if not has_wildcard(text):
        return False
    first = next(character for character in text if character in WILDCARDS)
    return first in "*?" or parse(text, Matcher.POSIX).literal is None


@rule(
    "KA511",
    Severity.HIGH,
    "ROS 2 design, SROS2 access control policies; ros2/sros2, policy/defaults (what create_enclave writes)",
    in_permissions(
        "Allow only what the enclave needs; `ros2 security generate_policy policy.xml` writes a policy from a "
        "running system"
    ),
    applies=speaks,
)
def allow_everything_permissions(use: PermissionsUse) -> Iterator[Violation]:
    """The grant allows every topic and service in both directions, the default of `ros2 security create_enclave`.

    Whoever takes over this enclave has the whole robot. Running create_enclave again restores this default. Judged by
    what the allow rules cover together, without earlier deny rules. Other rules do not repeat what follows.
    """
    for grant in use.document.grants:
        if allows_everything(grant):
            message = (
                f"{quoted(grant.subject_name.text)} may publish and subscribe to everything, the default of "
                "create_enclave. That includes the parameters and life cycle of every node. Expected are the topics "
                "that "
                "its nodes use."
            )
            yield about(use, grant, grant.line, message)
