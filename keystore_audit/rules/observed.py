"""KA6: the system as a graph or launch files show it, and what its enclaves are granted (`model.intended.observed`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Final

from msgspec.structs import replace

from keystore_audit.findings import Location, Severity, decision
from keystore_audit.grouped import grouped
from keystore_audit.intent.environment import DOMAIN, ENABLE, RMW, SECURE, STRATEGY
from keystore_audit.intent.intent import ROOT, Action, SetVariable
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.typed import DomainRule
from keystore_audit.keystore.typed import Rule as PermissionsRule
from keystore_audit.model.domains import contains, covered
from keystore_audit.model.names import ros_name
from keystore_audit.profiles import MIDDLEWARE
from keystore_audit.rules.registry import VERBS, Context, Violation, listed, more_like, quoted, rule, sentence
from keystore_audit.rules.remedies import CREATE_ENCLAVE, in_permissions
from keystore_audit.text import counted, meant

if TYPE_CHECKING:  # an audit without a graph or a launch file needs none of it
    from keystore_audit.model.intended.observed import ExcessGrant, GrantedName, MissingGrant, Observation
    from keystore_audit.model.intended.observed_needs import Need

SUGGEST: Final = "`keystore-audit suggest` prints the least policy for what was seen"
LAUNCHED: Final = " A launch file names only what it remaps: check whether a node uses them by their own names."

UNNAMED: Final = "a node whose name the file does not say"

_DOES: Final = {
    Action.PUBLISH: "publishes",
    Action.SUBSCRIBE: "subscribes to",
    Action.REQUEST: "asks the service",
    Action.REPLY: "answers the service",
    Action.CALL: "calls the action",
    Action.EXECUTE: "executes the action",
}


def _observed(_keystore: Keystore, context: Context) -> Observation | None:
    return context.observed


def _beside(location: Location, message: str = "") -> Location:
    """A place in a graph or a launch file, which is not the keystore's."""
    return replace(location, beside=True, message=message or location.message)


@rule(
    "KA650",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.3 (rules of a grant); ROS 2 design, SROS2 access control policies",
    in_permissions(f"Allow it, unless the node should not do it ({SUGGEST})"),
    of=_observed,
)
def missing_grant(observed: Observation) -> Iterator[Violation]:
    """A node does what its enclave's own implementation denies, so that it ends there under Enforce.

    Medium if some of the domains in which the enclave starts allow it. What every node does by itself (log, parameter
    events and services, ros_discovery_info) is one finding for an enclave. Nodes started without parameter services or
    log do not need those. What a node does later than the graph is not seen.
    """
    for missing in observed.missing:
        need = missing.need
        if not need.usual:
            who = f"The node {need.node}" if need.node else f"A node of {need.enclave}"
            message = (
                f"{who} {_right(need)}, but its enclave {need.enclave} may not{_in(missing)}: {missing.explain()}."
            )
            yield _missing(message, [missing])
    usual = (missing for missing in observed.missing if missing.need.usual)
    for enclave, group in grouped(usual, lambda missing: missing.need.enclave).items():
        what = listed(dict.fromkeys(_right(missing.need) for missing in group))
        first = group[0]
        message = f"Every node {what}, but the enclave {enclave} may not{_in(first)}: {first.explain()}."
        yield _missing(message, group)


def _right(need: Need) -> str:
    if need.action is None:
        return f"publishes and subscribes to {need.name}"
    return f"{_DOES[need.action]} {need.name}"


def _in(missing: MissingGrant) -> str:
    return f" in {missing.domains}" if missing.domains else ""


def _missing(message: str, group: Sequence[MissingGrant]) -> Violation:
    """One violation for rights of one enclave."""
    deciding = [replace(each.decides, message="what denies it") for each in group if each.decides is not None]
    needed = [_beside(each.need.location, "what needs it") for each in group]
    return Violation(
        message,
        (*deciding[:1], *needed, *deciding[1:]),
        enclave=group[0].need.enclave,
        severity=Severity.MEDIUM if all(each.domains for each in group) else None,
        profiles=tuple(dict.fromkeys(name for each in group for name in each.profiles)),
        key="\n".join(sorted(_right(each.need) for each in group)),
    )


@rule(
    "KA651",
    Severity.LOW,
    "ROS 2 design, SROS2 access control policies; least privilege (Saltzer and Schroeder 1975)",
    in_permissions(f"Remove what no node needs ({SUGGEST})"),
    of=_observed,
)
def excess_grant(observed: Observation) -> Iterator[Violation]:
    """An enclave is granted names that no node of it was seen to use: whoever takes it over has them all.

    What every node uses is not counted, nor what sros2's policies grant to every node. Nothing is reported if part of
    the files could not be worked out, or a launch file names nothing that the enclave's nodes use.
    """
    for excess in observed.excess:
        names = [*excess.names, *filter(None, (excess.wide,))]
        yield Violation(
            _excess(excess, observed),
            [each.location for each in names],
            enclave=excess.enclave,
            profiles=excess.profiles,
            key="\n".join(sorted({_granted(name) for name in names})),
        )


def _excess(excess: ExcessGrant, observation: Observation) -> str:
    where = listed(dict.fromkeys(observation.paths))
    said = []
    if excess.names:
        names = listed(dict.fromkeys(_granted(name) for name in excess.names))
        said.append(f"{excess.enclave} may {names}, but no node of it does in {where}: ")
        granted = counted(excess.allowed, "name")
        said.append(f"it uses {excess.used} of the {granted} that it is granted beside the usual ones.")
        said.append(LAUNCHED if excess.launched else "")
    if excess.wide is not None:
        more = "and infinitely many more" if excess.endless else "for one"
        begins = (
            " Its rights are unbounded, too" if said else f"The rights of {excess.enclave} are not bounded by {where}"
        )
        said.append(f"{begins}: it may {_granted(excess.wide)}, {more}.")
    return "".join(said)


def _granted(name: GrantedName) -> str:
    partition = f" in partition {quoted(name.partition)}" if name.partition else ""
    return f"{VERBS[name.operation]} {ros_name(name.topic)}{partition}"


@rule(
    "KA652",
    Severity.HIGH,
    "ROS 2 design, ROS 2 security enclaves; ros2/rcl, security.c (the keystore is searched for the exact path)",
    decision(f"Start the node in an existing enclave (`--ros-args --enclave`), or create this one: {CREATE_ENCLAVE}."),
    of=_observed,
)
def node_in_unknown_enclave(observed: Observation, context: Context) -> Iterator[Violation]:
    """A node is to run in an enclave that the keystore does not have: under Enforce it does not start.

    A process without `--enclave` is in the enclave `/`. The enclave may be in an unread part of the keystore.
    """
    known = [enclave.path for enclave in context.keystore.enclaves]
    for unknown in observed.unknown:
        named = f"the enclave {quoted(unknown.path)}"
        named = f"{named} (it names none)" if unknown.path == ROOT else named
        nodes = listed(name or UNNAMED for name in unknown.nodes)
        verb = "runs" if len(unknown.nodes) == 1 else "run"
        yield Violation(
            f"{sentence(nodes)} {verb} in {named}, which does not exist.{meant(unknown.path, known)}",
            [_beside(location) for location in unknown.locations],
            key="\n".join([unknown.path, *sorted(unknown.nodes)]),
        )


@rule(
    "KA653",
    Severity.HIGH,
    "DDS-Security 1.1, 9.4.1.3 (rules of a grant); ROS 2 design, Topic and Service name mapping to DDS",
    in_permissions("Allow what the node does with the name, or remove the remapping"),
    of=_observed,
)
def used_name_without_right(observed: Observation) -> Iterator[Violation]:
    """A launch file gives a node a name with which its enclave may do nothing at all.

    Whatever the node does under that name ends it under Enforce. Remapping an unused name does no harm.
    """
    found = grouped(observed.denied, lambda denied: (denied.enclave, denied.used.name))
    for (enclave, name), group in found.items():
        nodes = listed(dict.fromkeys(denied.used.node or f"a node of {enclave}" for denied in group))
        yield Violation(
            f"{sentence(nodes)} uses {name}, but {enclave} may neither publish nor subscribe to it, nor ask, "
            "answer, call or execute it.",
            [_beside(denied.used.location) for denied in group],
            enclave=enclave,
            profiles=group[0].profiles,
            key=name,
        )


@rule(
    "KA654",
    Severity.INFO,
    "ROS 2 design, ROS 2 launch (what only running tells)",
    decision("Give arguments with `--launch-argument`, or a graph of the running system with `--graph`."),
    of=_observed,
)
def observation_incomplete(observed: Observation, context: Context) -> Iterator[Violation]:
    """Part of a graph or launch file could not be worked out, or an enclave's rights are unknown.

    Nodes may need more than was found, so no grant is called an excess. Launch files are read, never run. If an
    enclave's rights are unknown, the audit is incomplete.
    """
    unresolved = (_beside(each.location, each.reason) for each in observed.unresolved)
    for path, found in grouped(unresolved, lambda place: place.path).items():
        yield Violation(
            f"{sentence(found[0].message)}{more_like(found)}. Nodes may need more than "
            f"{quoted(path)} shows, so no grant is called an excess.",
            found,
            undecided=context.launch_complete,
            key="\n".join(sorted({place.message for place in found})),
        )
    for undecided in observed.undecided:
        yield Violation(
            f"The rights of {undecided.enclave} are unknown, so they are not compared with what its nodes "
            f"need: {undecided.reason}.",
            (),
            enclave=undecided.enclave,
            profiles=undecided.profiles,
            undecided=True,
            key=undecided.reason,
        )


@rule(
    "KA655",
    Severity.CRITICAL,
    "rcl, security.c and domain_id.c (read)",
    decision(
        "Remove the variable from the launch file, and set it in the robot's environment for every process. "
        "Or record the running system, and give that with `--graph`."
    ),
    of=_observed,
)
def launch_changes_security(observed: Observation, context: Context) -> Iterator[Violation]:
    """A launch file starts a process without security, or not with this keystore, domain and middleware.

    What it sets overrides the robot's environment (`--env`). The audit is incomplete if only running the file tells a
    value. So it is if something about security is not read: code that is not followed, commands, and what stands before
    a program. A domain that it sets is high if no governance covers it, low if all do and every enclave is granted
    something there, else medium.
    """
    for variable in observed.variables:
        harm = _harm(variable, context)
        if harm is not None:
            severity, what = harm
            value = "a value that cannot be told" if variable.value is None else quoted(variable.value)
            yield Violation(
                f"{sentence(variable.node or 'a process')} starts with {variable.name} set to {value}: {what}.",
                (_beside(variable.location),),
                severity=severity,
                key=f"{variable.node} {variable.started} {variable.name} {variable.value}",
                undecided=variable.value is None or (variable.name == RMW and variable.value not in MIDDLEWARE),
            )
    speaking = (_beside(each.location, each.reason) for each in observed.speaking)
    for path, found in grouped(speaking, lambda place: place.path).items():
        yield Violation(
            f"{found[0].message}{more_like(found)}.",
            found,
            severity=Severity.HIGH,
            undecided=True,
            key=f"{path}\n" + "\n".join(sorted({place.message for place in found})),
        )


def _harm(variable: SetVariable, context: Context) -> tuple[Severity, str] | None:
    """How bad it is, and what it does; None: nothing."""
    if variable.name in SECURE and variable.value == SECURE[variable.name]:
        return None
    if variable.name == ENABLE:
        return Severity.CRITICAL, "there is no security unless the value is exactly 'true'"
    if variable.name == STRATEGY:
        follows = "it starts without security where its enclave does not load"
        return Severity.HIGH, f"unless the value is exactly 'Enforce', {follows}"
    if variable.name == RMW:
        return _harm_of_middleware(variable.value, context)
    if variable.name == DOMAIN:
        return _harm_of_domain(variable.value, context)
    return Severity.MEDIUM, "whether that is this keystore is not known"


def _harm_of_middleware(value: str | None, context: Context) -> tuple[Severity, str] | None:
    vendor = MIDDLEWARE.get(value or "")
    if value == "" or any(profile.name.rpartition("-")[0] == vendor for profile in context.profiles):
        return None
    return Severity.HIGH, "this report does not cover what that middleware enforces"


def _harm_of_domain(value: str | None, context: Context) -> tuple[Severity, str]:
    """As `_harm`. An empty value is as good as none: domain 0 (rcl, domain_id.c)."""
    asked = "ask with `--domain` what it may do there"
    digits = value if value != "" else "0"
    if digits is None or not (digits.isascii() and digits.isdigit() and len(digits) < _LONG):
        return Severity.MEDIUM, asked
    domain = int(digits)
    governances = [
        enclave.governance.governance for enclave in context.keystore.enclaves if enclave.governance is not None
    ]
    governed = [each is not None and _covers(each.domain_rules, domain, context) for each in governances]
    if governances and None not in governances and not any(governed):
        return Severity.HIGH, f"no governance covers domain {domain}: what starts there is not protected by any"
    if all(governed) and all(_is_granted(enclave, domain, context) for enclave in context.keystore.enclaves):
        return Severity.LOW, f"every enclave may be in domain {domain}; {asked}"
    return Severity.MEDIUM, asked


_LONG: Final = 10
"""Digits that no domain has."""


def _covers(rules: Iterable[DomainRule | PermissionsRule], domain: int, context: Context) -> bool:
    """Whether, however a chosen implementation reads ranges, one of the rules is about the domain."""
    readings = {profile.access.open_ranges for profile in context.profiles}
    return all(any(contains(covered(rule.domains, reading), domain) for rule in rules) for reading in readings)


def _is_granted(enclave: Enclave, domain: int, context: Context) -> bool:
    """Whether the enclave's own permissions allow something in the domain, to whomever."""
    return any(
        grant.default_allow or _covers([rule for rule in grant.rules if rule.allow], domain, context)
        for grant in enclave.grants
    )
