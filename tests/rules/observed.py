"""Graphs and launch files as values, and what the rules say of them beside a keystore."""

from __future__ import annotations

from typing import Any

from keystore_audit.findings import Finding, Location
from keystore_audit.intent.intent import (
    Action,
    IntendedNode,
    IntendedRight,
    Intent,
    Origin,
    SetVariable,
    Unresolved,
    UsedName,
)
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.intended.observed import Observation, observe
from keystore_audit.model.intended.observed_needs import Usual, usual_rights
from keystore_audit.model.inventory import documents_of
from keystore_audit.rules.judge import Judgement, judge
from tests.rules.divergent import chosen
from tests.rules.evidence import AT, allow, context, enclave, grant, keystore, permissions, rules_of

FILE = "robot.graph.json"
DISCOVERY = allow(["ros_discovery_info"], ["ros_discovery_info"])


def place(line: int, path: str = FILE) -> Location:
    return Location(path=path, line=line, beside=True)


def node(enclave: str, name: str | None = None, line: int = 1) -> IntendedNode:
    return IntendedNode(enclave=enclave, name=name or enclave, location=place(line))


def does(enclave: str, action: str, name: str, *, line: int = 2) -> IntendedRight:
    return IntendedRight(
        enclave=enclave, node=enclave, action=Action(action), name=name, allow=True, location=place(line)
    )


def uses(enclave: str, name: str, line: int = 3) -> UsedName:
    return UsedName(enclave=enclave, node=enclave, name=name, location=place(line))


def log(enclave: str) -> IntendedRight:
    """What shows that the graph is complete: it lists what every node does."""
    return does(enclave, "publish", "/rosout")


def graph(*rights: IntendedRight, nodes: tuple[IntendedNode, ...] | None = None, **more: Any) -> Intent:
    """A graph of these rights, by nodes that have the name of their enclave."""
    shown = {right.enclave: node(right.enclave) for right in rights}
    more = {"origin": Origin.GRAPH, "path": FILE, "files": (), "enclaves": (), **more}
    return Intent(nodes=tuple(shown.values()) if nodes is None else nodes, rights=rights, **more)


def variable(name: str, value: str | None) -> SetVariable:
    """What the launch file sets for the talker."""
    return SetVariable(node="/talker", name=name, value=value, location=place(3))


def launch(
    *names: UsedName,
    nodes: tuple[IntendedNode, ...] = (),
    unresolved: tuple[str, ...] = (),
    variables: tuple[SetVariable, ...] = (),
    speaking: tuple[str, ...] = (),
) -> Intent:
    """A launch file that remaps these names."""
    return Intent(
        origin=Origin.LAUNCH,
        path=FILE,
        files=(),
        enclaves=(),
        nodes=nodes,
        rights=(),
        names=names,
        unresolved=tuple(Unresolved(location=place(9), reason=reason) for reason in unresolved),
        variables=variables,
        speaking=tuple(Unresolved(location=place(number), reason=said) for number, said in enumerate(speaking, 7)),
    )


def granted(*rules: Any, path: str = "/talker", usual: bool = True, **more: Any) -> Keystore:
    """/talker and /listener; the first with these rules, what every node does and discovery."""
    rules = (*rules, *(usual_rules(path) if usual else ()), DISCOVERY)
    own = permissions(f"enclaves{path}/permissions.p7s", grant(path, *rules, **more))
    return keystore(enclave(path, permissions=own), enclave("/listener"))


def usual_rules(path: str) -> tuple[Any, ...]:
    """What every node needs."""
    from keystore_audit.keystore.typed import Operation
    from keystore_audit.model.names import dds_channels

    channels = [
        channel
        for action, name, usual in usual_rights(path)
        if usual is Usual.ALWAYS
        for channel in dds_channels(action.value, name)
    ]
    publish, subscribe = (
        [topic for operation, topic in channels if operation is wanted]
        for wanted in (Operation.PUBLISH, Operation.SUBSCRIBE)
    )
    return (allow(publish, subscribe),)


def observed(store: Keystore, *intents: Intent, names: tuple[str, ...] = (), domain: int | None = None) -> Observation:
    accesses = AccessViews(documents_of(store), AT, None)
    return observe(intents, store, chosen(*names), AT, accesses, domain)


def judged(store: Keystore, *intents: Intent, names: tuple[str, ...] = (), domain: int | None = None) -> Judgement:
    found = observed(store, *intents, names=names, domain=domain)
    return judge(context(store, profiles=chosen(*names), observed=found), rules_of("observed"))


def spoken(store: Keystore, *intents: Intent, **more: Any) -> tuple[Finding, ...]:
    return judged(store, *intents, **more).findings
