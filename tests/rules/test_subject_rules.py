"""KA503, KA519, KA520: a grant in another notation is of whom it means, and one of somebody else stays critical."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from cryptography import x509
from cryptography.x509.oid import NameOID
from msgspec.structs import replace

from keystore_audit.findings import Finding, Severity
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.model.subjects.told import contested
from keystore_audit.profiles import VARIANTS, SubjectComparison
from tests.keystore.builder import authority, certificate
from tests.rules.evidence import certificates, codes, enclave, grant, judged, keystore, permissions, text

C, ORG, CN, MAIL = (
    NameOID.COUNTRY_NAME,
    NameOID.ORGANIZATION_NAME,
    NameOID.COMMON_NAME,
    NameOID.EMAIL_ADDRESS,
)
Parts = Sequence[tuple[x509.ObjectIdentifier, str]]

OMG: Parts = ((C, "US"), (ORG, "Object Computing"), (CN, "TEST"), (MAIL, "a@b.com"))
"""As the certificates of the OMG's interoperability set (omg-dds/dds-security) have it."""

FAST_DDS = {name for name in VARIANTS if name.startswith("fastdds")}
ORDERED = {"fastdds-2.6.4", "fastdds-2.6", "fastdds-2.9"}
CYCLONE_DDS = {name for name in VARIANTS if name.startswith("cyclonedds")}


def holder(parts: Parts, *named: str, path: str = "/talker") -> Enclave:
    """An enclave whose certificate has this subject, and a grant for each of these subject_names."""
    subject = x509.Name([x509.NameAttribute(kind, value) for kind, value in parts])
    place = f"enclaves{path}/cert.pem"
    grants = [grant(path, subject_name=text(each, 39)) for each in named]
    return enclave(
        path,
        certificate=certificates(place, certificate(subject, authority()).pem),
        permissions=permissions(f"enclaves{path}/permissions.p7s", *grants),
    )


def said(*enclaves: Enclave) -> list[Finding]:
    return [each for each in judged(keystore(*enclaves)).findings if each.code in ("KA503", "KA519", "KA520")]


@pytest.mark.parametrize(
    ("parts", "named", "finding_it"),
    [
        (OMG, "/C=US/O=Object Computing/CN=TEST/emailAddress=a@b.com", {*CYCLONE_DDS, "opendds"}),
        (OMG, "/CN=TEST/O=Object Computing/C=US/emailAddress=a@b.com", CYCLONE_DDS),
        (OMG, "emailAddress=a@b.com, CN=TEST, O=Object Computing, C=US", {*FAST_DDS, "cyclonedds-11"}),
        (OMG, " emailAddress=a@b.com, CN=TEST, O=Object Computing, C=US", {*FAST_DDS, "cyclonedds-11"}),
        (OMG, "\n emailAddress=a@b.com,CN=TEST,O=Object Computing,C=US\n", CYCLONE_DDS),
        (OMG, "C=US,O=Object Computing,CN=TEST,emailAddress=a@b.com", {*VARIANTS} - {"spec", *ORDERED}),
        (((ORG, "Müller GmbH"), (CN, "/talker")), "CN=/talker,O=M\\C3\\BCller GmbH", CYCLONE_DDS),
        (((ORG, "Org"), (CN, "/talker")), "/O=Org/CN=/talker", CYCLONE_DDS),
    ],
)
def test_who_does_not_find_the_own_subject_in_this_notation(parts: Parts, named: str, finding_it: set[str]) -> None:
    """The finding of a difference, and never that another has the grant."""
    (found,) = said(holder(parts, named))
    assert (found.code, found.severity) == ("KA520", Severity.HIGH)
    assert set(found.profiles) == set(VARIANTS) - finding_it


@pytest.mark.parametrize("named", ["1.2.840.113549.1.9.1=a@b.com,CN=TEST,O=Object Computing,C=US", "CN=TEST"])
def test_what_nobody_finds_is_no_grant_for_the_certificate(named: str) -> None:
    (found,) = said(holder(OMG, named))
    assert (found.code, found.severity, found.profiles) == ("KA503", Severity.HIGH, ())
    assert "the identity is 'emailAddress=a@b.com,CN=TEST,O=Object Computing,C=US'" in found.message


def test_an_address_is_printed_as_all_implementations_print_it() -> None:
    (found,) = said(holder(OMG, "emailAddress=a@b.com,CN=TEST,O=Object Computing,C=US"))
    assert (found.code, found.severity, found.profiles) == ("KA520", Severity.LOW, ("opendds",))


@pytest.mark.parametrize(
    ("parts", "named"),
    [
        (OMG, "/C=US/O=Object Computing/OU=Arms/CN=TEST/emailAddress=a@b.com"),
        (((CN, "/"),), "CN=/arm"),
        (((CN, "/arm"),), "/CN=/arm/hand"),
        (((ORG, "a/CN=b"),), "/O=a/CN=b"),
    ],
)
def test_a_grant_of_somebody_else_stays_critical(parts: Parts, named: str) -> None:
    found = said(holder(parts, named))
    assert [(each.code, each.severity) for each in found] == [("KA519", Severity.CRITICAL), ("KA503", Severity.HIGH)]
    assert set(found[0].profiles) >= CYCLONE_DDS


def test_text_that_means_two_subjects_of_the_keystore_gives_each_the_grant_of_the_other() -> None:
    one, other = ((ORG, "Org"), (CN, "TEST")), ((CN, "TEST"), (ORG, "Org"))
    alone = {each.code for each in said(holder(one, "CN = TEST, O = Org"))}
    both = said(holder(one, "CN = TEST, O = Org"), holder(other, "O=Org,CN=TEST", path="/listener"))
    assert alone == {"KA520"}
    assert {each.severity for each in both if each.code == "KA519"} == {Severity.CRITICAL}


@pytest.mark.parametrize(
    ("named", "expired"), [("/C=US/O=Object Computing/CN=TEST/emailAddress=a@b.com", True), ("/C=US/CN=TEST", False)]
)
def test_the_own_grant_is_the_own_in_whatever_notation(named: str, expired: bool) -> None:
    over = grant("/talker", subject_name=text(named, 39), not_after=text("2021-01-01T00:00:00", 41))
    whole = holder(OMG, named)
    assert ("KA513" in codes(keystore(whole))) is expired
    found = codes(keystore(replace(whole, permissions=permissions("enclaves/talker/permissions.p7s", over))))
    assert ("KA505" in found) is expired
    assert "KA512" not in found


@pytest.mark.parametrize(
    ("named", "comparison", "rests_on_the_handshake"),
    [
        (("/CN=\\/talker", "CN=/talker"), SubjectComparison.PIECES_IN_ORDER, True),
        (("CN = /talker", "/CN=\\/talker"), SubjectComparison.ATTRIBUTES, True),
        (("/CN=\\/talker", "CN=/talker"), SubjectComparison.PIECES_WITHIN, False),
        (("/CN=\\/other", "CN=/talker"), SubjectComparison.PIECES_IN_ORDER, False),
        (("/CN=\\/talker",), SubjectComparison.PIECES_IN_ORDER, False),
        (("/C=US/CN=x", "CN=x,C=US"), SubjectComparison.PIECES_IN_ORDER, True),
        (("/C=US/CN=x",), SubjectComparison.PIECES_IN_ORDER, False),  # as in the OMG's interoperability set
    ],
)
def test_both_forms_of_a_subject_leave_it_open_which_grant_counts(
    named: Sequence[str], comparison: SubjectComparison, rests_on_the_handshake: bool
) -> None:
    """Measured with two processes of Fast DDS 2.9.1 whose digests of names fell either way."""
    grants = [grant("/talker", subject_name=text(each, 39)) for each in named]
    assert contested(permissions("enclaves/talker/permissions.p7s", *grants), comparison) is rests_on_the_handshake
