"""Governance documents: every element with its value and its line in the .p7s file, or no document at all."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.keystore import document
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.typed import GovernanceFile, ProtectionKind, read_governance
from tests.keystore.builder import GOVERNANCE, Signed, authority, evidence, present, signed_document
from tests.keystore.documents import SHARED

CA = authority()
TWO_RULES = b"""<?xml version="1.0" encoding="UTF-8"?>
<dds>
  <domain_access_rules>
    <!-- the robot -->
    <domain_rule>
      <domains>
        <id>0</id>
        <id_range>
          <min>5</min>
          <max>232</max>
        </id_range>
        <id_range><min>1</min></id_range>
        <id_range><max>3</max></id_range>
      </domains>
      <allow_unauthenticated_participants>1</allow_unauthenticated_participants>
      <enable_join_access_control>0</enable_join_access_control>
      <discovery_protection_kind>NONE</discovery_protection_kind>
      <liveliness_protection_kind>SIGN</liveliness_protection_kind>
      <rtps_protection_kind>ENCRYPT_WITH_ORIGIN_AUTHENTICATION</rtps_protection_kind>
      <topic_access_rules>
        <topic_rule>
          <topic_expression>rt/[a-c]*</topic_expression>
          <enable_discovery_protection>false</enable_discovery_protection>
          <enable_liveliness_protection>true</enable_liveliness_protection>
          <enable_read_access_control>false</enable_read_access_control>
          <enable_write_access_control>true</enable_write_access_control>
          <metadata_protection_kind>SIGN_WITH_ORIGIN_AUTHENTICATION</metadata_protection_kind>
          <data_protection_kind>NONE</data_protection_kind>
        </topic_rule>
        <topic_rule>
          <topic_expression>*</topic_expression>
          <enable_discovery_protection>true</enable_discovery_protection>
          <enable_liveliness_protection>false</enable_liveliness_protection>
          <enable_read_access_control>true</enable_read_access_control>
          <enable_write_access_control>false</enable_write_access_control>
          <metadata_protection_kind>ENCRYPT</metadata_protection_kind>
          <data_protection_kind>SIGN</data_protection_kind>
        </topic_rule>
      </topic_access_rules>
    </domain_rule>
  </domain_access_rules>
</dds>
"""


def read(content: bytes, signer: Signed = CA) -> GovernanceFile:
    message = signed_document(content, signer)
    return read_governance(present(message, "enclaves/governance.p7s"), [evidence(CA)])


def test_every_element_has_its_value_and_its_line_in_the_file() -> None:
    message = signed_document(TWO_RULES, CA)
    file = read_governance(present(message), [evidence(CA)])
    assert file.governance is not None
    text = message.replace(b"\r", b"").decode().split("\n")

    def at(line: int | None) -> str:
        assert line is not None
        return text[line - 1].strip()

    (rule,) = file.governance.domain_rules
    first, second = rule.topic_rules
    assert at(file.governance.line) == "<dds>"
    assert at(rule.line) == "<domain_rule>"
    assert [(ids.low, ids.high, at(ids.line)) for ids in rule.domains] == [
        (0, 0, "<id>0</id>"),
        (5, 232, "<id_range>"),
        (1, None, "<id_range><min>1</min></id_range>"),
        (None, 3, "<id_range><max>3</max></id_range>"),
    ]
    assert (rule.allow_unauthenticated_participants, rule.enable_join_access_control) == (True, False)
    assert rule.discovery_protection_kind is ProtectionKind.NONE
    assert rule.liveliness_protection_kind is ProtectionKind.SIGN
    assert rule.rtps_protection_kind is ProtectionKind.ENCRYPT_WITH_ORIGIN_AUTHENTICATION
    assert {tag: at(line).startswith(f"<{tag}>") for tag, line in rule.lines.items()} == dict.fromkeys(rule.lines, True)
    assert set(rule.lines) >= {"domains", "rtps_protection_kind", "topic_access_rules"}
    assert (first.expression.text, at(first.expression.line)) == (
        "rt/[a-c]*",
        "<topic_expression>rt/[a-c]*</topic_expression>",
    )
    assert [
        (
            topic.enable_discovery_protection,
            topic.enable_liveliness_protection,
            topic.enable_read_access_control,
            topic.enable_write_access_control,
        )
        for topic in (first, second)
    ] == [(False, True, False, True), (True, False, True, False)]
    assert first.metadata_protection_kind is ProtectionKind.SIGN_WITH_ORIGIN_AUTHENTICATION
    assert (first.data_protection_kind, second.data_protection_kind) == (ProtectionKind.NONE, ProtectionKind.SIGN)
    assert at(second.lines["data_protection_kind"]) == "<data_protection_kind>SIGN</data_protection_kind>"
    assert at(second.line) == "<topic_rule>"


@pytest.mark.parametrize(
    ("kind", "authenticates", "encrypts", "authenticates_origin"),
    [
        (ProtectionKind.NONE, False, False, False),
        (ProtectionKind.SIGN, True, False, False),
        (ProtectionKind.ENCRYPT, True, True, False),
        (ProtectionKind.SIGN_WITH_ORIGIN_AUTHENTICATION, True, False, True),
        (ProtectionKind.ENCRYPT_WITH_ORIGIN_AUTHENTICATION, True, True, True),
    ],
)
def test_what_a_kind_protects(
    kind: ProtectionKind, authenticates: bool, encrypts: bool, authenticates_origin: bool
) -> None:
    found = (kind.authenticates, kind.encrypts, kind.authenticates_origin)
    assert found == (authenticates, encrypts, authenticates_origin)


def test_what_ardent_wrote_protects_no_liveliness() -> None:
    line = b"          <enable_liveliness_protection>true</enable_liveliness_protection>\n"
    file = read(GOVERNANCE.replace(line, b""))
    assert [defect.kind for defect in file.defects] == [Kind.DDS_SECURITY_1_0]
    assert file.governance is not None
    (topic,) = file.governance.domain_rules[0].topic_rules
    assert not topic.enable_liveliness_protection
    assert "enable_liveliness_protection" not in topic.lines


# --- values that the schema lets pass


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (b"<id>0</id>", b"<id>+0</id>", 15),
        (b"<id>0</id>", b"<id>00</id>", 15),
        (b"<id>0</id>", b"<id>-0</id>", 15),
        (b"<id>0</id>", b"<id>233</id>", 15),
        (b"<id>0</id>", b"<id>10000000000000000000000</id>", 15),
        (b"<max>232</max>", b"<max>233</max>", 18),
        (b"<max>232</max>", b"<max>4</max>", 16),
        (b"<max>232</max>", b"<max>0</max>", 16),
    ],
)
def test_domains_that_are_none(old: bytes, new: bytes, line: int) -> None:
    file = read(TWO_RULES.replace(old, new, 1))
    (defect,) = file.defects
    assert (defect.kind, defect.line, defect.path) == (Kind.VALUE_INVALID, line, "enclaves/governance.p7s")
    assert file.readings.common is None


def test_an_empty_topic_expression_crashes_implementations() -> None:
    for empty in (b"<topic_expression></topic_expression>", b"<topic_expression/>"):
        file = read(GOVERNANCE.replace(b"<topic_expression>*</topic_expression>", empty))
        assert [defect.kind for defect in file.defects] == [Kind.EMPTY_TOPIC]
        assert file.governance is None


# --- no single meaning


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (b"<rtps_protection_kind>SIGN", b"<rtps_protection_kind>SI<!-- -->GN", Kind.XML_VARIES),
        (b"<rtps_protection_kind>SIGN", b"<rtps_protection_kind>NO<![CDATA[NE]]>", Kind.XML_AMBIGUOUS),
        (b"<rtps_protection_kind>SIGN", b"<rtps_protection_kind> SIGN", Kind.SCHEMA_INVALID),
        (b"<rtps_protection_kind>SIGN", b"<rtps_protection_kind>", Kind.SCHEMA_INVALID),
        (b">true<", b"> true <", Kind.XML_VARIES),
        (b">true<", b">True<", Kind.SCHEMA_INVALID),
        (b"<id>0</id>", b"<id>0<!-- -->1</id>", Kind.XML_VARIES),
        (b"</dds>", b"", Kind.XML_MALFORMED),
    ],
)
def test_documents_without_one_meaning(old: bytes, new: bytes, expected: Kind) -> None:
    file = read(GOVERNANCE.replace(old, new, 1))
    assert expected in {defect.kind for defect in file.defects}
    assert file.readings.common is None
    assert file.signed.content is not None


def test_a_file_that_was_not_read() -> None:
    file = read_governance(File(path="p", resolved=None, status=Status.MISSING), [])
    assert (file.governance, file.defects) == (None, ())


SECOND_DOMAIN = GOVERNANCE.replace(b"</domain_access_rules>", GOVERNANCE[GOVERNANCE.index(b"<domain_rule>") :], 1)


@pytest.mark.parametrize(("content", "words"), [(TWO_RULES, "topic rules"), (SECOND_DOMAIN, "domain rules")])
def test_a_document_of_more_rules_than_are_read_has_no_meaning(
    content: bytes, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = content.partition(b"</dds>")[0] + b"</dds>"
    monkeypatch.setattr(document, "FEW_BYTES", 0)
    monkeypatch.setattr(document, "MAX_RULES", 2)
    assert read(content).governance is not None
    monkeypatch.setattr(document, "MAX_RULES", 1)
    file = read(content)
    (defect,) = file.defects
    assert (file.governance, defect.detail) == (None, f"more than 1 {words}, which are not read here")
    assert defect.kind is Kind.BEYOND_LIMIT


# --- anything at all


@given(st.binary(max_size=200))
def test_no_content_raises(content: bytes) -> None:
    assert read(content).governance is None


@given(st.data())
def test_no_change_of_the_content_raises(data: st.DataObject) -> None:
    place = data.draw(st.integers(0, len(TWO_RULES)))
    inserted = data.draw(
        st.sampled_from([b"<", b">", b"<!---->", b"&#32;", b" ", b"\n", b"0", b"x", b"/", b"<a/>", b"\xff"])
    )
    removed = data.draw(st.integers(0, 40))
    file = read(TWO_RULES[:place] + inserted + TWO_RULES[place + removed :])
    assert file.governance is not None or any(defect.kind.opaque for defect in file.defects)


@pytest.mark.skipif(not SHARED.is_dir(), reason="no ../shared here")
def test_the_default_of_sros2() -> None:
    file = read((SHARED / "reference/xsd/sros2-rolling/defaults/governance.xml").read_bytes())
    assert file.defects == ()
    assert file.governance is not None
    assert file.governance.domain_rules[0].rtps_protection_kind is ProtectionKind.SIGN
