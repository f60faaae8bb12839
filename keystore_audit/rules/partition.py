"""KA637: endpoints in partitions that are patterns get around what permissions say of partitions."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from keystore_audit.findings import Severity
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.permissions import Criterion, Grant, Operation
from keystore_audit.model.matching.expression import has_wildcard, parse
from keystore_audit.model.matching.partition_patterns import EVERY_PARTITION
from keystore_audit.model.names import DISCOVERY_TOPIC, ros_name
from keystore_audit.model.semantics import DEFAULT_PARTITION
from keystore_audit.profiles import VARIANTS, Matcher, PartitionReading
from keystore_audit.rules.context import Context
from keystore_audit.rules.permissions import about
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.subjects import PermissionsUse, speaks
from keystore_audit.rules.wording import VERBS, more_like, quoted

_ROS: Final = re.compile(f"{DISCOVERY_TOPIC}$|r[tqr]/")
_ONE_CHARACTER: Final = re.compile(r"\?|\[[^\]]*\]")

NO_PARTITIONS: Final = in_permissions("ROS 2 uses no partitions: take them out of the rules, and name the topics alone")


@rule(
    "KA637",
    Severity.HIGH,
    clause="DDS 1.4, 2.2.3.13 (PARTITION); DDS-Security 1.1, 9.4.1.3.2.3 (partitions); measured",
    remedy=NO_PARTITIONS,
    applies=speaks,
)
def partition_evaded(use: PermissionsUse, _context: Context) -> Iterator[Violation]:
    """Where an endpoint may be in a partition that is a pattern, and so meet data that the rules keep from it.

    To permissions the partition of an endpoint is a plain string, to matching it is a pattern (measured on Cyclone DDS
    0.10.2 and Fast DDS 2.9.1): a denial in `secret` says nothing of `*`, and who is allowed in `?` may go into `*`.
    Properties, claims and flows count who is met so; `can` and `access` answer about the plain name. Topics are
    compared one expression with another; two with wildcards are taken to overlap.
    """
    for grant in use.document.grants:
        listed = any(criterion.partitions for each in grant.rules for criterion in each.criteria)
        ways = _ways(grant)
        for number, each in enumerate(grant.rules) if listed or grant.default_allow else ():
            for criterion in each.criteria:
                if each.allow:
                    yield from _beyond(use, grant, criterion)
                else:
                    yield from _evaded(use, grant, number, criterion, ways)


def of_no_node(use: PermissionsUse) -> Iterator[Violation]:
    """Names of ROS 2 that a grant allows in partitions alone: no node is in one."""
    for grant in use.document.grants:
        criteria = list(grant.allowed)
        if grant.default_allow or not any(criterion.partitions for criterion in criteria):
            continue
        apart: dict[tuple[Operation, str], Text] = {}
        plain: set[tuple[Operation, str]] = set()
        for criterion in criteria:
            uses = [(criterion.operation, text.text) for text in criterion.topics]
            listed = criterion.partitions or ()
            if listed and all(text.text.strip("*") for text in listed):  # no name of no character matches
                apart |= dict.fromkeys(uses, listed[0]) | apart
            else:
                plain.update(uses)
        found = [(*each, place) for each, place in apart.items() if each not in plain and _ROS.match(each[1])]
        if found:
            operation, topic, place = found[0]
            yield about(
                use,
                grant,
                place.line,
                f"{quoted(grant.subject_name.text)} may {VERBS[operation]} {ros_name(topic)}{more_like(found)} in "
                f"partition {quoted(place.text)} alone, and no ROS 2 node is in one: none may.",
                remedy=NO_PARTITIONS,
                key=f"{grant.subject_name.text} in partitions",
            )


def _beyond(use: PermissionsUse, grant: Grant, criterion: Criterion) -> Iterator[Violation]:
    """An allowed expression that matches patterns which match more than it does."""
    for text in criterion.partitions or ():
        wider = _ONE_CHARACTER.sub(EVERY_PARTITION, text.text)
        if wider == text.text or not _matches(text.text, wider):
            continue
        yield about(
            use,
            grant,
            text.line,
            f"{criterion.operation.value} is allowed in partitions that {quoted(text.text)} matches, and it matches "
            f"{quoted(wider)}: an endpoint there meets those of all partitions that this matches as a pattern.",
            key=f"{grant.subject_name.text} {criterion.operation.value} {text.text}",
        )


def _evaded(
    use: PermissionsUse, grant: Grant, number: int, criterion: Criterion, ways: Sequence[_Ways]
) -> Iterator[Violation]:
    """A denial in some partitions, though a pattern that meets them is allowed later on."""
    listed = criterion.partitions is not None
    denied = tuple(text.text for text in criterion.partitions or ()) or DEFAULT_PARTITION
    way = next(_around(grant, number, criterion, denied, ways), None)
    if way is not None:
        where = f"partition {', '.join(map(quoted, denied))}" if listed else "the default partition"
        yield about(
            use,
            grant,
            criterion.line,
            f"{criterion.operation.value} is denied in {where} and allowed in {quoted(way)}, which no denial matches: "
            "an endpoint there meets those of all partitions that this matches as a pattern.",
            profiles=_reading(listed=listed),
            key=f"{grant.subject_name.text} {criterion.operation.value} denied {' '.join(denied)}",
        )


class _Ways(NamedTuple):
    """Partitions that are patterns, and that an allow rule allows: its number, its criterion."""

    rule: int
    criterion: Criterion
    patterns: tuple[str, ...]


def _ways(grant: Grant) -> list[_Ways]:
    """All of a grant, in order; most rules have none."""
    found = []
    for number, each in enumerate(grant.rules):
        for criterion in each.criteria if each.allow else ():
            patterns = tuple(way for text in criterion.partitions or () for way in _patterns(text.text))
            if patterns:
                found.append(_Ways(number, criterion, patterns))
    return found


def _patterns(allowed: str) -> Iterator[str]:
    """The partitions that are patterns and that the expression allows: the one for all, and itself."""
    return (way for way in (EVERY_PARTITION, allowed) if has_wildcard(way) and _matches(allowed, way))


def _around(
    grant: Grant, number: int, criterion: Criterion, denied: Sequence[str], ways: Sequence[_Ways]
) -> Iterator[str]:
    """Partitions that are patterns, allowed by a later rule or by default and not matched by the denial."""
    for each in ways[bisect_right(ways, number, key=lambda way: way.rule) :]:
        if each.criterion.operation is criterion.operation:
            open_ = [way for way in each.patterns if not any(_matches(one, way) for one in denied)]
            if open_ and _overlap(each.criterion.topics, criterion.topics):
                yield from open_
    if grant.default_allow and not any(_matches(one, EVERY_PARTITION) for one in denied):
        yield EVERY_PARTITION


def _overlap(some: Sequence[Text], others: Sequence[Text]) -> bool:
    return any(
        _matches(one.text, other.text)
        or _matches(other.text, one.text)
        or (has_wildcard(one.text) and has_wildcard(other.text))
        for one in some
        for other in others
    )


def _matches(expression: str, name: str) -> bool:
    return parse(expression, Matcher.POSIX).matches(name)


def _reading(*, listed: bool) -> tuple[str, ...]:
    """Profiles under which a denial holds where it lists partitions in those alone, else in the default one alone."""
    readings = set(PartitionReading) - {PartitionReading.RULE} if listed else {PartitionReading.CRITERION_DEFAULT}
    return tuple(name for name, profile in VARIANTS.items() if profile.access.partitions in readings)
