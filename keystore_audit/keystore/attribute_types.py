"""The types of attributes of names, as OpenSSL calls them, and names in that form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

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

_NAMES: Final = {identifier: name for name, identifier in OBJECT_IDENTIFIERS.items()}


def written(name: x509.Name) -> str:
    """The name as RFC 4514 has it, with OpenSSL's short names for the types that have one."""
    return name.rfc4514_string(_NAMES)
