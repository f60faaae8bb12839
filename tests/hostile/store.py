"""A healthy keystore of two enclaves, and cases that spoil one of them."""

from __future__ import annotations

import base64
import os
import re
import shutil
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from _pytest.mark import ParameterSet
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from msgspec import Struct

from tests.keystore.builder import GOVERNANCE, PERMISSIONS, Signed, signed_document, sros2

PERMISSIONS_OF_VICTIM = PERMISSIONS.format(name="/victim").encode()
GOVERNANCE_OF_ALL = GOVERNANCE
P7S = "enclaves/victim/permissions.p7s"
CERT = "enclaves/victim/cert.pem"
KEY = "enclaves/victim/key.pem"

OUTSIDE = b"CANARY-OUTSIDE-3f9c1d77"
"""What stands in the files beside the keystore: it may appear in no output."""


class Base(Struct, frozen=True):
    """The healthy keystore at `root`, and the authorities, whose private keys are not in it."""

    root: Path
    identity: Signed
    permissions: Signed
    victim: Signed
    bystander: Signed


def build(root: Path) -> Base:
    """Make it: with the defaults, at the time of the tests, it passes."""
    sros2(root, ("/victim", "/bystander"), split=True)
    read = {
        name: _read(root, f"private/{name}_ca.key.pem", f"public/{name}_ca.cert.pem")
        for name in ("identity", "permissions")
    }
    enclaves = {
        name: _read(root, f"enclaves/{name}/key.pem", f"enclaves/{name}/cert.pem") for name in ("victim", "bystander")
    }
    shutil.rmtree(root / "private")
    for key in root.rglob("key.pem"):
        key.chmod(0o600)
    return Base(root, read["identity"], read["permissions"], enclaves["victim"], enclaves["bystander"])


def _read(root: Path, key: str, certificate: str) -> Signed:
    private = load_pem_private_key((root / key).read_bytes(), None)
    assert isinstance(private, ec.EllipticCurvePrivateKey)
    return Signed(private, x509.load_pem_x509_certificate((root / certificate).read_bytes()))


class Store(Struct, frozen=True):
    """A copy of the healthy keystore to be spoiled, with a neighbour that nobody may open."""

    base: Base
    root: Path
    url: str
    """Where a server listens that nobody may call."""

    @classmethod
    def copy(cls, base: Base, folder: Path, url: str) -> Store:
        root = folder / "keystore"
        shutil.copytree(base.root, root, symlinks=True)
        outside = folder / "outside"
        (outside / "below").mkdir(parents=True)
        for name in ("secret", "evil.dtd", "evil.xsd", "below/cert.pem"):
            (outside / name).write_bytes(b'<!ENTITY canary "' + OUTSIDE + b'">\n')
        return cls(base, root, url)

    @property
    def victim(self) -> Path:
        return self.root / "enclaves/victim"

    @property
    def outside(self) -> Path:
        return self.root.parent / "outside"

    def permit(self, xml: bytes) -> None:
        """Sign `xml` as the victim's permissions."""
        self.put("permissions.p7s", signed_document(xml, self.base.permissions))

    def govern(self, xml: bytes) -> None:
        """Sign `xml` as a governance of the victim's own."""
        self.put("governance.p7s", signed_document(xml, self.base.permissions))

    def identify(self, own: Signed) -> None:
        """Give the victim another identity."""
        self.put("cert.pem", own.pem)
        self.put("key.pem", own.key_pem)

    def message(self) -> bytes:
        """The victim's permissions.p7s as it is."""
        return (self.victim / "permissions.p7s").read_bytes()

    def put(self, name: str, content: bytes) -> None:
        """Give the victim a file of its own, in place of what is there."""
        path = self.victim / name
        mode = path.stat().st_mode & 0o777 if path.exists() else 0o644
        path.unlink(missing_ok=True)
        path.write_bytes(content)
        path.chmod(mode)
        if name == "permissions.p7s":
            (self.victim / "permissions.xml").unlink(missing_ok=True)

    def link(self, name: str, target: str) -> None:
        """Put a link in the place of the victim's file."""
        (self.victim / name).unlink(missing_ok=True)
        os.symlink(target, self.victim / name)


ANY: Final = -1


class Finds(Struct, frozen=True):
    """A finding that there must be: its code, its file, and a text that stands on its line (None: no line)."""

    code: str
    path: str = P7S
    at: bytes | None = None
    line: int | None = None
    """The line itself, where no text marks it; ANY where several would be right."""

    def line_in(self, root: Path) -> int | None:
        if self.at is None:
            return self.line
        content = (root / self.path).read_bytes()
        offset = content.find(self.at)
        assert offset >= 0, f"{self.at!r} is not in {self.path}"
        offset += len(self.at) - len(self.at.lstrip(b"\n"))  # a mark at the start of a line
        return content.count(b"\n", 0, offset) + 1


class Case(Struct, frozen=True):
    """One line of the catalogue: how the keystore is spoiled, and what an audit has to say."""

    name: str
    spoil: Callable[[Store], None]
    finds: tuple[Finds, ...]
    exit: int = 4
    """4: a run time may read what we did not; 1: it is wrong, and everything was decided."""
    options: tuple[str, ...] = ()
    nobody: bool = False
    """Audited by somebody who may not read everything."""
    bystander_changes: bool = False
    """Whether what is wrong concerns the other enclave too."""
    fault: str = ""
    """Why the audit is known to fail on it."""
    secrets: tuple[bytes, ...] = ()


def case(
    name: str,
    spoil: Callable[[Store], None],
    code: str = "",
    path: str = P7S,
    *,
    at: bytes | None = None,
    line: int | None = None,
    **more: Any,
) -> Case:
    """A case with one finding, or with none."""
    return Case(name, spoil, (Finds(code, path, at, line),) if code else (), **more)


def secrets_of(base: Base) -> Iterator[bytes]:
    """Pieces of every private key in every form in which it could be printed."""
    for signed in (base.identity, base.permissions, base.victim, base.bystander):
        assert isinstance(signed.key, ec.EllipticCurvePrivateKey)
        lines = signed.key_pem.splitlines()[1:-1]
        # The first line holds nothing but the algorithm, and the last part of the block is the public key.
        secret = base64.b64decode(b"".join(lines))[36:68]
        assert secret == signed.key.private_numbers().private_value.to_bytes(32, "big")
        body = b"".join(lines)[48:88]
        yield from (body[:16], body[16:32])
        yield from (secret.hex().encode()[i : i + 12] for i in range(0, 60, 12))
        yield from (secret.hex(":").encode()[i : i + 18] for i in range(0, 72, 18))
        yield str(int.from_bytes(secret, "big")).encode()[:20]
        yield from (repr(secret[i : i + 8])[2:-1].encode() for i in range(0, 32, 8))


_SGR = re.compile(rb"\x1b\[[0-9;]*m")


def steering(output: bytes) -> list[str]:
    """Characters in a report that a terminal would obey, beside colours and line ends."""
    text = _SGR.sub(b"", output).decode("utf-8")
    return [hex(ord(each)) for each in text if not (each.isprintable() or each in "\n\xa0")]


def parameters(cases: Collection[Case]) -> list[ParameterSet]:
    """The cases for `pytest.mark.parametrize`, known faults marked."""
    marks = {each.name: [pytest.mark.xfail(strict=True, reason=each.fault)] if each.fault else [] for each in cases}
    return [pytest.param(each, id=each.name, marks=marks[each.name]) for each in cases]
