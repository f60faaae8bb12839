"""What changed between two keystores, for people: on a terminal, and as Markdown for a comment on a pull request.

Both say the same words: the verdict, what could not be read, then the changes by layer. Names in words are raw, escaped
by whoever shows them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from msgspec.structs import replace

from keystore_audit.assumptions import CONDITIONS, Needed, holds_if
from keystore_audit.findings import Location
from keystore_audit.grouped import grouped
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
from keystore_audit.report.markdown import MAX_LENGTH
from keystore_audit.report.page import unbroken
from keystore_audit.text import MAX_EXPRESSION, counted, instant, shorten, some, terminal
from keystore_audit.text import markdown as escaped

MAX_ENCLAVES: Final = 3
MAX_CONSEQUENCES: Final = 6
MAX_UNREAD: Final = 10

_TITLES: Final = {
    Layer.TRUST: "Trust and protection",
    Layer.GRANTS: "Grants",
    Layer.ACCESS: "What peers accept, and own endpoints",
    Layer.ATTACKERS: "What attackers can do",
    Layer.INFLUENCE: "Where data can get",
}
_MARKS: Final = {
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

REMEDY: Final = (
    "Peers of NEW still accept what was signed before, so nothing is gone. Re-issue the identity under another subject "
    "and revoke the old one, sign with another permissions CA, or let the grant end."
)

_PATH, _ABOVE = "\0", "\1"
"""Stand for an enclave's path and for the path above it; neither is in a name (XML 1.0, 2.2)."""


def text(comparison: Comparison, fail_on: FailOn) -> str:
    """Lines of 80 columns at most, as far as names allow."""
    lines = [terminal(_verdict(comparison, fail_on))]
    lines.append(unbroken(f"{comparison.old} → {comparison.new}, at {instant(comparison.at)}", "", "  "))
    if needed := holds_if(conditions(comparison)):
        lines.append(unbroken(f"That there are no other rights {needed}.", "", "  "))
    if comparison.unknown:
        lines += ["", "Not compared, since it could not be read:"]
        lines += [unbroken(_unread(each), "  ? ", "    ") for each in comparison.unknown[:MAX_UNREAD]]
        if len(comparison.unknown) > MAX_UNREAD:
            lines.append(f"    and {len(comparison.unknown) - MAX_UNREAD} more")
    for layer, changes in _by_layer(comparison):
        lines += ["", _TITLES[layer]]
        for change, others in changes:
            lines += _lines(change, comparison, others)
    if comparison.changes:
        lines += ["", "+ gained   - lost   ± both   ~ changed   i no difference to anybody"]
    return "\n".join(lines) + "\n"


def _lines(change: Change, comparison: Comparison, others: Sequence[str]) -> Iterator[str]:
    yield unbroken(sentence(change, comparison), f"  {_MARKS[change.direction]} ", "    ")
    for side, location in _places(change):
        expression = f"  ({shorten(location.message, MAX_EXPRESSION)})" if location.message else ""
        yield terminal(f"      {side} {location}{expression}")
    for direction, words in _more(change, comparison, others, " (--format json)"):
        mark = f"{_MARKS[direction]} so " if direction is not None else ""
        yield unbroken(words, f"      {mark}", "        ")


def markdown(comparison: Comparison, fail_on: FailOn) -> str:
    """Headings and lists; what does not fit is counted."""
    lines = [f"## keystore-audit diff: {escaped(_verdict(comparison, fail_on))}", ""]
    lines += [f"{escaped(comparison.old)} → {escaped(comparison.new)} at {instant(comparison.at)}", ""]
    if needed := holds_if(conditions(comparison)):
        lines += [f"That there are no other rights {escaped(needed)}.", ""]
    used = sum(map(len, lines))
    left_out = 0
    for item in _items(comparison):
        used += len(item) + 1
        if used > MAX_LENGTH:
            left_out += bool(item)
        else:
            lines.append(item)
    if left_out:
        lines += ["", f"{left_out} more entries are in the full report."]
    return "\n".join(lines) + "\n"


def _items(comparison: Comparison) -> Iterator[str]:
    """Lines, or whole items where a part of them would break what is around it."""
    if comparison.unknown:
        unread = [f"- {escaped(_unread(each))}" for each in comparison.unknown]
        yield from ("### Not compared, since it could not be read", "", *unread, "")
    for layer, changes in _by_layer(comparison):
        yield from (f"### {_TITLES[layer]}", "")
        yield from (_item(change, comparison, others) for change, others in changes)
        yield ""


def _item(change: Change, comparison: Comparison, others: Sequence[str]) -> str:
    named = ", ".join(f"{side} {escaped(str(place))}" for side, place in _places(change))
    where = f" ({named})" if named else ""
    lines = [f"- **{change.direction.value}** {escaped(sentence(change, comparison))}{where}"]
    for direction, words in _more(change, comparison, others):
        mark = f"so *{direction.value}*: " if direction is not None else ""
        lines.append(f"  - {mark}{escaped(words)}")
    return "\n".join(lines)


def _more(
    change: Change, comparison: Comparison, others: Sequence[str], elsewhere: str = ""
) -> Iterator[tuple[Direction | None, str]]:
    """What is told below a change; with a direction, what follows from it. `elsewhere`: where the rest can be read."""
    if effective := _effective(change):
        yield None, effective
    for each in change.consequences[:MAX_CONSEQUENCES]:
        yield each.direction, consequence(each, comparison)
    left_out = len(change.consequences) - MAX_CONSEQUENCES
    if left_out > 0:
        yield None, f"and {counted(left_out, 'more consequence')}{elsewhere}"
    if others:
        yield None, f"likewise, each with its own path, or the one above it, in the names: {_enclaves(others)}"


def _verdict(comparison: Comparison, fail_on: FailOn) -> str:
    """What may be done about it, and which way effective rights and what attackers can do went."""
    if comparison.unknown:
        return f"UNKNOWN: {counted(len(comparison.unknown), 'place')} could not be read"
    failing = len(comparison.failing(fail_on))
    directions = [each.direction for each in comparison.changes if each.direction is not Direction.INFO]
    if not directions:
        return "NO CHANGE in meaning"
    changes = counted(len(directions), "change")
    if fail_on is FailOn.NONE or not failing:
        about = f" (those about {', '.join(comparison.labels)} could)" if comparison.labels else ""
        return f"PASS: {changes}, none that fails{about}{_way({*directions})}"
    return f"FAIL: {failing} of {changes} {'fails' if failing == 1 else 'fail'}{_way({*directions})}"


def _way(directions: set[Direction]) -> str:
    grew, shrank = (bool(directions & {each, Direction.MIXED}) for each in (Direction.GAINED, Direction.LOST))
    if grew or shrank:
        return f"; effective rights {'grew and shrank' if grew and shrank else 'grew' if grew else 'shrank'}"
    return "; effective rights neither grew nor shrank by themselves"


def conditions(comparison: Comparison) -> tuple[Needed, ...]:
    """What it rests on that there are no other rights than those told."""
    return answered_if(comparison.profiles, [each for each in CONDITIONS if each in comparison.assumed])


def _by_layer(comparison: Comparison) -> Iterator[tuple[Layer, Sequence[tuple[Change, Sequence[str]]]]]:
    """The changes of each layer that has any."""
    layers = grouped(comparison.changes, lambda change: change.layer)
    yield from ((layer, alike(layers[layer])) for layer in Layer if layer in layers)


def alike(changes: Iterable[Change]) -> Sequence[tuple[Change, Sequence[str]]]:
    """Each change that is not like one before it, with the enclaves of those that are.

    Two are alike if one becomes the other when its path, or the path above, is replaced in every name. Only whole
    segments are replaced: /a is no part of /arm.
    """
    kinds = grouped(changes, _form).values()
    return [(first, tuple(path for each in others for path in each.enclaves)) for first, *others in kinds]


def _form(change: Change) -> str:
    """What the change says, without the path of its enclave; places do not count."""
    if len(change.enclaves) != 1:
        return repr(change)
    (path,) = change.enclaves
    above = path.rpartition("/")[0]
    form = re.sub(re.escape(repr(path)[1:-1]) + r"(?!\w)", _PATH, repr(replace(change, old=None, new=None)))
    return form.replace(repr(above)[1:-1] + "/", _ABOVE) if above else form


def _places(change: Change) -> Iterator[tuple[str, Location]]:
    for side, place in (("old", change.old), ("new", change.new)):
        if place is not None:
            yield side, place


def _unread(each: Unread) -> str:
    """What could not be read."""
    whose = f" of {each.enclave}" if each.enclave is not None else ""
    return f"{each.side} {each.location}{whose}: {each.reason}"


def sentence(change: Change, comparison: Comparison) -> str:
    """The change as one sentence."""
    parts = [_subject(change, comparison)]
    if change.influenced is not None:
        parts.append(_influence(change.influenced))
    if change.names is not None:
        parts.append(_domains(change.names.domains) if change.operation == "join" else _names(change.names))
    aspects = [
        _aspect(each) for each in change.aspects if each.what != SUBJECT and (each.what, each.new) not in _COVERAGE
    ]
    if aspects:
        parts.append(f"({'; '.join(aspects)})")
    words = " ".join(parts) + _reasons(change)
    varies = ", not all of it under each" if change.varies else ""
    about = f" [{', '.join(change.labels)}]" if change.labels else ""
    return f"{words}{_under(change, comparison)}{varies}.{about}"


def _subject(change: Change, comparison: Comparison) -> str:
    if change.kind == "protection":
        covered = next((_COVERAGE.get((each.what, each.new or "")) for each in change.aspects), None)
        whom = f" for {_enclaves(change.enclaves)}" if len(change.enclaves) < comparison.common else ""
        return f"{covered}{whom}:" if covered is not None else f"{_PROTECTION[change.direction]}{whom} of"
    if change.enclaves:
        return _joined(change.enclaves, change.what)
    return f"Anybody {change.what}" if change.layer is Layer.ATTACKERS else change.what[:1].upper() + change.what[1:]


def _joined(paths: Sequence[str], what: str) -> str:
    """A phrase about enclaves: verb phrases follow their paths, others come after a colon."""
    colon = ":" if what.startswith(("its ", "it ", "the ")) else ""
    return f"{_enclaves(paths)}{colon} {what}"


def _effective(change: Change) -> str:
    """Of what is lost and not gone: until when, how bad that is, and what to do; or what asks for it."""
    against = "; ".join(change.against)
    if change.until is None:
        return f"{change.severity}: {against}." if against else ""
    asked = f" ({against})" if against else ""
    return f"{change.severity}: still effective until {change.until}{asked}. {REMEDY}"


def _enclaves(paths: Iterable[str]) -> str:
    return some(paths, MAX_ENCLAVES)


def consequence(each: Consequence, comparison: Comparison) -> str:
    """What follows, without a full stop."""
    under = _under(each, comparison)
    if each.influenced is not None:
        return f"{each.what} {_influence(each.influenced)}{under}"
    who = _joined(each.enclaves, each.what) if each.enclaves else f"anybody on the network {each.what}"
    about = f" {_names(each.names)}" if each.names is not None else ""
    parts = ", each a part of them" if each.parts else ""
    return f"{who}{about}{parts}{_reasons(each)}{under}"


def _influence(influenced: Influenced) -> str:
    """One way with all its hops, and how many other pairs there are."""
    way, others = influenced.way, influenced.pairs - 1
    hops = "".join(f" → {ros_name(hop.name.topic)} → {hop.receiver}" for hop in way)
    more = f", and between {counted(others, 'more pair')} of enclaves" if others > 0 else ""
    return f"from {way[0].sender} to {way[-1].receiver} ({way[0].sender}{hops}){more}"


def _reasons(each: Change | Consequence) -> str:
    """Why something does not start, or why it did not before."""
    before = ", and did not before" if each.direction is Direction.GAINED else ""
    return f"{before}: {'; '.join(each.reasons)}" if any(each.reasons) else ""


def _under(each: Change | Consequence, comparison: Comparison) -> str:
    """Under which profiles, unless under all."""
    return "" if len(each.profiles) == len(comparison.profiles) else f" under {', '.join(each.profiles)}"


def _names(several: Names) -> str:
    """The witnesses and how many others there are; domains once where they are the same for all."""
    if several.every:
        return f"every name in {_domains(several.domains)}"
    spelt = [each for each in several.shown if not each.several]
    shown = spelt if several.infinite and spelt else several.shown
    alike = all(each.domains == several.domains for each in shown)
    told = [_name(each) + ("" if alike else f" in {_domains(each.domains)}") for each in shown]
    if several.infinite:
        told.append("infinitely many other names")
    elif several.more:
        told.append(f"{several.more} more")
    elif len(spelt) < len(several.shown):
        told.append("others like them")
    listed = " and ".join([", ".join(told[:-1]), told[-1]] if len(told) > 1 else told)
    return f"{listed} in {_domains(several.domains)}" if alike else listed


def _name(name: Name) -> str:
    return ros_name(name.topic) + (f" in partition {name.partition!r}" if name.partition else "")


def _domains(domains: tuple[Interval, ...]) -> str:
    if domains == ((0, MAX_DOMAIN),):
        return "every domain"
    several = len(domains) > 1 or domains[0][0] != domains[0][1]
    return f"domain{'s' if several else ''} {describe(domains)}"


def _aspect(aspect: Aspect) -> str:
    if aspect.what in _LISTED and (aspect.old is None or aspect.new is None):
        return f"{aspect.what}: {'added' if aspect.old is None else 'removed'} {aspect.new or aspect.old}"
    return f"{aspect.what}: {aspect.old or 'none'} → {aspect.new or 'none'}"
