"""Changes between two keystores in words, for text and Markdown alike; raw names, escaped by whoever shows them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from keystore_audit.findings import Location
from keystore_audit.model.comparison import (
    Change,
    Comparison,
    Consequence,
    Direction,
    FailOn,
    Influenced,
    Layer,
    Name,
    Names,
    Unread,
)
from keystore_audit.model.domains import HIGHEST_DOMAIN, describe
from keystore_audit.model.names import ros_name

MAX_ENCLAVES: Final = 3
MAX_CONSEQUENCES: Final = 6

TITLES: Final = {
    Layer.TRUST: "Trust and protection",
    Layer.GRANTS: "Grants",
    Layer.ACCESS: "What peers accept",
    Layer.ATTACKERS: "What attackers can do",
    Layer.INFLUENCE: "Where data can get",
}
MARKS: Final = {
    Direction.GAINED: "+",
    Direction.LOST: "-",
    Direction.MIXED: "±",
    Direction.CHANGED: "~",
    Direction.INFO: "i",
}
_PROTECTION: Final = {
    Direction.GAINED: "Weaker protection",
    Direction.LOST: "Stronger protection",
    Direction.MIXED: "Protection weaker and stronger",
    Direction.CHANGED: "Other protection",
}
_COVERAGE: Final = {
    ("domain_rule", "true"): "now covered by a domain rule",
    ("domain_rule", "false"): "no longer covered by a domain rule",
    ("topic_rule", "true"): "now covered by a topic rule",
    ("topic_rule", "false"): "no longer covered by a topic rule",
}


def sentence(change: Change, comparison: Comparison) -> str:
    """The change as one sentence."""
    parts = [_subject(change)]
    if change.influenced is not None:
        parts.append(influence(change.influenced))
    if change.names is not None:
        parts.append(names(change.names))
    if change.aspects:
        parts.append(f"({'; '.join(_aspect(each.what, each.old, each.new) for each in change.aspects)})")
    words = " ".join(parts) + reasons(change.reasons)
    varies = ", not all of it under each" if change.varies else ""
    return f"{words}{under(change.profiles, comparison)}{varies}."


def _subject(change: Change) -> str:
    if change.kind == "protection":
        return f"{_PROTECTION[change.direction]} of"
    if not change.enclaves:
        return (
            f"Anybody {change.what}" if change.layer is Layer.ATTACKERS else change.what[:1].upper() + change.what[1:]
        )
    return _joined(change.enclaves, change.what)


def _joined(paths: Sequence[str], what: str) -> str:
    """A phrase about enclaves: verb phrases follow their paths, others come after a colon."""
    colon = ":" if what.startswith(("its ", "it ", "the ")) else ""
    return f"{enclaves(paths)}{colon} {what}"


def enclaves(paths: Sequence[str]) -> str:
    """The first of them, and how many more."""
    more = f" and {len(paths) - MAX_ENCLAVES} more" if len(paths) > MAX_ENCLAVES else ""
    return ", ".join(paths[:MAX_ENCLAVES]) + more


def consequence(each: Consequence, comparison: Comparison) -> str:
    """What follows, without a full stop."""
    if each.influenced is not None:
        return f"{each.what} {influence(each.influenced)}{under(each.profiles, comparison)}"
    who = _joined(each.enclaves, each.what) if each.enclaves else f"anybody on the network {each.what}"
    about = f" {names(each.names)}" if each.names is not None else ""
    return f"{who}{about}{reasons(each.reasons)}{under(each.profiles, comparison)}"


def influence(influenced: Influenced) -> str:
    """One way with all its hops, and how many other pairs there are."""
    way = influenced.way
    hops = f" → {way[0].sender}" + "".join(f" → {ros_name(hop.name.topic)} → {hop.receiver}" for hop in way)
    more = ""
    if influenced.pairs > 1:
        more = f", and between {_count(influenced.pairs - 1, 'more pair')} of enclaves"
    return f"from {way[0].sender} to {way[-1].receiver} ({hops[3:]}){more}"


def reasons(given: Iterable[str]) -> str:
    """Why, after a colon."""
    told = "; ".join(given)
    return f": {told}" if told else ""


def under(profiles: Sequence[str], comparison: Comparison) -> str:
    """Under which profiles, unless under all."""
    return "" if len(profiles) == len(comparison.profiles) else f" under {', '.join(profiles)}"


def names(several: Names) -> str:
    """The witnesses and how many others there are."""
    told = ", ".join(_name(each) for each in several.shown)
    if several.infinite:
        return f"{told} and infinitely many other names"
    if several.more:
        told += f" and {several.more} more"
    return f"{told} and others like them" if any(each.several for each in several.shown) else told


def _name(name: Name) -> str:
    partition = f" in partition {name.partition!r}" if name.partition else ""
    every = name.domains == ((0, HIGHEST_DOMAIN),)
    several = len(name.domains) > 1 or name.domains[0][0] != name.domains[0][1]
    domains = "every domain" if every else f"domain{'s' if several else ''} {describe(name.domains)}"
    return f"{ros_name(name.topic)}{partition} in {domains}"


def _aspect(what: str, old: str | None, new: str | None) -> str:
    covered = _COVERAGE.get((what, new or ""))
    return covered if covered is not None else f"{what}: {old or 'none'} → {new or 'none'}"


def place(location: Location | None) -> str | None:
    """File and line."""
    if location is None:
        return None
    return location.path if location.line is None else f"{location.path}:{location.line}"


def unread(each: Unread) -> str:
    """What could not be read."""
    whose = f" of {each.enclave}" if each.enclave is not None else ""
    return f"{each.side} {place(each.location)}{whose}: {each.reason}"


def verdict(comparison: Comparison, fail_on: FailOn) -> str:
    """The first line."""
    if comparison.unknown:
        return f"UNKNOWN: {_count(len(comparison.unknown), 'place')} could not be read"
    failing = len(comparison.failing(fail_on))
    counted = [change for change in comparison.changes if change.direction is not Direction.INFO]
    if not counted:
        return "NO CHANGE in meaning"
    if fail_on is FailOn.NONE or not failing:
        return f"PASS: {_count(len(counted), 'change')}, none that fails"
    return f"FAIL: {failing} of {_count(len(counted), 'change')} {'fails' if failing == 1 else 'fail'}"


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"
