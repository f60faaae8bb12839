"""Permissions documents: grants, rules and criteria in their order, with their lines, or no document at all."""

from __future__ import annotations

import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from keystore_audit.keystore import document
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.typed import Operation, PermissionsFile, read_permissions
from keystore_audit.text import terminal
from tests.keystore.builder import authority, evidence, present, signed_document
from tests.keystore.documents import PERMISSIONS, SHARED

CA = authority()
FULL = b"""<dds>
  <permissions>
    <grant name="/a">
      <subject_name>CN=/a,O=x</subject_name>
      <validity>
        <not_before>2024-01-01T00:00:00Z</not_before>
        <not_after>2034-01-01T00:00:00.5+01:00</not_after>
      </validity>
      <deny_rule>
        <domains>
          <id>3</id>
          <id_range><min>5</min></id_range>
        </domains>
        <publish>
          <partitions>
            <partition></partition>
            <partition>p*</partition>
          </partitions>
          <topics>
            <topic>rt/secret</topic>
          </topics>
        </publish>
        <relay><topics><topic>*</topic></topics><data_tags><tag><name>n</name><value>v</value></tag></data_tags></relay>
      </deny_rule>
      <!-- in this order -->
      <allow_rule>
        <domains><id_range><min>0</min><max>9</max></id_range></domains>
        <publish>
          <topics>
            <topic>b</topic>
            <topic>a</topic>
          </topics>
        </publish>
        <subscribe><topics><topic>c</topic></topics></subscribe>
        <subscribe><topics><topic>d</topic></topics></subscribe>
      </allow_rule>
      <allow_rule><domains><id>0</id></domains></allow_rule>
      <default>ALLOW</default>
    </grant>
    <grant name="">
      <subject_name>CN=/b</subject_name>
      <validity><not_before>2024-01-01T00:00:00</not_before><not_after>2034-01-01T24:00:00</not_after></validity>
      <default>DENY</default>
    </grant>
  </permissions>
</dds>
"""


def read(content: bytes) -> PermissionsFile:
    message = signed_document(content, CA)
    return read_permissions(present(message, "enclaves/a/permissions.p7s"), [evidence(CA)])


def test_every_element_has_its_value_and_its_line_in_the_file() -> None:
    message = signed_document(FULL, CA)
    file = read_permissions(present(message), [evidence(CA)])
    assert file.defects == ()
    assert file.permissions is not None
    text = message.replace(b"\r", b"").decode().split("\n")

    def at(line: int | None) -> str:
        assert line is not None
        return text[line - 1].strip()

    first, second = file.permissions.grants
    assert at(file.permissions.line) == "<dds>"
    assert [at(grant.line) for grant in (first, second)] == ['<grant name="/a">', '<grant name="">']
    assert at(first.subject_name.line) == f"<subject_name>{first.subject_name.text}</subject_name>"
    assert at(first.not_before.line) == f"<not_before>{first.not_before.text}</not_before>"
    assert at(first.not_after.line) == f"<not_after>{first.not_after.text}</not_after>"
    assert (first.default_allow, at(first.default_line)) == (True, "<default>ALLOW</default>")
    assert (second.default_allow, second.rules, second.name) == (False, (), "")
    deny, allow, nothing = first.rules
    assert [rule.allow for rule in first.rules] == [False, True, True]
    assert [at(rule.line) for rule in (deny, allow)] == ["<deny_rule>", "<allow_rule>"]
    assert nothing.criteria == ()
    assert [(ids.low, ids.high, at(ids.line)) for ids in deny.domains] == [
        (3, 3, "<id>3</id>"),
        (5, None, "<id_range><min>5</min></id_range>"),
    ]
    assert [(ids.low, ids.high) for ids in allow.domains] == [(0, 9)]
    publish, relay = deny.criteria
    assert publish.partitions is not None
    assert [(name.text, at(name.line)) for name in publish.partitions] == [
        ("", "<partition></partition>"),
        ("p*", "<partition>p*</partition>"),
    ]
    assert (relay.operation, relay.data_tags, relay.partitions) == (Operation.RELAY, True, None)
    assert [(c.operation.value, [t.text for t in c.topics]) for c in allow.criteria] == [
        ("publish", ["b", "a"]),
        ("subscribe", ["c"]),
        ("subscribe", ["d"]),
    ]
    assert [at(topic.line) for topic in allow.criteria[0].topics] == ["<topic>b</topic>", "<topic>a</topic>"]
    assert at(allow.criteria[0].line) == "<publish>"


def test_the_older_form_keeps_the_order_of_the_document() -> None:
    mixed = FULL.replace(b"<relay>", b"<subscribe><topics><topic>x</topic></topics></subscribe><relay>").replace(
        b"<publish>\n          <partitions>",
        b"<relay><topics><topic>first</topic></topics></relay>\n        <publish>\n          <partitions>",
    )
    file = read(mixed)
    assert [defect.kind for defect in file.defects] == [Kind.DDS_SECURITY_1_0]
    assert file.permissions is not None
    criteria = file.permissions.grants[0].rules[0].criteria
    assert [criterion.operation.value for criterion in criteria] == ["relay", "publish", "subscribe", "relay"]


@pytest.mark.parametrize(
    ("old", "new", "expected", "line"),
    [
        (b"<id>3</id>", b"<id>03</id>", Kind.VALUE_INVALID, 19),
        (b"<id>3</id>", b"<id>233</id>", Kind.VALUE_INVALID, 19),
        (b"<min>0</min><max>9</max>", b"<min>9</min><max>0</max>", Kind.VALUE_INVALID, 35),
        (b"<topic>rt/secret</topic>", b"<topic></topic>", Kind.EMPTY_TOPIC, 28),
        (b"<topic>rt/secret</topic>", b"<topic/>", Kind.EMPTY_TOPIC, 28),
        (b"CN=/a,O=x", b"", Kind.VALUE_INVALID, 12),
        (b"2024-01-01T00:00:00Z", b"2024-02-30T00:00:00", Kind.SCHEMA_INVALID, 14),
        (b"2024-01-01T00:00:00Z", b"2024-01-01", Kind.SCHEMA_INVALID, 14),
        (b"CN=/a,O=x", b"CN=/a<!-- -->b", Kind.XML_VARIES, 12),
        (b">ALLOW<", b">AL<!-- -->LOW<", Kind.XML_VARIES, 46),
        (b">ALLOW<", b">allow<", Kind.SCHEMA_INVALID, 46),
        (b'name="/a"', b"", Kind.SCHEMA_INVALID, 11),
    ],
)
def test_documents_without_one_meaning(old: bytes, new: bytes, expected: Kind, line: int) -> None:
    file = read(FULL.replace(old, new, 1))
    assert file.readings.common is None
    assert [(defect.kind, defect.line) for defect in file.defects] == [(expected, line)]


def test_a_rule_without_domains_crashes_an_implementation() -> None:
    file = read(FULL.replace(b"<domains><id>0</id></domains>", b""))
    assert file.permissions is None
    (crash,) = [defect for defect in file.defects if defect.kind is Kind.RULE_WITHOUT_DOMAINS]
    assert crash.line == 45
    assert Kind.SCHEMA_INVALID in {defect.kind for defect in file.defects}


@pytest.mark.parametrize("old", [b"2024-01-01T00:00:00Z", b"2034-01-01T00:00:00.5+01:00"])
def test_an_empty_date_is_more_than_invalid(old: bytes) -> None:
    assert old in FULL
    assert Kind.EMPTY_ELEMENT in {defect.kind for defect in read(FULL.replace(old, b"", 1)).defects}
    assert Kind.EMPTY_ELEMENT in {defect.kind for defect in read(b"<dds/>").defects}
    assert Kind.EMPTY_ELEMENT not in {defect.kind for defect in read(FULL.replace(old, b"x", 1)).defects}


# --- anything at all

SEEN = st.characters(codec="utf-8", exclude_categories=("Cc", "Cf", "Cs", "Cn", "Co", "Zl", "Zp")).filter(
    lambda sign: terminal(sign) == sign or unicodedata.category(sign) == "Zs"
)
"""Characters that people see: variation selectors are marks (Mn) by category, and none is seen."""
NAMES = st.text(SEEN, min_size=1)


QUOTES = ('"', "'", "\u2018", "\u201c")
"""Signs at the start of a value for which Cyclone DDS refuses the document."""
VALUES = NAMES.filter(lambda name: name == name.strip(" \t\r\n") and not name.startswith(QUOTES))


@given(st.lists(VALUES, min_size=1, max_size=5), NAMES)
def test_names_come_out_as_they_went_in(topics: list[str], grant_name: str) -> None:
    root = etree.fromstring(PERMISSIONS)
    listed = root.find(".//topics")
    grant = root.find(".//grant")
    assert listed is not None
    assert grant is not None
    listed.clear()
    for topic in topics:
        etree.SubElement(listed, "topic").text = topic
    grant.set("name", grant_name)
    file = read(etree.tostring(root, encoding="UTF-8", xml_declaration=True))
    assert file.defects == ()
    assert file.permissions is not None
    (read_grant,) = file.permissions.grants
    assert read_grant.name == grant_name
    assert [topic.text for topic in read_grant.rules[0].criteria[0].topics] == topics


WITHOUT_RULES = FULL[: FULL.index(b"<deny_rule>")] + FULL[FULL.index(b"<default>ALLOW") :]


@pytest.mark.parametrize(
    ("content", "most", "words", "last"),
    [(FULL, 2, "allow and deny rules", b"<allow_rule><domains><id>"), (WITHOUT_RULES, 1, "grants", b'<grant name="">')],
)
def test_a_document_of_more_rules_than_are_read_has_no_meaning(
    content: bytes, most: int, words: str, last: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(document, "FEW_BYTES", 0)
    monkeypatch.setattr(document, "MAX_RULES", most + 1)
    assert read(content).defects == ()
    monkeypatch.setattr(document, "MAX_RULES", most)
    file = read(content)
    (defect,) = file.defects
    before = signed_document(content, CA).partition(last)[0]
    assert (file.permissions, defect.line) == (None, before.count(b"\n") + 1)
    assert (defect.kind, defect.detail) == (Kind.BEYOND_LIMIT, f"more than {most} {words}, which are not read here")


@given(st.data())
def test_no_change_of_the_content_raises(data: st.DataObject) -> None:
    place = data.draw(st.integers(0, len(FULL)))
    inserted = data.draw(
        st.sampled_from([b"<", b">", b"<!---->", b"&#32;", b" ", b"\n", b"0", b"x", b"/", b"<a/>", b"\xff"])
    )
    removed = data.draw(st.integers(0, 40))
    file = read(FULL[:place] + inserted + FULL[place + removed :])
    assert (file.readings.common is None) == any(defect.kind.opaque for defect in file.defects)


@pytest.mark.skipif(not SHARED.is_dir(), reason="no ../shared here")
def test_reference_documents() -> None:
    """What sros2 made of its own sample policies: the grants, and no word said."""
    for path in sorted(SHARED.glob("reference/policies/**/permissions.xml")):
        file = read(path.read_bytes())
        assert file.defects == (), path
        assert file.permissions is not None
        expected = etree.parse(path).findall(".//grant")
        assert [grant.name for grant in file.permissions.grants] == [grant.get("name") for grant in expected]
        topics = [t.text for g in file.permissions.grants for r in g.rules for c in r.criteria for t in c.topics]
        assert topics == [topic.text for grant in expected for topic in grant.iter("topic")]
