"""Named messages with the certificates that a permissions CA file holds: what every writer makes, and departures.

`verdicts.tsv` says of each what we find in it, and what we and OpenSSL make of it, for implementations that pin the
signer and for those that follow a chain. `python -m tests.oracles.smime.corpus` prints that table as it is now.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.name import _ASN1Type
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID, ObjectIdentifier
from msgspec import Struct
from msgspec.structs import replace

from tests.keystore.builder import GOVERNANCE, Extension, Signed, authority, certificate, signed_document, usage
from tests.keystore.messages import by_openssl, corpus, taken_apart, with_signature
from tests.oracles.smime.comparison import compare
from tests.oracles.smime.crafted import CRAFTED
from tests.oracles.smime.der import ED25519, NULL, RSA, algorithm, parse, tlv
from tests.oracles.smime.oracle import Oracle, compile_oracle
from tests.oracles.smime.signed_data import CA, ED_CA, GOOD, LEAF, MESSAGE, RSA_CA, Info, sign
from tests.oracles.smime.textual import textual

TABLE = Path(__file__).parent / "verdicts.tsv"
P384_CA = authority(key=ec.generate_private_key(ec.SECP384R1()))
P521_CA = authority(key=ec.generate_private_key(ec.SECP521R1()))


class Case(Struct, frozen=True, kw_only=True):
    """A message, the permissions CA file, and other certificates that the keystore holds."""

    name: str
    message: bytes
    trusted: tuple[Signed, ...] = (CA,)
    known: tuple[Signed, ...] = ()


@lru_cache(maxsize=1)
def cases() -> tuple[Case, ...]:
    """All of them; made once, since every signature of an EC key is another."""
    return (*_writers(), *_by_hand(), *_crafted(), *_signers(), *_chains())


def _writers() -> Iterator[Case]:
    """Every option set of every writer that matters, with keys of every kind."""
    for kind, signer in (("EC", CA), ("RSA", RSA_CA)):
        for title, message in corpus(signer, rsa=kind == "RSA").items():
            yield Case(name=f"{kind}: {title}", message=message, trusted=(signer,))
    for kind, signer in (("P-384", P384_CA), ("P-521", P521_CA)):
        for title in ("smime", "cms"):
            yield Case(name=f"{kind}: {title} -text", message=by_openssl((title, "-text"), signer), trusted=(signer,))
    yield Case(name="Ed25519: by hand", message=_signed_by(ED_CA), trusted=(ED_CA,))  # openssl 3.0 cannot
    yield _key_for_pss_alone()
    named = named_key()
    yield Case(name="EC: cms -text -keyid", message=by_openssl(("cms", "-text", "-keyid"), named), trusted=(named,))


def _key_for_pss_alone() -> Case:
    """An authority whose key says that it makes RSA-PSS signatures and no others (RFC 4055, 1.2)."""
    with TemporaryDirectory() as folder:
        (Path(folder) / "content").write_bytes(GOVERNANCE)
        for arguments in (
            ("genpkey", "-algorithm", "RSA-PSS", "-pkeyopt", "rsa_keygen_bits:2048", "-out", "key"),
            ("req", "-x509", "-new", "-key", "key", "-subj", "/CN=sros2CA", "-days", "9999", "-out", "certificate"),
            ("cms", "-sign", "-text", "-in", "content", "-signer", "certificate", "-inkey", "key", "-out", "message"),
        ):
            subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)
        named = Signed(RSA_CA.key, x509.load_pem_x509_certificate((Path(folder) / "certificate").read_bytes()))
        return Case(name="RSA-PSS key: cms -text", message=(Path(folder) / "message").read_bytes(), trusted=(named,))


def _by_hand() -> Iterator[Case]:
    """The text around what is signed, for a message of each real writer."""
    for title, message in textual(_padded()).items():
        yield Case(name=f"text: {title}", message=message)
    for title, message in textual(by_openssl(("smime", "-text"), RSA_CA)).items():
        if title != "text behind the base64":  # there may be no padding, which decides
            yield Case(name=f"RSA text: {title}", message=message, trusted=(RSA_CA,))


def _padded() -> bytes:
    """A message whose base64 ends in padding, at which OpenSSL stops; lengths of EC signatures differ."""
    return next(m for m in (by_openssl(("smime", "-text"), CA) for _ in range(100)) if len(taken_apart(m)[1]) % 3)


def _crafted() -> Iterator[Case]:
    """The signature itself."""
    for title, der in CRAFTED.items():
        trusted = (CA, RSA_CA) if title == "signers out of order" else (CA,)
        yield Case(name=f"CMS: {title}", message=with_signature(MESSAGE, der), trusted=trusted)


def _signers() -> Iterator[Case]:
    """Who signed, and how many."""
    impostor = authority()
    twin = certificate("sros2CA", ca=True, serial=CA.certificate.serial_number)
    renewed = certificate("sros2CA", ca=True, key=CA.key)
    printable = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "sros2CA", _type=_ASN1Type.PrintableString)])
    stock = ("smime", "-text")
    for title, message, trusted in (
        ("the authority", by_openssl(stock, CA), (CA,)),
        ("a stranger with the authority's name", by_openssl(stock, impostor), (CA,)),
        ("a stranger with the authority's name and serial number", by_openssl(stock, twin), (CA,)),
        ("the authority and a stranger", by_openssl(stock, CA, impostor), (CA,)),
        ("the authority twice", by_openssl(stock, CA, CA), (CA,)),
        ("the authority and an enclave", by_openssl(stock, CA, LEAF), (CA,)),
        ("two authorities, both trusted", by_openssl(stock, CA, RSA_CA), (CA, RSA_CA)),
        ("two authorities, one trusted", by_openssl(stock, CA, RSA_CA), (RSA_CA,)),
        ("the second of two authorities", by_openssl(stock, RSA_CA), (CA, RSA_CA)),
        ("an authority before its renewal with the same key", by_openssl(stock, CA), (renewed,)),
        (
            "an authority before its renewal, certificate left out",
            by_openssl((*stock, "-nocerts"), CA),
            (renewed,),
        ),
        ("the authority, its certificate behind a false one", _bringing(twin, CA), (CA,)),
        (
            "the authority, its certificate behind a false one with another type of string",
            _bringing(certificate(printable, ca=True, serial=CA.certificate.serial_number), CA),
            (CA,),
        ),
        ("the authority, its certificate before a false one", _bringing(CA, twin), (CA,)),
        ("nobody trusted", by_openssl(stock, CA), ()),
    ):
        yield Case(name=f"signer: {title}", message=message, trusted=trusted)
    again = certificate("sros2CA", ca=True, key=CA.key, serial=CA.certificate.serial_number)
    for title, message, trusted, known in (
        ("an authority before its renewal with the same key and serial number", MESSAGE, (again,), (CA,)),
        ("an authority after its renewal with the same key and serial number", MESSAGE, (CA,), (again,)),
        ("the first of two authorities of one name and serial number", MESSAGE, (CA, twin), ()),
        ("the second of two authorities of one name and serial number", MESSAGE, (twin, CA), ()),
        ("an enclave that brings the authority along", _signed_by(LEAF, CA), (CA,), ()),
    ):
        yield Case(name=f"signer: {title}", message=message, trusted=trusted, known=known)
    bare = by_openssl((*stock, "-nocerts"), LEAF)
    yield Case(name="signer: an enclave, certificate left out", message=bare)
    yield Case(name="signer: an enclave of the keystore, certificate left out", message=bare, known=(LEAF,))
    yield Case(name="signer: an enclave, as sros2 signs", message=signed_document(GOVERNANCE, LEAF), known=(LEAF,))


def _bringing(*others: Signed) -> bytes:
    """A message that the authority signed, with these certificates."""
    brought = tlv(0xA0, *(other.der for other in others))
    return with_signature(MESSAGE, replace(GOOD, certificates=brought).der())


def _fitness() -> Iterator[tuple[str, list[Extension]]]:
    for title, purposes in (
        ("clientAuth", [ExtendedKeyUsageOID.CLIENT_AUTH]),
        ("emailProtection", [ExtendedKeyUsageOID.EMAIL_PROTECTION]),
        ("any", [ExtendedKeyUsageOID.ANY_EXTENDED_KEY_USAGE]),
        ("clientAuth and emailProtection", [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.EMAIL_PROTECTION]),
    ):
        yield f"extended key usage {title}", [(x509.ExtendedKeyUsage(purposes), False)]
    for used in ("digital_signature", "content_commitment", "key_encipherment", "key_cert_sign"):
        yield f"key usage {used}", [usage(used)]
    for title, mask in (("S/MIME", b"\x20"), ("SSL server", b"\x40"), ("SSL client", b"\x80")):
        netscape = x509.UnrecognizedExtension(ObjectIdentifier("2.16.840.1.113730.1.1"), tlv(3, b"\x05", mask))
        yield f"Netscape type {title}", [(netscape, False)]
    unknown = x509.UnrecognizedExtension(ObjectIdentifier("1.2.3.4"), NULL)
    yield "an unknown critical extension", [(unknown, True)]


def _signed_by(signer: Signed, *brought: Signed) -> bytes:
    """A message with the certificates of the signer and of others."""
    label = {"Ed25519PrivateKey": algorithm(ED25519), "RSAPrivateKey": algorithm(RSA, NULL)}.get(
        type(signer.key).__name__
    )
    info = Info(signer=signer) if label is None else Info(signer=signer, label=label)
    certificates = tlv(0xA0, *(other.der for other in (signer, *brought)))
    return with_signature(MESSAGE, replace(GOOD, certificates=certificates, infos=(info,)).der())


def _chains() -> Iterator[Case]:
    """Signers that the authority issued, over any number of others, and authorities of every kind."""
    for title, extensions in _fitness():
        yield Case(
            name=f"chain: an enclave with {title}", message=_signed_by(certificate("/a", CA, extensions=extensions))
        )
        named = authority(extensions=extensions)
        yield Case(name=f"chain: the authority with {title}", message=_signed_by(named), trusted=(named,))
        below = certificate("/a", named)
        yield Case(name=f"chain: an enclave of an authority with {title}", message=_signed_by(below), trusted=(named,))
    yield Case(
        name="chain: an enclave with the basic constraint CA", message=_signed_by(certificate("/a", CA, ca=True))
    )
    yield Case(name="chain: an enclave without basic constraints", message=_signed_by(certificate("/a", CA, ca=None)))
    for title, ca in (("CA:FALSE", False), ("no basic constraints", None)):
        named = certificate("sros2CA", ca=ca)
        yield Case(name=f"chain: the authority with {title}", message=_signed_by(named), trusted=(named,))
        yield Case(
            name=f"chain: an enclave of an authority with {title}",
            message=_signed_by(certificate("/a", named)),
            trusted=(named,),
        )
    middle = certificate("middle", CA, ca=True)
    lower = certificate("lower", middle, ca=True)
    below, deep = certificate("/a", middle), certificate("/a", lower)
    by_leaf = certificate("/b", LEAF)
    for title, message, trusted in (
        ("a middle authority", _signed_by(middle), (CA,)),
        ("an enclave below a middle authority that the message brings", _signed_by(below, middle), (CA,)),
        ("an enclave below a middle authority that is not there", _signed_by(below), (CA,)),
        ("an enclave two authorities down, more than the path length", _signed_by(deep, middle, lower), (CA,)),
        ("an enclave that an enclave issued", _signed_by(by_leaf, LEAF), (CA,)),
        ("a middle authority, trusted alone", _signed_by(middle), (middle,)),
        ("an enclave below a middle authority, which is trusted alone", _signed_by(below), (middle,)),
        ("a middle authority, trusted with the root", _signed_by(middle), (middle, CA)),
        ("an enclave below a middle authority, trusted with the root", _signed_by(below), (middle, CA)),
        ("an enclave, trusted itself", _signed_by(LEAF), (LEAF,)),
    ):
        yield Case(name=f"chain: {title}", message=message, trusted=trusted)
    other_key = x509.AuthorityKeyIdentifier(b"another key", None, None)
    yield Case(
        name="chain: an enclave whose authority key identifier names another key",
        message=_signed_by(certificate("/a", named_key(), extensions=[(other_key, False)])),
        trusted=(named_key(),),
    )
    for title, length in (("none", 0), ("one", 1)):
        root = authority("root", length=length)
        below_root = certificate("middle", root, ca=True)
        yield Case(
            name=f"chain: an enclave below a middle authority where the path may hold {title}",
            message=_signed_by(certificate("/a", below_root), below_root),
            trusted=(root,),
        )
    first = _version_1()
    yield Case(name="chain: the authority of version 1", message=_signed_by(first), trusted=(first,))
    below_first = certificate("/a", first)
    yield Case(name="chain: an enclave of an authority of version 1", message=_signed_by(below_first), trusted=(first,))
    renamed = certificate("another name", key=CA.key, ca=True)
    yield Case(
        name="chain: an enclave that the key of the authority signed in another name",
        message=_signed_by(certificate("/a", renamed)),
    )
    yield Case(
        name="chain: an enclave below a middle authority of the keystore",
        message=_signed_by(below),
        known=(middle, below),
    )


@lru_cache(maxsize=1)
def named_key() -> Signed:
    """An authority that says which key it has."""
    key = ec.generate_private_key(ec.SECP256R1())
    return authority(key=key, extensions=[(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False)])


def _version_1() -> Signed:
    """A self-signed certificate of version 1, which has no extensions."""
    (structure,) = parse(CA.der)
    signed, _, signature = structure.children
    del signed.children[0], signed.children[-1]
    signature.octets = b"\0" + sign(CA, signed.encode())
    made = x509.load_der_x509_certificate(structure.encode())
    assert made.version is x509.Version.v1
    return Signed(CA.key, made)


def table(oracle: Oracle) -> Iterator[str]:
    """One line for each case."""
    yield "case\tfound\tours, pinned\tOpenSSL, pinned\tours, chained\tOpenSSL, chained"
    for case in cases():
        columns = compare(oracle, case.message, case.trusted, case.known).columns()
        yield "\t".join((case.name, *columns))


def main() -> None:
    with TemporaryDirectory() as folder:
        oracle = Oracle(compile_oracle(lambda name: shutil.which(name) or name, Path(folder)))
        sys.stdout.writelines(f"{line}\n" for line in table(oracle))
        oracle.stop()


if __name__ == "__main__":
    main()
