"""Changes between two keystores in words, for text and Markdown alike; raw names, escaped by whoever shows them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.assumptions import CONDITIONS, Needed
from keystore_audit.keystore.document import MAX_DOMAIN
from keystore_audit.model.comparison.change import (
    Aspect,
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
from keystore_audit.model.comparison.others import SUBJECT
from keystore_audit.model.domains import Interval, describe
from keystore_audit.model.names import ros_name
from keystore_audit.report.content import answered_if
from keystore_audit.text import counted, some

MAX_ENCLAVES: Final = 3
MAX_CONSEQUENCES: Final = 6

TITLES: Final = {
    Layer.TRUST: "Trust and protection",
    Layer.GRANTS: "Grants",
    Layer.ACCESS: "What peers accept, and own endpoints",
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
    Direction.MIXED: "Weaker and stronger protection",
    Direction.CHANGED: "Other protection",
}
_COVERAGE: Final = {
    ("domain_rule", "true"): "Now covered by a domain rule",
    ("domain_rule", "false"): "No longer covered by a domain rule",
    ("topic_rule", "true"): "Now covered by a topic rule",
    ("topic_rule", "false"): "No longer covered by a topic rule",
}
_LISTED: Final = ("identity CA", "permissions CA", "revoked", "private key")
"""Aspects of which only what came and what went is told."""


_PATH, _ABOVE = "\0", "\1"
"""Stand for an enclave's path and for the path above it; neither is in a name (XML 1.0, 2.2)."""


def sentence(change: Change, comparison: Comparison) -> str:
    """The change as one sentence."""
    parts = [_subject(change, comparison)]
    if change.influenced is not None:
        parts.append(influence(change.influenced))
    if change.names is not None:
        parts.append(_domains(change.names.domains) if change.operation == "join" else names(change.names))
    aspects = [
        _aspect(each) for each in change.aspects if each.what != SUBJECT and (each.what, each.new) not in _COVERAGE
    ]
    if aspects:
        parts.append(f"({'; '.join(aspects)})")
    words = " ".join(parts) + reasons(change.reasons, change.direction)
    varies = ", not all of it under each" if change.varies else ""
    about = f" [{', '.join(change.labels)}]" if change.labels else ""
    return f"{words}{under(change.profiles, comparison)}{varies}.{about}"


def _subject(change: Change, comparison: Comparison) -> str:
    if change.kind == "protection":
        covered = [_COVERAGE.get((each.what, each.new or "")) for each in change.aspects]
        whom = f" for {enclaves(change.enclaves)}" if len(change.enclaves) < comparison.common else ""
        return f"{covered[0]}{whom}:" if covered[0] is not None else f"{_PROTECTION[change.direction]}{whom} of"
    if not change.enclaves:
        return (
            f"Anybody {change.what}" if change.layer is Layer.ATTACKERS else change.what[:1].upper() + change.what[1:]
        )
    return _joined(change.enclaves, change.what)


def _joined(paths: Sequence[str], what: str) -> str:
    """A phrase about enclaves: verb phrases follow their paths, others come after a colon."""
    colon = ":" if what.startswith(("its ", "it ", "the ")) else ""
    return f"{enclaves(paths)}{colon} {what}"


REMEDY: Final = (
    "Peers of NEW take what was signed before, so nothing is gone: re-issue the identity under another subject and "
    "revoke the old one, sign with another permissions CA, or let the grant end."
)


def effective(change: Change) -> str | None:
    """Of what is lost and not gone: until when, how bad that is, and what to do; or what asks for it."""
    if change.until is None:
        return f"{change.severity}: {'; '.join(change.against)}." if change.against else None
    against = f" ({'; '.join(change.against)})" if change.against else ""
    return f"{change.severity}: still effective until {change.until}{against}. {REMEDY}"


def enclaves(paths: Sequence[str]) -> str:
    """The first of them, and how many more."""
    return some(paths, MAX_ENCLAVES)


def consequence(each: Consequence, comparison: Comparison) -> str:
    """What follows, without a full stop."""
    if each.influenced is not None:
        return f"{each.what} {influence(each.influenced)}{under(each.profiles, comparison)}"
    who = _joined(each.enclaves, each.what) if each.enclaves else f"anybody on the network {each.what}"
    about = f" {names(each.names)}" if each.names is not None else ""
    parts = ", each a part of them" if each.parts else ""
    return f"{who}{about}{parts}{reasons(each.reasons, each.direction)}{under(each.profiles, comparison)}"


def others(paths: Sequence[str]) -> str:
    """Enclaves with a change like the one that was told."""
    return f"likewise, each with its own path, or the one above it, in the names: {enclaves(paths)}"


def left_out(consequences: Sequence[Consequence]) -> str:
    """How many are not shown."""
    return f"and {counted(len(consequences) - MAX_CONSEQUENCES, 'more consequence')}"


def influence(influenced: Influenced) -> str:
    """One way with all its hops, and how many other pairs there are."""
    way = influenced.way
    hops = f" → {way[0].sender}" + "".join(f" → {ros_name(hop.name.topic)} → {hop.receiver}" for hop in way)
    more = ""
    if influenced.pairs > 1:
        more = f", and between {counted(influenced.pairs - 1, 'more pair')} of enclaves"
    return f"from {way[0].sender} to {way[-1].receiver} ({hops[3:]}){more}"


def reasons(given: Iterable[str], direction: Direction) -> str:
    """Why something does not start, or why it did not before."""
    told = "; ".join(given)
    before = ", and did not before" if direction is Direction.GAINED else ""
    return f"{before}: {told}" if told else ""


def under(profiles: Sequence[str], comparison: Comparison) -> str:
    """Under which profiles, unless under all."""
    return "" if len(profiles) == len(comparison.profiles) else f" under {', '.join(profiles)}"


def names(several: Names) -> str:
    """The witnesses and how many others there are; domains once where they are the same for all."""
    if several.every:
        return f"every name in {_domains(several.domains)}"
    spelt = [each for each in several.shown if not each.several]
    shown = spelt if several.infinite and spelt else several.shown
    alike = all(each.domains == several.domains for each in shown)
    told = [_name(each, named=not alike) for each in shown]
    if several.infinite:
        told.append("infinitely many other names")
    elif several.more:
        told.append(f"{several.more} more")
    elif any(each.several for each in several.shown):
        told.append("others like them")
    listed = " and ".join([", ".join(told[:-1]), told[-1]] if len(told) > 1 else told)
    return f"{listed} in {_domains(several.domains)}" if alike else listed


def _name(name: Name, *, named: bool) -> str:
    partition = f" in partition {name.partition!r}" if name.partition else ""
    return f"{ros_name(name.topic)}{partition}" + (f" in {_domains(name.domains)}" if named else "")


def _domains(domains: tuple[Interval, ...]) -> str:
    if domains == ((0, MAX_DOMAIN),):
        return "every domain"
    several = len(domains) > 1 or domains[0][0] != domains[0][1]
    return f"domain{'s' if several else ''} {describe(domains)}"


def _aspect(aspect: Aspect) -> str:
    if aspect.what in _LISTED and (aspect.old is None or aspect.new is None):
        return f"{aspect.what}: {'added' if aspect.old is None else 'removed'} {aspect.new or aspect.old}"
    return f"{aspect.what}: {aspect.old or 'none'} → {aspect.new or 'none'}"


def unread(each: Unread) -> str:
    """What could not be read."""
    whose = f" of {each.enclave}" if each.enclave is not None else ""
    return f"{each.side} {each.location}{whose}: {each.reason}"


def verdict(comparison: Comparison, fail_on: FailOn) -> str:
    """The first line: what may be done about it, and which way effective rights and what attackers can do went."""
    if comparison.unknown:
        return f"UNKNOWN: {counted(len(comparison.unknown), 'place')} could not be read"
    failing = len(comparison.failing(fail_on))
    changes = [change for change in comparison.changes if change.direction is not Direction.INFO]
    if not changes:
        return "NO CHANGE in meaning"
    if fail_on is FailOn.NONE or not failing:
        about = f" (those about {', '.join(comparison.labels)} could)" if comparison.labels else ""
        return f"PASS: {counted(len(changes), 'change')}, none that fails{about}{_way(changes)}"
    return f"FAIL: {failing} of {counted(len(changes), 'change')} {'fails' if failing == 1 else 'fail'}{_way(changes)}"


def _way(changes: Sequence[Change]) -> str:
    directions = {change.direction for change in changes}
    grew = not directions.isdisjoint((Direction.GAINED, Direction.MIXED))
    shrank = not directions.isdisjoint((Direction.LOST, Direction.MIXED))
    if grew or shrank:
        return f"; effective rights {'grew and shrank' if grew and shrank else 'grew' if grew else 'shrank'}"
    return "; effective rights neither grew nor shrank by themselves"


def alike(changes: Iterable[Change]) -> list[tuple[Change, tuple[str, ...]]]:
    """Each change that is not like one before it, with the enclaves of those that are.

    Two are alike where each is the other with its path, or the path above it, put for that of the other in every name;
    whole segments of it, since nobody sees the path /a in /arm.
    """
    found: dict[str, tuple[Change, list[str]]] = {}
    for change in changes:
        key = _form(change)
        if key in found:
            found[key][1].extend(change.enclaves)
        else:
            found[key] = change, []
    return [(change, tuple(enclaves)) for change, enclaves in found.values()]


def _form(change: Change) -> str:
    """What the change says, without the path of its enclave; places do not count."""
    if len(change.enclaves) != 1:
        return repr(change)
    (path,) = change.enclaves
    above = path.rpartition("/")[0]
    form = re.sub(re.escape(repr(path)[1:-1]) + r"(?!\w)", _PATH, repr(replace(change, old=None, new=None)))
    return form.replace(repr(above)[1:-1] + "/", _ABOVE) if above else form


def conditions(comparison: Comparison) -> tuple[Needed, ...]:
    """What it rests on that there are no other rights than those told."""
    return answered_if(comparison.profiles, [each for each in CONDITIONS if each in comparison.assumed])
