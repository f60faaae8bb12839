"""KA6: services, actions and topics as ROS 2 nodes use them (`model.ros.patterns`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from keystore_audit.findings import Location, Severity
from keystore_audit.grouped import grouped
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.intended.observed_needs import TYPE_DESCRIPTION
from keystore_audit.model.names import ACTION_PART, ACTION_ROLES, SERVICE_ROLES, ros_name
from keystore_audit.model.ros.action_topics import ActionPattern
from keystore_audit.model.ros.halves import Half
from keystore_audit.model.ros.services import Reach, Rivals
from keystore_audit.rules.registry import VERBS, Context, Violation, listed, located, more, quoted, rule
from keystore_audit.rules.remedies import in_permissions

_PERMISSIONS_XSL: Final = "ros2/sros2, policy/templates/dds/permissions.xsl (the DDS topics of a service and an action)"
_FEWER: Final = in_permissions("Use fewer expressions with several wildcards, and name each service and action")
_DOES: Final = {"request": "request", "reply": "answer", "call": "call", "execute": "execute"}


def _halves(context: Context, roles: Sequence[str]) -> Iterator[Violation]:
    """One violation for each enclave with halves in these roles."""
    ros = context.meaning.ros
    if ros is None:
        return
    halves = (half for half in ros.halves.halves if half.role in roles)
    for path, found in grouped(halves, lambda half: half.enclave).items():
        yield _half(path, sorted(found, key=lambda half: (half.several, half.name, half.role)))
    for enclave, why in ros.halves.unknown if roles == SERVICE_ROLES else ():
        place = enclave.permissions.signed.file.place if enclave.permissions else enclave.files.directory
        yield Violation(
            f"Which services and actions {enclave.path} may use as a whole could not be worked out: {why}.",
            (Location(place),),
            enclave=enclave.path,
            severity=Severity.LOW,  # nobody has a right more for it: the audit is complete without
            remedy=_FEWER,
            key="unknown",
        )


def _half(path: str, found: Sequence[Half]) -> Violation:
    first = found[0]
    names = dict.fromkeys(half.name for half in found)
    others = f" (and {listed(list(names)[1:])})" if len(names) > 1 else ""
    like = ", one of many such names" if first.several else ""
    operation, topic = first.lacks[0]
    return Violation(
        f"{path} may {_DOES[first.role]} {first.name} in part only{like}{others}: "
        f"it may not {VERBS[operation]} {ros_name(topic)}{more(len(first.lacks), ' of its topics')}.",
        [half.location for half in found],
        enclave=path,
        profiles=tuple(dict.fromkeys(name for half in found for name in half.profiles)),
        key="\n".join(sorted({f"{half.role} {half.name}" for half in found})),
    )


@rule(
    "KA630",
    Severity.MEDIUM,
    _PERMISSIONS_XSL,
    in_permissions(
        "Allow both halves of the service, or neither: a client publishes rq/NAMERequest and subscribes to "
        "rr/NAMEReply, a server the reverse"
    ),
)
def half_service(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave may ask a service and not read its answers, or the reverse: the node fails when it makes the endpoint.

    Decided over all service names, as each implementation reads the rules. Only an allow rule that names requests or
    replies (`rq/`, `rr/`) counts: a reader of `*` records. For a service of an action, see half-action.
    """
    yield from _halves(context, SERVICE_ROLES)


@rule(
    "KA631",
    Severity.MEDIUM,
    f"ROS 2 design, actions (three services and two topics); {_PERMISSIONS_XSL}",
    in_permissions(
        "Allow all of the action, or nothing: the services send_goal, cancel_goal and get_result, and the "
        "topics feedback and status"
    ),
)
def half_action(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave may use only part of an action's three services and two topics: its client or server is not made.

    Checked if an expression names the action (with `/_action/`) on one of its services, or lists one of its topics by
    name for publishing. Reading only feedback and status is watching, and no finding.
    """
    yield from _halves(context, ACTION_ROLES)


def _reaches(context: Context, family: str) -> Iterator[Violation]:
    ros = context.meaning.ros
    if ros is None:
        return
    for reach, profiles in ros.reaches:
        if reach.family == family:
            yield _reach(reach, profiles)
    if ros.unknown is not None and family == "parameters":
        yield Violation(
            f"Whose services enclaves may use could not be worked out: {ros.unknown}.",
            (Location("."),),
            undecided=True,
            remedy=_FEWER,
            key="unknown",
        )


def _reach(reach: Reach, profiles: tuple[str, ...]) -> Violation:
    verb = {
        ("parameters", True): "set parameters of",
        ("parameters", False): "read parameters of",
        ("states", True): "change the state of",
        ("states", False): "read the state of",
    }[reach.family, reach.changes]
    others = more(reach.nodes, f" nodes of {listed(reach.owners)}")
    call, answer = reach.rights
    return Violation(
        f"{reach.caller} may {verb} the node {reach.node} in the enclave {reach.owner}{others} ({reach.service}).",
        (located(call), located(answer, "where the node's own enclave answers")),
        enclave=reach.caller,
        severity=None if reach.changes else Severity.LOW,
        profiles=profiles,
        key="\n".join((f"{reach.changes}", *reach.calls)),
    )


@rule(
    "KA632",
    Severity.HIGH,
    "ROS 2 design, parameters (services of every node); ROS 2 design, SROS2 access control policies (least privilege)",
    in_permissions("Let each enclave use only the parameter services of its own nodes"),
)
def parameter_services_of_others(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave may set parameters of a node that runs in another enclave: it decides what that node does.

    The node is another's if that enclave may answer the service, and the caller's permissions do not list the answer by
    name. Low if parameters can only be read. For an enclave that may do everything, see allow-everything-permissions.
    Accept it for a tool that configures others.
    """
    yield from _reaches(context, "parameters")


@rule(
    "KA633",
    Severity.HIGH,
    "ROS 2 design, managed nodes (change_state); ROS 2 design, SROS2 access control policies (least privilege)",
    in_permissions("Let only the enclave that manages the node call change_state"),
)
def lifecycle_services_of_others(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave may change the state of a managed node that runs in another enclave: it starts and stops it.

    Low if the state can only be read. A node's enclave is found as in parameter-services-of-others. Accept it for a
    lifecycle manager.
    """
    yield from _reaches(context, "states")


@rule(
    "KA634",
    Severity.MEDIUM,
    "ROS 2 design, SROS2 access control policies (least privilege); analysis of who may publish rr/NAMEReply",
    in_permissions("Let only one enclave reply on each service"),
)
def service_served_by_several(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Two enclaves may answer one service: a client accepts either answer, so one of them can be a false server.

    Checked for services that permissions list by name. A pattern that matches what others list is reported apart.
    """
    ros = context.meaning.ros
    for rivals, profiles in ros.rivals if ros is not None else ():
        yield _rivals(rivals, profiles)


def _rivals(rivals: Rivals, profiles: tuple[str, ...]) -> Violation:
    names = dict.fromkeys(_whole(service) for service in rivals.services)
    first = next(iter(names))
    others = more(len(names))
    if rivals.intruder is None:
        message = (
            f"{listed(rivals.enclaves)} may all answer {first}{others}: a client cannot tell whose answer it gets."
        )
    else:
        owners = [path for path in rivals.enclaves if path != rivals.intruder]
        message = f"{rivals.intruder} may answer {first}{others} by a pattern, in the place of {listed(owners)}."
    return Violation(
        message,
        [located(right) for right in rivals.rights],
        enclave=rivals.intruder,
        profiles=profiles,
        key="\n".join((*rivals.enclaves, *rivals.services)),
    )


def _whole(service: str) -> str:
    """The service, or the action that it is a part of."""
    action, part, _ = service.partition(ACTION_PART)
    return f"the action {action}" if part else service


_USES: Final = {Operation.PUBLISH: "publish", Operation.SUBSCRIBE: "read"}


@rule(
    "KA635",
    Severity.LOW,
    "ROS 2 design, actions (topics feedback and status below the name and _action)",
    in_permissions("Name each topic, and each action"),
)
def wildcard_grants_actions(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """A pattern for topics also covers the feedback and the status of actions, which it does not name.

    Medium if it lets the enclave publish those of an action that another enclave serves by name: clients then take them
    for the server's. A note if there is no such action yet. For an enclave that may do everything, see
    allow-everything-permissions. Judged by the enclave's own document, as the specification reads it.
    """
    for found in context.meaning.ros.actions if context.meaning.ros is not None else ():
        of = f"which {found.owner} serves" if found.owner is not None else "if there is one"
        yield Violation(
            f"By {quoted(found.expression)}{more(found.count)} {found.enclave} may also {_USES[found.operation]} "
            f"feedback and status of actions, such as {found.action}, {of}.",
            found.locations,
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
    "ros2/sros2, policy/common/node.xml; measured: without ros_discovery_info no participant of ROS 2 is made; "
    "ros2/rclcpp, node_type_descriptions.cpp (read)",
    in_permissions("Allow what sros2's common/node.xml has, and get_type_description, or switch these off in nodes"),
)
def missing_usual_topics(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave lacks rights that every ROS 2 node uses: ros_discovery_info, /rosout, /parameter_events, services.

    Since Foxy every process publishes and reads ros_discovery_info. Without it, DDS creates a participant, ROS 2 gives
    it up, and nothing runs; a governance that leaves the topic open needs no grant. The others are log, parameter
    events, the six parameter services, and since Iron get_type_description. Without them a node fails, unless it is
    told to do without. The policies of sros2 leave get_type_description out: no Jazzy node starts by them unless its
    parameter start_type_description_service is false. It is checked for nodes whose parameter services are granted by
    name, if a chosen implementation ships only since Iron. Only nodes with simulated time read /clock.
    """
    ros = context.meaning.ros
    if ros is None:
        return
    for found in ros.unusual:
        parameters = ("answer parameter requests for its nodes",) if found.silent else ()
        lacks = listed((*(f"{VERBS[operation]} {_name(topic)}" for operation, topic in found.lacks), *parameters))
        follows = "Nodes fail unless these are switched off" if found.starts else "No ROS 2 node of it is made"
        yield Violation(
            f"{found.enclave} lacks the right to {lacks}. {follows}.",
            (found.location,),
            enclave=found.enclave,
            profiles=found.profiles,
            key=lacks,
        )
    if ros.undescribed:
        nodes = {f"{each.enclave} {node}": node for each in ros.undescribed for node in each.nodes}
        lack = "lacks" if len(nodes) == 1 else "lack"
        yield Violation(
            f"{listed(nodes.values())} {lack} the right to answer {TYPE_DESCRIPTION}. Since Iron, nodes then fail to "
            "start unless start_type_description_service is false.",
            [each.location for each in ros.undescribed],
            enclave=ros.undescribed[0].enclave if len(ros.undescribed) == 1 else None,
            key="\n".join(nodes),
        )


def _name(topic: str) -> str:
    return topic if not topic.startswith("rt/") else ros_name(topic).partition(" ")[0]
