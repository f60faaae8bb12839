"""Keystores as `ros2 security` makes them, of any size, for measuring only."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from pathlib import Path
from tempfile import gettempdir

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import pkcs7

ROOT = Path(gettempdir()) / "keystore-audit-benchmarks"
"""Where they are made, once."""

Key = ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey

GOVERNANCE = """<?xml version="1.0" encoding="UTF-8"?>
<dds>
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

PARAMETER_SERVICES = (
    "describe_parameters",
    "get_parameters",
    "get_parameter_types",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)


def new_key(kind: str) -> Key:
    """A fresh key: `ec` is P-256, `rsa` has 2,048 bits."""
    return ec.generate_private_key(ec.SECP256R1()) if kind == "ec" else rsa.generate_private_key(65537, 2048)


def certificate(subject: str, key: Key, issuer: str, signer: Key, *, ca: bool) -> x509.Certificate:
    """A certificate with the extensions that sros2 writes, ten years from yesterday."""
    now = datetime.now(timezone.utc).replace(microsecond=0)
    name = [x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, text)]) for text in (subject, issuer)]
    builder = (
        x509.CertificateBuilder()
        .subject_name(name[0])
        .issuer_name(name[1])
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=3650))
        .add_extension(x509.BasicConstraints(ca=ca, path_length=1 if ca else None), critical=ca)
    )
    return builder.sign(signer, hashes.SHA256())


def permissions(path: str) -> str:
    """Permissions of one talker-like node: two topics of its own, the usual node topics and parameter services."""
    return wired_permissions(path, ["rt/chatter", f"rt{path}/status"], ["rt/clock", f"rt{path}/command"])


def wired_permissions(path: str, publish: list[str], subscribe: list[str]) -> str:
    """Permissions to publish and subscribe these DDS topics, with the usual node topics and parameter services."""
    publish = [*publish, "rt/rosout", "rt/parameter_events"]
    subscribe = [*subscribe, "rt/parameter_events"]
    publish += [f"rr{path}/{service}Reply" for service in PARAMETER_SERVICES]
    subscribe += [f"rq{path}/{service}Request" for service in PARAMETER_SERVICES]
    criteria = "".join(
        f"<{kind}><topics>" + "".join(f"<topic>{topic}</topic>\n" for topic in topics) + f"</topics></{kind}>\n"
        for kind, topics in (("publish", publish), ("subscribe", subscribe))
    )
    discovery = "<topics><topic>ros_discovery_info</topic></topics>"
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd">
  <permissions>
    <grant name="{path}">
      <subject_name>CN={path}</subject_name>
      <validity><not_before>2020-01-01T00:00:00</not_before><not_after>2090-01-01T00:00:00</not_after></validity>
      <allow_rule><domains><id>0</id></domains>
{criteria}</allow_rule>
      <allow_rule><domains><id>0</id></domains>
        <publish>{discovery}</publish><subscribe>{discovery}</subscribe></allow_rule>
      <default>DENY</default>
    </grant>
  </permissions>
</dds>
"""


def signed(text: str, ca: x509.Certificate, key: Key) -> bytes:
    """The document signed as sros2 signs it."""
    builder = pkcs7.PKCS7SignatureBuilder().set_data(text.encode()).add_signer(ca, key, hashes.SHA256())
    options = [pkcs7.PKCS7Options.Text, pkcs7.PKCS7Options.DetachedSignature]
    return builder.sign(serialization.Encoding.SMIME, options)


def build(root: Path, enclaves: int, kind: str) -> Path:
    """A keystore with so many enclaves, ten for each robot, made once and kept under `root`."""
    paths = [f"/robot{number // 10}/node{number % 10}" for number in range(enclaves)]
    return build_with(root / f"{kind}-{enclaves}", kind, {path: permissions(path) for path in paths})


def build_with(store: Path, kind: str, documents: dict[str, str]) -> Path:
    """The keystore `store` with these enclaves and their permissions, made once and kept."""
    if (store / "complete").exists():
        return store
    for folder in ("public", "private", "enclaves"):
        (store / folder).mkdir(parents=True, exist_ok=True)
    ca_key = new_key(kind)
    ca = certificate("sros2CA", ca_key, "sros2CA", ca_key, ca=True)
    (store / "public/ca.cert.pem").write_bytes(ca.public_bytes(serialization.Encoding.PEM))
    for name in ("identity_ca", "permissions_ca"):
        link(store / f"public/{name}.cert.pem", "ca.cert.pem")
    (store / "enclaves/governance.p7s").write_bytes(signed(GOVERNANCE, ca, ca_key))
    for path, document in documents.items():
        add_enclave(store, path, document, kind, ca, ca_key)
    (store / "complete").touch()
    return store


def add_enclave(store: Path, path: str, document: str, kind: str, ca: x509.Certificate, ca_key: Key) -> None:
    """One enclave with these permissions, and with links as sros2 makes them."""
    folder = store / ("enclaves" + path)
    folder.mkdir(parents=True, exist_ok=True)
    key = new_key(kind)
    made = certificate(path, key, "sros2CA", ca_key, ca=False)
    (folder / "cert.pem").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    (folder / "key.pem").write_bytes(private)
    (folder / "key.pem").chmod(0o600)
    (folder / "permissions.p7s").write_bytes(signed(document, ca, ca_key))
    up = "../" * (path.count("/") + 1)
    for name in ("identity_ca", "permissions_ca"):
        link(folder / f"{name}.cert.pem", f"{up}public/{name}.cert.pem")
    link(folder / "governance.p7s", f"{up[:-3]}governance.p7s")


def link(place: Path, target: str) -> None:
    """A symbolic link, unless it is there already."""
    if not place.is_symlink():
        place.symlink_to(target)
