"""Builds certificates, keys and whole keystores for the tests of reading, in every layout that sros2 wrote.

Each function takes only what differs from what sros2 makes today (facts: EC P-256, ten years, no extensions but
BasicConstraints); `tools/build_samples.py` builds the committed samples, which tell stories.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from functools import lru_cache
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, ed448, ed25519, rsa
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, pkcs7
from cryptography.x509.oid import NameOID
from msgspec import Struct

from keystore_audit.keystore.certificate import Certificate, CertificateFile, read_certificates
from keystore_audit.keystore.files import File, Status

PrivateKey = ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey | ed25519.Ed25519PrivateKey | ed448.Ed448PrivateKey

START = datetime(2024, 1, 1, tzinfo=timezone.utc)
END = START + timedelta(days=3650)

GOVERNANCE = b"""<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
  xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_governance.xsd">
  <domain_access_rules>
    <domain_rule>
      <domains><id>0</id></domains>
      <allow_unauthenticated_participants>false</allow_unauthenticated_participants>
      <enable_join_access_control>true</enable_join_access_control>
      <discovery_protection_kind>ENCRYPT</discovery_protection_kind>
      <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
      <rtps_protection_kind>SIGN</rtps_protection_kind>
      <topic_access_rules>
        <topic_rule>
          <topic_expression>*</topic_expression>
          <enable_discovery_protection>true</enable_discovery_protection>
          <enable_liveliness_protection>true</enable_liveliness_protection>
          <enable_read_access_control>true</enable_read_access_control>
          <enable_write_access_control>true</enable_write_access_control>
          <metadata_protection_kind>ENCRYPT</metadata_protection_kind>
          <data_protection_kind>ENCRYPT</data_protection_kind>
        </topic_rule>
      </topic_access_rules>
    </domain_rule>
  </domain_access_rules>
</dds>
"""

PERMISSIONS = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
  xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd">
  <permissions>
    <grant name="{name}">
      <subject_name>CN={name}</subject_name>
      <validity><not_before>2024-01-01T00:00:00</not_before><not_after>2034-01-01T00:00:00</not_after></validity>
      <allow_rule>
        <domains><id>0</id></domains>
        <publish><topics><topic>rt/chatter</topic></topics></publish>
      </allow_rule>
      <default>DENY</default>
    </grant>
  </permissions>
</dds>
"""


class Signed(Struct, frozen=True):
    """A certificate with its private key; it can issue others."""

    key: PrivateKey
    certificate: x509.Certificate

    @property
    def pem(self) -> bytes:
        return self.certificate.public_bytes(Encoding.PEM)

    @property
    def key_pem(self) -> bytes:
        return self.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def certificate(
    subject: str | x509.Name,
    issuer: Signed | None = None,
    *,
    key: PrivateKey | None = None,
    ca: bool | None = False,
    issuer_name: x509.Name | None = None,
    extensions: Sequence[tuple[x509.ExtensionType, bool]] = (),
    digest: hashes.HashAlgorithm | None = None,
    start: datetime = START,
    end: datetime = END,
    serial: int | None = None,
) -> Signed:
    """Make a certificate that `issuer` signs, itself if None; `ca` None leaves BasicConstraints out."""
    key = key if key is not None else ec.generate_private_key(ec.SECP256R1())
    subject = subject if isinstance(subject, x509.Name) else name(subject)
    by = issuer_name or (issuer.certificate.subject if issuer is not None else subject)
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(by)
        .public_key(key.public_key())
        .serial_number(serial if serial is not None else x509.random_serial_number())
        .not_valid_before(start)
        .not_valid_after(end)
    )
    if ca is not None:
        builder = builder.add_extension(x509.BasicConstraints(ca, 1 if ca else None), critical=ca)
    for extension, critical in extensions:
        builder = builder.add_extension(extension, critical)
    signing = issuer.key if issuer is not None else key
    edwards = isinstance(signing, ed25519.Ed25519PrivateKey | ed448.Ed448PrivateKey)
    return Signed(key, builder.sign(signing, None if edwards else digest or hashes.SHA256()))


def issued_by_openssl(subject: str, issuer: Signed, directory: Path, *options: str) -> Signed:
    """Make a certificate with the command line tool, for digests with which `cryptography` does not sign."""
    key = ec.generate_private_key(ec.SECP256R1())
    made = Signed(key, issuer.certificate)
    for file, content in (("ca.pem", issuer.pem), ("ca.key", issuer.key_pem), ("key", made.key_pem)):
        (directory / file).write_bytes(content)
    request = ("req", "-new", "-key", "key", "-subj", f"/CN={subject}", "-out", "request")
    signing = ("x509", "-req", "-in", "request", "-CA", "ca.pem", "-CAkey", "ca.key", "-days", "9", "-out", "leaf")
    for arguments in (request, (*signing, *options)):
        subprocess.run(["openssl", *arguments], cwd=directory, check=True, capture_output=True)
    return Signed(key, x509.load_pem_x509_certificate((directory / "leaf").read_bytes()))


def authority(subject: str | x509.Name = "sros2CA", **others: object) -> Signed:
    return certificate(subject, ca=True, **others)  # type: ignore[arg-type]


def crl(
    issuer: Signed, revoked: Sequence[int] = (), *, end: datetime | None = END, days: int = 0
) -> x509.CertificateRevocationList:
    builder = (
        x509.CertificateRevocationListBuilder()
        .issuer_name(issuer.certificate.subject)
        .last_update(START + timedelta(days=days))
        .next_update(end or END)
    )
    for serial in revoked:
        entry = x509.RevokedCertificateBuilder().serial_number(serial).revocation_date(START).build()
        builder = builder.add_revoked_certificate(entry)
    return builder.sign(issuer.key, hashes.SHA256())  # type: ignore[arg-type]


def signed_document(content: bytes, signer: Signed) -> bytes:
    """Sign as sros2 does since Iron."""
    return (
        pkcs7.PKCS7SignatureBuilder()
        .set_data(content)
        .add_signer(signer.certificate, signer.key, hashes.SHA256())  # type: ignore[arg-type]
        .sign(Encoding.SMIME, [pkcs7.PKCS7Options.Text, pkcs7.PKCS7Options.DetachedSignature])
    )


def present(content: bytes, path: str = "cert.pem") -> File:
    """A file as the root hands it out."""
    return File(path=path, resolved=path, status=Status.PRESENT, content=content, sha256="0", mode=0o644)


def read(*pem: bytes) -> CertificateFile:
    return read_certificates(present(b"".join(pem)))


@lru_cache(maxsize=256)
def evidence(signed: Signed) -> Certificate:
    """What the reader says of a certificate: the same object each time, since certificates are compared so."""
    (only,) = read(signed.pem).certificates
    return only


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)


def sros2(
    root: Path, enclaves: Sequence[str] = ("/talker", "/listener"), *, links: bool = True, split: bool = False
) -> Path:
    """Build the layout of Foxy and later: `links` as on Linux or copies, `split` for two authorities."""
    identity = authority()
    permissions = authority() if split else identity
    for directory in ("public", "private", "enclaves"):
        (root / directory).mkdir(parents=True)
    for stem, signer in (("identity_ca", identity), ("permissions_ca", permissions)):
        for folder, kind, pem in (("public", "cert", signer.pem), ("private", "key", signer.key_pem)):
            if split:
                _write(root / folder / f"{stem}.{kind}.pem", pem)
            else:
                _write(root / folder / f"ca.{kind}.pem", pem)
                os.symlink(f"ca.{kind}.pem", root / folder / f"{stem}.{kind}.pem")
    _write(root / "enclaves/governance.xml", GOVERNANCE)
    _write(root / "enclaves/governance.p7s", signed_document(GOVERNANCE, permissions))
    for path in enclaves:
        directory = root / "enclaves" / path.strip("/")
        _enclave(directory, path, identity, permissions)
        up = "../" * (path.strip("/").count("/") + 1) if path != "/" else ""
        targets = {f"{ca}_ca.cert.pem": f"../{up}public/{ca}_ca.cert.pem" for ca in ("identity", "permissions")}
        if path != "/":
            targets["governance.p7s"] = f"{up}governance.p7s"
        for entry, target in targets.items():
            if links:
                os.symlink(target, directory / entry)
            else:
                _write(directory / entry, (directory / target).read_bytes())
    return root


def flat(root: Path, nodes: Sequence[str] = ("talker", "ns/listener"), *, ardent: bool = False) -> Path:
    """Build the layout of Crystal to Eloquent, or of Ardent and Bouncy: copies below a flat root."""
    ca = authority("sros2testCA")
    governance = signed_document(GOVERNANCE, ca)
    for entry, content in (
        ("ca.cert.pem", ca.pem),
        ("ca.key.pem", ca.key_pem),
        ("governance.xml", GOVERNANCE),
        ("governance.p7s", governance),
        ("index.txt", b"V\n"),
        ("serial", b"1002\n"),
        ("1000.pem", ca.pem),
    ):
        _write(root / entry, content)
    for node in nodes:
        _enclave(root / node, node if ardent else f"/{node}", ca, ca)
        for entry in ("ca.cert.pem",) if ardent else ("identity_ca.cert.pem", "permissions_ca.cert.pem"):
            _write(root / node / entry, ca.pem)
        _write(root / node / "governance.p7s", governance)
    return root


def _enclave(directory: Path, path: str, identity: Signed, permissions: Signed) -> None:
    own = certificate(path, identity)
    document = PERMISSIONS.format(name=path).encode()
    for entry, content in (
        ("cert.pem", own.pem),
        ("key.pem", own.key_pem),
        ("permissions.xml", document),
        ("permissions.p7s", signed_document(document, permissions)),
    ):
        _write(directory / entry, content)
