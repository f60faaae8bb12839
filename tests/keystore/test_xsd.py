"""Validation: what is valid, the older form, failures in words. Whether the schemas are right: tests/oracles/xsd."""

from __future__ import annotations

import pytest

from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.grammar import MAX_DETAIL, MAX_EXPLAINED_BYTES, Grammar, validate
from keystore_audit.keystore.xml import MAX_DEFECTS, read_xml
from tests.keystore.builder import GOVERNANCE
from tests.keystore.documents import (
    ARDENT_GOVERNANCE,
    CRYSTAL_PERMISSIONS,
    FIRST_LINE,
    PERMISSIONS,
    SHARED,
    signed,
)


def defects(content: bytes, grammar: Grammar) -> tuple[Defect, ...]:
    root, found = read_xml(signed(content))
    assert root is not None, found
    return validate(root, grammar, signed(content))


def kinds(content: bytes, grammar: Grammar) -> set[Kind]:
    return {defect.kind for defect in defects(content, grammar)}


@pytest.mark.parametrize(
    ("content", "grammar"),
    [(ARDENT_GOVERNANCE, Grammar.GOVERNANCE), (CRYSTAL_PERMISSIONS, Grammar.PERMISSIONS)],
)
def test_the_older_form_is_known_whatever_schema_it_names(content: bytes, grammar: Grammar) -> None:
    for named in (b"20160303", b"20170901", b"19990101"):
        (defect,) = defects(content.replace(b"20170901", named).replace(b"20160303", named), grammar)
        assert defect.kind is Kind.DDS_SECURITY_1_0
        assert defect.line is not None
        assert defect.line > FIRST_LINE
    neither = content.replace(b"id>", b"number>")
    assert kinds(neither, grammar) == {Kind.SCHEMA_INVALID}


def test_data_has_no_origin_authentication() -> None:
    """DDS-Security 1.1, 9.4.1.2.6.6: the basic kinds alone."""
    for kind in (b"SIGN_WITH_ORIGIN_AUTHENTICATION", b"ENCRYPT_WITH_ORIGIN_AUTHENTICATION"):
        data = GOVERNANCE.replace(b"<data_protection_kind>ENCRYPT", b"<data_protection_kind>" + kind)
        metadata = GOVERNANCE.replace(b"<metadata_protection_kind>ENCRYPT", b"<metadata_protection_kind>" + kind)
        assert kinds(data, Grammar.GOVERNANCE) == {Kind.SCHEMA_INVALID}
        (defect,) = defects(data, Grammar.GOVERNANCE)
        assert f": expected NONE, SIGN, ENCRYPT, found '{kind.decode()}'" in defect.detail
        assert kinds(metadata, Grammar.GOVERNANCE) == set()
        (defect,) = defects(metadata.replace(kind, b"ENCRYPTED"), Grammar.GOVERNANCE)
        assert "ENCRYPT, SIGN_WITH_ORIGIN_AUTHENTICATION, ENCRYPT_WITH_ORIGIN_AUTHENTICATION, found" in defect.detail


@pytest.mark.parametrize(
    ("old", "new", "needle", "words"),
    [
        (b"<id>0</id>", b"<id>a</id>", b"<id>a", "expected a number from 0 on, found 'a'"),
        (b">DENY<", b">REFUSE<", b"REFUSE", "expected ALLOW, DENY, found 'REFUSE'"),
        (
            b"2024-01-01T00",
            b"2024-13-01T00",
            b"2024-13",
            "expected a date as 2026-01-31T00:00:00, found '2024-13-01T00:00:00'",
        ),
        (b"<default>DENY</default>", b"", b"<grant", "'default' expected"),
        (b"<domains><id>0</id></domains>", b"", b"<publish>", "Tag 'domains' expected"),
        (b"<topic>rt/chatter</topic>", b"", b"<publish><topics>", "Tag 'topic' expected"),
        (b' name="/talker"', b"", b"<grant", "missing required attribute 'name'"),
        (b"publish>", b"write>", b"<write>", "Unexpected child with tag 'write'"),
        (b"<grant", b"text<grant", b"<permissions>", "character data between child elements not allowed"),
    ],
)
def test_failures_name_line_got_and_expected(old: bytes, new: bytes, needle: bytes, words: str) -> None:
    content = PERMISSIONS.replace(old, new, -1 if b"publish" in old else 1)
    (defect, *_) = defects(content, Grammar.PERMISSIONS)
    assert defect.kind is Kind.SCHEMA_INVALID
    assert defect.line == content.count(b"\n", 0, content.index(needle)) + FIRST_LINE
    assert words in defect.detail


def test_every_failure_is_named() -> None:
    content = PERMISSIONS.replace(b"<id>0<", b"<id>a<").replace(b">DENY<", b">NO<").replace(b"2024", b"x")
    assert len(defects(content, Grammar.PERMISSIONS)) == 3


def test_doubled_elements_are_told_too() -> None:
    content = PERMISSIONS.replace(b"<topics>", b"<topics><topic>secret</topic></topics><topics>")
    assert kinds(content, Grammar.PERMISSIONS) == {Kind.SCHEMA_INVALID, Kind.XML_VARIES}


def test_explanations_are_bounded() -> None:
    many = PERMISSIONS.replace(b"<topics>", b"<topics>" + b"<x/>" * 1000)
    long = PERMISSIONS.replace(b"DENY", b"D" * 10_000)
    huge = PERMISSIONS.replace(
        b"<topics>", b"<topics>" + b"<topic>t</topic>\n" * (MAX_EXPLAINED_BYTES // 17) + b"<x/>" * 100
    )
    for content in (many, long, huge):
        found = defects(content, Grammar.PERMISSIONS)
        for kind in (Kind.SCHEMA_INVALID, Kind.XML_AMBIGUOUS):
            assert len([defect for defect in found if defect.kind is kind]) <= MAX_DEFECTS
        assert found
        assert all(len(defect.detail) <= MAX_DETAIL for defect in found)


@pytest.mark.skipif(not SHARED.is_dir(), reason="no ../shared here")
def test_reference_documents_are_valid() -> None:
    for path in sorted(SHARED.glob("reference/policies/**/permissions.xml")):
        assert defects(path.read_bytes(), Grammar.PERMISSIONS) == (), path
    governance = SHARED / "reference/xsd/sros2-rolling/defaults/governance.xml"
    assert defects(governance.read_bytes(), Grammar.GOVERNANCE) == ()
