"""Governance and permissions as expat reads them: nested tuples of texts, nothing concluded.

What is read is remembered by content, so that all here is compared by identity. A document outside the plain subset
(a document type, an instruction, a comment or CDATA inside a value) has no single meaning and is None: the parsers of
vendors differ on it (facts, x509-pkcs7-xml 4.1).
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from functools import cache
from xml.parsers import expat

from msgspec import Struct, field

Ids = tuple[tuple[int | None, int | None], ...]
"""Ranges by their bounds; a lone id is both."""


class Odd(Exception):
    """The document has no single meaning."""


class Criterion(Struct, frozen=True, eq=False):
    """`kind`: publish, subscribe or relay. `partitions`: None where none are listed."""

    kind: str
    topics: tuple[str, ...]
    partitions: tuple[str, ...] | None


class Rule(Struct, frozen=True, eq=False):
    """An allow or deny rule."""

    allow: bool
    ids: Ids
    criteria: tuple[Criterion, ...]


class Grant(Struct, frozen=True, eq=False):
    """A grant; dates as they are written."""

    subject: str
    not_before: str
    not_after: str
    default: str
    rules: tuple[Rule, ...]


class TopicRule(Struct, frozen=True, eq=False):
    """Of a governance: `flags` are discovery, liveliness, read and write; `kinds` metadata and data."""

    expression: str
    flags: tuple[bool, ...]
    kinds: tuple[str, ...]


class DomainRule(Struct, frozen=True, eq=False):
    """Of a governance: `flags` are unauthenticated and join; `kinds` discovery, liveliness and rtps."""

    ids: Ids
    flags: tuple[bool, ...]
    kinds: tuple[str, ...]
    topic_rules: tuple[TopicRule, ...]


class _Node(Struct):
    name: str
    text: list[str] = field(default_factory=list)
    below: list[_Node] = field(default_factory=list)
    broken: bool = False

    def value(self) -> str:
        if self.below or self.broken:
            raise Odd
        return "".join(self.text)

    def all(self, *names: str) -> list[_Node]:
        return [each for each in self.below if each.name in names]

    def one(self, name: str) -> _Node:
        found = self.all(name)
        if len(found) != 1:
            raise Odd
        return found[0]


def _tree(content: bytes) -> _Node:
    top = _Node("")
    stack = [top]
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def refuse(*_arguments: object) -> None:
        raise Odd

    def start(name: str, _attributes: object) -> None:
        node = _Node(name)
        stack[-1].below.append(node)
        stack.append(node)

    def end(_name: str) -> None:
        stack.pop()

    def text(data: str) -> None:
        stack[-1].text.append(data)

    def broken(*_arguments: object) -> None:
        stack[-1].broken = True

    parser.StartDoctypeDeclHandler = refuse
    parser.ProcessingInstructionHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = text
    parser.CommentHandler = broken
    parser.StartCdataSectionHandler = broken
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise Odd from error
    return top.one("dds")


def _ids(node: _Node) -> Ids:
    found: list[tuple[int | None, int | None]] = []
    for each in node.one("domains").below:
        if each.name == "id":
            number = int(each.value())
            found.append((number, number))
        else:
            bounds = [each.all(name) for name in ("min", "max")]
            low, high = (int(bound[0].value()) if bound else None for bound in bounds)
            found.append((low, high))
    return tuple(found)


_WORDS = {"true": True, "1": True, "false": False, "0": False}


def _flag(node: _Node, name: str) -> bool:
    word = node.one(name).value().strip().lower()
    if word not in _WORDS:
        raise Odd
    return _WORDS[word]


def _topic_rule(node: _Node) -> TopicRule:
    flags = ("enable_discovery_protection", "enable_liveliness_protection")
    flags += ("enable_read_access_control", "enable_write_access_control")
    return TopicRule(
        expression=node.one("topic_expression").value(),
        flags=tuple(_flag(node, name) for name in flags),
        kinds=tuple(node.one(f"{name}_protection_kind").value().strip() for name in ("metadata", "data")),
    )


def _domain_rule(node: _Node) -> DomainRule:
    flags = ("allow_unauthenticated_participants", "enable_join_access_control")
    kinds = ("discovery", "liveliness", "rtps")
    return DomainRule(
        ids=_ids(node),
        flags=tuple(_flag(node, name) for name in flags),
        kinds=tuple(node.one(f"{name}_protection_kind").value().strip() for name in kinds),
        topic_rules=tuple(_topic_rule(each) for each in node.one("topic_access_rules").all("topic_rule")),
    )


def _criterion(node: _Node) -> Criterion:
    lists = {name: node.all(f"{name}s") for name in ("topic", "partition")}
    if len(lists["topic"]) != 1 or len(lists["partition"]) > 1:
        raise Odd
    return Criterion(
        kind=node.name,
        topics=tuple(each.value() for each in lists["topic"][0].all("topic")),
        partitions=tuple(each.value() for each in lists["partition"][0].all("partition"))
        if lists["partition"]
        else None,
    )


def _grant(node: _Node) -> Grant:
    validity = node.one("validity")
    rules = tuple(
        Rule(
            allow=each.name == "allow_rule",
            ids=_ids(each),
            criteria=tuple(_criterion(below) for below in each.all("publish", "subscribe", "relay")),
        )
        for each in node.all("allow_rule", "deny_rule")
    )
    return Grant(
        subject=node.one("subject_name").value(),
        not_before=validity.one("not_before").value(),
        not_after=validity.one("not_after").value(),
        default=node.one("default").value(),
        rules=rules,
    )


@cache
def governance_in(content: bytes) -> tuple[DomainRule, ...] | None:
    """The domain rules, None where this is no governance of one meaning."""
    try:
        return tuple(_domain_rule(each) for each in _tree(content).one("domain_access_rules").all("domain_rule"))
    except (Odd, ValueError):
        return None


@cache
def permissions_in(content: bytes) -> tuple[Grant, ...] | None:
    """The grants, None where these are no permissions of one meaning."""
    try:
        return tuple(_grant(each) for each in _tree(content).one("permissions").all("grant"))
    except (Odd, ValueError):
        return None


def instant(text: str, most_offset: int) -> datetime | None:
    """A date without fraction, with an offset of so many hours at most or (UTC) without.

    None for any other form, which implementations read differently.
    """
    text = text.strip()
    try:
        zone = timezone.utc
        if text.endswith("Z"):
            text = text[:-1]
        elif len(text) > 19 and text[19] in "+-":
            sign = -1 if text[19] == "-" else 1
            if int(text[20:22]) > most_offset:
                return None
            zone = timezone(sign * timedelta(hours=int(text[20:22]), minutes=int(text[23:25])))
            text = text[:19]
        return datetime.strptime(text, "%Y-%m-%dT%H:%M:%S").replace(tzinfo=zone).astimezone(timezone.utc)
    except (ValueError, OverflowError):
        return None
