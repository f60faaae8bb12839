"""Measures each step of `keystore/` against one raw P-256 verification: `python -m benchmarks.keystore_stage [STORE]`.

Each step is done for all enclaves of an EC keystore of 1,000, by itself, in turns with as many raw verifications
through `cryptography` in the same process. What is printed is the median of the ratios of processor times, so that a
busy machine changes little. Collections of garbage are as rare as `keystore-audit` has them.
"""

from __future__ import annotations

import gc
import statistics
import sys
import time
from collections.abc import Callable
from functools import partial
from hashlib import sha256
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding
from lxml import etree

from benchmarks.keystores import ROOT, build
from keystore_audit.keystore.certificate import Certificate, read_certificates
from keystore_audit.keystore.cms import SignerInfo, read_signed_data
from keystore_audit.keystore.document import Grammar, validate
from keystore_audit.keystore.files import File
from keystore_audit.keystore.issuer import issued_by
from keystore_audit.keystore.keystore import Enclave, read_keystore
from keystore_audit.keystore.layout import Role, discover
from keystore_audit.keystore.mime import read_message, split_text
from keystore_audit.keystore.pem import read_pem
from keystore_audit.keystore.private_key import read_private_key
from keystore_audit.keystore.root import Root
from keystore_audit.keystore.smime import Candidates, SignedDocument, read_signed
from keystore_audit.keystore.typed import read_permissions
from keystore_audit.keystore.xml import read_xml
from tests.keystore.builder import authority

ROUNDS = 5
CHUNK = 25
"""Enclaves between two looks at the clock: work and verifications beside it then see the same machine."""

NAMED = frozenset(
    {"PEM", "certificate loaded", "chain signature", "MIME", "CMS parse", "CMS signature"}
    | {"XML parse", "one meaning only", "XSD"}
)
"""The steps whose sum is to be five verifications at most."""

Verify = Callable[[int], None]


class Subject:
    """One enclave with what its steps begin with."""

    def __init__(self, enclave: Enclave, key: File, candidates: Candidates) -> None:
        """Take it apart once, not measured."""
        files = enclave.files.files
        assert enclave.certificate is not None
        assert enclave.identity_ca is not None
        assert enclave.permissions is not None
        self.certificate_file, self.key_file = files[Role.CERTIFICATE], key
        self.permissions_file = files[Role.PERMISSIONS]
        self.candidates = candidates
        self.certificate: Certificate = enclave.certificate.certificates[0]
        self.authority: Certificate = enclave.identity_ca.certificates[0]
        self.der = self.certificate.parsed.public_bytes(Encoding.DER)
        self.message = read_message(self.permissions_file.content or b"")
        self.signer: SignerInfo = read_signed_data(self.message.signature).signers[0]
        self.signed: SignedDocument = enclave.permissions.signed
        self.root = etree.fromstring(self.signed.content or b"")


def _mime(each: Subject) -> None:
    message = read_message(each.permissions_file.content or b"")
    split_text(message.entity or b"", message.entity_line)


def _signature(each: Subject) -> None:
    sha256(each.message.entity or b"").digest()
    each.signer.scheme.made_by(each.authority.parsed.public_key(), each.signer.signature, each.signer.signed or b"")


STEPS: dict[str, Callable[[Subject], object]] = {
    "PEM of certificates": lambda each: read_pem(each.certificate_file.content or b""),
    "PEM of keys": lambda each: read_pem(each.key_file.content or b""),
    "certificate loaded": lambda each: x509.load_der_x509_certificate(each.der),
    "certificates": lambda each: read_certificates(each.certificate_file),
    "chain signature": lambda each: issued_by.__wrapped__(each.certificate, each.authority),
    "keys": lambda each: read_private_key(each.key_file),
    "MIME": _mime,
    "CMS parse": lambda each: read_signed_data(each.message.signature),
    "CMS signature": _signature,
    "signed": lambda each: read_signed(each.permissions_file, each.candidates),
    "XML parse": lambda each: etree.fromstring(each.signed.content or b""),
    "XML": lambda each: read_xml(each.signed),
    "XSD": lambda each: validate(each.root, Grammar.PERMISSIONS, each.signed),
    "permissions": lambda each: read_permissions(each.permissions_file, each.candidates),
}
"""What is measured enclave by enclave, some of it several steps at once, which `rows` takes apart."""


def raw() -> Verify:
    """What verifies one signature so many times: one P-256 key, the bytes of one certificate."""
    made = authority().certificate
    public, signature, data = made.public_key(), made.signature, made.tbs_certificate_bytes
    assert isinstance(public, ec.EllipticCurvePublicKey)

    def verify(times: int) -> None:
        for _ in range(times):
            public.verify(signature, data, ec.ECDSA(hashes.SHA256()))

    return verify


def ratio(work: Callable[[], object], enclaves: int, verify: Verify) -> float:
    """Processor time of `work` on so many enclaves over that of as many verifications, half before and half after."""
    start = time.process_time()
    verify(enclaves // 2)
    begin = time.process_time()
    work()
    end = time.process_time()
    verify(enclaves - enclaves // 2)
    return (end - begin) / (time.process_time() - end + begin - start)


def by_enclave(step: Callable[[Subject], object], subjects: list[Subject], verify: Verify) -> float:
    """The median ratio of a step, chunk by chunk."""

    def work(chunk: list[Subject]) -> None:
        for each in chunk:
            step(each)

    chunks = [subjects[begin : begin + CHUNK] for begin in range(0, len(subjects), CHUNK)]
    return statistics.median(ratio(partial(work, chunk), len(chunk), verify) for _ in range(ROUNDS) for chunk in chunks)


def at_once(work: Callable[[], object], enclaves: int, verify: Verify) -> float:
    """The median ratio of what is done for all enclaves at once."""
    found = []
    for _ in range(ROUNDS):
        gc.collect()
        found.append(ratio(work, enclaves, verify))
    return statistics.median(found)


def find(store: Path) -> None:
    """Find and read every file."""
    with Root.open(store) as root:
        discover(root)


def rows(store: Path) -> dict[str, float]:
    """Each step of one enclave, in raw verifications, and the whole of `read_keystore`."""
    keystore = read_keystore(store)
    with Root.open(store) as root:
        keys = [root.unsealed(root.sealed(each.files.files[Role.KEY].path)) for each in keystore.enclaves]
    own = [each.certificate.certificates[0] for each in keystore.enclaves if each.certificate]
    candidates = Candidates([*(each for file in keystore.authorities for each in file.certificates), *own])
    subjects = [Subject(enclave, key, candidates) for enclave, key in zip(keystore.enclaves, keys, strict=True)]
    verify = raw()
    found = {name: by_enclave(step, subjects, verify) for name, step in STEPS.items()}
    count = len(subjects)
    return {
        "finding and reading files": at_once(lambda: find(store), count, verify),
        "PEM": found["PEM of certificates"] + found["PEM of keys"],
        "certificate loaded": found["certificate loaded"],
        "what the certificate says": found["certificates"] - found["PEM of certificates"] - found["certificate loaded"],
        "chain signature": found["chain signature"],
        "key match": found["keys"] - found["PEM of keys"],
        "MIME": found["MIME"],
        "CMS parse": found["CMS parse"],
        "CMS signature": found["CMS signature"],
        "whose signature": found["signed"] - found["MIME"] - found["CMS parse"] - found["CMS signature"],
        "XML parse": found["XML parse"],
        "one meaning only": found["XML"] - found["XML parse"],
        "XSD": found["XSD"],
        "typed reading": found["permissions"] - found["signed"] - found["XML"] - found["XSD"],
        "keystore": at_once(lambda: read_keystore(store), count, verify) + found["chain signature"],
    }


def main() -> None:
    """Prints the table."""
    gc.set_threshold(200_000, 50, 50)
    found = rows(Path(sys.argv[1]) if len(sys.argv) > 1 else build(ROOT, 1000, "ec"))
    whole = found.pop("keystore")
    print("| step, for one enclave | raw P-256 verifications |\n|---|---|")
    for name, value in (*found.items(), ("rest", whole - sum(found.values())), ("**the whole**", whole)):
        print(f"| {name}{' *' if name in NAMED else ''} | {value:.2f} |")
    print(f"| **PEM, chain, CMS, XML, XSD: the steps with a star** | {sum(found[name] for name in NAMED):.2f} |")


if __name__ == "__main__":
    main()
