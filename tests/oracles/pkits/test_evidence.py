"""What the readers of certificates and revocation lists say of PKITS, beside OpenSSL and asn1crypto."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from datetime import datetime

import pytest
from asn1crypto import crl, x509  # type: ignore[import-untyped]

from keystore_audit.keystore.certificate import Certificate, read_certificates
from keystore_audit.keystore.crl import RevocationList, read_crl
from keystore_audit.keystore.issuer import Issue, crl_signed_by, issued_by
from keystore_audit.truth import Truth
from tests.keystore.builder import present
from tests.oracles.pkits import paths, suite

UNREAD = {
    "DSAParametersInheritedCACert": "its DSA key inherits the parameters of its issuer's (4.1.5)",
    "ValidDSAParameterInheritanceTest5EE": "its DSA key inherits the parameters of its issuer's",
}
"""Certificates that we do not read: opaque, never denied. OpenSSL 3 reads them and cannot use their keys."""


@pytest.fixture(scope="module")
def certificates() -> dict[str, Certificate]:
    found = {}
    for name, der in suite.load().certificates.items():
        read = read_certificates(present(suite.pem("CERTIFICATE", der)))
        if read.first is None:
            assert [defect.kind.opaque for defect in read.defects] == [True], name
        else:
            found[name] = read.first
    return found


@pytest.fixture(scope="module")
def lists() -> dict[str, RevocationList]:
    read = {name: read_crl(present(suite.pem("X509 CRL", der), "crl.pem")) for name, der in suite.load().lists.items()}
    return {name: file.revocation_lists[0] for name, file in read.items() if file.revocation_lists}


def test_certificates_are_read(certificates: dict[str, Certificate]) -> None:
    assert suite.load().certificates.keys() - certificates.keys() == UNREAD.keys()


def test_certificates_say_the_same(certificates: dict[str, Certificate]) -> None:
    """As asn1crypto reads them, in Python alone."""
    for name, ours in certificates.items():
        theirs = x509.Certificate.load(suite.load().certificates[name])
        constraints, usage = theirs.basic_constraints_value, theirs.key_usage_value
        assert ours.serial == theirs.serial_number, name
        assert (ours.subject_der, ours.issuer_der) == (theirs.subject.dump(), theirs.issuer.dump()), name
        assert (ours.not_before, ours.not_after) == (theirs.not_valid_before, theirs.not_valid_after), name
        assert ours.is_ca == (None if constraints is None else constraints["ca"].native), name
        assert ours.path_length == (None if constraints is None else constraints["path_len_constraint"].native), name
        assert (ours.key_usage is None) == (usage is None), name
        if usage is not None and ours.key_usage is not None:
            native = {word.replace("_", "") for word in usage.native}  # digital_signature
            assert {word.lower() for word in ours.key_usage} == native, name


def test_lists_say_the_same(lists: dict[str, RevocationList]) -> None:
    assert lists.keys() == suite.load().lists.keys()
    for name, ours in lists.items():
        theirs = crl.CertificateList.load(suite.load().lists[name])["tbs_cert_list"]
        assert ours.issuer_der == theirs["issuer"].dump(), name
        assert ours.this_update == theirs["this_update"].native, name
        assert ours.next_update == theirs["next_update"].native, name
        assert ours.revoked | ours.passed_over == frozenset(_revoked(theirs)), name


def _revoked(theirs: crl.TbsCertList) -> Iterator[int]:
    for entry in theirs["revoked_certificates"] or ():
        reason = entry.crl_reason_value
        if reason is None or reason.native != "remove_from_crl":
            yield entry["user_certificate"].native


def test_who_issued_whom(certificates: dict[str, Certificate]) -> None:
    """Every pair: names as X509_NAME_cmp, key identifiers and signature as X509_check_issued and X509_verify."""
    openssl, pkits = paths.load(), suite.load()
    issued = 0
    for (parent, issuer), (child, subject) in itertools.product(certificates.items(), repeat=2):
        ours = issued_by(subject, issuer)
        if ours is Issue.NAME_DIFFERS and not _alike(issuer.subject, subject.issuer):
            continue  # nearly all of 160,000 pairs
        theirs = openssl.issued(pkits.certificates[parent], pkits.certificates[child])
        if ours is not Issue.UNSUPPORTED:
            assert (ours is Issue.ISSUED) == theirs, (parent, child, ours)
            issued += theirs
    assert issued > 390


def _alike(one: str, other: str) -> bool:
    """Whether X509_NAME_cmp could find them equal: letters and digits are the same, whatever their case."""
    return [c for c in one.casefold() if c.isalnum()] == [c for c in other.casefold() if c.isalnum()]


def test_who_signed_which_list(certificates: dict[str, Certificate], lists: dict[str, RevocationList]) -> None:
    openssl, pkits = paths.load(), suite.load()
    verdicts = []
    for (name, issuer), (which, revocations) in itertools.product(certificates.items(), lists.items()):
        if openssl.names_issuer(pkits.certificates[name], pkits.lists[which]):
            ours = crl_signed_by(revocations, issuer)
            theirs = openssl.signed_list(pkits.certificates[name], pkits.lists[which])
            assert ours is Truth.UNKNOWN or ours.must == theirs, (name, which)
            verdicts.append(theirs)
    assert {True, False} == set(verdicts)
    assert len(verdicts) > 170


def test_dates_are_instants(certificates: dict[str, Certificate]) -> None:
    """4.2: years before 2000 in UTCTime, and GeneralizedTime."""
    assert certificates["Validpre2000UTCnotBeforeDateTest3EE"].not_before == _utc("1950-01-01T12:01:00")
    assert certificates["ValidGeneralizedTimenotAfterDateTest8EE"].not_after == _utc("2050-01-01T12:01:00")


def _utc(text: str) -> datetime:
    return datetime.fromisoformat(f"{text}+00:00")
