"""The list of reasons for which we leave open what OpenSSL accepts: `stricter.toml`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from keystore_audit import toml

Reason = tuple[str, str]
"""Kind of a defect, and what it says: `comparison.said`."""


@lru_cache(maxsize=1)
def listed() -> Mapping[Reason, frozenset[str]]:
    """The named cases of each reason; none where only random mutations show it."""
    data = toml.loads((Path(__file__).parent / "stricter.toml").read_text(encoding="utf-8"))
    found = {}
    for entry in data["class"]:
        assert entry["reason"], entry
        found[entry["kind"], entry["says"]] = frozenset(entry["cases"])
    assert len(found) == len(data["class"]), "no class stands there twice"
    return found
