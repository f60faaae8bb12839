"""Governance and permissions as sros2 writes them: one plain form of XML, which every implementation reads alike."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime, timezone
from typing import Final

from lxml import etree
from msgspec import Struct

from keystore_audit.certificate.errors import CannotTell

LAST_DOMAIN: Final = 230
"""The highest id that every implementation takes in a document."""

Domains = tuple[tuple[int, int], ...]
"""Closed intervals."""

_KINDS: Final = tuple(
    f"{kind}{origin}" for kind in ("SIGN", "ENCRYPT") for origin in ("", "_WITH_ORIGIN_AUTHENTICATION")
)
_SUBJECT: Final = re.compile(r"CN=(?:/[A-Za-z0-9_]+){1,19}")
_DECLARATION: Final = re.compile(rb"""\A<\?xml version="1\.0" encoding="(?:utf|UTF)-8"\?>""")
_DATE: Final = re.compile(r"((?:19[7-9]|2[01]\d)\d-\d\d-\d\dT\d\d:\d\d:\d\d)(?:Z|\+00:00)?")
_ATTRIBUTES: Final = frozenset({"{http://www.w3.org/2001/XMLSchema-instance}noNamespaceSchemaLocation"})


class Rule(Struct, frozen=True):
    """An allow or deny rule. Topics by expression."""

    line: int
    allow: bool
    domains: Domains
    publish: tuple[str, ...]
    subscribe: tuple[str, ...]


class Grant(Struct, frozen=True):
    """For one subject, between two dates in UTC. `allow`: the default."""

    line: int
    subject: str
    start: datetime
    end: datetime
    rules: tuple[Rule, ...]
    allow: bool


class Permissions(Struct, frozen=True):
    """`signer`: the fingerprint of the certificate that signed it."""

    path: str
    signer: str
    grants: tuple[Grant, ...]


class TopicRule(Struct, frozen=True):
    """What protects the topics of an expression; kinds as they are written."""

    line: int
    expression: str
    read: bool
    write: bool
    metadata: str
    data: str


class DomainRule(Struct, frozen=True):
    """What protects some domains."""

    line: int
    domains: Domains
    unauthenticated: bool
    join: bool
    rtps: str
    topics: tuple[TopicRule, ...]


class Governance(Struct, frozen=True):
    """`text`: the XML, by which equal ones are one. `signer`: as of permissions."""

    path: str
    signer: str
    text: bytes
    rules: tuple[DomainRule, ...]


class _Reader:
    """One document; `offset`: the lines of the file before it."""

    def __init__(self, path: str, text: bytes, offset: int) -> None:
        self._path = path
        self._offset = offset
        body = _DECLARATION.sub(b"", text, count=1)
        if b"<!" in body or b"<?" in body or b"&" in body or not body.isascii() or b"\0" in body:
            self.cannot("has comments, entities, or characters beyond ASCII")
        parser = etree.XMLParser(resolve_entities=False, load_dtd=False, no_network=True, huge_tree=False)
        try:
            self.root = etree.fromstring(text, parser)
        except etree.XMLSyntaxError as error:
            raise CannotTell(f"{path} is no XML: {error}") from error
        for each in self.root.iter():
            allowed = _ATTRIBUTES if each is self.root else frozenset(["name"] * (each.tag == "grant"))
            if not allowed.issuperset(each.attrib) or set(each.nsmap) - {"xsi"} or ":" in str(each.tag):
                self.cannot(f"has attributes or prefixes that the checker does not know, at line {self.line(each)}")
            if (each.tail or "").strip() or (len(each) and (each.text or "").strip()):
                self.cannot(f"has text beside elements at line {self.line(each)}")

    def cannot(self, why: str) -> None:
        raise CannotTell(f"{self._path} {why}")

    def line(self, element: etree._Element) -> int:
        """In the file."""
        return self._offset + int(str(element.sourceline))

    def inside(self, element: etree._Element, form: str) -> list[etree._Element]:
        """Its children, whose names make the form: a regular expression over names, each with a blank behind it."""
        children = list(element)
        if re.fullmatch(form, "".join(f"{child.tag} " for child in children)) is None:
            self.cannot(f"is not in the plain form of the schema at line {self.line(element)}")
        return children

    def text(self, element: etree._Element) -> str:
        text = element.text or ""
        if len(element) or not text or text != text.strip():
            self.cannot(f"has no plain text at line {self.line(element)}")
        return text

    def one_of(self, element: etree._Element, *words: str) -> str:
        text = self.text(element)
        if text not in words:
            self.cannot(f"has an unknown value at line {self.line(element)}: {text}")
        return text

    def flag(self, element: etree._Element) -> bool:
        return self.one_of(element, "true", "false") == "true"

    def domains(self, element: etree._Element) -> Domains:
        found = []
        for each in self.inside(element, "((id|id_range) )+"):
            bounds = [each] if each.tag == "id" else self.inside(each, "min max ")
            ids = [self.text(bound) for bound in bounds]
            if any(not re.fullmatch(r"[0-9]{1,3}", one) or int(one) > LAST_DOMAIN for one in ids):
                self.cannot(f"names a domain beyond {LAST_DOMAIN} at line {self.line(each)}")
            low, high = int(ids[0]), int(ids[-1])
            if low > high or (each.tag == "id_range" and high == 0):
                self.cannot(f"has an empty range of domains at line {self.line(each)}")
            found.append((low, high))
        return tuple(found)


def governance(path: str, signer: str, text: bytes, offset: int) -> Governance:
    """The governance of this text. Raises CannotTell."""
    reader = _Reader(path, text, offset)
    if reader.root.tag != "dds":
        reader.cannot("is no governance")
    (rules,) = reader.inside(reader.root, "domain_access_rules ")
    found = []
    for rule in reader.inside(rules, "(domain_rule )+"):
        domains, unauthenticated, join, *kinds, topics = reader.inside(
            rule,
            "domains allow_unauthenticated_participants enable_join_access_control discovery_protection_kind "
            "liveliness_protection_kind rtps_protection_kind topic_access_rules ",
        )
        rtps = [reader.one_of(kind, "NONE", *_KINDS) for kind in kinds][-1]
        if reader.flag(unauthenticated) and rtps != "NONE":
            reader.cannot("allows unauthenticated participants beside a protected RTPS, which some refuse")
        under = tuple(_topic_rule(reader, each) for each in reader.inside(topics, "(topic_rule )+"))
        flags = reader.flag(unauthenticated), reader.flag(join)
        found.append(DomainRule(reader.line(rule), reader.domains(domains), *flags, rtps, under))
    return Governance(path, signer, text, tuple(found))


def _topic_rule(reader: _Reader, rule: etree._Element) -> TopicRule:
    expression, discovery, liveliness, read, write, metadata, data = reader.inside(
        rule,
        "topic_expression enable_discovery_protection enable_liveliness_protection enable_read_access_control "
        "enable_write_access_control metadata_protection_kind data_protection_kind ",
    )
    _discovery, _liveliness, reads, writes = map(reader.flag, (discovery, liveliness, read, write))
    kinds = reader.one_of(metadata, "NONE", *_KINDS), reader.one_of(data, "NONE", "SIGN", "ENCRYPT")
    return TopicRule(reader.line(rule), reader.text(expression), reads, writes, *kinds)


def permissions(path: str, signer: str, text: bytes, offset: int) -> Permissions:
    """The permissions of this text. Raises CannotTell."""
    reader = _Reader(path, text, offset)
    if reader.root.tag != "dds":
        reader.cannot("is no permissions document")
    (grants,) = reader.inside(reader.root, "permissions ")
    return Permissions(path, signer, tuple(_grants(reader, grants)))


def _grants(reader: _Reader, grants: etree._Element) -> Iterator[Grant]:
    for grant in reader.inside(grants, "(grant )+"):
        subject, validity, *rules, default = reader.inside(
            grant, "subject_name validity ((allow_rule|deny_rule) )*default "
        )
        name = reader.text(subject)
        if _SUBJECT.fullmatch(name) is None or "name" not in grant.attrib:
            reader.cannot(f"has a grant without a name, or of a subject that is not CN=/NAME: {name}")
        start, end = (_date(reader, each) for each in reader.inside(validity, "not_before not_after "))
        found = tuple(_rule(reader, each) for each in rules)
        allow = reader.one_of(default, "ALLOW", "DENY") == "ALLOW"
        yield Grant(reader.line(grant), name, start, end, found, allow)


def _date(reader: _Reader, element: etree._Element) -> datetime:
    text = reader.text(element)
    found = _DATE.fullmatch(text)
    try:
        return datetime.fromisoformat(found[1] if found else "").replace(tzinfo=timezone.utc)
    except ValueError as error:
        raise CannotTell(f"line {reader.line(element)}: {text} is no date from 1970 to 2199 in UTC") from error


def _rule(reader: _Reader, rule: etree._Element) -> Rule:
    domains, *criteria = reader.inside(rule, "domains (publish )*(subscribe )*")
    topics: dict[str, list[str]] = {"publish": [], "subscribe": []}
    for each in criteria:
        (listed,) = reader.inside(each, "topics ")
        topics[str(each.tag)] += [reader.text(topic) for topic in reader.inside(listed, "(topic )+")]
    return Rule(
        reader.line(rule),
        rule.tag == "allow_rule",
        reader.domains(domains),
        tuple(topics["publish"]),
        tuple(topics["subscribe"]),
    )
