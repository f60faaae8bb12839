"""What implementations do with a keystore, for the second reader: written from the measured facts (dds-semantics.md).

Expressions are matched by libc's own `fnmatch`, which Fast DDS calls, and by Cyclone DDS's rules.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from functools import cache

from msgspec import Struct
from msgspec.structs import replace

from tests.second_reader.documents import Criterion, DomainRule, Grant, Ids, Rule, TopicRule
from tests.second_reader.openssl import Certificate

_libc = ctypes.CDLL(None)
_NOESCAPE = 2

HIGHEST = 232


class Implementation(Struct, frozen=True, eq=False):
    """What one implementation does.

    `partitions`: of a criterion (`own`), the same with a denial without any for the default one alone (`default`), or
    of the whole rule (`rule`). `subjects`: exact, ordered, parsed, cyclonedds or trimmed. `matcher`: posix, noescape
    or cyclonedds. `most_offset`: hours of a date's offset that it reads (measured). `lone_min`: an `<id_range>` with
    `<min>` alone is that one id.
    """

    name: str
    pins: bool
    first_only: bool
    needs_root: bool
    checks_root: bool
    subjects: str
    matcher: str
    lone_min: bool
    partitions: str
    honours_default: bool
    reads_zone: bool = True
    most_offset: int = 14
    highest: int | None = None
    relay_reads: bool = False
    relays: bool = False
    refuses_open_rtps: bool = False
    topics_by: tuple[tuple[str, ...], ...] = ()


_BOTH = ("publish", "subscribe")

_SPEC = Implementation(
    name="spec",
    pins=True,
    first_only=False,
    needs_root=False,
    checks_root=False,
    subjects="exact",
    matcher="posix",
    lone_min=False,
    partitions="own",
    honours_default=True,
    relays=True,
)
_FASTDDS = replace(
    _SPEC,
    needs_root=True,
    checks_root=True,
    subjects="parsed",
    matcher="noescape",
    lone_min=True,
    partitions="rule",
    honours_default=False,
    reads_zone=False,
    relay_reads=True,
    relays=False,
    refuses_open_rtps=True,
)
_CYCLONEDDS = replace(
    _SPEC,
    first_only=True,
    needs_root=True,
    subjects="trimmed",
    matcher="cyclonedds",
    most_offset=12,
    lone_min=True,
    partitions="default",
    highest=230,
    relays=False,
)

IMPLEMENTATIONS = {
    each.name: each
    for each in (
        _SPEC,
        replace(_FASTDDS, name="fastdds-2.6.4", pins=False, subjects="ordered", refuses_open_rtps=False),
        replace(_FASTDDS, name="fastdds-2.6", subjects="ordered"),
        replace(_FASTDDS, name="fastdds-2.9", pins=False, subjects="ordered", refuses_open_rtps=False),
        replace(_FASTDDS, name="fastdds-2.14"),
        replace(_FASTDDS, name="fastdds-3.2"),
        replace(_FASTDDS, name="fastdds-3.6"),
        replace(_CYCLONEDDS, name="cyclonedds-0.10", pins=False, subjects="cyclonedds", topics_by=(_BOTH,)),
        replace(_CYCLONEDDS, name="cyclonedds-11", topics_by=(_BOTH[:1], _BOTH[1:])),
    )
}


@cache
def matches(expression: str, name: str, matcher: str) -> bool:
    """Whether an expression matches a name."""
    if matcher == "cyclonedds":
        return _cyclonedds(expression, name)
    flags = _NOESCAPE if matcher == "noescape" else 0
    return bool(_libc.fnmatch(expression.encode(), name.encode(), flags) == 0)


def _cyclonedds(expression: str, name: str) -> bool:
    """`*`, `?`, `[...]` and `[!...]`, nothing else."""
    if not expression:
        return not name
    first = expression[0]
    if first == "*":
        return any(_cyclonedds(expression[1:], name[start:]) for start in range(len(name) + 1))
    if not name:
        return False
    if first == "?":
        return _cyclonedds(expression[1:], name[1:])
    if first == "[":
        end = expression.find("]", 1)
        if end < 0:
            return False
        members = expression[1:end]
        negated = members.startswith("!")
        within = _among(members[negated:], name[0])
        return within is not negated and _cyclonedds(expression[end + 1 :], name[1:])
    return first == name[0] and _cyclonedds(expression[1:], name[1:])


def _among(members: str, letter: str) -> bool:
    if letter == "]":  # it is compared like the others, and is always there (measured)
        return True
    place = 0
    while place < len(members):
        if members[place + 1 : place + 2] == "-" and place + 2 < len(members):
            if members[place] <= letter <= members[place + 2]:
                return True
            place += 3
        else:
            if members[place] == letter:
                return True
            place += 1
    return False


@cache
def covers(ids: Ids, domain: int, implementation: Implementation) -> bool:
    """Whether a rule is about a domain."""
    for low, most in ids:
        high = most
        if most is None:
            high = low if implementation.lone_min and low is not None else HIGHEST
        elif implementation.relay_reads and most == 0 and low is not None:  # Fast DDS: no bound at all
            high = low
        if high is not None and (low or 0) <= domain <= high:
            return True
    return False


def names(text: str, certificate: Certificate, how: str) -> bool:
    """Whether a grant's subject_name names the certificate."""
    if how == "exact":
        return text == certificate.subject
    if how in ("ordered", "parsed") and text == certificate.oneline:  # Fast DDS, of a peer
        return True
    if how == "ordered":
        return [part.strip() for part in text.split(",")] == [part.strip() for part in certificate.subject.split(",")]
    if how == "parsed":
        own, theirs = _attributes(certificate.subject), _attributes(text)
        repeated = len(dict(own)) != len(own)
        return not repeated and sorted(own) == sorted(theirs)
    own, theirs = (_tokens(each, trimmed=how == "trimmed") for each in (certificate.escaped, text))
    return set(own) <= set(theirs)


def _attributes(text: str) -> list[tuple[str, str]]:
    pairs = (part.partition("=") for part in text.split(","))
    return [(key.strip(), value.strip()) for key, _equals, value in pairs]


def _tokens(text: str, *, trimmed: bool) -> list[str]:
    pieces = text.replace("/", ",").replace("|", ",").split(",")
    if trimmed:
        pieces = ["=".join(part.strip() for part in piece.split("=")) for piece in pieces]
    return [piece for piece in pieces if piece]


def _is_in(topic: str, expressions: Iterable[str], matcher: str) -> bool:
    return any(matches(each, topic, matcher) for each in expressions)


def _applies(rule: Rule, criterion: Criterion, topic: str, partition: str, way: Implementation) -> bool:
    if not _is_in(topic, criterion.topics, way.matcher):
        return False
    if criterion.partitions is None:
        return partition == "" or (not rule.allow and way.partitions == "own")
    return _is_in(partition, criterion.partitions, way.matcher)


@cache
def lists(rule: Rule, kind: str, topic: str, partition: str, way: Implementation) -> bool:
    """Whether a rule is about a topic in a partition, in domains of its own."""
    return any(_applies(rule, each, topic, partition, way) for each in rule.criteria if each.kind == kind)


@cache
def decides(grant: Grant, kind: str, topic: str, partition: str, domain: int, way: Implementation) -> bool:
    """Whether a grant lets peers publish or subscribe: the first rule that is about it, else the default."""
    for rule in grant.rules:
        if not covers(rule.ids, domain, way):
            continue
        criteria = [each for each in rule.criteria if each.kind == kind]
        if way.partitions != "rule":
            if any(_applies(rule, each, topic, partition, way) for each in criteria):
                return rule.allow
            continue
        # Fast DDS: the first rule that lists the topic decides; a reader may be listed for relaying instead.
        relayed = [each for each in rule.criteria if each.kind == "relay"] if kind == "subscribe" else []
        for several in (criteria, relayed):
            if any(_is_in(topic, each.topics, way.matcher) for each in several):
                listed = {text for each in several for text in (("",) if each.partitions is None else each.partitions)}
                return rule.allow and _is_in(partition, listed, way.matcher)
    return way.honours_default and grant.default == "ALLOW"


@cache
def has_topic(grant: Grant, topic: str, domain: int, way: Implementation) -> bool:
    """Whether there is the topic at all: by the first rule that lists it, or by the first of one of the two kinds."""
    default = way.honours_default and grant.default == "ALLOW"
    first = [_lists_first(grant, topic, domain, way, kinds) for kinds in way.topics_by]
    return not any(first) or any(rule.allow if rule else default for rule in first)


def _lists_first(grant: Grant, topic: str, domain: int, way: Implementation, kinds: tuple[str, ...]) -> Rule | None:
    """The first rule that lists the topic for one of these, in whatever partition."""
    for rule in grant.rules:
        if covers(rule.ids, domain, way):
            listed = (each for each in rule.criteria if each.kind in kinds)
            if any(_is_in(topic, each.topics, way.matcher) for each in listed):
                return rule
    return None


@cache
def governs(
    rules: tuple[DomainRule, ...], topic: str, domain: int, way: Implementation
) -> tuple[DomainRule | None, TopicRule | None]:
    """The domain rule and the topic rule that count: the first each."""
    for rule in rules:
        if covers(rule.ids, domain, way):
            hit = (each for each in rule.topic_rules if matches(each.expression, topic, way.matcher))
            return rule, next(hit, None)
    return None, None
