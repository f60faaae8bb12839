"""Pairs for KA67x: a keystore, and the environment that its robots start with (`sample_keystores/environments/`)."""

from __future__ import annotations

from collections.abc import Iterator

from .base import ONE, TWO
from .store import Store
from .story import Story

RIGHT = "right"
"""The environment in which everything is as it should be."""


def stories() -> Iterator[Story]:
    """All pairs of KA67x."""
    for code, name, bad, text in (
        (
            "KA670",
            "security-not-enabled",
            "not_enabled",
            "Somebody switched security off to look for a fault, and the line stayed.",
        ),
        (
            "KA671",
            "security-not-enforced",
            "not_enforced",
            "ROS_SECURITY_STRATEGY says 'enforce', and only 'Enforce' is it.",
        ),
        (
            "KA672",
            "override-names-no-enclave",
            "no_such_enclave",
            "The override names /talkers, and the enclave is /talker.",
        ),
        ("KA674", "no-keystore-named", "no_keystore", "Nothing says where the keystore is."),
        ("KA675", "domain-id-invalid", "no_domain", "ROS_DOMAIN_ID is 300, and domains end at 232."),
        (
            "KA676",
            "middleware-not-modelled",
            "zenoh",
            "The robot runs rmw_zenoh_cpp, which reads neither the governance nor the permissions.",
        ),
        (
            "KA677",
            "distribution-not-modelled",
            "galactic",
            "The robot runs ROS 2 Galactic, whose releases of Fast DDS nobody maintains.",
        ),
    ):
        yield from _pair(code, name, bad, text, ONE)
    yield from _pair(
        "KA673",
        "override-for-every-process",
        "one_for_all",
        "Every process is /talker, though there is a listener with an enclave of its own.",
        TWO,
    )


def _pair(code: str, name: str, bad: str, text: str, store: Store) -> Iterator[Story]:
    for side, environment in (("bad", bad), ("good", RIGHT)):
        yield Story(
            directory=f"rules/{code}-{name}/{side}",
            rule=code,
            text=text if side == "bad" else "The environment enables and enforces security, as it should.",
            tree=store.tree(),
            options=("--env", f"environments/{environment}.env"),
        )
