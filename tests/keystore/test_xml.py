"""Signed XML: one meaning or a defect, nothing opened, nothing expanded, nothing unbounded."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.xml import MAX_DEFECTS, duplicates, read_xml, source_line
from tests.keystore.builder import GOVERNANCE
from tests.keystore.documents import FIRST_LINE, PERMISSIONS, SHARED, signed
from tests.steps import steps

NAME = b"<subject_name>CN=/talker</subject_name>"


def read(content: bytes) -> tuple[etree._Element | None, tuple[Defect, ...]]:
    return read_xml(signed(content))


def with_name(value: bytes) -> bytes:
    assert NAME in PERMISSIONS
    return PERMISSIONS.replace(NAME, b"<subject_name>" + value + b"</subject_name>")


def lines(content: bytes, needle: bytes) -> int:
    """The line of the file at which `needle` stands."""
    return content.count(b"\n", 0, content.index(needle)) + FIRST_LINE


# --- what means one thing


CLEAN = {
    "permissions": PERMISSIONS,
    "governance": GOVERNANCE,
    "CRLF": PERMISSIONS.replace(b"\n", b"\r\n"),
    "no declaration": PERMISSIONS.split(b"\n", 1)[1],
    "no schema location": b"<dds/>",
    "comments between elements": PERMISSIONS.replace(b"<grant", b"<!-- who -->\n<grant"),
    "comment at the top": PERMISSIONS.replace(b"<dds", b"<!-- top --><dds", 1),
    "comment at the end": PERMISSIONS.replace(b"</permissions>", b"</permissions><!-- -->") + b"<!-- -->",
    "CDATA in a comment": PERMISSIONS.replace(b"<grant", b"<!-- <![CDATA[ <!DOCTYPE --><grant"),
    "quoted attribute": PERMISSIONS.replace(b'"/talker"', b"'/talker'"),
    "character reference": with_name(b"CN=/t&#x61;lker&amp;&lt;&#62;"),
    "signs in a value": with_name(b"CN=/a!?'\"=:;]]"),
    "umlaut": with_name("CN=/töpfer".encode()),
    "a blank inside a value": with_name(b"CN=/a b"),
    "upper case encoding": PERMISSIONS.replace(b"UTF-8", b"utf-8"),
    "ASCII": PERMISSIONS.replace(b"UTF-8", b"US-ASCII"),
    "indented by tabs": PERMISSIONS.replace(b"  ", b"\t"),
    "on one line": PERMISSIONS.replace(b"\n", b""),
    "as sros2 of Crystal": PERMISSIONS.replace(b"<not_before>", b"<!--\n Format is CCYY-MM-DD\n-->\n<not_before>"),
}  # fmt: skip


@pytest.mark.parametrize("title", CLEAN)
def test_plain_xml_is_read_without_a_word(title: str) -> None:
    root, defects = read(CLEAN[title])
    assert root is not None
    assert defects == ()


# --- the catalogue of what implementations read differently (facts, x509-pkcs7-xml 4.1): content, line, words

DTD = b'<?xml version="1.0"?>\n<!DOCTYPE dds [%s]>\n' + PERMISSIONS.split(b"\n", 1)[1]
AMBIGUOUS: dict[str, tuple[bytes, int, str]] = {
    "comment in a value": (with_name(b"CN=/a<!-- -->b"), 14, "'CN=/a', Cyclone DDS and OpenDDS 'CN=/ab'"),
    "comment first in a value": (with_name(b"<!-- -->CN=/a"), 14, "first piece, '', Cyclone"),
    "comment for a value": (with_name(b"<!-- -->"), 14, "''"),
    "instruction in a value": (with_name(b"CN=/a<?x y?>b"), 14, "<?x y?>'"),
    "instruction between elements": (PERMISSIONS.replace(b"<grant", b"<?x y?><grant"), 13, "some parsers refuse"),
    "instruction at the top": (PERMISSIONS.replace(b"<dds", b"<?xml-stylesheet href='x'?><dds", 1), 10, "some parsers"),
    "instruction at the end": (PERMISSIONS + b"<?x y?>", 24, "some parsers"),
    "CDATA in a value": (with_name(b"CN=/<![CDATA[a]]>b"), 14, "first piece"),
    "CDATA for a value": (with_name(b"<![CDATA[CN=/a]]>"), 14, "CDATA"),
    "CDATA between elements": (PERMISSIONS.replace(b"<grant", b"<![CDATA[ ]]><grant"), 13, "CDATA"),
    "document type": (PERMISSIONS.replace(b"<dds", b"<!DOCTYPE dds>\n<dds", 1), 10, "document type"),
    "external document type": (PERMISSIONS.replace(b"<dds", b'<!DOCTYPE d SYSTEM "x:">\n<dds', 1), 10, "document type"),
    "internal entity": (DTD % b"<!ENTITY e 'CN=/x'>", 10, "document type"),
    "default attribute": (DTD % b"<!ATTLIST grant name CDATA 'x'>", 10, "document type"),
    "blank before a value": (with_name(b" CN=/a"), 14, "' CN=/a' with blanks"),
    "blank behind a value": (with_name(b"CN=/a "), 14, "trims"),
    "tab behind a value": (with_name(b"CN=/a\t"), 14, "trims"),
    "value on a line of its own": (with_name(b"\n CN=/a\n"), 14, "trims"),
    "value of blanks": (with_name(b"  "), 14, "trims"),
    "blank by reference": (with_name(b"CN=/a&#32;"), 14, "trims"),
    "blanks around a boolean": (GOVERNANCE.replace(b">true<", b"> true <", 1), 16, "trims"),
    "line feed in a value": (with_name(b"CN=/a\nb"), 14, "control"),
    "tab in a value": (with_name(b"CN=/a\tb"), 14, "control"),
    "line feed by reference": (with_name(b"CN=/a&#10;b"), 14, "control"),
    "CR by reference": (with_name(b"CN=/a&#13;b"), 14, "control"),
    "control by reference in an attribute": (PERMISSIONS.replace(b'"/talker"', b'"/t&#10;"'), 13, "attribute"),
    "C1": (with_name("CN=/\x9b0m".encode()), 14, "U+009B"),
    "C1 by reference": (with_name(b"CN=/&#x9b;0m"), 14, "control"),
    "DEL": (with_name(b"CN=/\x7f"), 14, "0x7f"),
    "bidi": (with_name("CN=/\u202ea".encode()), 14, "U+202E"),
    "bidi by reference": (with_name(b"CN=/&#x202e;a"), 14, "invisible"),
    "bidi in a comment": (PERMISSIONS.replace(b"<grant", "<!-- \u2066 --><grant".encode()), 13, "U+2066"),
    "zero width": (with_name("CN=/\u200ba".encode()), 14, "U+200B"),
    "tag letter": (with_name("CN=/a\U000e0041".encode()), 14, "U+E0041"),
    "line separator": (with_name("CN=/a\u2028".encode()), 14, "U+2028"),
    "filler that counts as a letter, by reference": (with_name(b"CN=/a&#x3164;"), 14, "invisible"),
    "escape": (with_name(b"CN=/\x1b[0m"), 14, "0x1b"),
    "NUL": (PERMISSIONS + b"\x00<evil/>", 24, "ignore everything behind it"),
    "NUL in a value": (with_name(b"CN=/a\x00b"), 14, "0x00"),
    "byte order mark": (b"\xef\xbb\xbf" + PERMISSIONS, 9, "byte order mark"),
    "UTF-16": (PERMISSIONS.decode().encode("utf-16"), 9, "UTF-16"),
    "UTF-16 without mark": (PERMISSIONS.decode().encode("utf-16-le"), 9, "UTF-16"),
    "UTF-16 the other way": (PERMISSIONS.decode().encode("utf-16-be"), 9, "UTF-16"),
    "UTF-32": (PERMISSIONS.decode().encode("utf-32-be"), 9, "UTF-32"),
    "ISO 8859-1": (PERMISSIONS.replace(b"UTF-8", b"ISO-8859-1"), 9, "ISO-8859-1"),
    "UTF-7": (PERMISSIONS.replace(b"UTF-8", b"UTF-7"), 9, "UTF-7"),
    "EBCDIC": (PERMISSIONS.replace(b"UTF-8", b"IBM037"), 9, "IBM037"),
    "no such encoding": (PERMISSIONS.replace(b"UTF-8", b"no-such"), 9, "no-such"),
    "second root": (PERMISSIONS + b"<dds/>", 24, "first root"),
    "text behind the root": (PERMISSIONS + b"evil", 24, "first root"),
    "default namespace": (PERMISSIONS.replace(b"<dds", b'<dds xmlns="urn:x"', 1), 11, "urn:x"),
    "prefix": (PERMISSIONS.replace(b"<dds", b'<dds xmlns:x="urn:x"', 1), 11, "'x' for"),
    "prefix below": (PERMISSIONS.replace(b"<grant", b'<grant xmlns:x="urn:x"'), 13, "'x' for"),
    "namespace below": (PERMISSIONS.replace(b"<default>", b'<default xmlns="urn:x">'), 20, "urn:x"),
    "element in a namespace": (PERMISSIONS.replace(b"default>", b"xsi:default>"), 20, "namespace"),
    "type": (PERMISSIONS.replace(b"<default>", b'<default xsi:type="xs:string">'), 20, "attribute"),
    "nil": (PERMISSIONS.replace(b"<default>", b"<default xsi:nil='true'>"), 20, "attribute"),
    "schema location": (PERMISSIONS.replace(b"<dds", b'<dds xsi:schemaLocation="a b"', 1), 11, "schemaLocation"),
    "location below": (PERMISSIONS.replace(b"<id>", b"<id xsi:noNamespaceSchemaLocation=''>", 1), 17, "attribute"),
    "another prefix": (PERMISSIONS.replace(b"xsi", b"x"), 11, "'x' for"),
    "lone CR": (PERMISSIONS.replace(b"<grant", b"\r<grant"), 13, "carriage return"),
    "lone CR in a value": (with_name(b"CN=/a\rb"), 14, "carriage return"),
    "comment behind the rules": (GOVERNANCE.replace(b"</dds>", b"<!-- --></dds>"), 33, "Fast DDS refuses"),
}  # fmt: skip


VARYING = frozenset(
    {"comment in a value", "comment first in a value", "comment for a value", "instruction in a value"}
    | {"instruction between elements", "instruction at the top", "instruction at the end"}
    | {"blank before a value", "blank behind a value", "tab behind a value", "value on a line of its own"}
    | {"value of blanks", "blank by reference", "blanks around a boolean", "default namespace", "prefix"}
    | {"prefix below", "namespace below", "type", "nil", "schema location", "location below", "another prefix"}
    | {"comment behind the rules"}
)
"""Of which it is known what each implementation does (tests/keystore/test_syntax.py)."""


@pytest.mark.parametrize("title", AMBIGUOUS)
def test_what_implementations_read_differently(title: str) -> None:
    content, line, words = AMBIGUOUS[title]
    _, defects = read(content)
    found = [defect for defect in defects if words in defect.detail]
    assert {defect.kind for defect in defects} <= {Kind.XML_AMBIGUOUS, Kind.XML_VARIES, Kind.XML_MALFORMED}
    kind = Kind.XML_VARIES if title in VARYING else Kind.XML_AMBIGUOUS
    assert [(defect.kind, defect.line, defect.path) for defect in found[:1]] == [
        (kind, line, "enclaves/permissions.p7s")
    ], defects


@pytest.mark.parametrize(
    "content",
    [
        b"<dds>",
        b"not xml",
        b"\n" + PERMISSIONS,
        b"\xef\xbb\xbf\xef\xbb\xbf" + PERMISSIONS,
        PERMISSIONS.replace(b'"1.0"', b'"9.9"', 1),
        with_name(b"CN=/\xff"),
        with_name(b"CN=/\xc0\x80"),
        with_name(b"CN=/&#27;"),
        with_name(b"CN=/&#0;"),
        with_name(b"CN=/&unknown;"),
        with_name(b"CN=/&"),
        PERMISSIONS.replace(b"<grant", b'<grant name="x"'),
        PERMISSIONS.replace(b"default>", b"y:default>"),
        b"<a>" * 300 + b"</a>" * 300,
        b"<a>" * 100_000,
    ],
)
def test_what_is_no_xml(content: bytes) -> None:
    root, defects = read(content)
    assert root is None
    assert Kind.XML_MALFORMED in {defect.kind for defect in defects}
    assert all(defect.line is None or defect.line >= FIRST_LINE for defect in defects)


@pytest.mark.parametrize("content", [b"", b" \r\n"])
def test_nothing_at_all_has_a_defect_of_its_own(content: bytes) -> None:
    """Fast DDS crashes on it."""
    root, defects = read(content)
    assert root is None
    assert [defect.kind for defect in defects] == [Kind.EMPTY_ELEMENT]


# --- nothing opened, nothing expanded


@pytest.mark.parametrize(
    "declaration",
    [
        '<!DOCTYPE dds [<!ENTITY e SYSTEM "{canary}">]>',
        '<!DOCTYPE dds [<!ENTITY % p SYSTEM "{canary}"> %p;]>',
        '<!DOCTYPE dds SYSTEM "{canary}">',
        '<!DOCTYPE dds PUBLIC "x" "{canary}" [<!ENTITY e "x">]>',
    ],
)
def test_no_file_is_opened(declaration: str, tmp_path: Path) -> None:
    canary = tmp_path / "canary"
    canary.write_text("<!ENTITY e 'CANARY'>")
    content = declaration.format(canary=canary.as_uri()).encode() + b"<dds><permissions>&e;</permissions></dds>"
    root, defects = read(content)
    assert root is None
    assert defects
    assert "CANARY" not in repr(defects)
    inclusion = f'<dds xmlns:xi="http://www.w3.org/2001/XInclude"><xi:include href="{canary.as_uri()}"/></dds>'
    root, defects = read(inclusion.encode())
    assert root is not None
    assert b"CANARY" not in etree.tostring(root)
    assert Kind.XML_AMBIGUOUS in {defect.kind for defect in defects}


LAUGHS = b"".join(b"<!ENTITY l%d '%s'>" % (i + 1, b"&l%d;" % i * 10) for i in range(9))
QUADRATIC = b"<!DOCTYPE dds [<!ENTITY a '%s'>]><dds>%s</dds>" % (b"x" * 50_000, b"&a;" * 20_000)
HOSTILE = {
    "billion laughs": b"<!DOCTYPE dds [<!ENTITY l0 'ha'>%s]><dds>&l9;</dds>" % LAUGHS,
    "billion laughs in an attribute": b"<!DOCTYPE dds [<!ENTITY l0 'ha'>%s]><dds a='&l9;'/>" % LAUGHS,
    "quadratic blow-up": QUADRATIC,
    "text of 8 MB": b"<dds>" + b"x" * (8 << 20) + b"</dds>",
    "attribute of 4 MB": b"<dds a='" + b"x" * (4 << 20) + b"'/>",
    "a million elements": b"<dds>" + b"<a/>" * 1_000_000 + b"</dds>",
    "100,000 elements": b"<dds>" + b"<a/>" * 99_000 + b"</dds>",
    "100,000 attributes": b"<dds " + b" ".join(b"a%d=''" % i for i in range(100_000)) + b"/>",
    "100,000 comments in a value": b"<dds>x" + b"<!---->" * 100_000 + b"</dds>",
    "100,000 instructions": b"<dds>" + b"<?x?>" * 100_000 + b"</dds>",
    "100,000 CDATA sections": b"<dds>" + b"<![CDATA[x]]>" * 100_000 + b"</dds>",
    "100,000 namespaces": b"<dds>" + b"<a xmlns='u'/>" * 99_000 + b"</dds>",
    "a million invisible characters": b"<dds>" + "\u202e".encode() * 1_000_000 + b"</dds>",
    "a million lone CRs": b"<dds>" + b"\r" * 1_000_000 + b"</dds>",
    "comment without an end": b"<dds>" + b"<!-- <!DOCTYPE" * 100_000,
}


@pytest.mark.parametrize("title", HOSTILE)
def test_hostile_sizes(title: str) -> None:
    """Work that C does not do at once grows with the elements, comments and sections at most."""
    defects: list[Defect] = []
    steps(lambda: defects.extend(read(HOSTILE[title])[1]), most=3_000_000)
    assert len(defects) <= MAX_DEFECTS
    assert defects or title in ("100,000 elements", "attribute of 4 MB"), "those are the schema's matter"
    assert all(len(defect.detail) < 400 for defect in defects)


# --- lines, duplicates, absence


def test_lines_beyond_the_sixteen_bits_that_a_node_holds() -> None:
    root, defects = read(b"<dds>\n" + b"<a></a>\n" * 70_000 + b"<b> x</b></dds>")
    assert root is not None
    assert source_line(root[-1]) == 70_002
    assert [defect.line for defect in defects] == [70_001 + FIRST_LINE]


def test_an_opaque_message_has_defects_without_a_line() -> None:
    _, (defect,) = read_xml(signed(with_name(b" CN=/a"), first_line=None))
    assert (defect.kind, defect.line) == (Kind.XML_VARIES, None)


def test_what_stands_twice_and_may_not() -> None:
    content = PERMISSIONS.replace(b"<default>DENY</default>", b"<default>DENY</default>\n<default>ALLOW</default>")
    root, _ = read(content)
    assert root is not None
    (defect,) = duplicates(root, signed(content))
    assert (defect.kind, defect.line) == (Kind.XML_VARIES, lines(content, b"<default>ALLOW"))
    assert "a second <default> in <grant>" in defect.detail
    twice = PERMISSIONS.replace(b"<topic>rt/chatter</topic>", b"<topic>a</topic><topic>b</topic>")
    root, _ = read(twice)
    assert root is not None
    assert duplicates(root, signed(twice)) == ()


# --- anything at all


@given(st.binary(max_size=300))
def test_no_bytes_raise(content: bytes) -> None:
    root, defects = read(content)
    assert root is not None or defects


PIECES = [
    *(
        b"<dds>",
        b"</dds>",
        b"<dds/>",
        b"<a",
        b">",
        b"/>",
        b"</a>",
        b"<!--",
        b"-->",
        b"<![CDATA[",
        b"]]>",
        b"<?x",
        b"?>",
    ),
    *(
        b"<!DOCTYPE dds",
        b"[<!ENTITY e 'x'>]",
        b"&e;",
        b"&#10;",
        b"&amp;",
        b" a='",
        b'"',
        b"'",
        b" ",
        b"\r",
        b"\n",
        b"\x00",
    ),
    *(
        b"xmlns='u'",
        b"xsi:nil='1'",
        b"\xef\xbb\xbf",
        b"<?xml version='1.0' encoding='",
        b"UTF-16",
        "\u202e".encode(),
        b"\xff",
    ),
]


@given(st.lists(st.sampled_from(PIECES), max_size=25))
def test_no_arrangement_of_markup_raises(pieces: list[bytes]) -> None:
    read(b"".join(pieces))


@given(st.text(min_size=1, max_size=20))
def test_a_value_without_defect_is_read_as_it_stands(value: str) -> None:
    """Whatever passes has no blank around it, no control or invisible character, and comes out as it went in."""
    escaped = value.replace("&", "&amp;").replace("<", "&lt;").replace("]]>", "]]&gt;")
    try:
        content = with_name(escaped.encode())
    except UnicodeEncodeError:
        return
    root, defects = read(content)
    if not defects:
        assert root is not None
        assert root.findtext(".//subject_name") == value == value.strip(" \t\r\n")
        assert not any(ord(character) < 0x20 for character in value)


@pytest.mark.skipif(not SHARED.is_dir(), reason="no ../shared here")
def test_reference_documents_are_plain() -> None:
    documents = sorted(SHARED.glob("reference/policies/**/permissions.xml"))
    assert len(documents) >= 6
    for path in [*documents, SHARED / "reference/xsd/sros2-rolling/defaults/governance.xml"]:
        root, defects = read(path.read_bytes())
        assert root is not None
        assert defects == (), path
