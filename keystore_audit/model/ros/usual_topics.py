"""The topics that every ROS 2 node uses, and which of them an enclave may not use.

Asked of the grant alone, in the default partition and in whatever domain, as the specification has it; of
ros_discovery_info also of each implementation with the governance, since no node is made without it. What nodes use is
in `ros2/sros2`, policy/common/node.xml; ros_discovery_info is added by sros2 itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from itertools import takewhile
from typing import Final

from keystore_audit.dataclass import dataclass
from keystore_audit.findings import Location
from keystore_audit.keystore.governance import Text
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.permissions import Grant, Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import document_channels
from keystore_audit.model.coverage import WILDCARDS, has_wildcard
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.expression import Matcher, parse
from keystore_audit.model.intended.observed_needs import DISCOVERY
from keystore_audit.model.names import DISCOVERY_TOPIC, SUFFIX_OF, is_ros_dds_name
from keystore_audit.model.profiles import Profile

PUBLISH, SUBSCRIBE = Operation.PUBLISH, Operation.SUBSCRIBE
Use = tuple[Operation, str]

USUAL: Final[tuple[Use, ...]] = (
    (PUBLISH, "rt/rosout"),
    (PUBLISH, "rt/parameter_events"),
    (SUBSCRIBE, "rt/parameter_events"),
)
"""Without these a node is not made unless it is told to do without (rcl: enable_rosout; rclcpp: parameter services)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unusual:
    """An enclave (its path) whose grant lacks some of what ROS 2 nodes use.

    `lacks`: uses; `starts`: whether none of them is of those without which no node is made. `location`: the grant.
    `profiles`: chosen ones for which it holds, empty for all.
    """

    enclave: str
    lacks: tuple[Use, ...]
    starts: bool
    location: Location
    profiles: tuple[str, ...] = ()


def unusual(
    enclaves: Iterable[Enclave], profiles: Sequence[Profile], accesses: AccessViews, at: datetime, *, discovers: bool
) -> Iterator[Unusual]:
    """Enclaves that lack some at `at` (aware UTC); `discovers`: whether their ROS 2 has ros_discovery_info (Foxy and
    later).

    An enclave with none of the `USUAL` is taken to do without, as nodes can be told to.
    """
    for enclave in enclaves:
        document = enclave.permissions.permissions if enclave.permissions else None
        first = enclave.identity
        grants = document.grants if document is not None and first is not None else ()
        grant = next((each for each in grants if first is not None and each.subject_name.text == first.subject), None)
        if grant is None or enclave.permissions is None or not any(rule.allow for rule in grant.rules):
            continue
        lacks = missing(grant, (*DISCOVERY, *USUAL))
        if not lacks or not _is_of_ros(grant):
            continue
        place = Location(path=enclave.permissions.signed.file.place, line=grant.line)
        undiscovered = tuple(use for use in lacks if use in DISCOVERY) if discovers else ()
        refusing = _undiscovering(enclave, profiles, accesses, at) if undiscovered else ()
        if refusing:
            under = () if len(refusing) == len(profiles) else refusing
            yield Unusual(enclave=enclave.path, lacks=undiscovered, starts=False, location=place, profiles=under)
            continue
        advised = tuple(use for use in lacks if use in USUAL)
        if advised and len(advised) < len(USUAL):
            yield Unusual(enclave=enclave.path, lacks=advised, starts=True, location=place)


def _undiscovering(
    enclave: Enclave, profiles: Sequence[Profile], accesses: AccessViews, at: datetime
) -> tuple[str, ...]:
    """The profiles whose implementation lets the enclave have no ros_discovery_info, both ways, in any domain.

    A governance may leave the topic open to everybody, whatever grants say.
    """
    files = [file for file in (enclave.permissions, enclave.governance) if file is not None]
    rows = dict.fromkeys(accesses.row(profile.access) for profile in profiles)
    read = {row: [accesses.read(file, row) for file in files] for row in rows}
    local = LocalRights(accesses, document_channels(read, [(DISCOVERY_TOPIC, "")]), at)
    return tuple(
        profile.name
        for profile in profiles
        if not local.allowed(enclave, profile, PUBLISH) & local.allowed(enclave, profile, SUBSCRIBE)
    )


def missing(grant: Grant, uses: Sequence[Use]) -> tuple[Use, ...]:
    """Those of the uses that the grant does not allow in any domain. A default that allows, allows them."""
    if grant.default_allow:
        return ()
    if all(rule.allow for rule in grant.rules):
        listed = {each: set(_listed(grant, each)) for each in (PUBLISH, SUBSCRIBE)}
        uses = [(operation, topic) for operation, topic in uses if topic not in listed[operation]]
    return tuple(use for use in uses if not _allows(grant, *use))


def _is_of_ros(grant: Grant) -> bool:
    """Whether an allow rule lists something that ROS 2 has a name for, discovery apart, or a pattern that begins so."""
    return any(
        _may_begin_a_ros_name(text) if has_wildcard(text) else text != DISCOVERY_TOPIC and is_ros_dds_name(text)
        for operation in (PUBLISH, SUBSCRIBE)
        for text in _listed(grant, operation)
    )


def _may_begin_a_ros_name(pattern: str) -> bool:
    head = "".join(takewhile(lambda character: character not in WILDCARDS, pattern))
    return any(start.startswith(head) or head.startswith(start) for start in SUFFIX_OF)


def _allows(grant: Grant, operation: Operation, topic: str) -> bool:
    """Whether the first rule that matches the topic, in the default partition, allows it."""
    for rule in grant.rules:
        for criterion in rule.criteria:
            here = criterion.partitions is None or _matched(criterion.partitions, "")
            if criterion.operation is operation and here and _matched(criterion.topics, topic):
                return rule.allow
    return False


def _matched(texts: Iterable[Text], name: str) -> bool:
    return any(
        text.text == name or (has_wildcard(text.text) and parse(text.text, Matcher.POSIX).matches(name))
        for text in texts
    )


def _listed(grant: Grant, operation: Operation) -> Iterator[str]:
    """What its allow rules list in the default partition alone; other partitions take a closer look."""
    return (
        text.text
        for rule in grant.rules
        if rule.allow
        for criterion in rule.criteria
        if criterion.operation is operation and criterion.partitions is None
        for text in criterion.topics
    )
