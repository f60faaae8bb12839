"""Revocation lists as evidence: what OpenSSL reads and verifies."""

from __future__ import annotations

import subprocess
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ed25519
from cryptography.hazmat.primitives.serialization import Encoding
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.keystore.crl import CrlFile, read_crl
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.issuer import crl_signed_by
from keystore_audit.truth import Truth
from tests.keystore import libcrypto
from tests.keystore.builder import START, Signed, authority, certificate, crl, entry, evidence, pem, present, rsa_key
from tests.keystore.test_certificate import MUTATIONS, mutated

CA = authority()
LIST = crl(CA, [5, 2**158])
PEM = LIST.public_bytes(Encoding.PEM)
DER = LIST.public_bytes(Encoding.DER)


def read(content: bytes) -> CrlFile:
    return read_crl(present(content, "crl.pem"))


@pytest.mark.parametrize("revoked", [[], [5]])
def test_the_dump_of_openssl_is_no_defect(revoked: list[int]) -> None:
    content = crl(CA, revoked).public_bytes(Encoding.PEM)
    dump = subprocess.run(["openssl", "crl", "-text"], input=content, capture_output=True, check=True).stdout
    assert dump.startswith(b"Certificate Revocation List (CRL):\n")
    found = read(dump)
    assert found.defects == ()
    assert found.revocation_lists[0].revoked == set(revoked)


@pytest.mark.parametrize(
    ("content", "expected", "lists"),
    [
        (b"", [Kind.CRL_UNREADABLE], 0),
        (DER, [Kind.CRL_UNREADABLE], 0),
        (b"note\n" + PEM, [Kind.CERTIFICATE_FILE_EXTRA], 1),
        (PEM + CA.pem, [Kind.CERTIFICATE_FILE_EXTRA], 1),
        (CA.pem, [Kind.CERTIFICATE_FILE_EXTRA, Kind.CRL_UNREADABLE], 0),
        (PEM + PEM, [], 2),
        (PEM.replace(b"\n", b"\r\n"), [], 1),
        (pem(b"junk", "X509 CRL"), [Kind.CRL_UNREADABLE], 0),
        (pem(b"junk", "X509 CRL") + PEM, [Kind.CRL_UNREADABLE], 1),
        (PEM.replace(b" CRL", b" CRLS"), [Kind.CERTIFICATE_FILE_EXTRA, Kind.CRL_UNREADABLE], 0),
    ],
)
def test_what_else_stands_in_a_file(content: bytes, expected: list[Kind], lists: int) -> None:
    found = read(content)
    assert [defect.kind for defect in found.defects] == expected
    assert len(found.revocation_lists) == lists


def test_a_version_that_there_is_not_is_no_traceback() -> None:
    """Found by hypothesis: InvalidVersion is no ValueError."""
    at = DER.index(b"\x02\x01\x01")
    assert [d.kind for d in read(pem(DER[: at + 2] + b"\x20" + DER[at + 3 :], "X509 CRL")).defects] == [
        Kind.CRL_UNREADABLE
    ]


def tampered(content: bytes) -> bytes:
    return pem(content[:-1] + bytes([content[-1] ^ 1]), "X509 CRL")


RSA_CA = authority("rsaCA", key=rsa_key())


@pytest.mark.parametrize(
    ("content", "ca", "signed"),
    [
        (PEM, CA, True),
        (PEM, authority(), False),
        (PEM, RSA_CA, False),
        (PEM, authority("other name", key=CA.key), True),  # only the key counts here
        (tampered(DER), CA, False),
        (crl(RSA_CA).public_bytes(Encoding.PEM), RSA_CA, True),
        (crl(RSA_CA).public_bytes(Encoding.PEM), CA, False),
    ],
)
def test_who_signed_a_list_is_what_openssl_says(content: bytes, ca: Signed, signed: bool, tmp_path: Path) -> None:
    (found,) = read(content).revocation_lists
    assert crl_signed_by(found, evidence(ca)) is Truth(signed)
    (tmp_path / "ca.pem").write_bytes(ca.pem)
    command = ["openssl", "crl", "-noout", "-verify", "-CAfile", tmp_path / "ca.pem"]
    said = subprocess.run(command, input=content, capture_output=True, check=False).stderr
    if found.issuer_der == evidence(ca).subject_der:  # the tool looks for the issuer by name first
        assert (b"verify OK" in said) is signed


def test_a_list_is_encoded_once_whoever_may_have_signed_it() -> None:
    """The library takes 20 ms for a long one each time: what was kept of it is verified."""
    (found,) = read(PEM).revocation_lists
    assert crl_signed_by(found, evidence(CA)).must
    assert not crl_signed_by(replace(found, signed_part=b"other bytes"), evidence(CA)).may


def test_ed25519_and_unknown_algorithms() -> None:
    key = ed25519.Ed25519PrivateKey.generate()
    edwards = authority("ed", key=key)
    (found,) = read(crl(edwards).public_bytes(Encoding.PEM)).revocation_lists
    assert crl_signed_by(found, evidence(edwards)) is Truth.YES
    assert crl_signed_by(found, evidence(CA)) is Truth.NO
    unknown = DER.replace(bytes.fromhex("06082a8648ce3d040302"), bytes.fromhex("06082a8648ce3d04037f"))
    (odd,) = read(pem(unknown, "X509 CRL")).revocation_lists
    assert crl_signed_by(odd, evidence(CA)) is Truth.UNKNOWN


def test_extensions_of_lists_and_entries() -> None:
    odd = x509.UnrecognizedExtension(x509.ObjectIdentifier("1.2.3.4"), b"\x05\x00")
    stranger = x509.UnrecognizedExtension(x509.ObjectIdentifier("1.2.3.5"), b"\x05\x00")
    point = x509.IssuingDistributionPoint(None, None, True, False, None, False, False)
    entries = (
        entry(1, (x509.CRLReason(x509.ReasonFlags.key_compromise), False)),
        entry(2, (x509.CRLReason(x509.ReasonFlags.remove_from_crl), False)),
        entry(3, (stranger, True)),
    )
    made = crl(CA, entries, extensions=[(point, True), (x509.CRLNumber(3), False), (odd, True)])
    (found,) = read(made.public_bytes(Encoding.PEM)).revocation_lists
    assert found.unknown_critical == ("1.2.3.4", "1.2.3.5")
    assert found.revoked == {1, 3}  # an entry that takes back is none


def test_of_several_entries_the_first_counts_and_other_issuers_none() -> None:
    def issuer(name: x509.Name) -> tuple[x509.CertificateIssuer, bool]:
        return x509.CertificateIssuer([x509.DirectoryName(name)]), True

    removed, other = (x509.CRLReason(x509.ReasonFlags.remove_from_crl), False), authority("other").certificate.subject
    entries = (
        *(entry(1), entry(2, removed), entry(2), entry(1, removed), entry(3, issuer(other)), entry(4)),
        *(entry(5, issuer(CA.certificate.subject)), entry(6, removed)),
    )
    (found,) = read(crl(CA, entries).public_bytes(Encoding.PEM)).revocation_lists
    assert found.revoked == {1, 5}
    assert found.passed_over == {2, 3, 4}


@pytest.mark.parametrize(("revoked", "critical"), [(True, False), (False, False), (False, True)])
def test_openssl_revokes_by_the_same_lists(revoked: bool, critical: bool, tmp_path: Path) -> None:
    leaf = certificate("/x", CA)
    odd = [(x509.UnrecognizedExtension(x509.ObjectIdentifier("1.2.3"), b"\x05\0"), True)] if critical else []
    content = crl(CA, [leaf.certificate.serial_number if revoked else 1], extensions=odd).public_bytes(Encoding.PEM)
    for file, data in (("ca", CA.pem), ("leaf", leaf.pem), ("crl", content)):
        (tmp_path / file).write_bytes(data)
    at = str(int((START + timedelta(days=5)).timestamp()))
    command = ["openssl", "verify", "-attime", at, "-crl_check", "-CRLfile", "crl", "-CAfile", "ca", "leaf"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    said = run.stdout + run.stderr
    (found,) = read(content).revocation_lists
    ours = evidence(leaf).serial in found.revoked
    assert ours is ("certificate revoked" in said) is revoked
    assert bool(found.unknown_critical) is ("unhandled critical CRL extension" in said) is critical


@settings(max_examples=400, deadline=None)
@given(
    st.one_of(
        st.binary(max_size=200),
        MUTATIONS.map(lambda changes: mutated(PEM, changes)),
        MUTATIONS.map(lambda changes: pem(mutated(DER, changes), "X509 CRL")),
    )
)
def test_any_bytes_have_an_answer_that_openssl_shares(content: bytes) -> None:
    found = read(content)
    assert found.revocation_lists or found.defects
    unreadable = any(defect.kind is Kind.CRL_UNREADABLE for defect in found.defects)
    if found.revocation_lists and not unreadable:
        first = found.revocation_lists[0].parsed.public_bytes(Encoding.DER)
        assert libcrypto.load().crl(content) == first
    for each in found.revocation_lists:
        assert crl_signed_by(each, evidence(CA)) in Truth
