"""Pairs for KA65x: a keystore, and the graph or launch file of the nodes that use it (`graphs/`, `launch/`)."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import LISTENER, with_rules, with_talker
from .documents import Permissions, Rule
from .policy import Node, grant
from .store import Store
from .story import Case, Story, pair

GRAPH = ("--graph", "graphs/talker.graph.json")
LAUNCH = ("--launch", "launch/talker.launch.xml")
UNSECURED = ("--launch", "launch/talker-unsecured.launch.xml")
ELSEWHERE = ("--launch", "launch/talker-elsewhere.launch.xml")

SEEN = ("rt/chatter", "rt/rosout")
"""What the graph shows the talker to publish."""

LAUNCHED = with_talker(permissions=Permissions(grants=(grant("/talker", Node(name="talker", publish=("chatter",))),)))
"""The talker with what every node has."""


def stories() -> Iterator[Story]:
    """All pairs of KA65x."""
    yield from _graphs()
    yield from _launches()


def _graphs() -> Iterator[Story]:
    yield from pair(
        "KA650",
        options=GRAPH,
        bad=Case(
            "The graph was taken with security off. It shows the talker publish /chatter and its log, and the "
            "permissions know of the log alone: under Enforce the talker fails when it makes its publisher.",
            _publishing("rt/rosout"),
        ),
        good=Case("The permissions let the talker publish both.", _publishing(*SEEN)),
    )
    yield from pair(
        "KA651",
        options=GRAPH,
        bad=Case(
            "The talker may publish /cmd_vel, which it never does in the graph: whoever takes it over drives.",
            _publishing(*SEEN, "rt/cmd_vel"),
        ),
        good=Case("The permissions let the talker publish what it does, and no more.", _publishing(*SEEN)),
    )
    seen = _publishing(*SEEN)
    yield from pair(
        "KA652",
        options=GRAPH,
        bad=Case(
            "The graph has the talker in the enclave /talker, and the keystore has none but the listener's: under "
            "Enforce the talker does not start.",
            replace(seen, enclaves=(LISTENER,)),
        ),
        good=Case("The keystore has the talker's enclave beside the listener's.", _both(seen)),
    )


def _launches() -> Iterator[Story]:
    yield from pair(
        "KA653",
        options=LAUNCH,
        bad=Case(
            "The launch file gives the talker's topic the name /chatter, and the talker may do nothing with that name: "
            "its permissions are of the time when the topic was called /talk.",
            with_talker(
                permissions=Permissions(grants=(grant("/talker", Node(name="talker", publish=("talk",))),)),
            ),
        ),
        good=Case("The talker may publish under the name that it has.", LAUNCHED),
    )
    yield from pair(
        "KA654",
        bad=Case(
            "The launch file includes another from a package that is not here. What that one starts is not known, so "
            "that no grant is called an excess.",
            LAUNCHED,
            ELSEWHERE,
        ),
        good=Case("The launch file says everything itself.", LAUNCHED, LAUNCH),
    )
    yield from pair(
        "KA655",
        bad=Case("The launch file switches security off for the talker: it starts without any.", LAUNCHED, UNSECURED),
        good=Case("The launch file says nothing of security.", LAUNCHED, LAUNCH),
    )


def _publishing(*topics: str) -> Store:
    return with_rules(Rule(publish=topics))


def _both(store: Store) -> Store:
    return replace(store, enclaves=(*store.enclaves, LISTENER))
