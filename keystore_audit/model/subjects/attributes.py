"""Subjects of certificates, and the types of their attributes as OpenSSL names them."""

from __future__ import annotations

import re
from collections.abc import Hashable, Mapping
from functools import lru_cache
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


# Subjects as OpenDDS prints and compares them (Certificate.h, SubjectName.cpp; read).
#
# A certificate's is printed as `openssl x509 -nameopt oneline` does, from the first relative name to the last, and
# parsed
# like the text of a grant: relative names in order, each a set of attributes. RFC 2253 has the order of DNs reversed.


RelativeNames = tuple[frozenset[tuple[str, str]], ...]

_ATTRIBUTE: Final = re.compile(r" *([A-Za-z][A-Za-z0-9-]*) *=((?:\\.?|[^\\,+])*)([,+]?)", re.DOTALL)
_UNESCAPED: Final = '"+,;<> #=\\'
"""What a backslash is taken from, one after the other."""


@lru_cache(maxsize=32_768)
def oneline(certificate: Subject) -> str:
    """The subject as X509_NAME_print_ex gives it with XN_FLAG_ONELINE."""
    names = ([typed(attribute) for attribute in relative] for relative in certificate.subject_name.rdns)
    return ", ".join(" + ".join(f"{kind} = {_quoted(value)}" for kind, value in each) for each in names)


def _quoted(value: str) -> str:
    quote = '"' if re.search(r"^[ #]|[,+<>;]| $", value) else ""
    return f"{quote}{''.join(map(_escaped, value))}{quote}"


def _escaped(character: str) -> str:
    if " " <= character < "\x7f":
        return f"\\{character}" if character in '"\\' else character
    return "".join(f"\\{byte:02X}" for byte in character.encode("utf-8", "surrogatepass"))


def relative_names(text: str) -> RelativeNames | None:
    """What a text means; None: it is no name, and a grant of it counts for nobody."""
    return _slashed(text) if text.startswith("/") else _parsed(text)


def _parsed(text: str) -> RelativeNames | None:
    found: list[frozenset[tuple[str, str]]] = []
    attributes: dict[str, str] = {}
    place, following = 0, ","
    while following:
        match = _ATTRIBUTE.match(text, place)
        if match is None:
            return None
        kind, value, following = match.groups()
        value = value.lstrip(" ")
        trimmed = value.rstrip(" ")
        trimmed += " " if trimmed.endswith("\\") and trimmed != value else ""
        if not trimmed:
            return None
        for character in _UNESCAPED:
            trimmed = trimmed.replace(f"\\{character}", character)
        attributes.setdefault(kind, trimmed)
        place = match.end()
        if following != "+":
            found.append(frozenset(attributes.items()))
            attributes = {}
    return tuple(found)


def _slashed(text: str) -> RelativeNames | None:
    """`/type=value/type=value`: one relative name; what has no value is passed over."""
    attributes: dict[str, str] = {}
    for piece in text.split("/"):
        kind, _sign, value = (each.strip(" ") for each in piece.partition("="))
        if kind and value:
            attributes.setdefault(kind, value)
    return (frozenset(attributes.items()),) if attributes else None
