"""ROS 2 names and the DDS names that they become, by the rules of rmw and of sros2's policy translation.

Sources: `intent/intent.py` (what a fully qualified name is) and rmw's topic prefixes. `permissions.xsl` of sros2 says
which DDS topics a right on a service or an action needs. Lengths are not limited here: rmw takes
at most 247 characters, a DDS participant any number.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.intent.intent import FULL_NAME, is_ros_name
from keystore_audit.keystore.typed import Operation

Use = tuple[Operation, str]
"""An operation on a DDS topic, or (in policies) on all that an expression matches."""

DISCOVERY_TOPIC: Final = "ros_discovery_info"

AMBIENT_TOPICS: Final = frozenset({"rt/rosout", "rt/parameter_events", DISCOVERY_TOPIC})
"""DDS topics that join every enclave to every other: logs, changes of parameters, and who has which endpoints."""

AMBIENT: Final = ("rt/clock", "rt/parameter_events", "rt/rosout", DISCOVERY_TOPIC)
"""DDS topics that nearly every node has a right to: no flow takes them unless a claim includes them."""

PARAMETER_SERVICES: Final = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)
"""The services that every node offers below its own name (rcl_interfaces)."""

SETTING_SERVICES: Final = ("set_parameters", "set_parameters_atomically")
"""Those of the parameter services that change what a node does."""

LIFECYCLE_SERVICES: Final = (
    "change_state",
    "get_available_states",
    "get_available_transitions",
    "get_state",
    "get_transition_graph",
)
"""The services that a managed node offers below its own name (lifecycle_msgs, rcl_lifecycle)."""

ACTION_SERVICES: Final = ("cancel_goal", "get_result", "send_goal")
ACTION_TOPICS: Final = ("feedback", "status")
"""The services and topics of an action, below its name and `_action/` (ROS 2 design, actions)."""

SERVICE_ROLES: Final = ("request", "reply")
ACTION_ROLES: Final = ("call", "execute")
"""What can be done with a service, and with an action, as a whole."""

TOPIC_PREFIX: Final = "rt"
REQUEST_PREFIX: Final = "rq"
REPLY_PREFIX: Final = "rr"
SERVICE_PREFIX: Final = "rs"
REQUEST_SUFFIX: Final = "Request"
REPLY_SUFFIX: Final = "Reply"

ACTION_PART: Final = "/_action/"
_MANGLING: Final = {
    # prefix: suffix, kind, and which half of it the DDS topic is
    TOPIC_PREFIX: ("", "topic", ""),
    REQUEST_PREFIX: (REQUEST_SUFFIX, "service", "request"),
    REPLY_PREFIX: (REPLY_SUFFIX, "service", "reply"),
    SERVICE_PREFIX: ("", "service", ""),
}
SUFFIX_OF: Final = {f"{prefix}/": suffix for prefix, (suffix, _kind, _half) in _MANGLING.items()}
"""How DDS names of ROS 2 begin, and how each of these has to end."""


class RosKind(str, Enum):
    """What a ROS 2 name names."""

    TOPIC = "topic"
    SERVICE = "service"
    ACTION = "action"
    DISCOVERY = "discovery"


class RosName(Struct, frozen=True, kw_only=True):
    """What one DDS topic is to ROS 2.

    `name`: fully qualified (for `ros_discovery_info`, which has none, that itself). `part`: which of its DDS topics it
    is, in words. That is "" for a topic, "request" of a service, "feedback" or "send_goal request" of an action.
    """

    kind: RosKind
    name: str
    part: str

    def __str__(self) -> str:
        return f"{self.name} ({f'{self.kind.value} {self.part}'.rstrip()})"


def is_ros_dds_name(dds: str) -> bool:
    """Return whether `parse_dds_name` gives a name; the quick question for 100,000s of topics."""
    suffix = _MANGLING.get(dds[:2], (None,))[0]
    if suffix is None or not dds.endswith(suffix):
        return dds == DISCOVERY_TOPIC
    return FULL_NAME.fullmatch(dds, 2, len(dds) - len(suffix)) is not None or dds == DISCOVERY_TOPIC


def parse_dds_name(dds: str) -> RosName | None:
    """Return what the DDS topic `dds` is to ROS 2, or None where the mangling of ROS 2 cannot produce it."""
    if dds == DISCOVERY_TOPIC:
        return RosName(kind=RosKind.DISCOVERY, name=dds, part="")
    name = plain_name(dds)
    if name is None:
        return None
    _suffix, kind, part = _MANGLING[dds[:2]]
    action, found, action_part = name.rpartition(ACTION_PART)
    if found and action and action_part in (ACTION_SERVICES if part else ACTION_TOPICS):
        return RosName(kind=RosKind.ACTION, name=action, part=f"{action_part} {part}".rstrip())
    return RosName(kind=RosKind(kind), name=name, part=part)


def plain_name(dds: str) -> str | None:
    """Return the fully qualified name of the topic or service that `dds` is of, those of an action apart.

    None where ROS 2 has no such name.
    """
    if dds == DISCOVERY_TOPIC or not is_ros_dds_name(dds):
        return None
    return dds[2 : len(dds) - len(_MANGLING[dds[:2]][0])]


def ros_name(dds: str) -> str:
    """Return `dds` as a user of ROS 2 calls it, "/add (service request)", or in quotes where ROS 2 has no such name.

    Raw text: the name may be anybody's, escape it for where it is shown.
    """
    name = parse_dds_name(dds)
    return str(name) if name is not None else f'"{dds}"'


def topics_named(dds: str, *, endless: bool) -> str:
    """Return `ros_name` of it, as one of infinitely many where it is that (`endless`)."""
    return f"{'topics such as ' if endless else ''}{ros_name(dds)}"


def dds_channels(operation: str, name: str) -> tuple[Use, ...]:
    """Return what `operation` on the ROS name `name` needs: DDS operations on DDS topics, all of them.

    `operation`: publish, subscribe or relay (of a topic), request or reply (of a service), call or execute (of an
    action). Raises UsageError for another operation, or where `name` is no fully qualified ROS name.
    """
    if not is_ros_name(name):
        raise UsageError(f"{name!r} is no fully qualified ROS name; expected one like '/chatter'")
    return dds_expressions(operation, name)


def dds_expressions(operation: str, name: str) -> tuple[Use, ...]:
    """Return what sros2 makes of the right to `operation` on `name`, which may have wildcards: as `dds_channels`.

    The name is taken as it is; raises UsageError for another operation.
    """
    if operation in {"publish", "subscribe", "relay"}:
        return ((Operation(operation), TOPIC_PREFIX + name),)
    if operation in SERVICE_ROLES:
        return _service(operation, name)
    if operation in ACTION_ROLES:
        action = name + ACTION_PART
        reads_topics = operation == "call"
        services = [
            channel
            for service in ACTION_SERVICES
            for channel in _service("request" if reads_topics else "reply", action + service)
        ]
        direction = Operation.SUBSCRIBE if reads_topics else Operation.PUBLISH
        return (*services, *((direction, TOPIC_PREFIX + action + topic) for topic in ACTION_TOPICS))
    raise UsageError(
        f"unknown operation {operation!r}; expected publish, subscribe, relay, request, reply, call or execute"
    )


def _service(operation: str, name: str) -> tuple[Use, ...]:
    request = REQUEST_PREFIX + name + REQUEST_SUFFIX
    reply = REPLY_PREFIX + name + REPLY_SUFFIX
    if operation == "request":
        return (Operation.PUBLISH, request), (Operation.SUBSCRIBE, reply)
    return (Operation.PUBLISH, reply), (Operation.SUBSCRIBE, request)
