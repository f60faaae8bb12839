"""sros2's mapping from ROS names to DDS permissions, as its permissions.xsl documents it (written anew).

What `ros2 security generate_artifacts` makes of a policy is compared with this in the tests.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from msgspec import Struct

from .documents import DISCOVERY, NOT_AFTER, NOT_BEFORE, Grant, Rule

ACTION_SERVICES = ("cancel_goal", "get_result", "send_goal")
ACTION_TOPICS = ("feedback", "status")
PARAMETER_SERVICES = (
    "~/describe_parameters",
    "~/get_parameter_types",
    "~/get_parameters",
    "~/list_parameters",
    "~/set_parameters",
    "~/set_parameters_atomically",
)


class Node(Struct, frozen=True, kw_only=True):
    """A `<profile>` of a policy: what one node may do, by ROS names (absolute, relative, or private: `~`)."""

    name: str
    namespace: str = "/"
    publish: tuple[str, ...] = ()
    subscribe: tuple[str, ...] = ()
    reply: tuple[str, ...] = ()
    request: tuple[str, ...] = ()
    execute: tuple[str, ...] = ()
    call: tuple[str, ...] = ()
    common: bool = True
    """Whether the policy includes sros2's common/node.xml: rosout, clock, parameter events and services."""

    def groups(self) -> Iterator[tuple[tuple[str, ...], tuple[str, ...]]]:
        """(published, subscribed) for each `<topics>`, `<services>` and `<actions>` element."""
        if self.common:
            yield self._topics(("rosout",)), ()
            yield (), self._topics(("/clock",))
            yield self._topics(("/parameter_events",)), self._topics(("/parameter_events",))
            yield (
                self._services("rr", PARAMETER_SERVICES, "Reply"),
                self._services("rq", PARAMETER_SERVICES, "Request"),
            )
            yield (
                self._services("rq", PARAMETER_SERVICES, "Request"),
                self._services("rr", PARAMETER_SERVICES, "Reply"),
            )
        yield self._topics(self.publish), ()
        yield (), self._topics(self.subscribe)
        yield self._services("rr", self.reply, "Reply"), self._services("rq", self.reply, "Request")
        yield self._services("rq", self.request, "Request"), self._services("rr", self.request, "Reply")
        yield self._answers(self.execute), self._goals(self.execute)
        yield self._goals(self.call), self._answers(self.call)

    def _topics(self, names: tuple[str, ...]) -> tuple[str, ...]:
        return self._services("rt", names, "")

    def _services(self, prefix: str, names: tuple[str, ...], suffix: str) -> tuple[str, ...]:
        return tuple(f"{prefix}{self._qualified(name)}{suffix}" for name in names)

    def _goals(self, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(f"rq{self._qualified(n)}/_action/{part}Request" for n in names for part in ACTION_SERVICES)

    def _answers(self, names: tuple[str, ...]) -> tuple[str, ...]:
        found: list[str] = []
        for name in names:
            found += (f"rr{self._qualified(name)}/_action/{part}Reply" for part in ACTION_SERVICES)
            found += (f"rt{self._qualified(name)}/_action/{part}" for part in ACTION_TOPICS)
        return tuple(found)

    def _qualified(self, name: str) -> str:
        namespace = self.namespace if self.namespace.endswith("/") else self.namespace + "/"
        if name.startswith("/"):
            return name
        if name.startswith("~"):
            return namespace + self.name + name[1:]
        return namespace + name


def grant(path: str, *nodes: Node, not_before: str = NOT_BEFORE, not_after: str = NOT_AFTER) -> Grant:
    """What sros2 grants an enclave in which `nodes` run: one allow rule, and one for discovery."""
    groups = [group for node in nodes for group in node.groups()]
    merged = Rule(
        publish=_merged(written for written, _read in groups),
        subscribe=_merged(read for _written, read in groups),
    )
    return Grant(path=path, not_before=not_before, not_after=not_after, rules=(merged, DISCOVERY))


def _merged(groups: Iterable[tuple[str, ...]]) -> tuple[str, ...]:
    """Groups in the order of their first names, each name once."""
    ordered = sorted((group for group in groups if group), key=lambda group: group[0])
    return tuple(dict.fromkeys(name for group in ordered for name in group))
