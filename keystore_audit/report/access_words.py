"""What tables of rights share, on a terminal and on a page, and what protects a topic, in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Final

from keystore_audit.model.formal.safeguard import Safeguard
from keystore_audit.model.tables.access_rows import Row

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


def namespace(path: str) -> str:
    """That of an enclave."""
    return path.rpartition("/")[0]


def full_name(row: Row) -> str:
    """What a row of a matrix is about, raw text."""
    return row.label + (" (not in ROS 2)" if row.dds_only else "")


def rights(rows: Iterable[Row]) -> dict[str, list[tuple[int, tuple[str, ...]]]]:
    """By enclave the numbers of the rows in which it may do something, and what."""
    found: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
    for number, row in enumerate(rows):
        for path, words in row.cells.items():
            found.setdefault(path, []).append((number, tuple(words)))
    return found


def worth_showing(rows: Sequence[Row], wanted: Iterable[int]) -> list[Row]:
    """The rows with these numbers, and with a pattern among them those that take something out of one."""
    numbers = set(wanted)
    if any(rows[number].several for number in numbers):  # what they may not do is news then
        numbers.update(number for number, row in enumerate(rows) if row.excepted)
    return [rows[number] for number in sorted(numbers)]


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
