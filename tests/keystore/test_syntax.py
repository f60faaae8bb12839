"""What each implementation makes of documents that are not of the plain form: one change at a time.

The real ones answer in tests/oracles/vendors: recipes of governance and of documents, and random changes.
"""

from __future__ import annotations

import pytest

from keystore_audit.keystore.defect import Defect
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.typed import Governance, Permissions, read_governance, read_permissions
from keystore_audit.profiles import Syntax
from tests.keystore.builder import GOVERNANCE, authority, present, signed_document
from tests.keystore.documents import PERMISSIONS

CA = authority()
READ = b"<enable_read_access_control>true</enable_read_access_control>"
WRITE = b"<enable_write_access_control>true</enable_write_access_control>"
ID, TOPICS, DEFAULT = b"<id>0</id>", b"<topics><topic>rt/chatter</topic></topics>", b"<default>DENY</default>"
SUBJECT, TOPIC, KIND = b"<subject_name>CN=/talker", b"<topic>rt/chatter", b"<rtps_protection_kind>SIGN"
NOT_AFTER = b"<not_after>2034-01-01T00:00:00</not_after>"
ROOT, XSI = b"<dds xmlns:xsi=", b' xsi:noNamespaceSchemaLocation="http://www.omg.org/'


def said(document: Governance | Permissions) -> dict[str, object]:
    """What stands in a document, value by value."""
    if isinstance(document, Governance):
        (rule,) = document.domain_rules
        (topic,) = rule.topic_rules
        return {
            "ids": [(each.low, each.high) for each in rule.domains],
            "rtps": rule.rtps_protection_kind.value,
            "data": topic.data_protection_kind.value,
            "topics": topic.expression.text,
            "read": topic.enable_read_access_control,
        }
    (grant,) = document.grants
    return {
        "subject": grant.subject_name.text,
        "until": grant.not_after.text,
        "ids": [(each.low, each.high) for rule in grant.rules for each in rule.domains],
        "topics": [text.text for criterion in grant.allowed for text in criterion.topics],
        "partitions": [text.text for criterion in grant.allowed for text in criterion.partitions or ()],
        "default": grant.default_allow,
    }


def answers(document: bytes) -> tuple[str, str, str]:
    """What each of three readers makes of it: what differs from the plain document, `refused` or `unknown`."""
    plain = GOVERNANCE if b"domain_access_rules" in document else PERMISSIONS
    read = read_governance if plain is GOVERNANCE else read_permissions
    usual = read(present(signed_document(plain, CA)), []).readings.common
    assert usual is not None
    found = []
    by_syntax = read(present(signed_document(document, CA)), []).readings.by_syntax
    for syntax in (Syntax.SCHEMA, Syntax.IN_ORDER, Syntax.ANY_ORDER):
        one = by_syntax.get(syntax)
        if isinstance(one, str):
            found.append("refused")
        elif one is None or isinstance(one, Defect):
            found.append("unknown")
        else:
            before = said(usual)
            found.append(", ".join(f"{name}={value}" for name, value in said(one).items() if value != before[name]))
    return found[0], found[1], found[2]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        # texts: flags, kinds, numbers
        (READ, READ.replace(b"true", b"FALSE"), ("read=False", "read=False", "read=False")),
        (READ, READ.replace(b"true", b"False"), ("refused", "read=False", "read=False")),
        (READ, READ.replace(b"true", b"fALSE"), ("refused", "refused", "read=False")),
        (READ, READ.replace(b"true", b" false\n"), ("read=False", "refused", "read=False")),
        (READ, READ.replace(b"true", b""), ("refused", "refused", "read=False")),
        (READ, READ.replace(b"true", b"2"), ("refused", "", "refused")),
        (READ, READ.replace(b"true", b"fal<!-- -->se"), ("read=False", "refused", "read=False")),
        (KIND + b"<", b"<rtps_protection_kind> ENCRYPT<", ("refused", "refused", "rtps=ENCRYPT")),
        (KIND + b"<", b"<rtps_protection_kind><", ("refused", "refused", "rtps=ENCRYPT_WITH_ORIGIN_AUTHENTICATION")),
        (b">ENCRYPT</data_protection_kind>", b"></data_protection_kind>", ("refused", "refused", "")),
        (ID, b"<id> +03 </id>", ("ids=[(3, 3)]",) * 3),
        (ID, b"<id>0x3</id>", ("refused", "unknown", "unknown")),
        (ID, b"<id>three</id>", ("refused", "refused", "refused")),
        (ID, b"<id>430</id>", ("ids=[(430, 430)]",) * 3),
        (ID, b"<id_range><max>3</max><min>2</min></id_range>", ("refused", "ids=[(2, 3)]", "ids=[(2, 3)]")),
        (ID, b"<id_range><min>5</min><max>2</max></id_range>", ("unknown", "ids=[(5, 2)]", "ids=[(5, 2)]")),
        # names
        (b"<topic_expression>*", b"<topic_expression>rt/<!-- -->*", ("topics=rt/*", "topics=rt/", "topics=rt/*")),
        (b"<topic_expression>*", b"<topic_expression> rt/*", ("topics= rt/*", "topics= rt/*", "topics=rt/*")),
        (b"<topic_expression>*", b"<topic_expression>'*", ("topics='*", "topics='*", "unknown")),
        # elements
        (READ, READ + b"<enable_key_revision>true</enable_key_revision>", ("refused",) * 3),
        (READ + b"\n          " + WRITE, WRITE + READ, ("refused", "refused", "")),
        (READ, READ + READ.replace(b"true", b"false"), ("refused", "refused", "read=False")),
        (READ, READ.replace(b"read_", b"READ_"), ("refused", "refused", "")),
        (READ, b"", ("refused",) * 3),
        (READ, b"text" + READ, ("refused", "", "refused")),
        (READ, b"<?pi x?>" + READ, ("", "refused", "")),
        (b"<dds", b"<?pi x?><dds", ("", "", "")),
        (b"</dds>", b"</dds><?pi x?>", ("", "refused", "")),
        (b"</dds>", b"<!-- --></dds>", ("", "refused", "")),
        (b"<domain_rule>", b'<domain_rule id="1">', ("refused", "", "refused")),
        (ROOT, b'<dds xmlns="urn:x" xmlns:xsi=', ("refused", "", "refused")),
        (XSI, XSI + b"\n   ", ("", "", "")),
        (XSI, b' xsi:schemaLocation="a\nb"' + XSI, ("", "", "refused")),
    ],
)
def test_governance(old: bytes, new: bytes, expected: tuple[str, str, str]) -> None:
    assert old in GOVERNANCE
    assert answers(GOVERNANCE.replace(old, new, 1)) == expected


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (SUBJECT, b"<subject_name> CN=/talker", ("subject= CN=/talker", "subject= CN=/talker", "")),
        (SUBJECT, b"<subject_name>CN=/<!-- -->talker", ("", "subject=CN=/", "")),
        (SUBJECT, b"<subject_name>", ("unknown", "refused", "refused")),
        (TOPIC, b"<topic>rt/<!-- -->chatter", ("", "topics=['rt/']", "")),
        (TOPIC, "<topic>\u00a0rt/<!-- -->chatter".encode(),
         ("topics=['\\xa0rt/chatter']", "topics=['\\xa0rt/']", "topics=['\\xa0rt/chatter']")),
        (TOPIC, b"<topic>rt/chatter ", ("topics=['rt/chatter ']", "topics=['rt/chatter ']", "")),
        (NOT_AFTER, b"<not_after>2034-1-1</not_after>", ("refused", "until=2034-1-1", "until=2034-1-1")),
        (NOT_AFTER, b"", ("refused", "refused", "refused")),
        (NOT_AFTER, NOT_AFTER + NOT_AFTER, ("refused", "", "")),
        (DEFAULT, b"", ("refused", "refused", "")),
        (DEFAULT, b"<default> ALLOW </default>", ("refused", "refused", "default=True")),
        (DEFAULT, b"<default>allow</default>", ("refused", "refused", "")),
        (DEFAULT, b"<default></default>", ("refused", "refused", "unknown")),
        (DEFAULT, DEFAULT + b"<default>ALLOW</default>", ("refused", "", "default=True")),
        (b'<grant name="/talker">', b"<grant>", ("refused", "refused", "")),
        (b"<domains><id>0</id></domains>", b"<domains></domains>", ("refused", "refused", "ids=[], topics=[]")),
        (TOPICS, b"", ("refused", "topics=[]", "topics=[]")),
        (TOPICS, b"<topics></topics>", ("refused", "refused", "topics=[]")),
        (TOPICS, TOPICS + b"<partitions></partitions>", ("refused", "refused", "topics=[]")),
        (TOPICS, TOPICS + b"<topics><topic>rt/b</topic></topics>",
         ("refused", "topics=['rt/chatter', 'rt/b']", "topics=['rt/b']")),
        (b"</permissions>", b"</permissions><permissions></permissions>", ("refused", "", "refused")),
        (b"<publish>", b"<note/><publish>", ("refused", "refused", "refused")),
    ],
)  # fmt: skip
def test_permissions(old: bytes, new: bytes, expected: tuple[str, str, str]) -> None:
    assert old in PERMISSIONS
    assert answers(PERMISSIONS.replace(old, new, 1)) == expected


def test_nobody_knows_of_others() -> None:
    """What was not measured of one: everything that is out of form."""
    document = GOVERNANCE.replace(b"true", b"TRUE", 1)
    found = read_governance(present(signed_document(document, CA)), []).readings
    assert (found.common, Syntax.UNKNOWN in found.by_syntax) == (None, False)


def test_a_file_that_was_not_read() -> None:
    missing = File(path="p", resolved=None, status=Status.MISSING)
    assert read_governance(missing, []).readings.by_syntax == {}
