"""Keystores and properties in Alloy that users ask of them (`sample_keystores/alloy_properties/`)."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import LISTENER_GRANT, PROVEN, governed, with_listener
from .documents import Permissions, Rule
from .store import Store
from .story import Case, Story, pair

ASKED = ("--engine", "both", "--alloy-property", "alloy_properties/chatter.als")
"""Alloy alone decides: the native engine by itself leaves them open."""


def stories() -> Iterator[Story]:
    """The pair of KA741."""
    yield from pair(
        "KA741",
        bad=Case(
            "An Alloy property says that only the talker publishes /chatter, but the listener may too.",
            _listener("rt/chatter"),
        ),
        good=Case("The listener may publish only /answer.", _listener("rt/answer")),
        options=ASKED,
    )


def _listener(published: str) -> Store:
    rules = (Rule(publish=(published,), subscribe=("rt/chatter",)),)
    return governed(with_listener(permissions=Permissions(grants=(replace(LISTENER_GRANT, rules=rules),))), PROVEN)
