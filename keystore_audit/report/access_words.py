"""What tables of rights share, on a terminal and on a page, and what protects a topic, in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Final

from msgspec import Struct

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


class Protected(Struct, frozen=True, kw_only=True):
    """`kind`: a class of the style sheet. `rank`: 0 is the least protected. `mark`: its shape. `remark`: what is not as
    it should be, in a few words; empty where everything is encrypted and asks for a grant.
    """

    kind: str
    rank: int
    mark: str
    remark: str


_KINDS: Final = (
    ("clear", "▽"),
    ("signed", "◇"),
    ("loose", "△"),
    ("guarded", "●"),
    ("ungoverned", "×"),
)
"""In clear; signed only; encrypted, and open to every enclave; encrypted and granted; covered by no rule."""


@lru_cache(maxsize=1024)  # hundreds of rows share a few
def protected(several: frozenset[tuple[Safeguard, ...]]) -> Protected:
    """The worst of what protects topics that stand together."""
    safeguards = {safeguard for group in several for safeguard in group}
    rank = min((_rank(safeguard) for safeguard in safeguards), default=len(_KINDS) - 1)
    remarks = dict.fromkeys(_remark(each) for each in sorted(safeguards, key=repr) if _rank(each) == rank)
    kind, mark = _KINDS[rank]
    return Protected(kind=kind, rank=rank, mark=mark, remark="; ".join(remark for remark in remarks if remark))


def _rank(safeguard: Safeguard) -> int:
    if not safeguard.governed:
        return 4
    if not safeguard.encrypted:
        return 1 if safeguard.authenticated else 0
    controlled = safeguard.read_controlled and safeguard.write_controlled and not safeguard.unauthenticated
    return 3 if controlled else 2


def _remark(safeguard: Safeguard) -> str:
    if not safeguard.governed:
        return "covered by no rule"
    remarks = []
    if not safeguard.encrypted:
        remarks.append("signed, in clear" if safeguard.authenticated else "in clear, not signed")
    if not safeguard.write_controlled:
        remarks.append("any enclave may publish")
    if not safeguard.read_controlled:
        remarks.append("any enclave may subscribe")
    if safeguard.unauthenticated:
        remarks.append("strangers are let in")
    return ", ".join(remarks)
