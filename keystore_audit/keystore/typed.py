"""The typed documents of DDS-Security 1.1, 9.4.1: governance (9.4.1.2) and permissions (9.4.1.3)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from typing import Any, Final

from lxml import etree
from msgspec import Struct

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.document import Document, DomainRange, Readings, Text, read_document
from keystore_audit.keystore.files import File
from keystore_audit.keystore.grammar import Grammar, elements, joined
from keystore_audit.keystore.smime import Candidates, SignedDocument, read_signed


class ProtectionKind(str, Enum):
    """How messages, submessages or payloads are protected (DDS-Security 1.1, 9.4.1.2.2)."""

    NONE = "NONE"
    SIGN = "SIGN"
    ENCRYPT = "ENCRYPT"
    SIGN_WITH_ORIGIN_AUTHENTICATION = "SIGN_WITH_ORIGIN_AUTHENTICATION"
    ENCRYPT_WITH_ORIGIN_AUTHENTICATION = "ENCRYPT_WITH_ORIGIN_AUTHENTICATION"

    @property
    def authenticates(self) -> bool:
        """Whether a message authentication code is there at all."""
        return self is not ProtectionKind.NONE

    @property
    def encrypts(self) -> bool:
        """Whether the bytes are unreadable without the key."""
        return self in (ProtectionKind.ENCRYPT, ProtectionKind.ENCRYPT_WITH_ORIGIN_AUTHENTICATION)

    @property
    def authenticates_origin(self) -> bool:
        """Whether a reader can tell the writer from other holders of the key."""
        return self.value.endswith("_WITH_ORIGIN_AUTHENTICATION")

    @property
    def without_origin(self) -> ProtectionKind:
        """What is left of it where the origin is not authenticated."""
        return ProtectionKind(self.value.removesuffix("_WITH_ORIGIN_AUTHENTICATION"))


class TopicRule(Struct, frozen=True, kw_only=True):
    """A `<topic_rule>`. `lines` maps each element name to its line."""

    expression: Text
    enable_discovery_protection: bool
    enable_liveliness_protection: bool = False  # DDS-Security 1.0 does not have it, and protected none
    enable_read_access_control: bool
    enable_write_access_control: bool
    metadata_protection_kind: ProtectionKind
    data_protection_kind: ProtectionKind
    line: int | None
    lines: Mapping[str, int | None]


class DomainRule(Struct, frozen=True, kw_only=True):
    """A `<domain_rule>`. `lines` maps each element name to its line."""

    domains: tuple[DomainRange, ...]
    allow_unauthenticated_participants: bool
    enable_join_access_control: bool
    discovery_protection_kind: ProtectionKind
    liveliness_protection_kind: ProtectionKind
    rtps_protection_kind: ProtectionKind
    topic_rules: tuple[TopicRule, ...]
    line: int | None
    lines: Mapping[str, int | None]


class Governance(Struct, frozen=True, kw_only=True):
    """The typed document, rules in document order."""

    domain_rules: tuple[DomainRule, ...]
    line: int | None


class GovernanceFile(Struct, frozen=True, kw_only=True, eq=False):
    """A signed governance document."""

    signed: SignedDocument
    readings: Readings[Governance]
    defects: tuple[Defect, ...]
    """Of the XML; those of the envelope are in `signed`."""

    @property
    def governance(self) -> Governance | None:
        """What it says, to those that read it if not all do; None where that is known of nobody."""
        return self.readings.first

    @property
    def domain_rules(self) -> tuple[DomainRule, ...]:
        """Those of the content, none where it says nothing."""
        return self.governance.domain_rules if self.governance is not None else ()

    @property
    def domains(self) -> list[DomainRange]:
        """What its domain rules name."""
        return [domains for rule in self.domain_rules for domains in rule.domains]


def read_governance(file: File, candidates: Candidates | Iterable[Certificate]) -> GovernanceFile:
    """Read a governance document and find who signed it (`smime.read_signed`).

    What is wrong with it is a defect; its content is read however the signature is. Raises AuditError only if the
    installation lacks its schemas.
    """
    signed = read_signed(file, candidates)
    readings, defects = read_document(signed, Grammar.GOVERNANCE, _governance)
    return GovernanceFile(signed=signed, readings=readings, defects=defects)


def _governance(document: Document, root: etree._Element) -> Governance:
    return Governance(
        domain_rules=tuple(_domain_rule(document, rule) for rules in elements(root) for rule in elements(rules)),
        line=document.line(root),
    )


def _domain_rule(document: Document, rule: etree._Element) -> DomainRule:
    parts = {str(part.tag): part for part in elements(rule)}
    return DomainRule(
        domains=tuple(document.domains(parts["domains"])),
        topic_rules=tuple(_topic_rule(document, topic) for topic in elements(parts["topic_access_rules"])),
        **_values(document, rule, parts),
    )


def _topic_rule(document: Document, rule: etree._Element) -> TopicRule:
    parts = {str(part.tag): part for part in elements(rule)}
    return TopicRule(expression=document.leaf(parts["topic_expression"]), **_values(document, rule, parts))


def _values(document: Document, rule: etree._Element, parts: Mapping[str, etree._Element]) -> dict[str, Any]:
    """What a rule says under the names of its elements, and where."""
    kinds = {tag: _kind(document, part) for tag, part in parts.items() if tag.endswith("_protection_kind")}
    flags = {tag: document.boolean(part) for tag, part in parts.items() if tag.startswith(("allow_", "enable_"))}
    lines = {tag: document.line(part) for tag, part in parts.items()}
    return {"line": document.line(rule), "lines": lines, **kinds, **flags}


def _kind(document: Document, element: etree._Element) -> ProtectionKind:
    text = document.text(element)
    try:
        return ProtectionKind(text)
    except ValueError:  # schema-valid, yet blanks around it: the document is not handed out
        document.invalid(element, f"expected a protection kind, found {text!r}")
        return ProtectionKind.NONE


# --- permissions


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
    """A signed permissions document."""

    signed: SignedDocument
    readings: Readings[Permissions]
    defects: tuple[Defect, ...]
    """Of the XML; those of the envelope are in `signed`."""

    @property
    def permissions(self) -> Permissions | None:
        """What it says, to those that read it if not all do; None where that is known of nobody."""
        return self.readings.first

    @property
    def subjects(self) -> frozenset[str]:
        """Whom its grants name, in each reading."""
        return frozenset(grant.subject_name.text for read in self.readings.distinct for grant in read.grants)

    @property
    def grants(self) -> tuple[Grant, ...]:
        """Those of the content, none where it says nothing."""
        return self.permissions.grants if self.permissions is not None else ()


def read_permissions(file: File, candidates: Candidates | Iterable[Certificate]) -> PermissionsFile:
    """Read a permissions document and find who signed it (`smime.read_signed`).

    What is wrong with it is a defect; its content is read however the signature is. Raises AuditError only if the
    installation lacks its schemas.
    """
    signed = read_signed(file, candidates)
    readings, defects = read_document(signed, Grammar.PERMISSIONS, _permissions)
    return PermissionsFile(signed=signed, readings=readings, defects=defects)


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
        not_before=document.leaf(not_before),
        not_after=document.leaf(not_after),
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
