"""KA6: topics as ROS 2 nodes use them (`model.ros.patterns`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from keystore_audit.findings import Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.intended.observed_needs import TYPE_DESCRIPTION
from keystore_audit.model.names import ros_name
from keystore_audit.model.ros.action_topics import ActionPattern
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.wording import VERBS, listed, places, quoted

_DOES: Final = {Operation.PUBLISH: "publish", Operation.SUBSCRIBE: "read"}


@rule(
    "KA635",
    Severity.LOW,
    clause="ROS 2 design, actions (topics feedback and status below the name and _action)",
    remedy=in_permissions("Name each topic, and each action"),
)
def wildcard_grants_actions(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A pattern for topics takes in the feedback and the status of actions, which it does not name.

    Medium where it lets the enclave publish those of an action that another enclave serves by name: clients of the
    action then take what it says for the server's. A note where there is no such action yet. An enclave that may do
    everything has allow-everything-permissions, and only that. Looked at is what an enclave's own document allows, as
    the specification reads it.
    """
    for found in context.meaning.ros.actions if context.meaning.ros is not None else ():
        more = f" and {found.count - 1} more" if found.count > 1 else ""
        of = f"which {found.owner} serves" if found.owner is not None else "if there is one"
        yield Violation(
            message=f"By {quoted(found.expression)}{more} {found.enclave} may {_DOES[found.operation]} feedback and "
            f"status of actions too, as of {found.action}, {of}.",
            locations=places(found.locations),
            enclave=found.enclave,
            severity=_severity(found),
            key="\n".join((f"{found.operation.value} {found.expression}", *map(" ".join, found.served))),
        )


def _severity(found: ActionPattern) -> Severity | None:
    if found.owner is None:
        return Severity.INFO
    return Severity.MEDIUM if found.operation is Operation.PUBLISH else None


@rule(
    "KA636",
    Severity.MEDIUM,
    clause="ros2/sros2, policy/common/node.xml; measured: without ros_discovery_info no participant of ROS 2 is made; "
    "ros2/rclcpp, node_type_descriptions.cpp (read)",
    remedy=in_permissions("Allow get_type_description and what sros2's common/node.xml has, or start nodes without it"),
)
def missing_usual_topics(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave lacks rights that every ROS 2 node uses: ros_discovery_info, /rosout, /parameter_events, services.

    Without ros_discovery_info, which Foxy and later publish and read in every process: DDS makes a participant,
    ROS 2 gives it up, and nothing runs. A governance that leaves the topic open needs no grant for it. Without the
    others a node fails unless it is told to do without: log, parameter events, the six parameter services, and since
    Iron the service get_type_description, which sros2's own policies leave out, so that no node of Jazzy starts by
    them unless its parameter start_type_description_service is false. The last is asked of nodes whose parameter
    services are granted by name, where an implementation is asked about that only distributions since Iron ship.
    /clock is read by nodes with simulated time alone.
    """
    ros = context.meaning.ros
    if ros is None:
        return
    for found in ros.unusual:
        parameters = ("answer for the parameters of any node",) if found.silent else ()
        lacks = listed((*(f"{VERBS[operation]} {_name(topic)}" for operation, topic in found.lacks), *parameters))
        follows = "nodes fail unless they are told to do without" if found.starts else "no ROS 2 node of it is made"
        yield Violation(
            message=f"{found.enclave} may not {lacks}: {follows}.",
            locations=(found.location,),
            enclave=found.enclave,
            profiles=found.profiles,
            key=lacks,
        )
    if ros.undescribed:
        nodes = {f"{each.enclave} {node}": node for each in ros.undescribed for node in each.nodes}
        yield Violation(
            message=f"{listed(nodes.values())} may not answer {TYPE_DESCRIPTION}, which nodes serve since Iron: they "
            "fail unless they are told to do without (start_type_description_service false).",
            locations=places(each.location for each in ros.undescribed),
            enclave=ros.undescribed[0].enclave if len(ros.undescribed) == 1 else None,
            key="\n".join(nodes),
        )


def _name(topic: str) -> str:
    return topic if not topic.startswith("rt/") else ros_name(topic).partition(" ")[0]
