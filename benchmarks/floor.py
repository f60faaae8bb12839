"""Measures what no audit in Python can do without, beside the loop and the audit: `python -m benchmarks.floor`.

The files of every enclave are opened, parsed, verified and validated by the libraries and nothing is asked about
them: no other form of them is looked for, nothing is typed, modelled, judged or reported. What an audit may take at a
given ratio to the loop, less this, is what is left for all that it is for.
"""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from lxml import etree

from benchmarks.audit import LOOP, audit, seconds
from benchmarks.keystores import ROOT, build
from keystore_audit.keystore.cms import read_signed_data
from keystore_audit.keystore.mime import read_message, split_text
from keystore_audit.resources import schemas


class Floor:
    """Reads enclaves one after the other; files that all of them share once."""

    def __init__(self) -> None:
        """Nothing read yet."""
        self.authorities: dict[bytes, x509.Certificate] = {}
        self.governances: set[bytes] = set()
        folder = schemas() / "dds_security_1.1"
        names = ("governance", "permissions")
        self.schemas = {name: etree.XMLSchema(etree.parse(str(folder / f"{name}.xsd"))) for name in names}

    def read(self, enclave: Path) -> None:
        """Certificate, key, chain and both documents of an enclave. Raises what the libraries raise."""
        certificate = x509.load_pem_x509_certificate((enclave / "cert.pem").read_bytes())
        pem = (enclave / "key.pem").read_bytes()
        key = load_pem_private_key(pem, None, unsafe_skip_rsa_key_validation=True)  # as the audit does
        assert key.public_key() == certificate.public_key()
        certificate.verify_directly_issued_by(self.authority(enclave / "identity_ca.cert.pem"))
        signer = self.authority(enclave / "permissions_ca.cert.pem")
        self.document("permissions", (enclave / "permissions.p7s").read_bytes(), signer)
        governance = (enclave / "governance.p7s").read_bytes()
        if governance not in self.governances:
            self.document("governance", governance, signer)
            self.governances.add(governance)

    def authority(self, path: Path) -> x509.Certificate:
        """The first certificate of a CA file."""
        content = path.read_bytes()
        if content not in self.authorities:
            self.authorities[content] = x509.load_pem_x509_certificate(content)
        return self.authorities[content]

    def document(self, name: str, content: bytes, authority: x509.Certificate) -> None:
        """Verify a signed document and validate its XML."""
        message = read_message(content)
        assert message.entity is not None
        signer = read_signed_data(message.signature).signers[0]
        sha256(message.entity).digest()
        assert signer.scheme.made_by(authority.public_key(), signer.signature, signer.signed or b"")
        self.schemas[name].assertValid(etree.fromstring(split_text(message.entity, 1)[0]))


def floor(store: Path) -> None:
    """Read half of the enclaves in a copy of this process, as the audit does."""
    gc.disable()
    enclaves = sorted(path.parent for path in (store / "enclaves").rglob("cert.pem"))
    reader = Floor()
    copy = os.fork()
    for enclave in enclaves[bool(copy) :: 2]:
        reader.read(enclave)
    if copy and os.waitpid(copy, 0)[1]:
        raise SystemExit("the copy failed")
    os._exit(0)


def row(kind: str) -> str:
    """One line of the table."""
    store = build(ROOT, 1000, kind)
    loop = seconds(lambda: subprocess.run(["bash", "-c", LOOP, "-", str(store)], check=True), 1)
    command = [sys.executable, "-m", "benchmarks.floor", str(store)]
    least = seconds(lambda: subprocess.run(command, check=True), 5)
    ours = seconds(lambda: audit(store), 3)
    return f"| {kind} | {loop:.1f} | {least:.2f} | {loop / least:.0f} | {ours:.2f} | {loop / ours:.1f} |"


def main() -> None:
    """Prints one row for each kind of keys; with the path of a keystore, only reads that."""
    if len(sys.argv) > 1:
        floor(Path(sys.argv[1]))
    print("| keys | loop s | floor s | loop / floor | audit s | loop / audit |\n|---|---|---|---|---|---|")
    for kind in ("ec", "rsa"):
        print(row(kind), flush=True)


if __name__ == "__main__":
    main()
