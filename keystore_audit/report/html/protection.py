"""How what protects a topic looks: a shape, a word for it in class names, and a phrase."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

from msgspec import Struct

from keystore_audit.model.formal.safeguard import Safeguard


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
