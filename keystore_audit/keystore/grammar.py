"""The grammar of DDS-Security 1.1, 9.4.1, and 1.0's: libxml2 decides, xmlschema explains what it refuses."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from lxml import etree

from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.keystore.xml import MAX_DEFECTS, duplicates, source_line
from keystore_audit.profiles import facts
from keystore_audit.resources import schemas
from keystore_audit.text import shorten

if TYPE_CHECKING:
    from xmlschema import XMLSchema10

MAX_EXPLAINED_BYTES: Final = 64 * 1024
"""Longest text that xmlschema explains, at 0.9 ms a kilobyte; of a longer one libxml2's messages are reported."""

MAX_DETAIL: Final = 400
"""Characters of one explanation, which may quote names and values from the document."""

_ELEMENT: Final = type(etree.Element("dds"))
_CURRENT: Final = "1.1"
_OLD: Final = "1.0"
_OLD_IS_READ: Final = {  # rules of permissions differ in the order of publish, subscribe and relay alone
    "governance": "which readers of 1.1 refuse or interpret differently",
    "permissions": facts.ORDER_OF_1_0,
}
_RAISED_BY_XMLSCHEMA: Final = (LookupError, ValueError, TypeError, AttributeError, ArithmeticError)
"""What xmlschema raises beyond its own exceptions: on xsi:type, on years of twenty digits."""

_VALUE_TYPES: Final = {
    "xs:boolean": "true or false",
    "xs:dateTime": "a date as 2026-01-31T00:00:00",
    "xs:nonNegativeInteger": "a number from 0 on",
}


class Grammar(str, Enum):
    """Which of the two documents of DDS-Security 1.1, 9.4.1; the value is the name of its schema file."""

    GOVERNANCE = "governance"
    PERMISSIONS = "permissions"


def elements(parent: etree._Element) -> list[etree._Element]:
    """The child elements, comments left out."""
    return [child for child in parent if type(child) is _ELEMENT]


def joined(element: etree._Element) -> str:
    """The text of a leaf element without the comments in it."""
    text = element.text or ""
    return str(text) if len(element) == 0 else str(text) + "".join(str(child.tail or "") for child in element)


def validate(root: etree._Element, grammar: Grammar, signed: SignedDocument) -> tuple[Defect, ...]:
    """Validate against version 1.1 of the grammar, then 1.0, whatever schema the document names.

    Nothing for a valid document, `Kind.DDS_SECURITY_1_0` for one of the older form, else `Kind.SCHEMA_INVALID` for
    every failure, got and expected, and `Kind.XML_AMBIGUOUS` for doubled elements. Raises AuditError if the
    installation lacks its schemas.
    """
    current = _schema(_CURRENT, grammar)
    if current.validate(root):
        return ()
    log: Any = current.error_log  # the stubs do not know what is in it
    messages: list[tuple[int, str]] = [(error.line, error.message) for error in log]
    if _schema(_OLD, grammar).validate(root):
        detail = f"{grammar.value} of DDS-Security 1.0 (20160303), {_OLD_IS_READ[grammar.value]}"
        line, message = messages[0]
        return (signed.defect(Kind.DDS_SECURITY_1_0, line, shorten(f"{detail}: {message}", MAX_DETAIL)),)
    explained: list[tuple[int | None, str]] = []
    if signed.content is not None and len(signed.content) <= MAX_EXPLAINED_BYTES:
        explained = _explained(root, grammar)
    failures = [
        signed.defect(Kind.SCHEMA_INVALID, line, shorten(detail, MAX_DETAIL))
        for line, detail in explained or messages[:MAX_DEFECTS]
    ]
    return (*failures, *duplicates(root, signed), *_rules_without_domains(root, signed), *_empty(root, signed))


def is_valid(root: etree._Element, grammar: Grammar, *, any_date: bool) -> bool:
    """Whether the document is of the grammar of 1.1; of 1.0's too, unless `any_date`: dates are any text then.

    Raises AuditError as `validate`.
    """
    current = _schema(_CURRENT, grammar, any_date=any_date).validate(root)
    return current or (not any_date and _schema(_OLD, grammar).validate(root))


def _rules_without_domains(root: etree._Element, signed: SignedDocument) -> Iterator[Defect]:
    """Rules that crash Cyclone DDS (measured, 0.10.2), in the order of the document."""
    for rule in itertools.islice(root.iter("allow_rule", "deny_rule"), MAX_DEFECTS):
        if rule.find("domains") is None:
            yield signed.defect(Kind.RULE_WITHOUT_DOMAINS, source_line(rule), f"<{rule.tag!s}> has no <domains>")


def _empty(root: etree._Element, signed: SignedDocument) -> Iterator[Defect]:
    """Elements whose emptiness crashes Fast DDS (measured, 2.9.1 and 2.14.6): the document, the dates of a grant."""
    dates = itertools.islice(root.iter("not_before", "not_after"), MAX_DEFECTS)
    for element in [root, *dates] if len(root) == 0 else dates:
        if len(element) == 0 and not (element.text or "").strip():
            yield signed.defect(Kind.EMPTY_ELEMENT, source_line(element), f"<{element.tag!s}> is empty")


@lru_cache(maxsize=8)
def _schema(version: str, grammar: Grammar, *, any_date: bool = False) -> etree.XMLSchema:
    text = Path(_schema_path(version, grammar)).read_bytes()
    return etree.XMLSchema(etree.fromstring(text.replace(b"xs:dateTime", b"xs:string") if any_date else text))


@lru_cache(maxsize=2)
def _explaining(grammar: Grammar) -> XMLSchema10:
    """The schema by its text, and without permission to load anything: xmlschema gives a path to urllib as a URL."""
    import xmlschema  # 0.2 s, and only documents that are refused need it

    text = Path(_schema_path(_CURRENT, grammar)).read_text("utf-8")
    return xmlschema.XMLSchema10(text, allow="none", use_fallback=False)


def _schema_path(version: str, grammar: Grammar) -> str:
    return str(schemas() / f"dds_security_{version}" / f"{grammar.value}.xsd")


def _explained(root: etree._Element, grammar: Grammar) -> list[tuple[int | None, str]]:
    """The explanations, as far as they go: xmlschema raises on some documents that it should refuse (xsi:type)."""
    import xmlschema

    found: list[tuple[int | None, str]] = []
    # What comes before a fault is kept; without any, the words of lxml, which has refused the document, stand.
    with contextlib.suppress(xmlschema.XMLSchemaException, *_RAISED_BY_XMLSCHEMA):
        found.extend(itertools.islice(_explanations(root, grammar), MAX_DEFECTS))
    return found


def _explanations(root: etree._Element, grammar: Grammar) -> Iterator[tuple[int | None, str]]:
    """What is wrong in the words of xmlschema, which names got and expected and does not stop at the first failure."""
    for error in _explaining(grammar).iter_errors(root, use_location_hints=False):
        element: object = error.elem
        if not etree.iselement(element):
            yield source_line(root), f"<{root.tag!s}>: {error.reason}"
            continue
        found = "" if len(element) else f", found {str(element.text or '')!r}"
        expected = getattr(error.validator, "prefixed_name", None)  # of a simple type: xs:boolean, xs:dateTime
        wanted = f"expected {_VALUE_TYPES[expected]}" if found and expected in _VALUE_TYPES else error.reason
        if getattr(error.validator, "enumeration", None):
            wanted = f"expected {', '.join(_values(grammar, str(element.tag)))}"
        index = getattr(error, "index", len(element))  # of a child that should not be there
        yield source_line(element[index] if index < len(element) else element), f"<{element.tag!s}>: {wanted}{found}"


@lru_cache(maxsize=32)
def _values(grammar: Grammar, tag: str) -> tuple[str, ...]:
    """All values that an element of the grammar may have; xmlschema names those of one part of a union."""
    declared: Any = _explaining(grammar).find(f".//{tag}")
    parts = getattr(declared.type, "member_types", (declared.type,))
    return tuple(value for part in parts for value in part.enumeration)
