"""Named documents: every row of the facts (x509-pkcs7-xml 4.1) and of issue 4, point 3.

What each parser reads in them is in `measured.json`. The catalogue of `tests/keystore/test_xml.py` is part of them;
here stands what only the comparison of parsers needs.
"""

from __future__ import annotations

from tests.keystore.builder import GOVERNANCE
from tests.keystore.documents import PERMISSIONS
from tests.keystore.test_xml import AMBIGUOUS, CLEAN
from tests.oracles.xml.ours import DocumentKind

_DOCTYPE = b"<!DOCTYPE dds [%s]>"
_TOPICS = b"<topic>rt/chatter</topic>"


def kind_of(document: bytes) -> DocumentKind:
    """Which reader the document is for."""
    return DocumentKind.GOVERNANCE if b"<domain_access_rules" in document else DocumentKind.PERMISSIONS


def plain_of(document: bytes) -> bytes:
    """The plain document from which this one is made."""
    return GOVERNANCE if kind_of(document) is DocumentKind.GOVERNANCE else PERMISSIONS


def _with(old: bytes, new: bytes, document: bytes = PERMISSIONS) -> bytes:
    assert old in document
    return document.replace(old, new, 1)


def _named(value: bytes) -> bytes:
    return _with(b"<subject_name>CN=/talker<", b"<subject_name>" + value + b"<")


def _topics(value: bytes) -> bytes:
    return _with(_TOPICS, value)


def _declared(declaration: bytes, value: bytes = b"CN=/talker") -> bytes:
    return _with(b"<dds", _DOCTYPE % declaration + b"<dds", _named(value))


def _domain(value: bytes) -> bytes:
    return _with(b"<id>0</id>", value)


_OF_PARSERS: dict[str, bytes] = {
    # entities and document types
    "external entity": _declared(b'<!ENTITY e SYSTEM "file:///etc/hostname">', b"&e;"),
    "parameter entity": _declared(b'<!ENTITY % p SYSTEM "file:///etc/hostname"> %p;'),
    "internal entity in a value": _declared(b"<!ENTITY e 'x'>", b"CN=/a&e;b"),
    "internal entity in an attribute": _with(b'"/talker"', b'"&e;"', _declared(b"<!ENTITY e 'x'>")),
    "entity that is not declared": _named(b"CN=/a&e;b"),
    "billion laughs": _declared(b"<!ENTITY a 'ha'><!ENTITY b '&a;&a;'><!ENTITY c '&b;&b;'>", b"&c;"),
    # pieces of a value
    "comment at the start of a value": _named(b"<!-- -->CN=/a"),
    "comment at the end of a value": _named(b"CN=/a<!-- -->"),
    "two comments in a value": _named(b"CN=/<!-- -->a<!-- -->b"),
    "comment and blank before a value": _named(b"<!-- --> CN=/a"),
    "CDATA with markup": _topics(b"<topic><![CDATA[</topic><topic>*]]></topic>"),
    "two CDATA sections": _named(b"<![CDATA[CN=/a]]><![CDATA[b]]>"),
    "empty CDATA section in a value": _named(b"CN=/a<![CDATA[]]>b"),
    "comment in a date": _with(b"<not_after>2034", b"<not_after>2<!-- -->034"),
    "comment in a domain": _domain(b"<id>1<!-- -->0</id>"),
    "comment in a boolean": _with(b">false<", b">fal<!-- -->se<", GOVERNANCE),
    "end of CDATA in a value": _named(b"CN=/a]]&gt;b"),
    # references
    "reference to a letter": _named(b"CN=/&#x62;&#98;"),
    "reference with zeros": _named(b"CN=/&#x0000062;&#00098;"),
    "reference beyond the plane": _named(b"CN=/&#x1F916;"),
    "reference with a capital X": _named(b"CN=/&#X62;"),
    "reference to NUL": _named(b"CN=/a&#0;b"),
    "reference to escape": _named(b"CN=/a&#27;b"),
    "reference to a surrogate": _named(b"CN=/a&#xD800;b"),
    "reference beyond Unicode": _named(b"CN=/a&#x110000;b"),
    "reference without a number": _named(b"CN=/a&#;b"),
    "reference to a reference": _named(b"CN=/&amp;lt;&#38;#98;"),
    "the five entities": _named(b"CN=/&amp;&lt;&gt;&quot;&apos;"),
    "ampersand alone": _named(b"CN=/a & b"),
    "reference to a blank between elements": _topics(b"&#32;" + _TOPICS),
    "reference to a line feed between elements": _topics(_TOPICS + b"&#xA;"),
    # quotation marks
    "value that begins with a quotation mark": _topics(b'<topic>"a</topic>'),
    "value that begins with an apostrophe": _topics(b"<topic>'a</topic>"),
    "value that begins with a typographic quotation mark": _topics("<topic>\u201ca</topic>".encode()),
    "value that begins with a typographic apostrophe": _topics("<topic>\u2018a</topic>".encode()),
    "value between quotation marks": _topics(b'<topic>"a"</topic>'),
    "value that begins with a referenced quotation mark": _topics(b"<topic>&quot;a</topic>"),
    "quotation mark inside a value": _topics(b"<topic>a\"b'c</topic>"),
    # blanks
    "blank in an end tag": _with(b"</topic>", b"</topic >"),
    "line feed in an end tag": _with(b"</grant>", b"</grant\n>"),
    "blanks in a start tag": _with(b'<grant name="/talker">', b'<grant\n\tname = "/talker"\n>'),
    "blank before a slash": _topics(_TOPICS + b"<topic />"),
    "tab in an attribute": _with(b'"/talker"', b'"/a\tb"'),
    "line feed in an attribute": _with(b'"/talker"', b'"/a\nb"'),
    "blanks around an attribute": _with(b'"/talker"', b'" /a "'),
    "blanks around a date": _with(b"<not_after>2034", b"<not_after> 2034"),
    "blanks around a domain": _domain(b"<id> 0 </id>"),
    "blanks around a kind": _with(b">SIGN<", b"> SIGN <", GOVERNANCE),
    "no-break space before a value": _named("\u00a0CN=/a".encode()),
    "form feed before a value": _named(b"\x0cCN=/a"),
    "blank line before the declaration": b"\n" + PERMISSIONS,
    "blank line before the root": PERMISSIONS.split(b"\n", 1)[1].replace(b"<dds", b"\n<dds", 1),
    # encodings
    "ill-formed UTF-8": _named(b"CN=/\xff"),
    "overlong UTF-8": _named(b"CN=/\xc0\xaf"),
    "surrogate in UTF-8": _named(b"CN=/\xed\xa0\x80"),
    "noncharacter": _named("CN=/\ufffe".encode()),
    "beyond the plane": _named("CN=/\U0001f916".encode()),
    "composed and decomposed": _named("CN=/\u00e9e\u0301".encode()),
    "XML 1.1": _with(b'"1.0"', b'"1.1"'),
    "version 9.9": _with(b'"1.0"', b'"9.9"'),
    "standalone": _with(b"?>", b" standalone='yes'?>"),
    "second declaration": _with(b"<dds", b'<?xml version="1.0"?><dds'),
    "two byte order marks": b"\xef\xbb\xbf\xef\xbb\xbf" + PERMISSIONS,
    # structure
    "empty": b"",
    "no markup": b"evil",
    "other root": b"<x/>",
    "other root first": b"<x/>" + PERMISSIONS.split(b"\n", 1)[1],
    "end tag of another case": _with(b"</topic>", b"</TOPIC>"),
    "element names in capitals": _with(b"<topic>rt/chatter</topic>", b"<TOPIC>rt/chatter</TOPIC>"),
    "doubled attribute": _with(b"<grant", b"<grant name='/x'"),
    "other attribute": _with(b"<grant", b"<grant x='y'"),
    "attribute without quotes": _with(b'"/talker"', b"/talker"),
    "less-than in an attribute": _with(b'"/talker"', b'"/a<b"'),
    "no attribute": _with(b' name="/talker"', b""),
    "xsi declared again": _with(b"<grant", b"<grant xmlns:xsi='http://www.w3.org/2001/XMLSchema-instance'"),
    "no namespace declared again": _with(b"<grant", b"<grant xmlns=''"),
    "depth 97": _topics(b"<x>" * 91 + b"</x>" * 91 + _TOPICS),
    "depth 120": _topics(b"<x>" * 114 + b"</x>" * 114 + _TOPICS),
    "depth 300": _topics(b"<x>" * 294 + b"</x>" * 294 + _TOPICS),
    "two minus signs in a comment": _with(b"<grant", b"<!-- -- --><grant"),
    "end of a comment alone": _with(b"<grant", b"--><grant"),
    "text between elements": _with(b"<grant", b"evil<grant"),
    "duplicate container": _with(b"</permissions>", b"</permissions><permissions></permissions>"),
    "duplicate default": _with(b"<default>DENY</default>", b"<default>DENY</default><default>ALLOW</default>"),
    "two lists of topics": _with(b"</topics>", b"</topics><topics><topic>*</topic></topics>"),
    "order": _with(b"<subject_name>", b"<default>DENY</default><subject_name>", _with(b"<default>DENY</default>", b"")),
    # values beyond the grammar
    "empty topic": _topics(b"<topic></topic>"),
    "empty topic in one tag": _topics(b"<topic/>"),
    "empty topics": _topics(b""),
    "empty subject": _named(b""),
    "rule without domains": _domain(b"").replace(b"<domains></domains>", b""),
    "huge number": _domain(b"<id>10000000000000000000000</id>"),
    "number with a sign": _domain(b"<id>+0</id>"),
    "number with zeros": _domain(b"<id>00</id>"),
    "no domain": _domain(b""),
    "range without minimum": _domain(b"<id_range><max>7</max></id_range>"),
    "range without minimum behind the domain": _domain(b"<id>0</id><id_range><max>7</max></id_range>"),
    "range without minimum in the governance": _with(b"<id>0</id>", b"<id_range><max>7</max></id_range>", GOVERNANCE),
    "domain 230": _domain(b"<id>0</id><id>230</id>"),
    "domain 231": _domain(b"<id>0</id><id>231</id>"),
    "domain 231 in the governance": _with(b"<id>0</id>", b"<id>0</id><id>231</id>", GOVERNANCE),
    "range without maximum": _domain(b"<id_range><min>7</min></id_range>"),
    "range the wrong way": _domain(b"<id_range><min>7</min><max>3</max></id_range>"),
    "year of five digits": _with(b"<not_after>2034", b"<not_after>99999"),
    "year before 1": _with(b"<not_before>2024", b"<not_before>-0001"),
    "hour 24": _with(b"2034-01-01T00", b"2034-01-01T24"),
    "time zone": _with(b"2034-01-01T00:00:00", b"2034-01-01T00:00:00+05:00"),
    "time zone far east": _with(b"2034-01-01T00:00:00", b"2034-01-01T00:00:00+14:00"),
    "fraction of a second": _with(b"2034-01-01T00:00:00", b"2034-01-01T00:00:00.5"),
    "year beyond 64 bits of nanoseconds": _with(b"<not_after>2034", b"<not_after>2263"),
    "day that does not exist": _with(b"2034-01-01", b"2034-02-30"),
    "boolean in capitals": _with(b">false<", b">FALSE<", GOVERNANCE),
    "boolean as number": _with(b">false<", b">0<", GOVERNANCE),
    "empty boolean": _with(b">false<", b"><", GOVERNANCE),
    "empty kind": _with(b"<rtps_protection_kind>SIGN", b"<rtps_protection_kind>", GOVERNANCE),
    "partitions": _with(b"</topics>", b"</topics><partitions><partition>A*</partition><partition/></partitions>"),
    "partitions before topics": _with(b"<publish>", b"<publish><partitions><partition/></partitions>"),
    "empty topic expression": _with(b"<topic_expression>*<", b"<topic_expression><", GOVERNANCE),
    "long value": _topics(b"<topic>" + b"x" * 70_000 + b"</topic>"),
}

DOCUMENTS: dict[str, bytes] = CLEAN | {title: case[0] for title, case in AMBIGUOUS.items()} | _OF_PARSERS
assert len(DOCUMENTS) == len(CLEAN) + len(AMBIGUOUS) + len(_OF_PARSERS), "a title stands for one document"
