"""NIST's Public Key Interoperability Test Suite (PKITS 1.0.1) as `cryptography-vectors` brings it along.

Each of the 224 tests is an S/MIME message with its certification path and revocation lists inside, read here with
asn1crypto. Its number follows from its name; `test_the_suite_is_complete` shows that none is missing or doubled.
"""

from __future__ import annotations

import base64
import re
from enum import Enum
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from asn1crypto import cms, parser  # type: ignore[import-untyped]
from msgspec import Struct

from tests.conftest import lacking
from tests.keystore import builder


class Counts(str, Enum):
    """What a DDS implementation makes of a section: that which X509_verify_cert makes of it under its flags."""

    ALWAYS = "always: signatures, names, dates, basic constraints, name constraints, unknown critical extensions"
    POLICIES = "where the caller sets X509_V_FLAG_POLICY_CHECK: Fast DDS; whatever policies, since none are asked for"
    LIST = "with a crl.pem, for the identity alone: one list; none that is partial, indirect or of another scope"
    BOTH = "keyCertSign always, cRLSign with a crl.pem"


class Section(Struct, frozen=True):
    """A section of the suite. `names`: what tells its tests from those of the sections after it."""

    title: str
    tests: int
    names: str
    counts: Counts


SECTIONS = {
    "4.13": Section("Name Constraints", 38, "nameConstraints", Counts.ALWAYS),
    "4.15": Section("Delta-CRLs", 10, "deltaCRL", Counts.LIST),
    "4.14": Section(
        "Distribution Points",
        35,
        "distributionPoint|DistributionPoint|IDPwith|cRLIssuer|onlyContains|onlySomeReasons",
        Counts.LIST,
    ),
    "4.16": Section("Private Certificate Extensions", 2, "CertificateExtension", Counts.ALWAYS),
    "4.12": Section("Inhibit Any Policy", 10, "inhibitAnyPolicy", Counts.POLICIES),
    "4.11": Section("Inhibit Policy Mapping", 11, "inhibitPolicyMapping", Counts.POLICIES),
    "4.10": Section("Policy Mappings", 14, "Mapping", Counts.POLICIES),
    "4.9": Section("Require Explicit Policy", 8, "[rR]equireExplicitPolicy", Counts.POLICIES),
    "4.8": Section("Certificate Policies", 20, "Polic(y|ies)Test|CertificatesNoPolicies|Qualifier", Counts.POLICIES),
    "4.7": Section("Key Usage", 5, "keyUsage", Counts.BOTH),
    "4.6": Section("Verifying Basic Constraints", 17, "basicConstraints|cAFalse|pathLenConstraint", Counts.ALWAYS),
    "4.5": Section("Verifying Paths with Self-Issued Certificates", 8, "BasicSelfIssued", Counts.LIST),
    "4.4": Section("Basic Certificate Revocation Tests", 21, "CRL|Revoked|SerialNumber", Counts.LIST),
    "4.2": Section("Validity Periods", 8, "Date", Counts.ALWAYS),
    "4.3": Section("Verifying Name Chaining", 11, "NameChaining|RFC3280|UTF8String", Counts.ALWAYS),
    "4.1": Section("Signature Verification", 6, "Signature|DSA", Counts.ALWAYS),
}
"""In the order in which names are looked at: what stands first is the more special."""


class Case(Struct, frozen=True):
    """One test: a message, the certificates and lists that it brings along (DER), and the signer's certificate.

    `issuers`: the path below the trust anchor without the signer. `valid`: what RFC 5280 says by the suite's name of
    the test; None where that depends on the policies that the verifier asks for.
    """

    number: str
    name: str
    message: bytes
    issuers: tuple[bytes, ...]
    signer: bytes
    lists: tuple[bytes, ...]
    valid: bool | None

    @property
    def section(self) -> str:
        """`4.1` … `4.16`."""
        return self.number.rpartition(".")[0]

    @property
    def without_lists(self) -> bytes:
        """The message with no revocation lists in its SignedData: they are not signed, and none of ours has them."""
        head, _, tail = self.message.rpartition(b"\n\n------")
        start, _, encoded = head.rpartition(b"\n\n")
        kind, wrapped = _elements(_inside(base64.b64decode(encoded)))
        fields = _elements(_inside(_inside(wrapped)))
        signed = parser.emit(0, 1, 16, b"".join(each for each in fields if each[:1] != b"\xa1"))
        outer = parser.emit(0, 1, 16, kind + parser.emit(2, 1, 0, signed))
        return start + b"\n\n" + base64.encodebytes(outer) + b"\n------" + tail

    @property
    def label(self) -> str:
        """For messages and lists of deviations."""
        return f"{self.number} {self.name}"


class Suite(Struct, frozen=True):
    """The whole of it, DER throughout."""

    anchor: bytes
    anchor_list: bytes
    certificates: dict[str, bytes]
    lists: dict[str, bytes]
    cases: tuple[Case, ...]


@lru_cache(maxsize=1)
def load() -> Suite:
    """Read it; without the package a skip, in CI a failure."""
    found = find_spec("cryptography_vectors")
    if found is None or found.origin is None:
        lacking("PKITS (cryptography-vectors)")
    root = Path(found.origin).parent / "x509/PKITS_data"
    certificates = {path.stem: path.read_bytes() for path in sorted((root / "certs").iterdir())}
    lists = {path.stem: path.read_bytes() for path in sorted((root / "crls").iterdir())}
    return Suite(
        anchor=certificates["TrustAnchorRootCertificate"],
        anchor_list=lists["TrustAnchorRootCRL"],
        certificates=certificates,
        lists=lists,
        cases=tuple(_case(path) for path in sorted((root / "smime").iterdir())),
    )


def _case(path: Path) -> Case:
    message = path.read_bytes()
    name = path.stem.removeprefix("Signed")
    section = next(number for number, section in SECTIONS.items() if re.search(section.names, name))
    encoded = message.rpartition(b"\n\n------")[0].rpartition(b"\n\n")[2]
    signed = cms.ContentInfo.load(base64.b64decode(encoded))["content"]
    (signer_info,) = signed["signer_infos"]
    wanted = signer_info["sid"].chosen
    parsed = [choice.chosen for choice in signed["certificates"]]
    named = [(each.issuer, each.serial_number) for each in parsed].index(_named(wanted))
    certificates = _elements(signed["certificates"].contents)
    return Case(
        number=f"{section}.{name.rpartition('Test')[2]}",
        name=name,
        message=message,
        issuers=(*certificates[:named], *certificates[named + 1 :]),
        signer=certificates[named],
        lists=_elements(signed["crls"].contents),
        valid=True if name.startswith("Valid") else False if name.startswith(("Invalid", "Missing")) else None,
    )


def _inside(der: bytes) -> bytes:
    content: bytes = parser.parse(der)[4]
    return content


def _elements(rest: bytes) -> tuple[bytes, ...]:
    """The elements one after another, byte for byte: asn1crypto writes unique identifiers again, and wrongly."""
    found = []
    while rest:
        _, _, _, header, content, trailer = parser.parse(rest)
        found.append(header + content + trailer)
        rest = rest[len(found[-1]) :]
    return tuple(found)


def _named(identifier: cms.IssuerAndSerialNumber) -> tuple[object, int]:
    return identifier["issuer"], identifier["serial_number"].native


def pem(label: str, *ders: bytes) -> bytes:
    """PEM blocks of one kind."""
    return b"".join(builder.pem(der, label) for der in ders)
