"""Subjects as OpenDDS prints and compares them (Certificate.h, SubjectName.cpp; read).

A certificate's is printed as `openssl x509 -nameopt oneline` does, from the first relative name to the last, and parsed
like the text of a grant: relative names in order, each a set of attributes. RFC 2253 has the order of DNs reversed.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final

from keystore_audit.model.subjects.attributes import Subject, typed

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
