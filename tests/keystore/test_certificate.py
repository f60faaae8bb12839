"""Certificates as evidence: what OpenSSL reads, we read; who issued, as OpenSSL verifies."""

from __future__ import annotations

import base64
import subprocess
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, ed448, ed25519, padding
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import NameOID
from hypothesis import example, given, settings
from hypothesis import strategies as st

from keystore_audit.keystore.certificate import IN_DER, Certificate
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.issuer import Issue, fit_to_sign, issued_by
from keystore_audit.keystore.pem import MAX_BLOCKS
from tests.keystore import libcrypto
from tests.keystore.builder import (
    START,
    Signed,
    authority,
    certificate,
    crl,
    evidence,
    issued_by_openssl,
    name,
    pem,
    read,
    rsa_key,
)

CA = authority()
LEAF = certificate("/talker", CA)
RSA_KEY = rsa_key()
OTHER_EKU = x509.ObjectIdentifier("1.2.3.4")


def kinds(*pem: bytes) -> list[Kind]:
    return [defect.kind for defect in read(*pem).defects]


def openssl(*arguments: str | Path, data: bytes = b"") -> str:
    """Run the command line tool; it is in every image that `make test` knows."""
    run = subprocess.run(["openssl", *arguments], input=data, capture_output=True, check=False)
    return (run.stdout + run.stderr).decode()


VARIETY = {
    "sros2 leaf": LEAF,
    "sros2 authority": CA,
    "RSA": certificate("/rsa", CA, key=RSA_KEY),
    "RSA authority, SHA-512": authority("rsa", key=RSA_KEY, digest=hashes.SHA512()),
    "RSA-1024": authority("weak", key=rsa_key(1024)),
    "P-384": authority("p384", key=ec.generate_private_key(ec.SECP384R1()), digest=hashes.SHA384()),
    "secp256k1": authority("k1", key=ec.generate_private_key(ec.SECP256K1())),
    "Ed25519": authority("ed", key=ed25519.Ed25519PrivateKey.generate()),
    "Ed448": authority("ed448", key=ed448.Ed448PrivateKey.generate()),
    "no extension": certificate("/plain", CA, ca=None),
    "before 1970 to 9999": certificate("/long", CA, start=datetime(1951, 1, 1), end=datetime(9999, 12, 31, 23, 59, 59)),
    "rich name": certificate(
        x509.Name(
            [
                x509.NameAttribute(NameOID.COUNTRY_NAME, "DE"),
                x509.NameAttribute(NameOID.ORGANIZATION_NAME, "Böse, GmbH"),
                x509.NameAttribute(NameOID.COMMON_NAME, "/x\x1b]0;y\x07"),
            ]
        ),
        CA,
    ),
    "serial of 20 octets": certificate("/serial", CA, serial=2**159 - 1),
}


@pytest.mark.parametrize("signed", VARIETY.values(), ids=VARIETY.keys())
def test_openssl_reads_the_same(signed: Signed) -> None:
    ours = evidence(signed)
    shown = openssl("x509", "-noout", "-serial", "-dates", "-dateopt", "iso_8601", data=signed.pem)
    assert f"serial={ours.serial:02X}".replace("=0", "=") == shown.split("\n")[0].replace("=0", "=")
    assert f"notBefore={ours.not_before:%Y-%m-%d %H:%M:%SZ}" in shown
    assert f"notAfter={ours.not_after:%Y-%m-%d %H:%M:%SZ}" in shown
    text = openssl("x509", "-noout", "-text", data=signed.pem)
    assert f"Signature Algorithm: {ours.signature_algorithm}\n" in text
    kind = ours.key_kind.split(" ")
    if kind[0] == "RSA":
        assert f"Public-Key: ({kind[1]} bit)" in text
    elif kind[0] == "EC":
        assert {"secp256r1": "prime256v1"}.get(kind[1], kind[1]) in text
    else:
        assert f"Public Key Algorithm: {ours.key_kind.upper()}" in text
    names = openssl("x509", "-noout", "-subject", "-issuer", "-nameopt", "RFC2253,-esc_msb,-esc_ctrl", data=signed.pem)
    assert f"subject={ours.subject}\n" in names
    assert f"issuer={ours.issuer}\n" in names
    public = openssl("x509", "-noout", "-pubkey", data=signed.pem).encode()
    der = base64.b64decode(b"".join(public.split(b"\n")[1:-2]))
    digest = hashes.Hash(hashes.SHA256())
    digest.update(der)
    assert ours.key == digest.finalize().hex()


RSA_CA = authority("rsaCA", key=RSA_KEY)
SAME_NAME = authority()
SAME_KEY = authority(key=CA.key)
SPACED = certificate("/talker", CA, issuer_name=name("  SROS2ca "))
KEY_ID = x509.SubjectKeyIdentifier.from_public_key(CA.key.public_key())
CA_WITH_ID = authority(key=CA.key, extensions=[(KEY_ID, False)])
AKI_OTHER_KEY = x509.AuthorityKeyIdentifier(b"x" * 20, None, None)
AKI_OTHER_SERIAL = x509.AuthorityKeyIdentifier(None, [x509.DirectoryName(name("sros2CA"))], 7)
AKI_RIGHT = x509.AuthorityKeyIdentifier(
    KEY_ID.digest, [x509.DirectoryName(name("sros2ca"))], CA_WITH_ID.certificate.serial_number
)


def tampered(signed: Signed) -> Signed:
    """Change a bit of the signature."""
    der = bytearray(signed.certificate.public_bytes(Encoding.DER))
    der[-1] ^= 1
    return Signed(signed.key, x509.load_der_x509_certificate(bytes(der)))


def relabelled(signed: Signed) -> Signed:
    """State ecdsa-with-SHA384 outside, where the signed part says SHA256."""
    der = signed.certificate.public_bytes(Encoding.DER)
    sha256, sha384 = (bytes.fromhex(f"06082a8648ce3d0403{last}") for last in ("02", "03"))
    at = der.rindex(sha256)
    return Signed(signed.key, x509.load_der_x509_certificate(der[:at] + sha384 + der[at + len(sha384) :]))


ISSUES = {
    "issued": (LEAF, CA, Issue.ISSUED),
    "self-signed": (CA, CA, Issue.ISSUED),
    "RSA": (certificate("/x", RSA_CA), RSA_CA, Issue.ISSUED),
    "EC, SHA-512": (certificate("/x", CA, digest=hashes.SHA512()), CA, Issue.ISSUED),
    "Ed25519": (certificate("/x", VARIETY["Ed25519"]), VARIETY["Ed25519"], Issue.ISSUED),
    "Ed448": (certificate("/x", VARIETY["Ed448"]), VARIETY["Ed448"], Issue.ISSUED),
    "weak RSA": (certificate("/x", VARIETY["RSA-1024"]), VARIETY["RSA-1024"], Issue.ISSUED),
    "renewed authority, same key": (LEAF, SAME_KEY, Issue.ISSUED),
    "another authority of the same name": (LEAF, SAME_NAME, Issue.SIGNATURE_INVALID),
    "another kind of key, same name": (LEAF, authority(key=RSA_KEY), Issue.SIGNATURE_INVALID),
    "tampered": (tampered(LEAF), CA, Issue.SIGNATURE_INVALID),
    "two signature algorithms": (relabelled(LEAF), CA, Issue.SIGNATURE_INVALID),
    "another name": (LEAF, RSA_CA, Issue.NAME_DIFFERS),
    "another name, same key": (LEAF, authority("sros2testCA", key=CA.key), Issue.NAME_DIFFERS),
    "name in other case and blanks": (SPACED, CA, Issue.ISSUED),
    "key identifier of another": (
        certificate("/x", CA, extensions=[(AKI_OTHER_KEY, False)]),
        CA_WITH_ID,
        Issue.KEY_IDENTIFIER_DIFFERS,
    ),
    "key identifier, authority without": (
        certificate("/x", CA, extensions=[(AKI_OTHER_KEY, False)]),
        CA,
        Issue.ISSUED,
    ),
    "serial number of another": (
        certificate("/x", CA, extensions=[(AKI_OTHER_SERIAL, False)]),
        CA,
        Issue.KEY_IDENTIFIER_DIFFERS,
    ),
    "all identifiers right": (certificate("/x", CA, extensions=[(AKI_RIGHT, False)]), CA_WITH_ID, Issue.ISSUED),
}


@pytest.mark.parametrize(("leaf", "issuer", "issue"), ISSUES.values(), ids=ISSUES.keys())
def test_who_issued_a_certificate_is_what_openssl_verifies(
    leaf: Signed, issuer: Signed, issue: Issue, tmp_path: Path
) -> None:
    _agree_with_openssl(leaf, issuer, issue, tmp_path)


@pytest.mark.parametrize(
    ("digest", "issuer"),
    [
        *((digest, CA) for digest in ("sha1", "sha224", "sha384", "sha512")),
        *((digest, RSA_CA) for digest in ("sha1", "sha3-256", "md5")),
    ],
)
def test_weak_and_rare_digests_are_verified_too(digest: str, issuer: Signed, tmp_path: Path) -> None:
    """Fast DDS takes sha1WithRSAEncryption: that it is weak is for a rule to say."""
    leaf = issued_by_openssl("x", issuer, tmp_path, f"-{digest}")
    _agree_with_openssl(leaf, issuer, Issue.ISSUED, tmp_path)
    _agree_with_openssl(tampered(leaf), issuer, Issue.SIGNATURE_INVALID, tmp_path)


def _agree_with_openssl(leaf: Signed, issuer: Signed, issue: Issue, tmp_path: Path) -> None:
    assert issued_by(evidence(leaf), evidence(issuer)) is issue
    (tmp_path / "ca.pem").write_bytes(issuer.pem)
    (tmp_path / "leaf.pem").write_bytes(leaf.pem)
    at = str(int((leaf.certificate.not_valid_before_utc + timedelta(days=1)).timestamp()))
    said = openssl(
        # Level 0, or weak keys and digests are refused for being weak: the run times do not.
        *("verify", "-auth_level", "0", "-attime", at, "-CAfile", tmp_path / "ca.pem", tmp_path / "leaf.pem")
    )
    assert said.endswith("leaf.pem: OK\n") is (issue is Issue.ISSUED), said


def test_what_cannot_be_verified_is_no_answer() -> None:
    """RSA-PSS with SHAKE, say: neither issued nor not; nothing may read it as a refusal."""
    pss = x509.CertificateBuilder().subject_name(name("/x")).issuer_name(name("rsaCA"))
    pss = pss.public_key(LEAF.key.public_key()).serial_number(1)
    pss = pss.not_valid_before(START).not_valid_after(START + timedelta(days=9))
    known = pss.sign(RSA_KEY, hashes.SHA256(), rsa_padding=padding.PSS(padding.MGF1(hashes.SHA256()), 32))
    assert issued_by(evidence(Signed(LEAF.key, known)), evidence(RSA_CA)) is Issue.ISSUED
    der = known.public_bytes(Encoding.DER)
    unknown = der.replace(bytes.fromhex("06092a864886f70d01010a"), bytes.fromhex("06092a864886f70d01017a"))
    odd = read(pem(unknown)).first
    assert odd is not None
    assert odd.signature_algorithm == "1.2.840.113549.1.1.122"
    assert issued_by(odd, evidence(RSA_CA)) is Issue.UNSUPPORTED


ORACLE_NAMES = st.lists(
    st.tuples(
        st.sampled_from([NameOID.COMMON_NAME, NameOID.ORGANIZATION_NAME]),
        st.text(alphabet=st.sampled_from("aAbB \tä"), min_size=1, max_size=6),
    ),
    min_size=1,
    max_size=2,
)


@settings(max_examples=300, deadline=None)
@given(ORACLE_NAMES, ORACLE_NAMES)
def test_names_are_compared_as_openssl_compares_them(
    first: list[tuple[x509.ObjectIdentifier, str]], second: list[tuple[x509.ObjectIdentifier, str]]
) -> None:
    from keystore_audit.keystore.crl import same_name

    oracle = libcrypto.load()
    names = [x509.Name([x509.NameAttribute(oid, value) for oid, value in parts]) for parts in (first, second)]
    recased = x509.Name([x509.NameAttribute(oid, f" {value.upper()} ") for oid, value in first])
    for other in (names[1], recased):
        expected = oracle.same_name(names[0].public_bytes(), other.public_bytes())
        assert same_name(names[0], other) is expected


def test_a_dump_of_openssl_before_the_block_is_no_defect() -> None:
    """As Ardent to Dashing wrote it with `openssl ca` (facts 1.3)."""
    dump = openssl("x509", "-text", data=LEAF.pem).encode()
    assert dump.startswith(b"Certificate:\n    Data:\n")
    file = read(dump)
    assert file.defects == ()
    assert file.certificates[0].line == dump.split(b"\n").index(b"-----BEGIN CERTIFICATE-----") + 1
    assert read(dump, openssl("x509", "-text", data=CA.pem).encode()).defects == ()
    assert kinds(dump.replace(b"    Data:", b"Data:")) == [Kind.CERTIFICATE_FILE_EXTRA]
    assert kinds(dump.replace(b"Certificate:", b"Certificates:")) == [Kind.CERTIFICATE_FILE_EXTRA]


@pytest.mark.parametrize(
    ("content", "expected", "subjects"),
    [
        (b"", [Kind.CERTIFICATE_UNREADABLE], []),
        (b"hello\n", [Kind.CERTIFICATE_UNREADABLE], []),
        (LEAF.certificate.public_bytes(Encoding.DER), [Kind.CERTIFICATE_UNREADABLE], []),
        (b"a note\n" + LEAF.pem, [Kind.CERTIFICATE_FILE_EXTRA], ["/talker"]),
        (LEAF.pem + b"a note", [Kind.CERTIFICATE_FILE_EXTRA], ["/talker"]),
        (b"\xef\xbb\xbf" + b"\n" + LEAF.pem, [Kind.CERTIFICATE_FILE_EXTRA], ["/talker"]),
        (LEAF.pem.replace(b"\n", b"\r\n"), [], ["/talker"]),
        (LEAF.pem.rstrip(), [], ["/talker"]),
        (LEAF.pem.replace(b"BEGIN CERT", b"BEGIN X509 CERT").replace(b"END CERT", b"END X509 CERT"), [], ["/talker"]),
        (LEAF.pem.replace(b" CERT", b" TRUSTED CERT"), [Kind.CERTIFICATE_UNREADABLE], []),
        (LEAF.pem.replace(b" CERTIFICATE", b" CERTIFICATE REQUEST"), [Kind.CERTIFICATE_FILE_EXTRA] * 1, None),
        (LEAF.pem.replace(b"END CERT", b"END X509 CERT"), [Kind.CERTIFICATE_UNREADABLE], []),
        (LEAF.pem.replace(b"-----END", b"----END"), [Kind.CERTIFICATE_UNREADABLE], []),
        (LEAF.pem.replace(b"-----BEGIN", b" -----BEGIN"), [Kind.CERTIFICATE_UNREADABLE], []),
        (b" " * 254 + CA.pem + LEAF.pem, [Kind.CERTIFICATE_UNREADABLE], []),
        (LEAF.pem.replace(b"\nMII", b"\n MII"), [Kind.CERTIFICATE_UNREADABLE], []),
        (LEAF.pem.replace(b"\nMII", b"\n\nMII"), [Kind.CERTIFICATE_UNREADABLE], []),
        (LEAF.pem.replace(b"\nMII", b"\nX-Header: 1\n\nMII"), [Kind.CERTIFICATE_UNREADABLE], []),
        (LEAF.pem.replace(b"MII", b"M*I"), [Kind.CERTIFICATE_UNREADABLE], []),
        (pem(LEAF.certificate.public_bytes(Encoding.DER) + b"\0"), [Kind.CERTIFICATE_UNREADABLE], []),
        (pem(b"\x30\x00"), [Kind.CERTIFICATE_UNREADABLE], []),
        (pem(b"\x30\x82\xff\xff" + b"\0" * 65535), [Kind.CERTIFICATE_UNREADABLE], []),
        (pem(b"junk") + LEAF.pem, [Kind.CERTIFICATE_UNREADABLE], []),
        (LEAF.pem + pem(b"junk"), [Kind.CERTIFICATE_UNREADABLE], ["/talker"]),
        (LEAF.pem + pem(b"junk", "X509 CRL"), [Kind.CRL_UNREADABLE], ["/talker"]),
    ],
)
def test_what_else_stands_in_a_file(content: bytes, expected: list[Kind], subjects: list[str] | None) -> None:
    file = read(content)
    found = [defect.kind for defect in file.defects]
    if subjects is None:  # no certificate at all, and it says so as well
        expected, subjects = [*expected, Kind.CERTIFICATE_UNREADABLE], []
    assert found == expected
    assert [read_one.subject for read_one in file.certificates] == [f"CN={subject}" for subject in subjects]
    assert all(defect.path == "cert.pem" and defect.detail.startswith("expected") for defect in file.defects) or (
        Kind.CERTIFICATE_UNREADABLE in found
    )


@pytest.mark.parametrize(
    ("content", "instead"),
    [
        (b"\n", "nothing"),
        (b"hello\n", "none"),
        (LEAF.certificate.public_bytes(Encoding.DER), IN_DER),
        (LEAF.certificate.public_bytes(Encoding.DER)[:-1], "none"),
        (LEAF.pem.replace(b" CERTIFICATE", b" CERTIFICATE REQUEST"), "a block (CERTIFICATE REQUEST)"),
        (LEAF.key_pem, "a private key (PRIVATE KEY)"),
    ],
)
def test_what_stands_there_instead_of_a_certificate(content: bytes, instead: str) -> None:
    (said,) = [each.detail for each in read(content).defects if each.kind is Kind.CERTIFICATE_UNREADABLE]
    assert said == f"expected a PEM block CERTIFICATE, found {instead}"


def test_a_private_key_in_the_file_is_named_and_never_shown() -> None:
    for content in (LEAF.key_pem + LEAF.pem, LEAF.pem + LEAF.key_pem):
        file = read(content)
        (defect,) = file.defects
        assert defect.kind is Kind.CERTIFICATE_FILE_EXTRA
        assert "a private key" in defect.detail
        assert len(file.certificates) == 1
        secret = LEAF.key_pem.split(b"\n")[1].decode()
        assert secret[:16] not in repr(file)


def test_revocation_lists_beside_certificates_are_read() -> None:
    """Fast DDS enforces a CRL that is appended to the CA file."""
    file = read(CA.pem, crl(CA, [5]).public_bytes(Encoding.PEM))
    assert (len(file.certificates), file.defects) == (1, ())
    assert file.revocation_lists[0].revoked == {5}


def test_many_blocks_and_long_files_are_bounded() -> None:
    file = read(LEAF.pem * (MAX_BLOCKS + 5))
    assert len(file.certificates) == MAX_BLOCKS
    assert [defect.kind for defect in file.defects] == [Kind.CERTIFICATE_UNREADABLE]
    big = x509.UnrecognizedExtension(OTHER_EKU, b"\0" * 70_000)
    assert kinds(certificate("/big", CA, extensions=[(big, False)]).pem) == [Kind.CERTIFICATE_UNREADABLE]
    assert len(read(b"-----BEGIN " * 300_000).defects) < 3 * MAX_BLOCKS


EKU = x509.oid.ExtendedKeyUsageOID


def usage(*names: str) -> x509.KeyUsage:
    every = (
        *("digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement"),
        *("key_cert_sign", "crl_sign", "encipher_only", "decipher_only"),
    )
    return x509.KeyUsage(**{each: each in names for each in every})


NETSCAPE = x509.ObjectIdentifier("2.16.840.1.113730.1.1")
PURPOSES: dict[str, list[x509.ExtensionType]] = {
    "sros2": [],
    "emailProtection": [x509.ExtendedKeyUsage([EKU.EMAIL_PROTECTION])],
    "clientAuth": [x509.ExtendedKeyUsage([EKU.CLIENT_AUTH])],
    "both": [x509.ExtendedKeyUsage([EKU.CLIENT_AUTH, EKU.EMAIL_PROTECTION])],
    "any": [x509.ExtendedKeyUsage([EKU.ANY_EXTENDED_KEY_USAGE])],
    "digitalSignature": [usage("digital_signature")],
    "nonRepudiation": [usage("content_commitment")],
    "keyAgreement": [usage("key_agreement", "encipher_only")],
    "keyCertSign": [usage("key_cert_sign", "crl_sign")],
    "emailProtection, keyAgreement": [
        x509.ExtendedKeyUsage([EKU.EMAIL_PROTECTION]),
        usage("key_agreement", "decipher_only"),
    ],
    "Netscape S/MIME": [x509.UnrecognizedExtension(NETSCAPE, b"\x03\x02\x05\x20")],
    "Netscape SSL client": [x509.UnrecognizedExtension(NETSCAPE, b"\x03\x02\x07\x80")],
    "Netscape SSL server": [x509.UnrecognizedExtension(NETSCAPE, b"\x03\x02\x06\x40")],
}


@pytest.mark.parametrize("extensions", PURPOSES.values(), ids=PURPOSES.keys())
def test_fit_to_sign_is_what_openssl_calls_smime_signing(extensions: list[x509.ExtensionType]) -> None:
    signed = certificate("/x", CA, extensions=[(extension, False) for extension in extensions])
    purposes = openssl("x509", "-noout", "-purpose", data=signed.pem)
    assert fit_to_sign(evidence(signed)) is ("S/MIME signing : Yes" in purposes)


def test_usages_have_the_names_of_rfc_5280() -> None:
    assert evidence(certificate("/x", CA, extensions=[(usage("key_agreement", "encipher_only"), True)])).key_usage == {
        "keyAgreement",
        "encipherOnly",
    }
    all_but = evidence(certificate("/x", CA, extensions=[(usage("content_commitment", "crl_sign"), True)]))
    assert all_but.key_usage == {"nonRepudiation", "cRLSign"}


CRITICAL: dict[str, x509.ExtensionType] = {
    "subjectKeyIdentifier": KEY_ID,
    "subjectAltName": x509.SubjectAlternativeName([x509.DNSName("a")]),
    "issuerAltName": x509.IssuerAlternativeName([x509.DNSName("a")]),
    "ocsp-nocheck": x509.OCSPNoCheck(),
    "tlsfeature": x509.TLSFeature([x509.TLSFeatureType.status_request]),
    "keyUsage": usage("digital_signature"),
    "extKeyUsage": x509.ExtendedKeyUsage([OTHER_EKU]),
    "policies": x509.CertificatePolicies([x509.PolicyInformation(OTHER_EKU, None)]),
    "policyConstraints": x509.PolicyConstraints(9, None),
    "inhibitAnyPolicy": x509.InhibitAnyPolicy(3),
    "nameConstraints": x509.NameConstraints([x509.DNSName("a")], None),
    "crlPoints": x509.CRLDistributionPoints([x509.DistributionPoint([x509.DNSName("a")], None, None, None)]),
    "freshestCrl": x509.FreshestCRL([x509.DistributionPoint([x509.DNSName("a")], None, None, None)]),
    "netscapeType": x509.UnrecognizedExtension(NETSCAPE, b"\x03\x02\x05\xa0"),
    "netscapeComment": x509.UnrecognizedExtension(x509.ObjectIdentifier("2.16.840.1.113730.1.13"), b"\x16\x01a"),
    "ipAddrBlocks": x509.UnrecognizedExtension(
        x509.ObjectIdentifier("1.3.6.1.5.5.7.1.7"), bytes.fromhex("30083006040200010500")
    ),
    "autonomousSysIds": x509.UnrecognizedExtension(
        x509.ObjectIdentifier("1.3.6.1.5.5.7.1.8"), bytes.fromhex("3004a0020500")
    ),
    "policyMappings": x509.UnrecognizedExtension(
        x509.ObjectIdentifier("2.5.29.33"), bytes.fromhex("300a300806022a0306022a04")
    ),
    "proxyCertInfo": x509.UnrecognizedExtension(
        x509.ObjectIdentifier("1.3.6.1.5.5.7.1.14"), bytes.fromhex("300c300a06082b06010505071501")
    ),
    "private": x509.UnrecognizedExtension(OTHER_EKU, b"\x05\x00"),
}


@pytest.mark.parametrize("extension", CRITICAL.values(), ids=CRITICAL.keys())
def test_critical_extensions_are_unknown_where_openssl_refuses_them(
    extension: x509.ExtensionType, tmp_path: Path
) -> None:
    leaf = certificate("/x", CA, extensions=[(extension, True)])
    (tmp_path / "ca.pem").write_bytes(CA.pem)
    (tmp_path / "leaf.pem").write_bytes(leaf.pem)
    at = str(int((START + timedelta(days=5)).timestamp()))
    said = openssl("verify", "-attime", at, "-CAfile", tmp_path / "ca.pem", tmp_path / "leaf.pem")
    refused = not said.endswith("leaf.pem: OK\n")
    assert evidence(leaf).unknown_critical == ((extension.oid.dotted_string,) if refused else ())
    harmless = certificate("/x", CA, extensions=[(extension, False)])
    assert evidence(harmless).unknown_critical == ()


MUTATIONS = st.lists(
    st.tuples(
        st.sampled_from(["replace", "insert", "delete", "repeat"]),
        st.integers(0, 2000),
        st.sampled_from(
            [
                b" ",
                b"\n",
                b"\r",
                b"\0",
                b"-",
                b"=",
                b":",
                b"\x02",
                b"\x30",
                b"\x80",
                b"-----BEGIN CERTIFICATE-----\n",
                b"-----END ",
                b"A",
                b"\xff",
            ]
        ),
    ),
    min_size=1,
    max_size=3,
)


def mutated(content: bytes, changes: list[tuple[str, int, bytes]]) -> bytes:
    for change, place, piece in changes:
        at = place % (len(content) + 1)
        if change == "insert":
            content = content[:at] + piece + content[at:]
        elif change == "replace":
            content = content[:at] + piece + content[at + len(piece) :]
        elif change == "delete":
            content = content[:at] + content[at + 1 + len(piece) :]
        else:
            line = content[:at].count(b"\n")
            lines = content.split(b"\n")
            content = b"\n".join(lines[: line + 1] + lines[line:])
    return content


@settings(max_examples=1500, deadline=None)
@given(st.sampled_from([LEAF.pem, CA.pem + LEAF.pem, LEAF.key_pem + LEAF.pem]), MUTATIONS)
@example(LEAF.key_pem + LEAF.pem, [("insert", LEAF.key_pem.rindex(b"\n-----"), b"=")])
def test_what_we_read_first_is_what_openssl_reads_first(content: bytes, changes: list[tuple[str, int, bytes]]) -> None:
    """Ours readable implies OpenSSL's the same; ours not means unknown, so OpenSSL may read it or not."""
    content = mutated(content, changes)
    file = read(content)
    if file.first is not None:
        theirs = libcrypto.load().certificate(content)
        assert theirs == file.first.parsed.public_bytes(Encoding.DER)
    else:
        assert any(defect.kind.opaque for defect in file.defects)


def test_a_key_whose_parameters_openssl_refuses_leaves_the_certificate_unread() -> None:
    known, unknown = bytes.fromhex("06072a8648ce3d0201"), bytes.fromhex("06072a8648ce3d0217")
    der = LEAF.certificate.public_bytes(Encoding.DER)
    for parameters, taken in ((b"\x06\x08", True), (b"\x20\x08", False)):
        changed = base64.encodebytes(der.replace(known + b"\x06\x08", unknown + parameters))
        content = b"-----BEGIN CERTIFICATE-----\n" + changed + b"-----END CERTIFICATE-----\n"
        assert (libcrypto.load().certificate(content) is not None) is taken
        assert (read(content).first is not None) is taken


RICH = [
    LEAF,
    certificate("/rich", CA, extensions=[(extension, False) for extension in CRITICAL.values()]),
    certificate("/aki", CA, extensions=[(AKI_RIGHT, False), (KEY_ID, True)]),
    *VARIETY.values(),
]
MUTATED = st.tuples(st.sampled_from(RICH), MUTATIONS).map(
    lambda case: pem(mutated(case[0].certificate.public_bytes(Encoding.DER), case[1]))
)


@settings(max_examples=1000, deadline=None)
@given(st.one_of(st.binary(max_size=300), st.binary(max_size=200).map(pem), MUTATED, MUTATED))
def test_any_bytes_have_an_answer(content: bytes) -> None:
    file = read(content)
    assert file.certificates or file.defects
    for found in file.certificates:
        assert issued_by(found, found) in Issue
        assert fit_to_sign(found) in (True, False)
        assert isinstance(found, Certificate)
        assert found.not_before.tzinfo is timezone.utc
