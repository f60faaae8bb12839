"""Governance and permissions as sros2 writes them: one plain form of XML, which every implementation reads alike."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from typing import Final

from lxml import etree
from msgspec import Struct

from keystore_audit.certificate.errors import CannotTell

LAST_DOMAIN: Final = 230
"""The highest id that every implementation takes in a document."""

Domains = tuple[tuple[int, int], ...]
"""Closed intervals."""

SUBJECT: Final = re.compile(r"CN=(?:/[A-Za-z0-9_]+){1,19}")
_PLAIN: Final = re.compile(
    rf"""
    dds:<(domain_access_rules|permissions)>
    |domain_access_rules:(<domain_rule>)+
    |domain_rule:<domains><allow_unauthenticated_participants><enable_join_access_control>
        <discovery_protection_kind><liveliness_protection_kind><rtps_protection_kind><topic_access_rules>
    |domains:(<id>|<id_range>)+
    |id_range:<min><max>
    |topic_access_rules:(<topic_rule>)+
    |topic_rule:<topic_expression><enable_discovery_protection><enable_liveliness_protection>
        <enable_read_access_control><enable_write_access_control><metadata_protection_kind><data_protection_kind>
    |permissions:(<grant>)+
    |grant:<subject_name><validity>(<allow_rule>|<deny_rule>)*<default>
    |validity:<not_before><not_after>
    |(allow|deny)_rule:<domains>(<publish>)*(<subscribe>)*
    |(publish|subscribe):<topics>
    |topics:(<topic>)+
    |(id|min|max):[0-9]{{1,3}}
    |(discovery|liveliness|rtps|metadata)_protection_kind:(NONE|(SIGN|ENCRYPT)(_WITH_ORIGIN_AUTHENTICATION)?)
    |data_protection_kind:(NONE|SIGN|ENCRYPT)
    |(allow_unauthenticated_participants|enable_[a-z_]+):(true|false)
    |default:(ALLOW|DENY)
    |subject_name:{SUBJECT.pattern}
    |not_(before|after):(19[7-9]|2[01][0-9])[0-9]-[0-9]{{2}}-[0-9]{{2}}T[0-9]{{2}}:[0-9]{{2}}:[0-9]{{2}}(Z|[+]00:00)?
    |topic(_expression)?:[!-~]+
    """,
    re.VERBOSE,
)
"""By the name of an element, what it holds: its children, or a text, in which there is no `<`."""

_DECLARATION: Final = re.compile(rb"""\A<\?xml version="1\.0" encoding="(?:utf|UTF)-8"\?>""")
_LOCATION: Final = "{http://www.w3.org/2001/XMLSchema-instance}noNamespaceSchemaLocation"


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
    """`text`: the XML; equal texts are one governance. `signer`: as of permissions."""

    path: str
    signer: str
    text: bytes
    rules: tuple[DomainRule, ...]


def _root(text: bytes) -> etree._Element:
    """The document, of the plain form."""
    body = _DECLARATION.sub(b"", text, count=1)
    if b"<!" in body or b"<?" in body or b"&" in body or not body.isascii():
        raise CannotTell("has comments, entities, or characters beyond ASCII")
    parser = etree.XMLParser(resolve_entities=False, load_dtd=False, no_network=True, huge_tree=False)
    try:
        root = etree.fromstring(text, parser)
    except etree.XMLSyntaxError as error:
        raise CannotTell(f"is no XML: {error}") from error
    for each in root.iter():
        tag, text_inside = str(each.tag), each.text or ""
        children = "".join(f"<{child.tag}>" for child in each)
        plain = _PLAIN.fullmatch(f"{tag}:{children or text_inside}") and not (children and text_inside.strip())
        known = {"name"} if tag == "grant" else {_LOCATION} if each is root else set[str]()
        if not plain or (each.tail or "").strip() or {*each.attrib} - known or {*each.nsmap} - {"xsi"}:
            raise CannotTell(
                f"is not in the plain form of the schema at element {tag}, line {each.sourceline} of its XML"
            )
    return root


def _line(element: etree._Element, offset: int) -> int:
    return offset + int(str(element.sourceline))


def _domains(element: etree._Element) -> Domains:
    found = []
    for each in element.iterfind("domains/*"):
        low, *high = (int(text) for text in each.itertext() if text.strip())
        found.append((low, high[0] if high else low))
        if not low <= found[-1][1] <= LAST_DOMAIN or (high and not high[0]):
            raise CannotTell(f"has an empty range of domains, or an id beyond {LAST_DOMAIN}")
    return tuple(found)


def _says(element: etree._Element, tag: str) -> str:
    return element.findtext(tag) or ""


def _is(element: etree._Element, tag: str) -> bool:
    return _says(element, tag) == "true"


def governance(path: str, signer: str, text: bytes, offset: int) -> Governance:
    """The governance of this text, which stands behind `offset` lines of its file. Raises CannotTell."""
    found = []
    for rule in _root(text).iterfind("domain_access_rules/domain_rule"):
        unauthenticated, rtps = _is(rule, "allow_unauthenticated_participants"), _says(rule, "rtps_protection_kind")
        if unauthenticated and rtps != "NONE":
            raise CannotTell("allows unauthenticated participants beside a protected RTPS, which some refuse")
        under = tuple(_topic_rule(each, offset) for each in rule.iterfind("topic_access_rules/topic_rule"))
        join = _is(rule, "enable_join_access_control")
        found.append(DomainRule(_line(rule, offset), _domains(rule), unauthenticated, join, rtps, under))
    if not found:
        raise CannotTell("is no governance")
    return Governance(path, signer, text, tuple(found))


def _topic_rule(rule: etree._Element, offset: int) -> TopicRule:
    return TopicRule(
        _line(rule, offset),
        _says(rule, "topic_expression"),
        _is(rule, "enable_read_access_control"),
        _is(rule, "enable_write_access_control"),
        _says(rule, "metadata_protection_kind"),
        _says(rule, "data_protection_kind"),
    )


def permissions(path: str, signer: str, text: bytes, offset: int) -> Permissions:
    """The permissions of this text, as `governance`. Raises CannotTell."""
    found = []
    for grant in _root(text).iterfind("permissions/grant"):
        if "name" not in grant.attrib:
            raise CannotTell("has a grant without a name")
        start, end = (_date(_says(grant, f"validity/not_{edge}")) for edge in ("before", "after"))
        rules = tuple(_rule(each, offset) for each in grant if each.find("domains") is not None)
        allow = _says(grant, "default") == "ALLOW"
        found.append(Grant(_line(grant, offset), _says(grant, "subject_name"), start, end, rules, allow))
    return Permissions(path, signer, tuple(found))


def _date(text: str) -> datetime:
    try:
        return datetime.fromisoformat(text[:19]).replace(tzinfo=timezone.utc)
    except ValueError as error:
        raise CannotTell(f"has a date that is none: {text}") from error


def _rule(rule: etree._Element, offset: int) -> Rule:
    publish, subscribe = (
        tuple(each.text or "" for each in rule.iterfind(f"{way}/topics/topic")) for way in ("publish", "subscribe")
    )
    return Rule(_line(rule, offset), rule.tag == "allow_rule", _domains(rule), publish, subscribe)
