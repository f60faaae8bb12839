"""Keystores whose enclaves have labels (`sample_keystores/settings/labels.toml`)."""

from __future__ import annotations

from collections.abc import Iterator

from .flow_stories import answering
from .story import Case, Story, pair

LABELS = ("--settings", "settings/labels.toml")


def stories() -> Iterator[Story]:
    """The pair of KA742."""
    yield from pair(
        "KA742",
        bad=Case(
            "The talker is trusted and the listener is not, and nothing untrusted may reach what is trusted; the "
            "listener may publish /answer, to which the talker subscribes.",
            answering("rt/answer"),
        ),
        good=Case("Nobody subscribes to what the untrusted listener publishes.", answering("rt/question")),
        options=LABELS,
    )
