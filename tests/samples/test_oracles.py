"""The samples against programs and documents that we did not write: openssl, pyca's builder, sros2's own files."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree
from msgspec.structs import replace

from tools import build_samples
from tools.samples.base import PERMISSIONS_CA, TALKER_CERTIFICATE
from tools.samples.certificates import Certificate
from tools.samples.documents import DISCOVERY, Governance, Permissions
from tools.samples.keys import Key
from tools.samples.policy import grant
from tools.samples.smime import signed_by
from tools.samples.stock import SAMPLE_POLICY

SAMPLES = build_samples.SAMPLES
Find = Callable[[str], str]

ENCLAVES = sorted(
    path.parent for family in ("healthy", "stock") for path in (SAMPLES / family).rglob("permissions.p7s")
)
"""Every enclave that is as it should be, or as sros2 makes it."""

AS_THE_RUN_TIMES = ("-nointern", "-noverify")
"""PKCS7_verify as Fast DDS, Cyclone DDS 11 and OpenDDS call it: the signer is one of -certfile, no chain."""


AT = str(int(datetime(2026, 11, 21, 12, tzinfo=timezone.utc).timestamp()))


def name(path: Path) -> str:
    return path.relative_to(SAMPLES).as_posix()


def verify(openssl: str, message: Path, *arguments: str | Path) -> bytes | None:
    """The document that `openssl smime -verify -text` hands out, None where it refuses."""
    command = [openssl, "smime", "-verify", "-text", "-in", str(message), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, check=False)
    return done.stdout if done.returncode == 0 else None


def pinned(openssl: str, enclave: Path, document: str) -> bytes | None:
    """The document as the run times that pin the signer read it."""
    return verify(
        openssl, enclave / f"{document}.p7s", *AS_THE_RUN_TIMES, "-certfile", enclave / "permissions_ca.cert.pem"
    )


@pytest.mark.parametrize("enclave", ENCLAVES, ids=name)
def test_openssl_verifies_every_healthy_and_stock_enclave(enclave: Path, oracle: Find) -> None:
    openssl = oracle("openssl")
    permissions = pinned(openssl, enclave, "permissions")
    assert permissions is not None
    assert permissions.replace(b"\r\n", b"\n") == (enclave / "permissions.xml").read_bytes()
    assert pinned(openssl, enclave, "governance") is not None
    authority = ["-CAfile", str(enclave / "identity_ca.cert.pem")]
    chain = [openssl, "verify", "-attime", AT, *authority, str(enclave / "cert.pem")]
    subprocess.run(chain, check=True, capture_output=True)
    key = subprocess.run([openssl, "pkey", "-in", str(enclave / "key.pem"), "-pubout"], check=True, capture_output=True)
    certified = subprocess.run(
        [openssl, "x509", "-in", str(enclave / "cert.pem"), "-noout", "-pubkey"], check=True, capture_output=True
    )
    assert key.stdout == certified.stdout


def test_openssl_takes_the_leaf_signed_document_that_the_run_times_refuse(oracle: Find) -> None:
    """CVE-2023-24010: asked as everybody asks it, openssl calls self-made permissions valid."""
    openssl = oracle("openssl")
    enclave = _bad("KA703") / "enclaves" / "talker"
    asked_by_hand = verify(openssl, enclave / "permissions.p7s", "-CAfile", enclave / "permissions_ca.cert.pem")
    assert asked_by_hand is not None
    assert b"<topic>rt/cmd_vel</topic>" in asked_by_hand
    assert pinned(openssl, enclave, "permissions") is None


ACCEPTED = ("KA306", "KA308", "KA309", "KA310", "KA311", "KA312", "KA313", "KA314")
REFUSED = ("KA301", "KA302", "KA303", "KA304", "KA305", "KA307", "KA315", "KA316")


@pytest.mark.parametrize("code", ACCEPTED + REFUSED)
def test_openssl_says_of_a_bad_signature_what_its_story_says(code: str, oracle: Find) -> None:
    enclave = _bad(code) / "enclaves" / "talker"
    assert (pinned(oracle("openssl"), enclave, "permissions") is not None) == (code in ACCEPTED)
    good = enclave.parents[2] / "good" / "enclaves" / "talker"
    assert pinned(oracle("openssl"), good, "permissions") is not None


@settings(max_examples=25)
@given(st.lists(st.text(st.characters(codec="ascii", categories=("L", "N", "P", "S", "Zs")), max_size=70)))
def test_openssl_reads_the_document_that_was_signed(lines: list[str]) -> None:
    """Whatever the document, the message verifies and hands out the same lines."""
    document = "".join(line.rstrip() + "\n" for line in ("<dds>", *lines, "</dds>")).encode()
    command = ["openssl", "smime", "-verify", "-text", "-noverify", "-inform", "SMIME"]
    done = subprocess.run(command, input=signed_by(PERMISSIONS_CA).smime(document), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.replace(b"\r\n", b"\n") == document


def test_openssl_opens_the_encrypted_key_with_its_password_only(oracle: Find) -> None:
    key = _bad("KA211") / "enclaves" / "talker" / "key.pem"
    read = [oracle("openssl"), "pkey", "-in", str(key), "-pubout", "-passin"]
    right = subprocess.run([*read, "pass:sample"], capture_output=True, check=False)
    certified = x509.load_der_x509_certificate(TALKER_CERTIFICATE.der()).public_key()
    assert load_pem_private_key(key.read_bytes(), b"sample").public_key() == certified
    assert right.returncode == 0
    assert subprocess.run([*read, "pass:wrong"], capture_output=True, check=False).returncode != 0


@given(st.text(st.characters(codec="utf-8", categories=("L", "N")), max_size=20), st.sampled_from(("P-256", "P-384")))
def test_a_key_depends_on_its_label_alone(label: str, curve: str) -> None:
    key, again, other = (
        Key(label=label, curve=curve),
        Key(label=label, curve=curve),
        Key(label=label + "'", curve=curve),
    )
    assert key.pem() == again.pem() != other.pem()
    private = load_pem_private_key(key.pem(), None)
    assert private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()) == key.pem()


def _by_pyca(certificate: Certificate) -> bytes:
    """`certificate` as sros2 builds it, with pyca's builder; the nonce is RFC 6979's there too."""
    issuer = certificate.issuer or certificate
    subject, name_of_issuer = (
        x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, c.subject)]) for c in (certificate, issuer)
    )
    builder = (
        x509.CertificateBuilder(issuer_name=name_of_issuer, subject_name=subject)
        .serial_number(certificate.serial_number())
        .not_valid_before(certificate.not_before)
        .not_valid_after(certificate.not_after)
        .public_key(certificate.key.private().public_key())
        .add_extension(
            x509.BasicConstraints(ca=bool(certificate.ca), path_length=certificate.path_length),
            critical=bool(certificate.ca),
        )
    )
    built = builder.sign(issuer.key.private(), hashes.SHA256(), ecdsa_deterministic=True)
    return built.public_bytes(Encoding.PEM)


@pytest.mark.parametrize("certificate", [PERMISSIONS_CA, TALKER_CERTIFICATE], ids=lambda c: c.subject)
def test_certificates_are_those_of_the_builder_that_sros2_uses(certificate: Certificate) -> None:
    assert certificate.pem() == _by_pyca(certificate)


def test_permissions_are_what_sros2_made_of_the_same_policy(shared: Path) -> None:
    expected = shared / "reference/policies/sros2-rolling/permissions/sample/permissions.xml"
    dates = {"not_before": "2020-05-01T00:00:00", "not_after": "2030-05-01T00:00:00"}
    grants = (grant(path, node, **dates) for path, node in SAMPLE_POLICY.items())
    # The reference was made for a run time without the discovery topic.
    without = tuple(replace(g, rules=tuple(rule for rule in g.rules if rule != DISCOVERY)) for g in grants)
    assert Permissions(grants=without).xml() == expected.read_text("utf-8")


def test_the_governance_is_sros2s_own(shared: Path) -> None:
    own = etree.parse(shared / "reference/xsd/sros2-rolling/defaults/governance.xml").getroot()
    assert etree.tostring(etree.fromstring(Governance().xml()), method="c14n") == etree.tostring(own, method="c14n")


OUTSIDE_THE_SCHEMA = {
    ("KA401", "governance"),
    ("KA421", "governance"),
    ("KA501", "permissions"),
    ("KA518", "permissions"),
    ("KA521", "permissions"),
}
"""Bad samples whose story is that the document does not fit DDS-Security 1.1's schema."""


@pytest.mark.parametrize("document", ["governance", "permissions"])
def test_documents_fit_sros2s_schemas_unless_that_is_the_story(document: str, shared: Path) -> None:
    schema = etree.XMLSchema(etree.parse(shared / f"reference/xsd/sros2-rolling/{document}.xsd"))
    outside = set()
    for path in SAMPLES.rglob(f"{document}.p7s"):
        content = path.read_bytes()
        start, end = content.find(b"<dds"), content.find(b"</dds>")
        if start >= 0 and not path.is_symlink():
            xml = etree.fromstring(content[start : end + len(b"</dds>")])
            if not schema.validate(xml):
                outside.add((path.relative_to(SAMPLES).parts[1].split("-")[0], document))
    assert outside == {found for found in OUTSIDE_THE_SCHEMA if found[1] == document}


def _bad(code: str) -> Path:
    (folder,) = (SAMPLES / "rules").glob(f"{code}-*")
    return folder / "bad"
