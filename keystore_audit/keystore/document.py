"""What governance and permissions documents have in common: from a signed file to valid elements with one meaning."""

from __future__ import annotations

import contextlib
import itertools
import re
from collections import Counter
from collections.abc import Callable, Iterator
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from lxml import etree
from msgspec import Struct

from keystore_audit.keystore.defect import Defect, Kind, first_opaque
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.keystore.xml import MAX_DEFECTS, duplicates, read_xml, source_line
from keystore_audit.profiles import facts
from keystore_audit.resources import schemas
from keystore_audit.text import shorten

if TYPE_CHECKING:
    from xmlschema import XMLSchema10

T = TypeVar("T")

MAX_DOMAIN: Final = 232
"""The largest domain whose UDP ports exist (DDSI-RTPS 2.5, 9.6.2.3: 7400 + 250 × domain + 11 + 2 × participant)."""

_CANONICAL: Final = re.compile(r"0|[1-9][0-9]{0,9}")
"""An integer as every implementation reads it; the schema also takes `+0`, `-0`, `00` and any number of digits."""

MAX_RULES: Final = 1_000
"""Grants, rules of permissions, domain rules and topic rules of a document that are read, of each: up to 0.9 s.

A real enclave has up to some hundred rules, and a document for all of a fleet a grant for each enclave."""

MAX_NAMES: Final = 10_000
"""Topics, and partitions, of a document that are read: up to 0.9 s. A hundred nodes in one enclave have some 5,000."""

MAX_WILD: Final = 1_500
MAX_WILD_CHARACTERS: Final = 20_000
"""Those of them with wildcards, which are compared with all others, and their characters: up to 0.9 s.

A real enclave has some dozens; 1,000 of 20 characters are within it."""

FEW_BYTES: Final = 16_384
"""In so many there are less of any of these: a rule takes 50 bytes, a topic 16."""

_ELEMENT: Final = type(etree.Element("dds"))

_COUNTED: Final = {
    "grant": "grants",
    "allow_rule": "allow and deny rules",
    "deny_rule": "allow and deny rules",
    "domain_rule": "domain rules",
    "topic": "topics",
    "partition": "partitions",
    "topic_expression": "topic rules",
}
_WILD: Final = "topics and partitions with wildcards"
_CHARACTERS: Final = f"characters of {_WILD}"
_MOST: Final = {"topics": MAX_NAMES, "partitions": MAX_NAMES, _WILD: MAX_WILD, _CHARACTERS: MAX_WILD_CHARACTERS}
_EXPRESSIONS: Final = ("topic", "partition", "topic_expression")
_WILDCARDS: Final = frozenset("*?[")

_TOPICS: Final = ("topic", "topic_expression")
"""Elements that crash implementations when they are empty (measured: Cyclone DDS 0.10.2, Fast DDS 2.9.1)."""


class Text(Struct, frozen=True, kw_only=True):
    """The text of an element and the line of the .p7s file where it stands (None: opaque message)."""

    text: str
    line: int | None


class DomainRange(Struct, frozen=True, kw_only=True):
    """An `<id>` (both bounds equal) or an `<id_range>`; an absent bound is None. What that means is the profile's."""

    low: int | None
    high: int | None
    line: int | None


class Document:
    """The XML of a signed document, with the defects found so far; values are read through it.

    `root` is None unless the text is one well-formed, schema-valid document of no more rules than are read. The methods
    expect elements of a valid one, and add `Kind.VALUE_INVALID` for values that the schema lets pass.
    """

    def __init__(self, signed: SignedDocument, grammar: Grammar) -> None:
        self.signed = signed
        self._line_before = None if signed.first_line is None else signed.first_line - 1
        root, defects = read_xml(signed)
        self._defects = list(defects)
        self._invalid = 0
        self.root: etree._Element | None = None
        if root is not None:
            failures = validate(root, grammar, signed)
            self._defects += failures
            valid = all(failure.kind is Kind.DDS_SECURITY_1_0 for failure in failures)
            few = len(signed.content or b"") <= FEW_BYTES
            if valid and (few or not self._has_more(root)):
                self.root = root

    def _has_more(self, root: etree._Element) -> bool:
        """Whether there are more than are read, which is a defect then."""
        counts = Counter[str]()
        for element in root.iter(*_COUNTED):
            for words, more in _counted(element):
                counts[words] += more
                most = _MOST.get(words, MAX_RULES)
                if counts[words] > most:
                    self.invalid(element, f"more than {most} {words}, which are not read here", Kind.BEYOND_LIMIT)
                    return True
        return False

    @property
    def defects(self) -> tuple[Defect, ...]:
        """Everything out of order in the XML, in the order found."""
        return tuple(self._defects)

    def meaning(self, read: Callable[[Document, etree._Element], T]) -> T | None:
        """What `read` makes of the root; None where the document has no meaning that we can tell."""
        found = None if self.root is None else read(self, self.root)
        return None if first_opaque(self._defects) is not None else found

    def line(self, element: etree._Element) -> int | None:
        """The line of the file at which the element stands."""
        line: Any = element.sourceline  # the stubs do not know what it is
        return None if line is None or self._line_before is None else line + self._line_before

    def invalid(self, element: etree._Element, detail: str, kind: Kind = Kind.VALUE_INVALID) -> None:
        """Note that the value of `element` is not one that DDS-Security gives a meaning to."""
        self._invalid += 1
        if self._invalid <= MAX_DEFECTS:
            self._defects.append(self.signed.defect(kind, source_line(element), detail))

    def text(self, element: etree._Element, *, may_be_empty: bool = False) -> str:
        """The text of a leaf element, the pieces around comments joined as the schema does."""
        text = joined(element)
        if not text and not may_be_empty:
            kind = Kind.EMPTY_TOPIC if element.tag in _TOPICS else Kind.VALUE_INVALID
            self.invalid(element, f"<{element.tag!s}> is empty", kind)
        return text

    def leaf(self, element: etree._Element, *, may_be_empty: bool = False) -> Text:
        """The same with its line."""
        text = element.text
        if not text or len(element):  # empty, or a comment in it
            text = self.text(element, may_be_empty=may_be_empty)
        return Text(text=text, line=self.line(element))

    def boolean(self, element: etree._Element) -> bool:
        """An xs:boolean."""
        return joined(element) in ("true", "1")

    def domains(self, element: etree._Element) -> Iterator[DomainRange]:
        """Each `<id>` and `<id_range>` of a `<domains>`."""
        for entry in elements(element):
            if entry.tag == "id":
                number = self._domain(entry)
                yield DomainRange(low=number, high=number, line=self.line(entry))
                continue
            bounds = {bound.tag: self._domain(bound) for bound in elements(entry)}
            low, high = bounds.get("min"), bounds.get("max")
            if low is not None and high is not None and low > high:
                self.invalid(entry, f"expected min <= max, found {low} > {high}: implementations read it differently")
            yield DomainRange(low=low, high=high, line=self.line(entry))

    def _domain(self, element: etree._Element) -> int | None:
        text = joined(element)
        if _CANONICAL.fullmatch(text) is None:
            self.invalid(element, f"expected a domain id in plain digits, found {text[:40]!r}")
            return None
        number = int(text)
        if number > MAX_DOMAIN:
            self.invalid(element, f"expected a domain id of 0 to {MAX_DOMAIN}, found {number}")
        return number


def _counted(element: etree._Element) -> Iterator[tuple[str, int]]:
    """What the element is one of, or has some of, of which not more than so many are read."""
    yield _COUNTED[element.tag], 1
    if element.tag in _EXPRESSIONS:
        text = joined(element)
        if not _WILDCARDS.isdisjoint(text):
            yield _WILD, 1
            yield _CHARACTERS, len(text)


def elements(parent: etree._Element) -> list[etree._Element]:
    """The child elements, comments left out."""
    return [child for child in parent if type(child) is _ELEMENT]


def joined(element: etree._Element) -> str:
    """The text of a leaf element without the comments in it."""
    text = element.text or ""
    return str(text) if len(element) == 0 else str(text) + "".join(str(child.tail or "") for child in element)


# --- validation against the grammar of DDS-Security: libxml2 decides, xmlschema explains what it refuses


MAX_EXPLAINED_BYTES: Final = 64 * 1024
"""Longest text that xmlschema explains, at 0.9 ms a kilobyte; of a longer one libxml2's messages are reported."""

MAX_DETAIL: Final = 400
"""Characters of one explanation, which may quote names and values from the document."""

_CURRENT: Final = "1.1"
_OLD: Final = "1.0"
_OLD_IS_READ: Final = {  # rules of permissions differ in the order of publish, subscribe and relay alone
    "governance": "which readers of 1.1 refuse or read as they like",
    "permissions": facts.ORDER_OF_1_0,
}
_RAISED_BY_XMLSCHEMA: Final = (LookupError, ValueError, TypeError, AttributeError, ArithmeticError)
"""Beside its own exceptions: on xsi:type, on years of twenty digits."""

_VALUE_TYPES: Final = {
    "xs:boolean": "true or false",
    "xs:dateTime": "a date as 2026-01-31T00:00:00",
    "xs:nonNegativeInteger": "a number from 0 on",
}


class Grammar(str, Enum):
    """Which of the two documents of DDS-Security 1.1, 9.4.1; the value is the name of its schema file."""

    GOVERNANCE = "governance"
    PERMISSIONS = "permissions"


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


@lru_cache(maxsize=4)
def _schema(version: str, grammar: Grammar) -> etree.XMLSchema:
    return etree.XMLSchema(etree.parse(_schema_path(version, grammar)))


@lru_cache(maxsize=2)
def _explaining(grammar: Grammar) -> XMLSchema10:
    """The schema by its text, with leave to load nothing: of a path xmlschema makes a URL, and asks urllib for it."""
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
