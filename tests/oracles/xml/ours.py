"""What our readers say of a document: whether it has one meaning, and which values that meaning is made of."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from enum import Enum

from msgspec import Struct

from keystore_audit.keystore.defect import first_opaque
from keystore_audit.keystore.document import DomainRange
from keystore_audit.keystore.typed import Governance, Permissions, TopicRule, read_governance, read_permissions
from tests.keystore.builder import present
from tests.oracles.xml.parsers import Item

_BOUNDARY = b"===============1408883182640362377=="
_HEAD = (
    b'MIME-Version: 1.0\nContent-Type: multipart/signed; protocol="application/x-pkcs7-signature"; micalg="sha-256"; '
    b'boundary="' + _BOUNDARY + b'"\n\n--' + _BOUNDARY + b"\nContent-Type: text/plain\n\n"
)
_TAIL = (
    b"\n--" + _BOUNDARY + b"\nContent-Type: application/x-pkcs7-signature\nContent-Transfer-Encoding: base64\n\n"
    b"MAA=\n--" + _BOUNDARY + b"--\n"
)


class DocumentKind(Enum):
    """Which of the two signed documents of an enclave."""

    GOVERNANCE = "governance"
    PERMISSIONS = "permissions"


class OurReading(Struct, frozen=True):
    """`content`: the text as handed to a parser (line ends are CRLF). `typed`: None unless it has one meaning."""

    content: bytes
    typed: Governance | Permissions | None
    kinds: frozenset[str]

    @property
    def values(self) -> tuple[str, ...] | None:
        """The values that the meaning is made of."""
        if isinstance(self.typed, Governance):
            return tuple(_of_governance(self.typed))
        return None if self.typed is None else tuple(_of_permissions(self.typed))


def signed_message(document: bytes) -> bytes:
    """The document in the envelope that sros2 writes; the signature is nobody's, the content is read all the same."""
    return _HEAD + document + _TAIL


def read(document: bytes, kind: DocumentKind) -> OurReading | None:
    """Read it as a file of an enclave. None: the envelope has no text to read (the document holds its boundary)."""
    return read_message(signed_message(document), kind)


def read_message(message: bytes, kind: DocumentKind) -> OurReading | None:
    """Read a signed file; None where its envelope has no single content."""
    typed: Governance | Permissions | None
    if kind is DocumentKind.GOVERNANCE:
        governance = read_governance(present(message, "enclaves/governance.p7s"), ())
        signed, defects, typed = governance.signed, governance.defects, governance.governance
    else:
        permissions = read_permissions(present(message, "enclaves/permissions.p7s"), ())
        signed, defects, typed = permissions.signed, permissions.defects, permissions.permissions
    if signed.content is None:
        return None
    if first_opaque(defects) is not None:
        typed = None  # it has no one meaning
    return OurReading(signed.content, typed, frozenset(defect.kind.value for defect in defects))


_NAMES_NOT_KEPT = frozenset({"tag", "name", "value"})
"""Data tags: no implementation applies them, and we keep only whether there are any."""

_TRUE = frozenset({"true", "1"})


def comparable(reading: Sequence[Item]) -> tuple[str, ...]:
    """The values that a parser reads, as ours are written: partitions last, which stand before or behind topics."""
    kept = [item for before, item in itertools.pairwise(reading) if _is_kept(item, before)]
    partitions = [item for item in kept if item.path.endswith("/partition")]
    return tuple(_canonical(item) for item in [*(item for item in kept if item not in partitions), *partitions])


def _is_kept(item: Item, before: Item) -> bool:
    if item.kind == "A":
        return item.path.endswith("grant@name")
    leaf = item.path.rpartition("/")[2]
    if leaf == "max" and before.path.endswith("/min") and before.value == item.value:
        return False  # we keep no difference between the range 7 to 7 and the domain 7
    return item.kind == "V" and leaf not in _NAMES_NOT_KEPT and leaf not in ("partitions", "data_tags")


def _canonical(item: Item) -> str:
    leaf = item.path.rpartition("/")[2]
    if leaf.startswith(("enable_", "allow_unauthenticated")):
        return str(item.value in _TRUE)
    return item.value


def _of_permissions(permissions: Permissions) -> Iterator[str]:
    for grant in permissions.grants:
        yield from (grant.name, grant.subject_name.text, grant.not_before.text, grant.not_after.text)
        for rule in grant.rules:
            yield from _of_domains(rule.domains)
            yield from (topic.text for criterion in rule.criteria for topic in criterion.topics)
        yield "ALLOW" if grant.default_allow else "DENY"
    for criterion in (criterion for grant in permissions.grants for rule in grant.rules for criterion in rule.criteria):
        yield from (partition.text for partition in criterion.partitions or ())


def _of_domains(domains: Iterable[DomainRange]) -> Iterator[str]:
    for entry in domains:
        bounds = (entry.low, entry.high)
        yield from (str(bound) for bound in (bounds if entry.low != entry.high else bounds[:1]) if bound is not None)


def _of_governance(governance: Governance) -> Iterator[str]:
    for rule in governance.domain_rules:
        yield from _of_domains(rule.domains)
        yield str(rule.allow_unauthenticated_participants)
        yield str(rule.enable_join_access_control)
        yield rule.discovery_protection_kind.value
        yield rule.liveliness_protection_kind.value
        yield rule.rtps_protection_kind.value
        for topic in rule.topic_rules:
            yield from _of_topic_rule(topic)


def _of_topic_rule(rule: TopicRule) -> Iterator[str]:
    yield rule.expression.text
    yield str(rule.enable_discovery_protection)
    if "enable_liveliness_protection" in rule.lines:
        yield str(rule.enable_liveliness_protection)
    yield str(rule.enable_read_access_control)
    yield str(rule.enable_write_access_control)
    yield rule.metadata_protection_kind.value
    yield rule.data_protection_kind.value
