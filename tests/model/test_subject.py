"""Comparing subjects: many at once as one by one, and what each comparison makes of a name. Vendors: tests/oracles."""

from __future__ import annotations

import pytest
from cryptography import x509
from cryptography.x509.oid import NameOID
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.keystore.certificate import Certificate
from keystore_audit.model.subjects.comparison import matching, names, printed
from keystore_audit.model.subjects.told import same_meaning
from keystore_audit.profiles import SubjectComparison
from tests.amount import tried
from tests.keystore.builder import certificate, evidence

KINDS = (NameOID.COMMON_NAME, NameOID.ORGANIZATION_NAME, NameOID.ORGANIZATIONAL_UNIT_NAME)
VALUES = ("/a", "/b", "/a/b", "/b/a", "a,b", "=", "x", "ä")


def identity(*attributes: tuple[x509.ObjectIdentifier, str]) -> Certificate:
    return evidence(certificate(x509.Name([x509.NameAttribute(kind, value) for kind, value in attributes])))


IDENTITIES = [
    identity(),
    *(identity((NameOID.COMMON_NAME, value)) for value in VALUES),
    *(identity((other, "x"), (NameOID.COMMON_NAME, "/a")) for other in KINDS),
    identity((KINDS[2], "x"), (KINDS[2], "/a"), (NameOID.COMMON_NAME, "/a")),
]

ATTRIBUTES = st.tuples(st.sampled_from(["CN", "O", "OU", "", " CN "]), st.sampled_from(["=", "", " = "]))
TEXTS = st.lists(st.tuples(ATTRIBUTES, st.sampled_from([*VALUES, "", '"/a"', "\\/a"])), max_size=3).map(
    lambda parts: ",".join(f"{kind}{sign}{value}" for (kind, sign), value in parts)
)


@settings(max_examples=tried(300))
@given(texts=st.lists(TEXTS, max_size=6), comparison=st.sampled_from(SubjectComparison))
def test_many_at_once_are_as_one_by_one(texts: list[str], comparison: SubjectComparison) -> None:
    found = matching(texts, IDENTITIES, comparison, own=True)
    assert found == {
        text: frozenset(n for n, each in enumerate(IDENTITIES) if names(text, each, comparison)) for text in texts
    }


@pytest.mark.parametrize("comparison", SubjectComparison)
def test_every_implementation_finds_what_sros2_writes(comparison: SubjectComparison) -> None:
    subject = identity((NameOID.COMMON_NAME, "/robot/arm_2"))
    assert names("CN=/robot/arm_2", subject, comparison)
    assert not names("CN=/robot/leg", subject, comparison)
    assert not names("CN=/robot", subject, comparison)


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("CN=/a,O=x", True),
        ("O=x, CN = /a", True),
        ('O="x",CN=\\/a', True),
        (" \n2.5.4.3=/a,O=\\78 ", True),
        ("/O=x/CN=/a", True),
        ("/O=x/CN=\\/a", True),
        ("/CN=/a/O=x", False),  # the slash in the value: whether it ends there is nowhere said
        ("CN=/a", False),
        ("CN=/a,O=x,O=x", False),
        ("CN=/A,O=x", False),
        ("nonsense", False),
        ("", False),
    ],
)
def test_what_means_the_same_subject(text: str, same: bool) -> None:
    assert same_meaning(text, identity((NameOID.ORGANIZATION_NAME, "x"), (NameOID.COMMON_NAME, "/a"))) is same


def test_a_name_beyond_ascii_is_printed_in_two_ways() -> None:
    subject = identity((NameOID.COMMON_NAME, "/ä"))
    assert printed(subject, escape_non_ascii=True) == "CN=/\\C3\\A4"
    assert printed(subject, escape_non_ascii=False) == "CN=/ä"


def test_attributes_of_one_relative_name_are_printed_from_the_last_too() -> None:
    several = x509.RelativeDistinguishedName(x509.NameAttribute(kind, "x" * n) for n, kind in enumerate(KINDS, 1))
    subject = evidence(certificate(x509.Name([several, *x509.Name([x509.NameAttribute(KINDS[0], "/a")]).rdns])))
    assert printed(subject, escape_non_ascii=False) == "CN=/a,OU=xxx+O=xx+CN=x"
    assert names("CN=/a,OU=xxx+O=xx+CN=x", subject, SubjectComparison.PIECES_IN_ORDER)
    assert not names("CN=/a,CN=x+O=xx+OU=xxx", subject, SubjectComparison.PIECES_IN_ORDER)
