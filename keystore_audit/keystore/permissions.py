"""The permissions document: DDS-Security 1.1, 9.4.1.3."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from enum import Enum
from typing import Final

from lxml import etree
from msgspec import Struct

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.document import Document, DomainRange, Grammar, Text, elements, joined
from keystore_audit.keystore.files import File
from keystore_audit.keystore.smime import Candidates, SignedDocument, read_signed

_FOUR_DIGIT_YEAR: Final = re.compile(r"[0-9]{4}-")
"""xs:dateTime also has years before 1 and beyond 9999, which no implementation reads."""


class Operation(str, Enum):
    """What a criterion is about."""

    PUBLISH = "publish"
    SUBSCRIBE = "subscribe"
    RELAY = "relay"


_OPERATIONS: Final = {operation.value: operation for operation in Operation}


class Criterion(Struct, frozen=True, kw_only=True):
    """A `<publish>`, `<subscribe>` or `<relay>`. No `<partitions>` element: `partitions` is None."""

    operation: Operation
    topics: tuple[Text, ...]
    partitions: tuple[Text, ...] | None
    data_tags: bool
    line: int | None


class Rule(Struct, frozen=True, kw_only=True):
    """An `<allow_rule>` or `<deny_rule>`."""

    allow: bool
    domains: tuple[DomainRange, ...]
    criteria: tuple[Criterion, ...]
    line: int | None


class Grant(Struct, frozen=True, kw_only=True):
    """A `<grant>`. Dates are the text of the document: vendors read them differently (`model/validity.py`)."""

    name: str
    subject_name: Text
    not_before: Text
    not_after: Text
    rules: tuple[Rule, ...]
    default_allow: bool
    default_line: int | None
    line: int | None

    @property
    def allowed_domains(self) -> list[DomainRange]:
        """What its allow rules name."""
        return [domains for rule in self.rules if rule.allow for domains in rule.domains]

    @property
    def allowed(self) -> Iterator[Criterion]:
        """What its allow rules are about, in order."""
        return (criterion for rule in self.rules if rule.allow for criterion in rule.criteria)

    def listed(self, operation: Operation) -> Iterator[Text]:
        """The expressions for topics of its allow rules for an operation, in any domain and partition."""
        return (text for criterion in self.allowed if criterion.operation is operation for text in criterion.topics)


class Permissions(Struct, frozen=True, kw_only=True):
    """The typed document, grants in document order."""

    grants: tuple[Grant, ...]
    line: int | None


class PermissionsFile(Struct, frozen=True, kw_only=True, eq=False):
    """A signed permissions document; `permissions` is None where the content has no single meaning."""

    signed: SignedDocument
    permissions: Permissions | None
    defects: tuple[Defect, ...]
    """Of the XML; those of the envelope are in `signed`."""

    @property
    def grants(self) -> tuple[Grant, ...]:
        """Those of the content, none where it has no single meaning."""
        return self.permissions.grants if self.permissions is not None else ()


def read_permissions(file: File, candidates: Candidates | Iterable[Certificate]) -> PermissionsFile:
    """Read a permissions document and find who signed it (`smime.read_signed`).

    What is wrong with it is a defect; its content is read however the signature is. Raises AuditError only if the
    installation lacks its schemas.
    """
    document = Document(read_signed(file, candidates), Grammar.PERMISSIONS)
    permissions = document.meaning(_permissions)
    return PermissionsFile(signed=document.signed, permissions=permissions, defects=document.defects)


def _permissions(document: Document, root: etree._Element) -> Permissions:
    return Permissions(
        grants=tuple(_grant(document, grant) for grants in elements(root) for grant in elements(grants)),
        line=document.line(root),
    )


def _grant(document: Document, grant: etree._Element) -> Grant:
    subject_name, validity, *rules, default = elements(grant)
    not_before, not_after = elements(validity)
    return Grant(
        name=str(grant.get("name", "")),
        subject_name=document.leaf(subject_name),
        not_before=_date(document, not_before),
        not_after=_date(document, not_after),
        rules=tuple(_rule(document, rule) for rule in rules),
        default_allow=joined(default) == "ALLOW",
        default_line=document.line(default),
        line=document.line(grant),
    )


def _rule(document: Document, rule: etree._Element) -> Rule:
    domains, *criteria = elements(rule)
    return Rule(
        allow=rule.tag == "allow_rule",
        domains=tuple(document.domains(domains)),
        criteria=tuple(_criterion(document, criterion) for criterion in criteria),
        line=document.line(rule),
    )


def _criterion(document: Document, criterion: etree._Element) -> Criterion:
    parts = {part.tag: part for part in elements(criterion)}
    partitions = parts.get("partitions")
    return Criterion(
        operation=_OPERATIONS[criterion.tag],
        topics=tuple([document.leaf(topic) for topic in elements(parts["topics"])]),
        partitions=None if partitions is None else _partitions(document, partitions),
        data_tags="data_tags" in parts,
        line=document.line(criterion),
    )


def _partitions(document: Document, element: etree._Element) -> tuple[Text, ...]:
    """Partition expressions; the empty one means the default partition, and sros2 of Crystal writes it."""
    return tuple(document.leaf(name, may_be_empty=True) for name in elements(element))


def _date(document: Document, element: etree._Element) -> Text:
    date = document.leaf(element)
    if _FOUR_DIGIT_YEAR.match(date.text) is None:
        document.invalid(element, f"expected a date of the years 1 to 9999, found {date.text[:40]!r}")
    return date
