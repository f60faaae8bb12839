"""Keystores as `ros2 security` makes them, of any size, for measuring only."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from pathlib import Path
from tempfile import gettempdir

from cryptography.hazmat.primitives.asymmetric import ec, rsa

from tests.keystore.builder import GOVERNANCE, Signed, authority, certificate, signed_document, write
from tests.keystore.documents import grant, pub, rule, sub
from tests.keystore.documents import permissions as document

ROOT = Path(gettempdir()) / "keystore-audit-benchmarks"
"""Where they are made, once."""

PARAMETER_SERVICES = (
    "describe_parameters",
    "get_parameters",
    "get_parameter_types",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)


def new_key(kind: str) -> ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey:
    """A fresh key: `ec` is P-256, `rsa` has 2,048 bits."""
    return ec.generate_private_key(ec.SECP256R1()) if kind == "ec" else rsa.generate_private_key(65537, 2048)


def permissions(path: str) -> str:
    """Permissions of one talker-like node: two topics of its own, the usual node topics and parameter services."""
    return wired_permissions(path, ["rt/chatter", f"rt{path}/status"], ["rt/clock", f"rt{path}/command"])


def wired_permissions(path: str, publish: list[str], subscribe: list[str]) -> str:
    """Permissions to publish and subscribe these DDS topics, with the usual node topics and parameter services."""
    publish = [*publish, "rt/rosout", "rt/parameter_events"]
    subscribe = [*subscribe, "rt/parameter_events"]
    publish += [f"rr{path}/{service}Reply" for service in PARAMETER_SERVICES]
    subscribe += [f"rq{path}/{service}Request" for service in PARAMETER_SERVICES]
    rules = (rule(pub(*publish), sub(*subscribe)), rule(pub("ros_discovery_info"), sub("ros_discovery_info")))
    return document(grant(path, *rules, start="2020-01-01T00:00:00", end="2090-01-01T00:00:00", name=path))


def build(root: Path, enclaves: int, kind: str) -> Path:
    """A keystore with so many enclaves, ten for each robot, made once and kept under `root`."""
    paths = [f"/robot{number // 10}/node{number % 10}" for number in range(enclaves)]
    return build_with(root / f"{kind}-{enclaves}", kind, {path: permissions(path) for path in paths})


def build_with(store: Path, kind: str, documents: dict[str, str], governance: bytes = GOVERNANCE) -> Path:
    """The keystore `store` with these enclaves and their permissions, made once and kept."""
    if (store / "complete").exists():
        return store
    now = datetime.now(timezone.utc).replace(microsecond=0)
    dates = {"start": now - timedelta(days=1), "end": now + timedelta(days=3650)}
    ca = authority(key=new_key(kind), **dates)
    for name in ("identity_ca", "permissions_ca"):
        write(store, {f"public/{name}.cert.pem": "ca.cert.pem"})
    write(store, {"public/ca.cert.pem": ca.pem, "enclaves/governance.p7s": signed_document(governance, ca)})
    (store / "private").mkdir()
    for path, text in documents.items():
        own = certificate(path, ca, key=new_key(kind), **dates)
        add_enclave(store, path, own, text, ca)
    (store / "complete").touch()
    return store


def add_enclave(store: Path, path: str, own: Signed, text: str, ca: Signed) -> None:
    """One enclave with these permissions, and with links as sros2 makes them."""
    folder, up = store / ("enclaves" + path), "../" * (path.count("/") + 1)
    files = {"cert.pem": own.pem, "key.pem": own.key_pem, "permissions.p7s": signed_document(text.encode(), ca)}
    links = {f"{name}_ca.cert.pem": f"{up}public/{name}_ca.cert.pem" for name in ("identity", "permissions")}
    write(folder, {**files, **links, "governance.p7s": f"{up[:-3]}governance.p7s"})
    (folder / "key.pem").chmod(0o600)
