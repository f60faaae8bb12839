"""What permissions mean to ROS 2 nodes: services and actions that are whole or half, and who can reach whom."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from itertools import takewhile
from typing import TYPE_CHECKING, Final, NamedTuple

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.document import Text
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import LayoutKind
from keystore_audit.keystore.typed import Grant, Operation, PermissionsFile
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.channels import document_channels
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.system import System
from keystore_audit.model.intended.observed_needs import DISCOVERY, TYPE_DESCRIPTION
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.matching.expression import WILDCARDS, has_wildcard, parse
from keystore_audit.model.names import (
    DISCOVERY_TOPIC,
    PARAMETER_SERVICES,
    REPLY_PREFIX,
    REPLY_SUFFIX,
    SUFFIX_OF,
    Use,
    dds_expressions,
    is_ros_dds_name,
)
from keystore_audit.model.ros.action_topics import ActionPattern, action_patterns
from keystore_audit.model.ros.halves import Halves, halves
from keystore_audit.model.ros.holders import Holder, Holders
from keystore_audit.model.ros.services import Reach, Rivals, Services
from keystore_audit.model.semantics import DIRECTIONS, is_controlled
from keystore_audit.profiles import VARIANTS, Matcher, Profile

if TYPE_CHECKING:
    from collections.abc import Mapping

    from keystore_audit.model.question import Usability


# The topics and services that every ROS 2 node uses, and which of them an enclave may not use.
#
# Asked of the grant alone, in the default partition and in whatever domain, as the specification has it. Each
# implementation is asked with the governance about ros_discovery_info, since no node is made without it. What
# nodes use is in `ros2/sros2`, policy/common/node.xml. sros2 itself adds ros_discovery_info; nobody adds
# `get_type_description`. Since Iron rclcpp and rclpy serve it (`NodeTypeDescriptions`), and drop a node that cannot.


PUBLISH, SUBSCRIBE = Operation.PUBLISH, Operation.SUBSCRIBE

USUAL: Final[tuple[Use, ...]] = (
    (PUBLISH, "rt/rosout"),
    (PUBLISH, "rt/parameter_events"),
    (SUBSCRIBE, "rt/parameter_events"),
)
"""Without these no node is made, unless it is told to do without (rcl: enable_rosout; rclcpp: parameter services)."""

_SINCE_IRON: Final = frozenset({"jazzy", "kilted", "lyrical", "rolling"})

_ANSWERS: Final = tuple(f"/{service}{REPLY_SUFFIX}" for service in PARAMETER_SERVICES)
"""The ends of the names of DDS topics on which a node answers for its parameters."""

MAX_NODES: Final = 250
"""Nodes of an enclave that are asked about: up to a second with 1,500 expressions. A real enclave has some dozens."""


class Unusual(Struct, frozen=True, kw_only=True):
    """An enclave (its path) whose grant lacks some of what ROS 2 nodes use.

    `lacks`: uses; `silent`: no node of it may answer for its parameters; `starts`: whether it has all without which no
    node is made. `location`: the grant. `profiles`: chosen ones for which it holds; of what
    they have no part in, none.
    """

    enclave: str
    lacks: tuple[Use, ...]
    silent: bool = False
    starts: bool
    location: Location
    profiles: tuple[str, ...] = ()


def unusual(
    enclaves: Iterable[Enclave], profiles: Sequence[Profile], accesses: AccessViews, at: datetime, *, discovers: bool
) -> Iterator[Unusual]:
    """Enclaves that lack some at `at` (aware UTC); `discovers`: whether their ROS 2 has ros_discovery_info (Foxy and
    later).
    """
    for enclave, grant, place in _granted(enclaves):
        if not _is_of_ros(grant):
            continue
        lacks = missing(grant, (*DISCOVERY, *USUAL))
        undiscovered = tuple(use for use in lacks if use in DISCOVERY) if discovers else ()
        refusing = _undiscovering(enclave, profiles, accesses, at) if undiscovered else ()
        if refusing:
            yield Unusual(enclave=enclave.path, lacks=undiscovered, starts=False, location=place, profiles=refusing)
            continue
        advised = tuple(use for use in lacks if use in USUAL)
        silent = not grant.default_allow and not any(map(_may_answer, _listed(grant, PUBLISH)))
        if advised or silent:
            yield Unusual(enclave=enclave.path, lacks=advised, silent=silent, starts=True, location=place)


class Undescribed(Struct, frozen=True, kw_only=True):
    """Nodes (fully qualified) that an enclave (its path) lets answer for their parameters, and not describe their
    types. `location`: the grant.
    """

    enclave: str
    nodes: tuple[str, ...]
    location: Location


def since_iron(profiles: Iterable[Profile]) -> bool:
    """Whether a profile is only of distributions since Iron; Cyclone DDS 0.10 is Humble's too."""
    return any(each.distributions and _SINCE_IRON.issuperset(each.distributions) for each in profiles)


def undescribed(enclaves: Iterable[Enclave]) -> Iterator[Undescribed]:
    """Enclaves of nodes that their grant names, by all of the parameter services, without the description of types."""
    for enclave, grant, place in _granted(enclaves):
        answers = set(_listed(grant, PUBLISH))
        ends = [text[len(REPLY_PREFIX) : -len(_ANSWERS[0])] for text in sorted(answers) if text.endswith(_ANSWERS[0])]
        named = [node for node in ends if answers.issuperset(f"{REPLY_PREFIX}{node}{answer}" for answer in _ANSWERS)]
        uses = {node: dds_expressions("reply", f"{node}/{TYPE_DESCRIPTION}") for node in named[:MAX_NODES]}
        lacks = set(missing(grant, [use for each in uses.values() for use in each]))
        nodes = tuple(n for n in uses if any(use in lacks and _controls(enclave, *use) for use in uses[n]))
        if nodes:
            yield Undescribed(enclave=enclave.path, nodes=nodes, location=place)


def _controls(enclave: Enclave, operation: Operation, topic: str) -> bool:
    """Whether some domain rule of the enclave's governance, as the specification reads it, asks for a grant there."""
    governance = enclave.governance.governance if enclave.governance is not None else None
    if governance is None:
        return True
    for domain_rule in governance.domain_rules:
        rule = next((each for each in domain_rule.topic_rules if _matched([each.expression], topic)), None)
        if rule is None or is_controlled(rule, operation):
            return True
    return False


def _granted(enclaves: Iterable[Enclave]) -> Iterator[tuple[Enclave, Grant, Location]]:
    """Enclaves with their grant, where it allows anything, and its place."""
    for enclave in enclaves:
        subject = None if enclave.identity is None else enclave.identity.subject
        grant = next((each for each in enclave.grants if each.subject_name.text == subject), None)
        if grant is not None and enclave.permissions is not None and any(rule.allow for rule in grant.rules):
            yield enclave, grant, Location(path=enclave.permissions.signed.file.place, line=grant.line)


def _may_answer(text: str) -> bool:
    """Whether an expression of topics that may be published takes in an answer about a node's parameters."""
    head, prefix = _before_wildcards(text), f"{REPLY_PREFIX}/"
    return head.startswith(prefix) and text.endswith(_ANSWERS) if head == text else _agree(head, prefix)


def _undiscovering(
    enclave: Enclave, profiles: Sequence[Profile], accesses: AccessViews, at: datetime
) -> tuple[str, ...]:
    """The profiles whose implementation lets the enclave have no ros_discovery_info, both ways, in any domain.

    A governance may leave the topic open to everybody, whatever grants say.
    """
    read = accesses.by_row(profiles, (enclave.permissions, enclave.governance))
    local = LocalRights(accesses, document_channels(read, [(DISCOVERY_TOPIC, "")]), at)
    return tuple(
        profile.name
        for profile in profiles
        if not local.allowed(enclave, profile, PUBLISH) & local.allowed(enclave, profile, SUBSCRIBE)
    )


def missing(grant: Grant, uses: Sequence[Use]) -> tuple[Use, ...]:
    """The uses that the grant does not allow in any domain. A default that allows, allows them."""
    if grant.default_allow:
        return ()
    if all(rule.allow for rule in grant.rules):
        listed = {each: set(_listed(grant, each)) for each in DIRECTIONS}
        uses = [(operation, topic) for operation, topic in uses if topic not in listed[operation]]
    lists = list(_lists(grant)) if uses else []
    return tuple(use for use in uses if not _allows(lists, *use))


def _is_of_ros(grant: Grant) -> bool:
    """Whether an allow rule lists something that ROS 2 has a name for, discovery apart, or a pattern that begins so;
    in whatever partition.
    """
    return any(
        _may_begin_a_ros_name(text) if has_wildcard(text) else text != DISCOVERY_TOPIC and is_ros_dds_name(text)
        for criterion in grant.allowed
        for text in (each.text for each in criterion.topics)
    )


def _may_begin_a_ros_name(pattern: str) -> bool:
    return any(_agree(_before_wildcards(pattern), start) for start in SUFFIX_OF)


def _before_wildcards(pattern: str) -> str:
    return pattern if not has_wildcard(pattern) else "".join(takewhile(lambda each: each not in WILDCARDS, pattern))


def _agree(head: str, start: str) -> bool:
    """Whether a name may begin with both."""
    return head.startswith(start) or start.startswith(head)


class _List(NamedTuple):
    """The topics of a criterion that counts in the default partition: names, and expressions with wildcards."""

    operation: Operation
    allow: bool
    names: frozenset[str]
    wild: tuple[str, ...]


def _lists(grant: Grant) -> Iterator[_List]:
    for rule in grant.rules:
        for criterion in rule.criteria:
            if criterion.partitions is None or _matched(criterion.partitions, ""):
                names = frozenset(text.text for text in criterion.topics)
                yield _List(criterion.operation, rule.allow, names, tuple(filter(has_wildcard, names)))


def _allows(lists: Iterable[_List], operation: Operation, topic: str) -> bool:
    """Whether the first rule that matches the topic allows it."""
    for each in lists:
        if each.operation is operation and (topic in each.names or any(_matches(text, topic) for text in each.wild)):
            return each.allow
    return False


def _matched(texts: Iterable[Text], name: str) -> bool:
    return any(text.text == name or (has_wildcard(text.text) and _matches(text.text, name)) for text in texts)


def _matches(expression: str, name: str) -> bool:
    return parse(expression, Matcher.POSIX).matches(name)


def _listed(grant: Grant, operation: Operation) -> Iterator[str]:
    """What its allow rules list in the default partition alone; other partitions need a closer look."""
    return (
        text.text
        for criterion in grant.allowed
        if criterion.operation is operation and criterion.partitions is None
        for text in criterion.topics
    )


_BEFORE_FOXY: Final = frozenset((LayoutKind.FLAT, LayoutKind.ARDENT))


class RosPatterns(Struct, frozen=True, kw_only=True):
    """`reaches`, `rivals`: each with the chosen profiles that it holds for.

    `unknown`: why services could not be compared. `actions`: patterns for topics that take in actions. `unusual`:
    enclaves that lack some of what every node uses. `undescribed`: those that lack what nodes use since Iron, where a
    distribution since then is asked about.
    """

    halves: Halves
    reaches: tuple[tuple[Reach, tuple[str, ...]], ...] = ()
    rivals: tuple[tuple[Rivals, tuple[str, ...]], ...] = ()
    unknown: str | None = None
    actions: tuple[ActionPattern, ...] = ()
    unusual: tuple[Unusual, ...] = ()
    undescribed: tuple[Undescribed, ...] = ()


def ros_patterns(
    keystore: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    systems: Sequence[System],
    usability: Mapping[tuple[str, str], Usability],
) -> RosPatterns:
    """Everything at `at` (aware UTC); `systems` are those of the profiles, `usability` by (directory, profile)."""
    files = {
        document.place: document.file
        for document in documents_of(keystore)
        if isinstance(document.file, PermissionsFile)
    }
    reaches: dict[Reach, list[str]] = {}
    rivals: dict[Rivals, list[str]] = {}
    unknown = None
    holders = Holders(files, accesses)
    known: dict[tuple[tuple[Holder, ...], Matcher, tuple[int, ...]], tuple[tuple[Reach, ...], tuple[Rivals, ...]]] = {}
    for system in systems:
        if not system.may:
            continue
        row = accesses.row(VARIANTS[system.profiles[0]].access)
        applied = {system.trust_domains[each.trust_domain].governance for each in system.enclaves if not each.unmanaged}
        governed = frozenset().union(*(each.domains for each in system.domain_rules if each.document in applied))
        domains = [system.domains[number].intervals[0][0] for number in sorted(governed)]
        key = holders.of(system, row), row.matcher, tuple(domains)
        try:
            if key not in known:
                services = Services(*key)
                known[key] = tuple(services.reaches()), tuple(services.rivals())
        except BudgetExceeded as exceeded:
            unknown = exceeded.message
            continue
        for reach in known[key][0]:
            reaches.setdefault(reach, []).extend(system.profiles)
        for group in known[key][1]:
            rivals.setdefault(group, []).extend(system.profiles)
    discovers = keystore.layout.kind not in _BEFORE_FOXY
    return RosPatterns(
        halves=halves(keystore, profiles, at, accesses, usability),
        reaches=tuple((reach, tuple(held)) for reach, held in reaches.items()),
        rivals=tuple((group, tuple(held)) for group, held in rivals.items()),
        unknown=unknown,
        actions=action_patterns(keystore.enclaves),
        unusual=tuple(unusual(keystore.enclaves, profiles, accesses, at, discovers=discovers)),
        undescribed=tuple(undescribed(keystore.enclaves)) if discovers and since_iron(profiles) else (),
    )
