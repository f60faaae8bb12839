"""Subjects of certificates, and the types of their attributes as OpenSSL names them."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Final, Protocol

from cryptography import x509

SHORT_NAMES: Final[Mapping[str, str]] = {
    # OpenSSL's short names (crypto/objects/objects.txt) of what stands in subjects; cryptography knows nine of them.
    "2.5.4.3": "CN",
    "2.5.4.4": "SN",
    "2.5.4.5": "serialNumber",
    "2.5.4.6": "C",
    "2.5.4.7": "L",
    "2.5.4.8": "ST",
    "2.5.4.9": "street",
    "2.5.4.10": "O",
    "2.5.4.11": "OU",
    "2.5.4.12": "title",
    "2.5.4.17": "postalCode",
    "2.5.4.41": "name",
    "2.5.4.42": "GN",
    "2.5.4.43": "initials",
    "2.5.4.44": "generationQualifier",
    "2.5.4.46": "dnQualifier",
    "2.5.4.65": "pseudonym",
    "0.9.2342.19200300.100.1.1": "UID",
    "0.9.2342.19200300.100.1.25": "DC",
    "1.2.840.113549.1.9.1": "emailAddress",
}

OBJECT_IDENTIFIERS: Final[Mapping[str, x509.ObjectIdentifier]] = {
    name: x509.ObjectIdentifier(number) for number, name in SHORT_NAMES.items()
}
"""By OpenSSL's short names."""


class Subject(Hashable, Protocol):
    """Whom a certificate is about, as `Certificate` has it; the certificate need not be here."""

    @property
    def subject(self) -> str:
        """As RFC 4514 writes it."""

    @property
    def subject_name(self) -> x509.Name:
        """Its attributes."""


def typed(attribute: x509.NameAttribute[str | bytes]) -> tuple[str, str]:
    """Its short name, or the numbers of a type without one, and its value."""
    kind = attribute.oid.dotted_string
    value = attribute.value if isinstance(attribute.value, str) else "#" + attribute.value.hex().upper()
    return SHORT_NAMES.get(kind, kind), value
