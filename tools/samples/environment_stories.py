"""Pairs for KA67x: a keystore, and the environment that its robots start with (`sample_keystores/environments/`)."""

from __future__ import annotations

from collections.abc import Iterator

from .base import ONE, TWO
from .store import Store
from .story import Case, Story, pair

RIGHT = "right"
"""The environment in which everything is as it should be."""


def stories() -> Iterator[Story]:
    """All pairs of KA67x."""
    for code, bad, text in (
        ("KA670", "not_enabled", "Somebody switched security off to look for a fault, and the line stayed."),
        ("KA671", "not_enforced", "ROS_SECURITY_STRATEGY says 'enforce', but only 'Enforce' counts."),
        ("KA672", "no_such_enclave", "The override names /talkers, but the enclave is /talker."),
        ("KA674", "no_keystore", "Nothing says where the keystore is."),
        ("KA675", "no_domain", "ROS_DOMAIN_ID is 300, but domains end at 232."),
        ("KA676", "zenoh", "The robot runs rmw_zenoh_cpp, which reads neither the governance nor the permissions."),
        ("KA677", "galactic", "The robot runs ROS 2 Galactic, whose releases of Fast DDS nobody maintains."),
    ):
        yield from _pair(code, bad, text, ONE)
    several = "Every process is /talker, though the listener has its own enclave."
    yield from _pair("KA673", "one_for_all", several, TWO)


def _pair(code: str, bad: str, text: str, store: Store) -> Iterator[Story]:
    right = "Security is enabled and enforced."
    return pair(code, bad=Case(text, store, _env(bad)), good=Case(right, store, _env(RIGHT)))


def _env(name: str) -> tuple[str, ...]:
    return ("--env", f"environments/{name}.env")
