"""Pairs for KA909 and KA910: findings that somebody accepts (`sample_keystores/suppressions/`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from .base import TALKER_CERTIFICATE, with_talker
from .certificates import day
from .story import Story

STORE = with_talker(
    certificate=replace(TALKER_CERTIFICATE, not_after=day(2026, 12, 5)),
)
"""The talker's identity ends soon (KA205)."""


def stories() -> Iterator[Story]:
    """Both pairs."""
    for code, name, file, text in (
        (
            "KA909",
            "suppression-expired",
            "ended",
            "That the talker's identity ends soon was accepted until 20 November 2026, which is over: it counts again.",
        ),
        (
            "KA910",
            "suppression-unused",
            "unused",
            "That an identity ends soon is accepted of the listener, and there is no listener. It is the talker's.",
        ),
    ):
        yield _story(code, name, "bad", file, text)
        yield _story(
            code, name, "good", "current", "That the talker's identity ends soon is accepted until 4 December 2026."
        )


def _story(code: str, name: str, side: str, file: str, text: str) -> Story:
    return Story(
        directory=f"rules/{code}-{name}/{side}",
        rule=code,
        text=text,
        tree=STORE.tree(),
        options=("--settings", f"suppressions/{file}.toml"),
    )
