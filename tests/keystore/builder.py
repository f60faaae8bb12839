"""Keys, certificates, revocation lists, signed documents and whole keystores, for every test and benchmark.

Each function takes only what differs from what sros2 makes today (facts: EC P-256, ten years, no extensions but
BasicConstraints); `documents.py` writes the XML. `tools/build_samples.py` alone has writers of its own: the committed
samples are the same bytes at every build.
"""

from __future__ import annotations

import base64
import hashlib
import os
import subprocess
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta, timezone
from functools import lru_cache
from pathlib import Path
from typing import Any

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


Extension = tuple[x509.ExtensionType, bool]
"""And whether it is critical."""

CURVES = {each.name: each for each in (ec.SECP224R1(), ec.SECP256K1(), ec.SECP256R1(), ec.SECP384R1())}
USAGES = (
    *("digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement"),
    *("key_cert_sign", "crl_sign", "encipher_only", "decipher_only"),
)
SROS2 = (pkcs7.PKCS7Options.Text, pkcs7.PKCS7Options.DetachedSignature)


class Signed(Struct, frozen=True):
    """A certificate with its private key; it can issue others."""

    key: PrivateKey
    certificate: x509.Certificate

    @property
    def pem(self) -> bytes:
        return self.certificate.public_bytes(Encoding.PEM)

    @property
    def der(self) -> bytes:
        return self.certificate.public_bytes(Encoding.DER)

    @property
    def key_pem(self) -> bytes:
        return self.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


def pem(der: bytes, label: str = "CERTIFICATE") -> bytes:
    """A block of PEM, in lines of 64 characters."""
    encoded = base64.b64encode(der)
    lines = b"\n".join(encoded[start : start + 64] for start in range(0, len(encoded), 64))
    return b"-----BEGIN %b-----\n%b\n-----END %b-----\n" % (label.encode(), lines, label.encode())


def name(text: str) -> x509.Name:
    """A common name, no attribute at all for the empty one."""
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)] if text else [])


@lru_cache(maxsize=1024)
def _key(_label: str, curve: str) -> ec.EllipticCurvePrivateKey:
    return ec.generate_private_key(CURVES[curve])


def key(label: str, curve: str = "secp256r1") -> ec.EllipticCurvePrivateKey:
    """One key for each label and curve, made anew in each run."""
    return _key(label, curve)


@lru_cache(maxsize=8)
def rsa_key(bits: int = 2048) -> rsa.RSAPrivateKey:
    """One of this size, which takes long to make."""
    return rsa.generate_private_key(65537, bits)


def usage(*which: str) -> Extension:
    """Key usage, critical."""
    return x509.KeyUsage(**{each: each in which for each in USAGES}), True


def certificate(
    subject: str | x509.Name,
    issuer: Signed | None = None,
    *,
    key: PrivateKey | None = None,
    ca: bool | None = False,
    length: int | None = 1,
    issuer_name: x509.Name | None = None,
    extensions: Sequence[Extension] = (),
    digest: hashes.HashAlgorithm | None = None,
    start: datetime = START,
    end: datetime = END,
    serial: int | None = None,
) -> Signed:
    """Make a certificate that `issuer` signs, itself if None.

    `ca` None leaves BasicConstraints out; `length`: how long the path below an authority may be.
    """
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
        builder = builder.add_extension(x509.BasicConstraints(ca, length if ca else None), critical=ca)
    for extension, critical in extensions:
        builder = builder.add_extension(extension, critical)
    signing = issuer.key if issuer is not None else key
    return Signed(key, builder.sign(signing, _digest(signing, digest)))


def _digest(signing: PrivateKey, chosen: hashes.HashAlgorithm | None = None) -> Any:
    edwards = isinstance(signing, ed25519.Ed25519PrivateKey | ed448.Ed448PrivateKey)
    return None if edwards else chosen or hashes.SHA256()


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


def entry(serial: int, *extensions: Extension) -> x509.RevokedCertificate:
    """Of a revocation list."""
    builder = x509.RevokedCertificateBuilder().serial_number(serial).revocation_date(START)
    for extension, critical in extensions:
        builder = builder.add_extension(extension, critical)
    return builder.build()


def crl(
    issuer: Signed,
    revoked: Sequence[int | x509.RevokedCertificate] = (),
    *,
    start: datetime = START,
    end: datetime | None = END,
    days: int = 0,
    extensions: Sequence[Extension] = (),
) -> x509.CertificateRevocationList:
    """A list of serial numbers or whole entries, from so many `days` behind `start` on."""
    builder = (
        x509.CertificateRevocationListBuilder()
        .issuer_name(issuer.certificate.subject)
        .last_update(start + timedelta(days=days))
        .next_update(end or END)
    )
    for extension, critical in extensions:
        builder = builder.add_extension(extension, critical)
    for each in revoked:
        builder = builder.add_revoked_certificate(entry(each) if isinstance(each, int) else each)
    return builder.sign(issuer.key, _digest(issuer.key))


def signed_document(
    content: bytes, signer: Signed, *embedded: Signed, options: Sequence[pkcs7.PKCS7Options] = SROS2
) -> bytes:
    """Sign as sros2 does since Iron; `embedded`: further certificates in the message."""
    builder = pkcs7.PKCS7SignatureBuilder().set_data(content)
    builder = builder.add_signer(signer.certificate, signer.key, hashes.SHA256())  # type: ignore[arg-type]
    for each in embedded:
        builder = builder.add_certificate(each.certificate)
    return builder.sign(Encoding.SMIME, options)


def present(content: bytes, path: str = "cert.pem") -> File:
    """A file as the root hands it out."""
    return File(
        path=path,
        resolved=path,
        status=Status.PRESENT,
        content=content,
        sha256=hashlib.sha256(content).hexdigest(),
        mode=0o644,
    )


def read(*pem: bytes) -> CertificateFile:
    return read_certificates(present(b"".join(pem)))


@lru_cache(maxsize=256)
def evidence(signed: Signed) -> Certificate:
    """What the reader says of a certificate: the same object each time, since certificates are compared so."""
    (only,) = read(signed.pem).certificates
    return only


def write(root: Path, files: Mapping[str, bytes | str | None]) -> Path:
    """Write files by path: bytes are contents, texts are where links lead, None is left out."""
    for path, content in files.items():
        place = root / path
        if content is None:
            continue
        place.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, str):
            os.symlink(content, place)
        else:
            place.write_bytes(content)
    return root


def enclave(
    own: Signed, identity_ca: bytes, permissions_ca: bytes, governance: bytes, permissions: bytes
) -> dict[str, bytes]:
    """The files of an enclave by name; the documents are signed already."""
    return {
        "cert.pem": own.pem,
        "key.pem": own.key_pem,
        "identity_ca.cert.pem": identity_ca,
        "permissions_ca.cert.pem": permissions_ca,
        "permissions.p7s": permissions,
        "governance.p7s": governance,
    }


def write_enclave(
    directory: Path, own: Signed, document: bytes, identity: Signed, permissions: Signed, governance: bytes
) -> None:
    """An enclave's folder with copies of all that it needs."""
    documents = (signed_document(each, permissions) for each in (governance, document))
    write(directory, enclave(own, identity.pem, permissions.pem, *documents))


def _stock(path: str) -> str:
    return PERMISSIONS.format(name=path)


def sros2(
    root: Path,
    enclaves: Sequence[str] = ("/talker", "/listener"),
    *,
    links: bool = True,
    split: bool = False,
    document: Callable[[str], str] = _stock,
    own_governances: bool = False,
) -> Path:
    """Build the layout of Foxy and later: `links` as on Linux or copies, `split` for two authorities.

    `document`: the permissions of an enclave; `own_governances`: the governance is signed for each by itself.
    """
    identity = authority()
    permissions = authority() if split else identity
    for stem, signer in (("identity_ca", identity), ("permissions_ca", permissions)):
        for folder, kind, pem in (("public", "cert", signer.pem), ("private", "key", signer.key_pem)):
            one = {} if split or stem != "identity_ca" else {f"{folder}/ca.{kind}.pem": pem}
            write(root, {**one, f"{folder}/{stem}.{kind}.pem": pem if split else f"ca.{kind}.pem"})
    governance = signed_document(GOVERNANCE, permissions)
    write(root, {"enclaves/governance.xml": GOVERNANCE, "enclaves/governance.p7s": governance})
    for path in enclaves:
        directory = root / "enclaves" / path.strip("/")
        own = _own(path, identity, permissions, document(path))
        up = "../" * (path.strip("/").count("/") + 1) if path != "/" else ""
        targets = {f"{ca}_ca.cert.pem": f"../{up}public/{ca}_ca.cert.pem" for ca in ("identity", "permissions")}
        if own_governances:
            own["governance.p7s"] = signed_document(GOVERNANCE, permissions)
        elif path != "/":
            targets["governance.p7s"] = f"{up}governance.p7s"
        write(directory, own)
        write(directory, {n: target if links else (directory / target).read_bytes() for n, target in targets.items()})
    return root


def flat(root: Path, nodes: Sequence[str] = ("talker", "ns/listener"), *, ardent: bool = False) -> Path:
    """Build the layout of Crystal to Eloquent, or of Ardent and Bouncy: copies below a flat root."""
    ca = authority("sros2testCA")
    governance = signed_document(GOVERNANCE, ca)
    documents = {"governance.xml": GOVERNANCE, "governance.p7s": governance}
    database = {"index.txt": b"V\n", "serial": b"1002\n", "1000.pem": ca.pem}
    write(root, {"ca.cert.pem": ca.pem, "ca.key.pem": ca.key_pem, **documents, **database})
    for node in nodes:
        shared = ("ca.cert.pem",) if ardent else ("identity_ca.cert.pem", "permissions_ca.cert.pem")
        path = node if ardent else f"/{node}"
        own = _own(path, ca, ca, _stock(path))
        write(root / node, {**own, **dict.fromkeys(shared, ca.pem), "governance.p7s": governance})
    return root


def _own(path: str, identity: Signed, permissions: Signed, text: str) -> dict[str, bytes]:
    own, document = certificate(path, identity), text.encode()
    signed = signed_document(document, permissions)
    return {"cert.pem": own.pem, "key.pem": own.key_pem, "permissions.xml": document, "permissions.p7s": signed}
