"""What protects the samples of a topic, and whose rights are asked for: the governance in force, topic by topic."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from msgspec import Struct

from keystore_audit.model.formal.attacker import enclaves_views
from keystore_audit.model.formal.protection import Protection
from keystore_audit.model.formal.system import System

LAYERS: Final[Mapping[str, tuple[str, str]]] = {
    "data": ("data_encrypts", "data_authenticates"),
    "metadata": ("metadata_encrypts", "metadata_authenticates"),
    "rtps": ("rtps_encrypts", "rtps_authenticates"),
}
"""The layers that a governance protects, as its elements call them, with the fields of `Protection`."""


class Safeguard(Struct, frozen=True, kw_only=True):
    """`encrypted`, `authenticated`: the layers (keys of `LAYERS`) that are. `read_controlled`, `write_controlled`:
    whether rights are asked for. Not `governed`: no topic rule covers the topic, so nobody can use it.
    `unauthenticated`: participants without any identity are let in.
    """

    governed: bool
    encrypted: tuple[str, ...] = ()
    authenticated: tuple[str, ...] = ()
    read_controlled: bool = True
    write_controlled: bool = True
    unauthenticated: bool = False


def safeguards(system: System, channels: range, domain: int) -> tuple[tuple[Safeguard, ...], ...]:
    """By channel, all of one domain class: what the governances of the realms say of it, each different one once.

    A realm whose governance could not be read, or is not in force in the domain, says nothing, unless none does.
    """
    views = enclaves_views(system)
    spoken = [view.protection for view in views if not view.open and view.protection.ruled >> domain & 1]
    distinct = list({_key(protection): protection for protection in spoken}.values())
    return tuple(
        tuple(dict.fromkeys(_safeguard(protection, channel, domain) for protection in distinct))
        or (Safeguard(governed=False),)
        for channel in channels
    )


def _key(protection: Protection) -> tuple[int, ...]:
    return tuple(getattr(protection, name) for name in Protection.__struct_fields__)


def _safeguard(protection: Protection, channel: int, domain: int) -> Safeguard:
    def holds(names: Iterable[int]) -> tuple[str, ...]:
        return tuple(layer for layer, field in zip(LAYERS, names, strict=True) if field >> channel & 1)

    if not protection.governed >> channel & 1:
        return Safeguard(governed=False)
    return Safeguard(
        governed=True,
        encrypted=holds(getattr(protection, encrypts) for encrypts, _signs in LAYERS.values()),
        authenticated=holds(getattr(protection, signs) for _encrypts, signs in LAYERS.values()),
        read_controlled=bool(protection.read_controlled >> channel & 1),
        write_controlled=bool(protection.write_controlled >> channel & 1),
        unauthenticated=bool(protection.unauthenticated >> domain & 1),
    )
