"""Subjects of certificates, and how OpenSSL and OpenDDS write them."""

from __future__ import annotations

import re
from collections.abc import Hashable
from functools import lru_cache
from typing import Final, Protocol

from cryptography import x509

from keystore_audit.keystore.attribute_types import SHORT_NAMES


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


@lru_cache(maxsize=32_768)
def compact(certificate: Subject) -> str:
    r"""The subject as X509_NAME_oneline of OpenSSL 3 gives it: `/C=DE/CN=x`, slashes and plus signs in values escaped.

    Other octets than those of printed ASCII are written as `\xC3` (crypto/x509/x509_obj.c), here those of UTF-8.
    """
    return "".join(
        f"{'+' if place else '/'}{kind}={''.join(map(_compactly, value.encode('utf-8', 'surrogatepass')))}"
        for relative in certificate.subject_name.rdns
        for place, (kind, value) in enumerate(map(typed, relative))
    )


def _compactly(octet: int) -> str:
    if not 0x20 <= octet <= 0x7E:
        return f"\\x{octet:02X}"
    return f"\\{octet:c}" if octet in b"/+" else chr(octet)


# Subjects as OpenDDS prints and compares them (Certificate.h, SubjectName.cpp; read).
#
# A certificate's is printed as `openssl x509 -nameopt oneline` does, from the first relative name to the last. It is
# parsed like the text of a grant: relative names in order, each a set of attributes. RFC 2253 reverses their order.


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
    """`/type=value/type=value`: a relative name each, in order; what has no type or no value is passed over."""
    pieces = (tuple(part.strip(" ") for part in piece.strip(" ").partition("=")[::2]) for piece in text.split("/"))
    return tuple(frozenset({(kind, value)}) for kind, value in pieces if kind and value) or None
