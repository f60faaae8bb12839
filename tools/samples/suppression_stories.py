"""Pairs for KA909 and KA910: findings that somebody accepts (`sample_keystores/suppressions/`)."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from .base import TALKER_CERTIFICATE, with_talker
from .certificates import day
from .story import Case, Story, pair

STORE = with_talker(
    certificate=replace(TALKER_CERTIFICATE, not_after=day(2026, 12, 5)),
)
"""The talker's identity ends soon (KA205)."""


def stories() -> Iterator[Story]:
    """Both pairs."""
    for code, file, text in (
        (
            "KA909",
            "ended",
            "That the talker's identity ends soon was accepted until 20 November 2026. Now it counts again.",
        ),
        (
            "KA910",
            "unused",
            "It is accepted that the listener's identity ends soon, but there is only a talker.",
        ),
    ):
        current = "It is accepted until 4 December 2026 that the talker's identity ends soon."
        yield from pair(code, bad=_case(text, file), good=_case(current, "current"))


def _case(text: str, file: str) -> Case:
    return Case(text, STORE, ("--settings", f"suppressions/{file}.toml"))
