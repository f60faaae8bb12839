"""Which nodes there are and how they are wired, as graphs, launch files and policies say it, in one system."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.intent.intent import Intent, Origin
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import LayoutKind
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.channels import Channels, ReadRegion
from keystore_audit.model.claims.globs import region_of
from keystore_audit.model.formal.system import NodeAtom, System
from keystore_audit.model.intended.observed_needs import DISCOVERY, Usual, in_layout, missing_usual
from keystore_audit.model.names import Use, dds_channels, dds_expressions


class WiredNode(Struct, frozen=True, kw_only=True):
    """A node of the enclave (its path), and what it is there to do; `denied`: what a policy takes away from that."""

    enclave: str
    name: str
    location: Location
    uses: frozenset[Use]
    denied: frozenset[Use]


def wiring(intents: Sequence[Intent], kind: LayoutKind) -> tuple[WiredNode, ...]:
    """The nodes of the files, in their order, one for each name and enclave.

    What every node does is among it, where a graph or a launch file does not say so. Names of which a launch file does
    not say how they are used are left out.
    """
    places: dict[tuple[str, str], Location] = {}
    uses: dict[tuple[str, str], set[Use]] = {}
    denied: dict[tuple[str, str], set[Use]] = {}
    for intent in in_layout(intents, kind):
        for node in intent.nodes:
            key = (node.enclave, node.name)
            places.setdefault(key, node.location)
            uses.setdefault(key, set()).update(DISCOVERY)
        for right in intent.rights:
            key = (right.enclave, right.node)
            places.setdefault(key, right.location)
            points = dds_expressions(right.action.value, right.name)
            (uses if right.allow else denied).setdefault(key, set()).update(points)
        for node, action, name in missing_usual(intent, frozenset({Usual.ALWAYS})):
            if intent.origin is not Origin.POLICY:
                uses[node.enclave, node.name].update(dds_channels(action.value, name))
    return tuple(
        WiredNode(
            enclave=enclave,
            name=name,
            location=place,
            uses=frozenset(uses.get((enclave, name), ())),
            denied=frozenset(denied.get((enclave, name), ())),
        )
        for (enclave, name), place in places.items()
    )


def wiring_regions(nodes: Iterable[WiredNode]) -> tuple[ReadRegion, ...]:
    """The topics that nodes use: they take part in the classes, so that wires are exact."""
    points = {topic: None for node in nodes for _operation, topic in sorted({*node.uses, *node.denied})}
    return tuple(region_of((topic,)) for topic in points)


def with_nodes(
    systems: Sequence[System], nodes: Sequence[WiredNode], channels: Channels, keystore: Keystore
) -> tuple[System, ...]:
    """The systems with the nodes as facts. Nodes use the default partition, and every domain that is governed."""
    if not nodes:
        return tuple(systems)
    known = {enclave.path for enclave in keystore.enclaves}
    by_topic = {topic: _in_default_partition(channels, topic) for topic in _topics(nodes)}
    return tuple(replace(system, nodes=tuple(_atoms(system, nodes, by_topic, known))) for system in systems)


def _topics(nodes: Iterable[WiredNode]) -> set[str]:
    return {topic for node in nodes for _operation, topic in (*node.uses, *node.denied)}


def _in_default_partition(channels: Channels, topic: str) -> frozenset[int]:
    """The channels of the topic whose class of partitions has the default one: it is the witness of such a class."""
    return frozenset(n for n in channels.regions[region_of((topic,))] if channels.channels[n].partition == "")


def _atoms(
    system: System, nodes: Iterable[WiredNode], by_topic: Mapping[str, frozenset[int]], known: set[str]
) -> Iterator[NodeAtom]:
    places = {enclave.label: n for n, enclave in enumerate(system.enclaves) if enclave.label in known}

    def channels(node: WiredNode, operation: Operation) -> frozenset[int]:
        used = frozenset[int]().union(*(by_topic[topic] for each, topic in node.uses if each is operation))
        return used.difference(*(by_topic[topic] for each, topic in node.denied if each is operation))

    for node in nodes:
        yield NodeAtom(
            label=node.name or node.enclave,
            location=node.location,
            enclave=places.get(node.enclave),
            publishes=channels(node, Operation.PUBLISH),
            subscribes=channels(node, Operation.SUBSCRIBE),
        )
