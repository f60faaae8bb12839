"""KA638: rules that are limited to data tags, which every implementation passes over."""

from __future__ import annotations

from collections.abc import Iterator

from keystore_audit.findings import Severity
from keystore_audit.keystore.permissions import Criterion, Grant
from keystore_audit.keystore.permissions import Rule as PermissionsRule
from keystore_audit.rules.context import Context
from keystore_audit.rules.permissions import about
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.subjects import PermissionsUse, speaks
from keystore_audit.rules.wording import listed, quoted


@rule(
    "KA638",
    Severity.HIGH,
    clause="DDS-Security 1.1, 9.4.1.3.2.3 (data_tags); measured on Fast DDS 2.9.1 and Cyclone DDS 0.10.2",
    remedy=in_permissions("ROS 2 has no data tags: take <data_tags> out, and allow or deny what remains"),
    applies=speaks,
)
def data_tags_ignored(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """A rule is limited to endpoints with certain data tags, and every implementation applies it to all endpoints.

    To the specification an allow rule with tags allows these alone, and a deny rule leaves all others alone. High where
    more is allowed than it says, medium where more is denied. Everything else here is decided as implementations do,
    without the tags, under `spec` too.
    """
    for grant, each, criterion in _tagged(use):
        verb, operation = "allows" if each.allow else "denies", criterion.operation.value
        topics = [text.text for text in criterion.topics]
        yield about(
            use,
            grant,
            criterion.line,
            f"A rule {verb} {operation} of {listed(map(quoted, topics))} to endpoints with certain data tags "
            f"alone, and every implementation passes over the tags: it {verb} it to all.",
            severity=None if each.allow else Severity.MEDIUM,
            key=f"{grant.subject_name.text} {verb} {operation} {' '.join(topics)}",
        )


def _tagged(use: PermissionsUse) -> Iterator[tuple[Grant, PermissionsRule, Criterion]]:
    for grant in use.document.grants:
        for each in grant.rules:
            yield from ((grant, each, criterion) for criterion in each.criteria if criterion.data_tags)
