"""What governance and permissions documents have in common: from a signed file to what it says, and to whom."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, Generic, TypeVar

from lxml import etree
from msgspec import Struct

from keystore_audit.keystore.defect import Defect, Kind, first_opaque
from keystore_audit.keystore.grammar import Grammar, elements, joined, validate
from keystore_audit.keystore.smime import SignedDocument
from keystore_audit.keystore.syntax import FORMS, Refused, Unclear, as_read
from keystore_audit.keystore.xml import MAX_DEFECTS, read_xml, source_line
from keystore_audit.profiles import Syntax

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
"""A document of fewer bytes has fewer of all these: a rule takes 50 bytes, a topic 16."""

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
KNOWN_FORMS: Final = frozenset({Kind.XML_VARIES, Kind.SCHEMA_INVALID, Kind.VALUE_INVALID})
"""Defects for which `syntax` knows what implementations make of them."""

ONLY_1_1: Final = (Syntax.IN_ORDER, Syntax.ANY_ORDER)
"""Readings that take no governance of DDS-Security 1.0, and no ranges of ids that end before they begin (measured)."""

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
    """A reader of the values in a valid document, with the defects of those that have no meaning.

    The methods expect elements of a valid one, and add `Kind.VALUE_INVALID` for values that the schema lets pass.
    `syntax`: whose reading it is; then ids may be of no domain, and ranges end before they begin where somebody reads
    that.
    """

    def __init__(self, signed: SignedDocument, syntax: Syntax | None = None) -> None:
        self.signed = signed
        self.defects: list[Defect] = []
        self._syntax = syntax
        self._line_before = None if signed.first_line is None else signed.first_line - 1
        self._invalid = 0

    def has_more(self, root: etree._Element) -> bool:
        """Whether there are more rules and names than are read, which is a defect then."""
        if len(self.signed.content or b"") <= FEW_BYTES:
            return False
        counts = Counter[str]()
        for element in root.iter(*_COUNTED):
            for words, more in _counted(element):
                counts[words] += more
                most = _MOST.get(words, MAX_RULES)
                if counts[words] > most:
                    self.invalid(element, f"more than {most} {words}, which are not read here", Kind.BEYOND_LIMIT)
                    return True
        return False

    def line(self, element: etree._Element) -> int | None:
        """The line of the file at which the element stands."""
        line: Any = element.sourceline  # the stubs do not know what it is
        return None if line is None or self._line_before is None else line + self._line_before

    def invalid(self, element: etree._Element, detail: str, kind: Kind = Kind.VALUE_INVALID) -> None:
        """Note that the value of `element` is not one that DDS-Security gives a meaning to."""
        self._invalid += 1
        if self._invalid <= MAX_DEFECTS:
            self.defects.append(self.signed.defect(kind, source_line(element), detail))

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
            if low is not None and high is not None and low > high and self._syntax not in ONLY_1_1:
                self.invalid(entry, f"expected min <= max, found {low} > {high}: implementations read it differently")
            yield DomainRange(low=low, high=high, line=self.line(entry))

    def _domain(self, element: etree._Element) -> int | None:
        text = joined(element)
        if _CANONICAL.fullmatch(text) is None:
            self.invalid(element, f"expected a domain id in plain digits, found {text[:40]!r}")
            return None
        number = int(text)
        if number > MAX_DOMAIN and self._syntax is None:
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


class Readings(Struct, Generic[T], frozen=True, kw_only=True):
    """What a document says to each kind of XML reader; a str: why one refuses it; a defect: why it is unknown.

    For a kind that is missing, it is unknown how it reads the document.
    """

    by_syntax: Mapping[Syntax, T | str | Defect]

    @property
    def common(self) -> T | None:
        """What it says to all of them, if that is one meaning."""
        first = self.first
        return first if all(self.by_syntax.get(syntax) is first for syntax in Syntax) else None

    @property
    def distinct(self) -> list[T]:
        """Its distinct meanings; they differ in single values."""
        return [*{id(each): each for each in self._read}.values()]

    @property
    def first(self) -> T | None:
        """What it says to the first that reads it."""
        return next(self._read, None)

    @property
    def _read(self) -> Iterator[T]:
        return (each for each in self.by_syntax.values() if not isinstance(each, (str, Defect)))


def read_document(
    signed: SignedDocument, grammar: Grammar, read: Callable[[Document, etree._Element], T]
) -> tuple[Readings[T], tuple[Defect, ...]]:
    """What `read` makes of the signed text, and everything out of order in it, in the order found.

    A document that breaks the plain form is read as by each implementation (`syntax.as_read`), if that is known
    for all that is out of order. Raises AuditError only if the installation lacks its schemas.
    """
    root, found = read_xml(signed)
    if root is None:
        return Readings(by_syntax={}), found
    document = Document(signed)
    failures = validate(root, grammar, signed)
    valid = all(failure.kind is Kind.DDS_SECURITY_1_0 for failure in failures)
    common = read(document, root) if valid and not document.has_more(root) else None
    defects = (*found, *failures, *document.defects)
    readings: dict[Syntax, T | str | Defect] = {}
    if common is not None and first_opaque(defects) is None:
        readings = dict.fromkeys(Syntax, common)
        if grammar is Grammar.GOVERNANCE and failures:
            readings |= dict.fromkeys(ONLY_1_1, "it has the form of DDS-Security 1.0")
    elif {each.kind for each in defects if each.kind.opaque} <= KNOWN_FORMS:
        readings = dict(_readings(root, signed, grammar, read))
    return Readings(by_syntax=readings), defects


def _readings(
    root: etree._Element, signed: SignedDocument, grammar: Grammar, read: Callable[[Document, etree._Element], T]
) -> Iterator[tuple[Syntax, T | str | Defect]]:
    for syntax in FORMS:
        own = Document(signed, syntax)
        try:
            form = as_read(root, grammar, syntax)
        except Refused as refused:
            yield syntax, str(refused)
        except Unclear as unclear:
            line = None if unclear.element is None else source_line(unclear.element)
            yield syntax, signed.defect(Kind.VALUE_INVALID, line, str(unclear))
        else:
            meaning = None if own.has_more(form) else read(own, form)
            yield syntax, own.defects[0] if own.defects or meaning is None else meaning
