"""What no audit in Python can do without: `python -m benchmarks.floor DIRECTORY` reads every keystore below it.

The files of every enclave are opened, parsed, verified and validated by the libraries, each content once, and nothing
is asked about them: no other form of them is looked for, nothing is typed, modelled, judged or reported.
"""

from __future__ import annotations

import gc
import sys
from hashlib import sha256
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from lxml import etree

from keystore_audit.keystore.cms import read_signed_data
from keystore_audit.keystore.mime import read_message, split_text
from keystore_audit.resources import schemas


class Floor:
    """Reads enclaves one after the other."""

    def __init__(self) -> None:
        self._authorities: dict[bytes, x509.Certificate] = {}
        self._documents: set[bytes] = set()
        folder = schemas() / "dds_security_1.1"
        names = ("governance", "permissions")
        self._schemas = {name: etree.XMLSchema(etree.parse(str(folder / f"{name}.xsd"))) for name in names}

    def read(self, enclave: Path) -> None:
        """Certificate, key, chain and both documents of an enclave. Raises what the libraries raise."""
        certificate = x509.load_pem_x509_certificate((enclave / "cert.pem").read_bytes())
        pem = (enclave / "key.pem").read_bytes()
        key = load_pem_private_key(pem, None, unsafe_skip_rsa_key_validation=True)  # as the audit does
        assert key.public_key() == certificate.public_key()
        certificate.verify_directly_issued_by(self._authority(enclave / "identity_ca.cert.pem"))
        signer = self._authority(enclave / "permissions_ca.cert.pem")
        for name in self._schemas:
            content = (enclave / f"{name}.p7s").read_bytes()
            if content not in self._documents:
                self._documents.add(content)
                self._verify(name, content, signer)

    def _authority(self, path: Path) -> x509.Certificate:
        """The first certificate of a CA file."""
        content = path.read_bytes()
        if content not in self._authorities:
            self._authorities[content] = x509.load_pem_x509_certificate(content)
        return self._authorities[content]

    def _verify(self, name: str, content: bytes, authority: x509.Certificate) -> None:
        """Verify a signed document and validate its XML."""
        message = read_message(content)
        assert message.entity is not None
        signer = read_signed_data(message.signature).signers[0]
        sha256(message.entity).digest()
        assert signer.scheme.made_by(authority.public_key(), signer.signature, signer.signed or b"").must
        self._schemas[name].assertValid(etree.fromstring(split_text(message.entity, 1)[0]))


if __name__ == "__main__":
    gc.disable()
    floor = Floor()
    for certificate in sorted(Path(sys.argv[1]).rglob("cert.pem")):
        floor.read(certificate.parent)
