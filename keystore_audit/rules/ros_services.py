"""KA6: services and actions as ROS 2 has them: whole or half, and whose they are (`model.ros.patterns`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from keystore_audit.findings import Location, Severity
from keystore_audit.grouped import grouped
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.names import ACTION_PART, ACTION_ROLES, SERVICE_ROLES, ros_name
from keystore_audit.model.ros.halves import Half
from keystore_audit.model.ros.services import Reach, Rivals
from keystore_audit.rules.context import Context
from keystore_audit.rules.registry import Violation, rule
from keystore_audit.rules.remedies import in_permissions
from keystore_audit.rules.wording import VERBS, listed, located, places

_PERMISSIONS_XSL: Final = "ros2/sros2, policy/templates/dds/permissions.xsl (the DDS topics of a service and an action)"
_FEWER: Final = in_permissions("Write fewer expressions with several wildcards, and name each service and action")
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
            message=f"Which services and actions {enclave.path} may use as a whole could not be worked out: {why}.",
            locations=(Location(path=place),),
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
    more = f" and {len(first.lacks) - 1} more of its topics" if len(first.lacks) > 1 else ""
    return Violation(
        message=f"{path} may {_DOES[first.role]} {first.name} in part only{like}{others}: "
        f"it may not {VERBS[operation]} {ros_name(topic)}{more}.",
        locations=places(half.location for half in found),
        enclave=path,
        profiles=first.profiles if all(half.profiles == first.profiles for half in found) else _united(found),
        key="\n".join(sorted({f"{half.role} {half.name}" for half in found})),
    )


def _united(found: Sequence[Half]) -> tuple[str, ...]:
    """The profiles that any of them holds for, empty for all."""
    if not all(half.profiles for half in found):
        return ()
    return tuple(dict.fromkeys(name for half in found for name in half.profiles))


@rule(
    "KA630",
    Severity.MEDIUM,
    clause=_PERMISSIONS_XSL,
    remedy=in_permissions(
        "Allow both halves of the service, or neither: a client publishes rq/NAMERequest and subscribes to "
        "rr/NAMEReply, a server the reverse"
    ),
)
def half_service(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave may ask a service and not read its answers, or the reverse: the node fails when it makes the endpoint.

    Decided over all service names, after deny rules and as each implementation reads the patterns. The half that is
    there has to come from an allow rule that names requests or replies (`rq/`, `rr/`): who may read `*` records. A
    service that an action is made of is half-action's.
    """
    yield from _halves(context, SERVICE_ROLES)


@rule(
    "KA631",
    Severity.MEDIUM,
    clause=f"ROS 2 design, actions (three services and two topics); {_PERMISSIONS_XSL}",
    remedy=in_permissions(
        "Allow all of the action, or nothing: the services send_goal, cancel_goal and get_result, and the "
        "topics feedback and status"
    ),
)
def half_action(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave may use a part of an action's three services and two topics: its client or server is not made.

    Looked at where an expression names the action for one (with `/_action/`) on one of its services, or lists a topic
    of it by name for publishing. Whoever only reads feedback and status watches, and may.
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
            message=f"Whose services enclaves may use could not be worked out: {ros.unknown}.",
            locations=(Location(path="."),),
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
    more = f" and {reach.nodes - 1} more nodes of {listed(reach.owners)}" if reach.nodes > 1 else ""
    call, answer = reach.rights
    return Violation(
        message=f"{reach.caller} may {verb} the node {reach.node} in the enclave {reach.owner}{more} "
        f"({reach.service}).",
        locations=(located(call), located(answer, "where the node's own enclave answers")),
        enclave=reach.caller,
        severity=None if reach.changes else Severity.LOW,
        profiles=profiles,
        key="\n".join((f"{reach.changes}", *reach.calls)),
    )


@rule(
    "KA632",
    Severity.HIGH,
    clause="ROS 2 design, parameters (services of every node); ROS 2 design, SROS2 access control policies (least "
    "privilege)",
    remedy=in_permissions("Let each enclave ask the parameter services of its own nodes alone"),
)
def parameter_services_of_others(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave may set parameters of a node that runs in another enclave: it decides what that node does.

    The node is another's where that one's own permissions let it answer the service, and the caller's do not list the
    answer by name. Low where parameters can only be read. An enclave that may do everything has
    allow-everything-permissions, and only that. A tool that configures others needs this right: accept the finding.
    """
    yield from _reaches(context, "parameters")


@rule(
    "KA633",
    Severity.HIGH,
    clause="ROS 2 design, managed nodes (change_state); ROS 2 design, SROS2 access control policies (least privilege)",
    remedy=in_permissions("Let the one enclave that manages the node ask change_state, and no other"),
)
def lifecycle_services_of_others(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """An enclave may change the state of a managed node that runs in another enclave: it starts and stops it.

    Low where the state can only be read. Whose node it is, parameter-services-of-others says. A lifecycle manager needs
    this right: accept the finding for it.
    """
    yield from _reaches(context, "states")


@rule(
    "KA634",
    Severity.MEDIUM,
    clause="ROS 2 design, SROS2 access control policies (least privilege); analysis of who may publish rr/NAMEReply",
    remedy=in_permissions("Let one enclave alone reply on each service"),
)
def service_served_by_several(_keystore: Keystore, context: Context) -> Iterator[Violation]:
    """Two enclaves may answer one service: a client takes the answer of either, so that one can be a false server.

    Services that permissions list by name; an enclave with a pattern that matches what others list is told apart.
    """
    ros = context.meaning.ros
    for rivals, profiles in ros.rivals if ros is not None else ():
        yield _rivals(rivals, profiles)


def _rivals(rivals: Rivals, profiles: tuple[str, ...]) -> Violation:
    names = dict.fromkeys(_whole(service) for service in rivals.services)
    first = next(iter(names))
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    if rivals.intruder is None:
        message = f"{listed(rivals.enclaves)} may all answer {first}{more}: a client cannot tell whose answer it gets."
    else:
        owners = [path for path in rivals.enclaves if path != rivals.intruder]
        message = f"{rivals.intruder} may answer {first}{more} by a pattern, in the place of {listed(owners)}."
    return Violation(
        message=message,
        locations=places(located(right) for right in rivals.rights),
        enclave=rivals.intruder,
        profiles=profiles,
        key="\n".join((*rivals.enclaves, *rivals.services)),
    )


def _whole(service: str) -> str:
    """The service, or the action that it is a part of."""
    action, part, _ = service.partition(ACTION_PART)
    return f"the action {action}" if part else service
