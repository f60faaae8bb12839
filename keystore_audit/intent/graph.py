"""A running ROS graph, as `keystore-audit-record` writes it down: schemas/graph.schema.json, docs/intent.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, NoReturn

from keystore_audit.findings import Location
from keystore_audit.intent.intent import (
    Action,
    IntendedNode,
    IntendedRight,
    Intent,
    Origin,
    is_node_name,
    is_path,
    is_ros_name,
    joined,
)
from keystore_audit.intent.source import Source, Value, parse_json, read_source, shown
from keystore_audit.keystore.defect import Malformed

SCHEMA_VERSION: Final = 1
"""The form that is read; another number is another form."""

ENDPOINTS: Final[Mapping[str, tuple[Action, str]]] = {
    "publishers": (Action.PUBLISH, "topic"),
    "subscribers": (Action.SUBSCRIBE, "topic"),
    "service_servers": (Action.REPLY, "service"),
    "service_clients": (Action.REQUEST, "service"),
    "action_servers": (Action.EXECUTE, "action"),
    "action_clients": (Action.CALL, "action"),
}
"""Lists of a node, what each entry lets it do, and the key of the entry that holds the name."""


def read_graph(path: Path) -> Intent:
    """Read the graph in the file at `path`; every right has the line of its entry.

    Raises UsageError, naming file and line, for what is not of the form: wrong JSON, unknown or missing keys, names
    that are not fully qualified. Nodes of one name in one enclave are one node: ROS 2 only warns of them.
    """
    source = read_source(path)
    try:
        document = parse_json(source.text)
    except Malformed as error:
        raise source.malformed(error.line, error.detail) from None
    return _Graph(source).intent(document)


class _Graph:
    """One graph being read."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._enclaves: dict[str, Location] = {}
        self._nodes: dict[tuple[str, str], IntendedNode] = {}
        self._rights: dict[tuple[str, str, Action, str], IntendedRight] = {}

    def intent(self, document: Value) -> Intent:
        entries = self._object(document, "the graph", ("schema_version", "nodes"))
        version = entries["schema_version"]
        if version.content is True or version.content != SCHEMA_VERSION:
            self._refuse(version, f"expected schema_version {SCHEMA_VERSION}, the form that is read")
        for node in self._array(entries["nodes"], "nodes"):
            self._node(node)
        return Intent(
            origin=Origin.GRAPH,
            path=self._source.path,
            files=(self._source.file,),
            enclaves=tuple(self._enclaves.items()),
            nodes=tuple(self._nodes.values()),
            rights=tuple(self._rights.values()),
        )

    def _node(self, node: Value) -> None:
        entries = self._object(node, "a node", ("name", "namespace", "enclave"), tuple(ENDPOINTS))
        name = self._text(entries["name"], "the name of a node without its namespace", is_node_name)
        namespace = self._text(entries["namespace"], "a namespace like '/' or '/robot'", is_path)
        enclave = self._text(entries["enclave"], "an enclave like '/' or '/robot'", is_path)
        full = joined(namespace, name)
        location = self._source.location(node.line)
        self._enclaves.setdefault(enclave, location)
        self._nodes.setdefault((enclave, full), IntendedNode(enclave=enclave, name=full, location=location))
        for key in (key for key in ENDPOINTS if key in entries):
            action, named = ENDPOINTS[key]
            for entry in self._array(entries[key], key):
                endpoint = self._object(entry, f"an entry of {key}", (named,), ("type",))
                right = IntendedRight(
                    enclave=enclave,
                    node=full,
                    action=action,
                    name=self._text(endpoint[named], "a fully qualified name like '/chatter'", is_ros_name),
                    allow=True,
                    location=self._source.location(endpoint[named].line),
                )
                if "type" in endpoint:
                    self._text(endpoint["type"], "the name of a type", lambda _name: True)
                self._rights.setdefault((enclave, full, action, right.name), right)  # a topic may have two types

    def _text(self, value: Value, expected: str, valid: Callable[[str], bool]) -> str:
        if not isinstance(value.content, str):
            self._refuse(value, f"expected {expected}, in quotes")
        if not valid(value.content):
            self._refuse(value, f"expected {expected}, found {shown(value.content)}")
        return value.content

    def _array(self, value: Value, what: str) -> tuple[Value, ...]:
        if not isinstance(value.content, tuple):
            self._refuse(value, f"expected an array of {what}")
        return value.content

    def _object(
        self, value: Value, what: str, required: tuple[str, ...], optional: tuple[str, ...] = ()
    ) -> Mapping[str, Value]:
        content = value.content
        if not isinstance(content, Mapping):
            self._refuse(value, f"expected an object for {what}")
        for key, entry in content.items():
            if key not in required + optional:
                known = ", ".join(required + optional)
                self._refuse(entry, f"expected of {what} the keys {known}; found {shown(key)}")
        for key in required:
            if key not in content:
                self._refuse(value, f"expected {what} to have the key {key!r}, and there is none")
        return content

    def _refuse(self, value: Value, detail: str) -> NoReturn:
        raise self._source.malformed(value.line, detail)
