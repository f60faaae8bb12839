"""What the governance of two keystores says of each name: the row that decides there, before and after."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.keystore.governance import ProtectionKind
from keystore_audit.model.comparison.change import Aspect, Direction, Layer, direction_of, joint_direction
from keystore_audit.model.comparison.drafts import Draft, in_order
from keystore_audit.model.comparison.sides import Pair, Sides, View, is_void
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.system import TopicRuleAtom

_Value = bool | ProtectionKind | None

_OF_DOMAINS: Final = (
    "allow_unauthenticated_participants",
    "enable_join_access_control",
    "discovery_protection_kind",
    "liveliness_protection_kind",
    "rtps_protection_kind",
)
_OF_TOPICS: Final = (
    "enable_discovery_protection",
    "enable_liveliness_protection",
    "enable_read_access_control",
    "enable_write_access_control",
    "metadata_protection_kind",
    "data_protection_kind",
)
DOMAIN_COVERED: Final = "domain_rule"
TOPIC_COVERED: Final = "topic_rule"
_OPENS: Final = frozenset({"allow_unauthenticated_participants", DOMAIN_COVERED, TOPIC_COVERED})
"""What lets more happen where it is there: without a rule that covers it nothing can be used (DDS-Security 1.1,
9.4.1.2)."""


class Row(NamedTuple):
    """What decides about a channel: values in the order of the names above; None: no such rule covers it."""

    domain: tuple[_Value, ...] | None
    topic: tuple[_Value, ...] | None


_NOTHING: Final = Row(None, None)


class _Part(NamedTuple):
    row: Row
    channels: int
    location: Location | None


class _Difference(NamedTuple):
    """One aspect that differs, and where."""

    what: str
    old: _Value
    new: _Value
    channels: int


class _Found(Struct):
    """Who has a difference, under which profiles, and the rules that decide there."""

    enclaves: dict[str, None]
    profiles: dict[str, None]
    old: Location | None
    new: Location | None


def governance_changes(sides: Sides) -> list[Draft]:
    """One draft for each set of names about which the same aspects changed, of the same enclaves."""
    # By aspect and enclave the profiles, then by aspect and profiles the enclaves.
    found: dict[tuple[_Difference, str], _Found] = {}
    for pair in sides.pairs:
        known: dict[tuple[int | None, int | None], list[tuple[_Difference, Location | None, Location | None]]] = {}
        for path in sides.compared:
            if _is_refused(sides, pair, path):
                continue  # whether it starts says so
            key = _document(pair.old, path), _document(pair.new, path)
            if key not in known:
                known[key] = list(_differences(_parts(pair.old, key[0]), _parts(pair.new, key[1]), sides.mask))
            for difference, old, new in known[key]:
                each = found.setdefault((difference, path), _Found({}, {}, old, new))
                each.profiles.update(dict.fromkeys(pair.profiles))
    merged: dict[tuple[_Difference, tuple[str, ...]], _Found] = {}
    for (difference, path), each in found.items():
        profiles = in_order(each.profiles, sides)
        merged.setdefault((difference, profiles), _Found({}, {}, each.old, each.new)).enclaves[path] = None
    grouped: dict[tuple[int, tuple[str, ...], tuple[str, ...]], list[tuple[_Difference, _Found]]] = {}
    for (difference, profiles), each in merged.items():
        grouped.setdefault((difference.channels, profiles, tuple(each.enclaves)), []).append((difference, each))
    return [
        _draft(channels, profiles, enclaves, members) for (channels, profiles, enclaves), members in grouped.items()
    ]


def same_protection(pair: Pair, path: str) -> bool:
    """Whether the enclave's governance says the same of every name, in whatever domain."""
    old, new = (_parts(view, _document(view, path)) for view in (pair.old, pair.new))
    return not any(_differences(old, new, pair.old.decisions.all_channels))


def _draft(
    channels: int,
    profiles: tuple[str, ...],
    enclaves: tuple[str, ...],
    members: list[tuple[_Difference, _Found]],
) -> Draft:
    aspects = tuple(_aspect(difference) for difference, _found in members)
    first = members[0][1]
    return Draft(
        layer=Layer.TRUST,
        kind="protection",
        direction=joint_direction(aspects),
        what="what the governance protects",
        enclaves=enclaves,
        profiles=profiles,
        aspects=aspects,
        channels=channels,
        old=first.old,
        new=first.new,
    )


def _aspect(difference: _Difference) -> Aspect:
    old, new = _word(difference.old), _word(difference.new)
    return Aspect(what=difference.what, old=old, new=new, direction=_direction(difference))


def _word(value: _Value) -> str | None:
    if value is None:
        return None
    return value.value if isinstance(value, ProtectionKind) else str(value).lower()


def _direction(difference: _Difference) -> Direction:
    old, new = difference.old, difference.new
    if isinstance(old, ProtectionKind) and isinstance(new, ProtectionKind):
        before, after = _strengths(old), _strengths(new)
        return direction_of(gains=bool(before - after), losses=bool(after - before))
    opens = bool(new) if difference.what in _OPENS else not new
    return Direction.GAINED if opens else Direction.LOST


def _strengths(kind: ProtectionKind) -> frozenset[str]:
    has = {"signed": kind.authenticates, "secret": kind.encrypts, "origin": kind.authenticates_origin}
    return frozenset(name for name, holds in has.items() if holds)


def _is_refused(sides: Sides, pair: Pair, path: str) -> bool:
    """Whether the implementations take one of the documents for none."""
    return any(is_void(by_path[path].governance, pair.lead, sides.accesses) for by_path in sides.enclaves)


def _document(view: View, path: str) -> int | None:
    return view.system.realms[view.enclave(path).realm].governance


def _parts(view: View, document: int | None) -> list[_Part]:
    """All channels by the row that decides, whoever signed the document."""
    system, undecided = view.system, view.decisions.all_channels
    parts: list[_Part] = []
    rules = [(number, rule) for number, rule in enumerate(system.domain_rules) if rule.document == document]
    topics: dict[int, list[TopicRuleAtom]] = {number: [] for number, _rule in rules}
    for topic in system.topic_rules:
        if topic.domain_rule in topics:
            topics[topic.domain_rule].append(topic)
    for number, rule in rules:
        within = view.decisions.within(rule.domains) & undecided
        undecided &= ~within
        domain = tuple(getattr(rule, name) for name in _OF_DOMAINS)
        for topic in topics[number]:
            hit = bits(topic.channels) & within
            within &= ~hit
            row = Row(domain, tuple(getattr(topic, name) for name in _OF_TOPICS))
            if hit:
                parts.append(_Part(row, hit, topic.location))
        if within:
            parts.append(_Part(Row(domain, None), within, rule.location))
    return [*parts, _Part(_NOTHING, undecided, None)] if undecided else parts


def _differences(
    old: list[_Part], new: list[_Part], mask: int
) -> Iterator[tuple[_Difference, Location | None, Location | None]]:
    """Each aspect that differs, with all names about which it does."""
    found: dict[tuple[str, _Value, _Value], tuple[int, Location | None, Location | None]] = {}
    for before in old:
        for after in new:
            both = before.channels & after.channels & mask
            if not both or before.row == after.row:
                continue
            for key in _aspects(before.row, after.row):
                channels, one, other = found.get(key, (0, before.location, after.location))
                found[key] = (channels | both, one, other)
    for (what, one_value, other_value), (channels, one, other) in found.items():
        yield _Difference(what, one_value, other_value, channels), one, other


def _aspects(old: Row, new: Row) -> Iterator[tuple[str, _Value, _Value]]:
    """The aspects in which two rows differ; where one covers nothing, that alone."""
    if old.domain is None or new.domain is None:
        if (old.domain is None) != (new.domain is None):
            yield DOMAIN_COVERED, old.domain is not None, new.domain is not None
        return
    for name, before, after in zip(_OF_DOMAINS, old.domain, new.domain, strict=True):
        if before is not after:
            yield name, before, after
    if old.topic is None or new.topic is None:
        if (old.topic is None) != (new.topic is None):
            yield TOPIC_COVERED, old.topic is not None, new.topic is not None
        return
    for name, before, after in zip(_OF_TOPICS, old.topic, new.topic, strict=True):
        if before is not after:
            yield name, before, after
