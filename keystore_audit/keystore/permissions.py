"""The permissions document: DDS-Security 1.1, 9.4.1.3."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.governance import DomainRange, Text
from keystore_audit.keystore.smime import SignedDocument


class Operation(str, Enum):
    """What a criterion is about."""

    PUBLISH = "publish"
    SUBSCRIBE = "subscribe"
    RELAY = "relay"


@dataclass(frozen=True, slots=True, kw_only=True)
class Criterion:
    """A `<publish>`, `<subscribe>` or `<relay>`. No `<partitions>` element: `partitions` is None."""

    operation: Operation
    topics: tuple[Text, ...]
    partitions: tuple[Text, ...] | None
    data_tags: bool
    line: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """An `<allow_rule>` or `<deny_rule>`."""

    allow: bool
    domains: tuple[DomainRange, ...]
    criteria: tuple[Criterion, ...]
    line: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Grant:
    """A `<grant>`. Dates are the text of the document: vendors read them differently (`model/validity.py`)."""

    name: str
    subject_name: Text
    not_before: Text
    not_after: Text
    rules: tuple[Rule, ...]
    default_allow: bool
    default_line: int | None
    line: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Permissions:
    """The typed document, grants in document order."""

    grants: tuple[Grant, ...]
    line: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PermissionsFile:
    """A signed permissions document; `permissions` is None where the content has no single meaning."""

    signed: SignedDocument
    permissions: Permissions | None
    defects: tuple[Defect, ...]
    """Of the XML; those of the envelope are in `signed`."""
