"""The governance document: DDS-Security 1.1, 9.4.1.2."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.smime import SignedDocument


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Text:
    """The text of an element and the line of the .p7s file where it stands (None: opaque message)."""

    text: str
    line: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class DomainRange:
    """An `<id>` (both bounds equal) or an `<id_range>`; an absent bound is None. What that means is the profile's."""

    low: int | None
    high: int | None
    line: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicRule:
    """A `<topic_rule>`. `lines` maps each element name to its line."""

    expression: Text
    enable_discovery_protection: bool
    enable_liveliness_protection: bool
    enable_read_access_control: bool
    enable_write_access_control: bool
    metadata_protection_kind: ProtectionKind
    data_protection_kind: ProtectionKind
    line: int | None
    lines: Mapping[str, int | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class DomainRule:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Governance:
    """The typed document, rules in document order."""

    domain_rules: tuple[DomainRule, ...]
    line: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class GovernanceFile:
    """A signed governance document; `governance` is None where the content has no single meaning."""

    signed: SignedDocument
    governance: Governance | None
    defects: tuple[Defect, ...]
    """Of the XML; those of the envelope are in `signed`."""
