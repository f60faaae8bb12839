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
            "The graph shows the talker publish /chatter and its log, but the permissions allow only the log. Under "
            "Enforce it fails when it creates its publisher.",
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
        good=Case("The permissions let the talker publish only what it does.", _publishing(*SEEN)),
    )
    seen = _publishing(*SEEN)
    yield from pair(
        "KA652",
        options=GRAPH,
        bad=Case(
            "The graph has the talker in the enclave /talker, but the keystore has only the listener's: under "
            "Enforce the talker does not start.",
            replace(seen, enclaves=(LISTENER,)),
        ),
        good=Case("The keystore has both enclaves.", _both(seen)),
    )


def _launches() -> Iterator[Story]:
    yield from pair(
        "KA653",
        options=LAUNCH,
        bad=Case(
            "The launch file calls the talker's topic /chatter, but the talker may do nothing with that name: its "
            "permissions still say /talk.",
            with_talker(
                permissions=Permissions(grants=(grant("/talker", Node(name="talker", publish=("talk",))),)),
            ),
        ),
        good=Case("The talker may publish under its name.", LAUNCHED),
    )
    yield from pair(
        "KA654",
        bad=Case(
            "The launch file includes one from a package that is not here. What that starts is unknown, so no grant "
            "is called an excess.",
            LAUNCHED,
            ELSEWHERE,
        ),
        good=Case("The launch file is complete.", LAUNCHED, LAUNCH),
    )
    yield from pair(
        "KA655",
        bad=Case("The launch file switches security off for the talker.", LAUNCHED, UNSECURED),
        good=Case("The launch file says nothing of security.", LAUNCHED, LAUNCH),
    )


def _publishing(*topics: str) -> Store:
    return with_rules(Rule(publish=topics))


def _both(store: Store) -> Store:
    return replace(store, enclaves=(*store.enclaves, LISTENER))
