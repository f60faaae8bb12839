"""What protects a topic, and what may be done with it, in words."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from keystore_audit.model.safeguard import Safeguard

SHORT: Final = {
    "publish": "pub",
    "subscribe": "sub",
    "relay": "relay",
    "request": "req",
    "reply": "rep",
    "call": "call",
    "execute": "exec",
}
"""Operations as they stand in a matrix."""

_LAYERS: Final = {"data": "payload", "metadata": "submessages", "rtps": "RTPS messages"}


@lru_cache(maxsize=1024)  # hundreds of rows share a few
def protection_words(several: frozenset[tuple[Safeguard, ...]]) -> str:
    """A phrase; where governances differ, or topics that stand together, each."""
    phrases = dict.fromkeys(_words(each) for group in sorted(several, key=repr) for each in group)
    if len(phrases) == 1:
        return next(iter(phrases))
    return f"Protected in different ways: {' / '.join(phrases)}"


def _words(safeguard: Safeguard) -> str:
    if not safeguard.governed:
        return "No rule of the governance covers it: nobody can use it"
    open_ = "; participants without any identity are let in" if safeguard.unauthenticated else ""
    return f"{_secrecy(safeguard)}; {_control(safeguard)}{open_}"


def _secrecy(safeguard: Safeguard) -> str:
    if safeguard.encrypted:
        return f"Encrypted ({', '.join(_LAYERS[layer] for layer in safeguard.encrypted)})"
    if safeguard.authenticated:
        layers = ", ".join(_LAYERS[layer] for layer in safeguard.authenticated)
        return f"In clear for everybody on the network, but signed ({layers})"
    return "In clear for everybody on the network, and not signed"


def _control(safeguard: Safeguard) -> str:
    if safeguard.read_controlled and safeguard.write_controlled:
        return "publishing and subscribing need a grant"
    if safeguard.write_controlled:
        return "publishing needs a grant, any enclave may subscribe"
    if safeguard.read_controlled:
        return "subscribing needs a grant, any enclave may publish"
    return "any enclave may publish and subscribe"
