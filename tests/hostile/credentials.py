"""Facts 4.3: certificates, keys and revocation lists that are not what their file's name says."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from typing import Any, Final

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
)

from tests.hostile.store import CERT, KEY, Case, Store, case
from tests.keystore.builder import END, START, PrivateKey, authority, certificate, crl, pem, rsa_key
from tests.oracles.smime.der import parse

CRL: Final = "enclaves/victim/crl.pem"
IDENTITY_CA: Final = "enclaves/victim/identity_ca.cert.pem"
MEDIUM: Final = ("--fail-on", "medium")
LOW: Final = ("--fail-on", "low")

Make = Callable[[Store], bytes]


def file(name: str, content: Make) -> Callable[[Store], None]:
    return lambda store: store.put(name, content(store))


def holding(name: str, path: str, content: Make, code: str, line: int | None = 1, **more: Any) -> Case:
    """The victim's file at `path` holds something else."""
    return case(name, file(path.rpartition("/")[2], content), code, path, line=line, **more)


def issued(**others: Any) -> Callable[[Store], None]:
    """The victim has another certificate, with the key that belongs to it."""

    return lambda store: store.identify(certificate("/victim", store.base.identity, **others))


def keyed(key: PrivateKey) -> Callable[[Store], None]:
    return issued(key=key)


def der(store: Store) -> bytes:
    return store.base.victim.der


def with_serial(store: Store, serial: bytes) -> bytes:
    """The victim's certificate with another serial number; its signature is then of another certificate."""
    number = store.base.victim.certificate.serial_number
    old = number.to_bytes(number.bit_length() // 8 + 1, "big")
    whole = der(store)
    old, new = b"\x02" + bytes([len(old)]) + old, b"\x02" + bytes([len(serial)]) + serial
    assert whole.count(old) == 1
    grown = len(new) - len(old)
    body = whole.replace(old, new)
    outer, inner = (int.from_bytes(whole[i + 2 : i + 4], "big") + grown for i in (0, 4))
    return body[:2] + outer.to_bytes(2, "big") + body[4:6] + inner.to_bytes(2, "big") + body[8:]


def encrypted(store: Store) -> bytes:
    key = store.base.victim.key
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"password"))


def encrypted_traditional(store: Store) -> bytes:
    key = store.base.victim.key
    return key.private_bytes(Encoding.PEM, PrivateFormat.TraditionalOpenSSL, BestAvailableEncryption(b"password"))


def key_der(store: Store) -> bytes:
    return store.base.victim.key.private_bytes(Encoding.DER, PrivateFormat.PKCS8, NoEncryption())


def _unreadable_dates(store: Store) -> bytes:
    """Digits of a date that are none, in a certificate that is whole otherwise."""
    return pem(re.sub(rb"\x17\r\d{12}Z", b"\x17\r991332256199Z", der(store), count=1))


def _chmod(store: Store) -> None:
    (store.victim / "key.pem").chmod(0o644)


def _authority_key(store: Store) -> None:
    private = store.root / "private"
    private.mkdir()
    (private / "permissions_ca.key.pem").write_bytes(store.base.permissions.key_pem)


def _authority_key_in_public(store: Store) -> None:
    (store.root / "public/ca.key.pem").write_bytes(store.base.identity.key_pem)


def _same_key(store: Store) -> None:
    """The victim has a certificate of its own for the bystander's key."""
    store.identify(certificate("/victim", store.base.identity, key=store.base.bystander.key))


def _same_certificate(store: Store) -> None:
    store.identify(store.base.bystander)


def _stranger(store: Store) -> None:
    store.identify(certificate("/victim", authority(store.base.identity.certificate.subject)))


def _revoking(store: Store, **others: Any) -> bytes:
    return crl(store.base.identity, [store.base.victim.certificate.serial_number], **others).public_bytes(Encoding.PEM)


def _of_a_namesake(store: Store) -> bytes:
    return crl(authority(store.base.identity.certificate.subject)).public_bytes(Encoding.PEM)


def _many(store: Store) -> bytes:
    return crl(store.base.identity, range(1, 5_000)).public_bytes(Encoding.PEM)


def _long_list(store: Store) -> bytes:
    """The same entry over and over, so that the signature is wrong and all of it has to be hashed."""
    (tree,) = parse(crl(store.base.identity, [1]).public_bytes(Encoding.DER))
    entries = next(each for each in tree.children[0].children if each.tag == 0x30 and each.children[0].tag == 0x30)
    entries.children *= 60_000
    return pem(tree.encode(), "X509 CRL")


def _address(store: Store) -> None:
    """A PKCS #11 address with a PIN beside the key."""
    (store.victim / "key.p11").write_bytes(b"pkcs11:object=key;pin-value=CANARY-PIN-771?pin-value=CANARY-PIN-771\n")


FOREVER: Final = datetime(9999, 12, 31, 23, 59, 59, tzinfo=timezone.utc)
"""What RFC 5280, 4.1.2.5, has for certificates without an end."""

UNKNOWN: Final = x509.UnrecognizedExtension(x509.ObjectIdentifier("1.2.3.4"), b"\x05\x00")
JUNK: Final = bytes(range(256)) * 8

CERTIFICATES: Final = (
    holding(
        "two certificates in one file",
        CERT,
        lambda s: s.base.victim.pem + s.base.bystander.pem,
        "KA202",
        line=10,
        exit=1,
        options=MEDIUM,
    ),
    holding(
        "text around the certificate", CERT, lambda s: b"<dds/>\n" + s.base.victim.pem, "KA202", exit=1, options=MEDIUM
    ),
    holding(
        "a private key beside the certificate",
        CERT,
        lambda s: s.base.victim.pem + s.base.victim.key_pem,
        "KA202",
        line=10,
        exit=1,
        options=MEDIUM,
    ),
    holding("a certificate in DER", CERT, der, "KA201", line=None),
    holding("a certificate under another label", CERT, lambda s: pem(der(s), "TRUSTED CERTIFICATE"), "KA201"),
    holding("a key where the certificate belongs", CERT, lambda s: s.base.victim.key_pem, "KA201", line=None),
    holding("an empty certificate", CERT, lambda _: b"", "KA201", line=None),
    holding("a certificate of random bytes", CERT, lambda _: pem(JUNK), "KA201"),
    holding("a certificate file of NULs", CERT, lambda _: b"\0" * (1 << 20), "KA201", line=None),
    holding("a certificate that never ends", CERT, lambda s: s.base.victim.pem[:-30], "KA201"),
    holding("a certificate with bytes behind it", CERT, lambda s: pem(der(s) + b"\0"), "KA201"),
    holding(
        "a certificate whose length says 2^31",
        CERT,
        lambda _: pem(b"\x30\x84\x7f\xff\xff\xff" + JUNK),
        "KA201",
    ),
    holding("a certificate of 100,000 levels", CERT, lambda _: pem(b"\x30\x80" * 100_000), "KA201"),
    holding(
        "100,000 PEM blocks",
        CERT,
        lambda s: s.base.victim.pem + b"-----BEGIN X-----\n-----END X-----\n" * 100_000,
        "KA202",
        line=10,
        exit=1,
        options=MEDIUM,
    ),
    holding("a million begins of a PEM block", CERT, lambda _: b"-----BEGIN CERTIFICATE-----\n" * 140_000, "KA201"),
    holding(
        "3 MB of text around the certificate",
        CERT,
        lambda s: b"x" * (3 << 20) + b"\n" + s.base.victim.pem,
        "KA202",
        exit=1,
        options=MEDIUM,
    ),
    holding(
        "an authority that is text",
        IDENTITY_CA,
        lambda _: b"-----BEGIN CERTIFICATE-----\n\x1b]0;x\x07\n-----END CERTIFICATE-----\n",
        "KA201",
        bystander_changes=True,
    ),
    holding("dates that are none", CERT, _unreadable_dates, "KA201"),
    holding("a negative serial number", CERT, lambda s: pem(with_serial(s, b"\xff\x01")), "KA201"),
    holding("a serial number of 40 octets", CERT, lambda s: pem(with_serial(s, b"\x01" * 40)), "KA201"),
    holding("a serial number of nothing", CERT, lambda s: pem(with_serial(s, b"")), "KA201"),
    case("dates that are reversed", issued(start=END, end=END + timedelta(1)), "KA204", CERT, line=1, exit=1),
    case(
        "dates before 1970",
        issued(start=datetime(1950, 1, 1, tzinfo=timezone.utc), end=datetime(1969, 1, 1, tzinfo=timezone.utc)),
        "KA203",
        CERT,
        line=1,
        exit=1,
    ),
    case("dates until the end of 9999", issued(start=START, end=FOREVER), "KA206", CERT, line=1, exit=1, options=LOW),
    case("a critical extension that nobody knows", issued(extensions=[(UNKNOWN, True)]), "KA221", CERT, line=1, exit=1),
    case("a certificate of somebody with the CA's name", _stranger, "KA207", CERT, line=1, exit=1),
    case("the key of the other enclave", _same_key, "KA219", CERT, line=1, exit=1, bystander_changes=True),
    case(
        "the certificate of the other enclave", _same_certificate, "KA219", CERT, line=1, exit=1, bystander_changes=True
    ),
    case("a serial number of 20 octets and a bit", issued(serial=(1 << 159) - 1), exit=0),
)

KEYS: Final = (
    holding(
        "a key of another certificate",
        KEY,
        lambda s: s.base.bystander.key_pem,
        "KA209",
        line=None,
        exit=1,
        bystander_changes=True,
    ),
    holding("a key with a password", KEY, encrypted, "KA211", exit=1),
    holding("a traditional key with a password", KEY, encrypted_traditional, "KA211", exit=1),
    holding("a key in DER", KEY, key_der, "KA210"),
    holding("a key under another label", KEY, lambda s: pem(key_der(s)[26:], "RSA PRIVATE KEY"), "KA210"),
    holding("a certificate where the key belongs", KEY, lambda s: s.base.victim.pem, "KA210"),
    holding("a key that never ends", KEY, lambda s: s.base.victim.key_pem[:-20], "KA210"),
    holding("a key cut off inside", KEY, lambda s: pem(key_der(s)[:60], "PRIVATE KEY"), "KA210"),
    holding("a key of nothing", KEY, lambda _: pem(b"", "PRIVATE KEY"), "KA210"),
    holding("a key of 3 MB", KEY, lambda _: pem(b"\x30\x83\x2d\xc6\xc0" + b"\0" * 3_000_000, "PRIVATE KEY"), "KA210"),
    holding(
        "an RSA key of 0",
        KEY,
        lambda _: pem(b"\x30\x1b" + b"\x02\x01\x00" * 9, "RSA PRIVATE KEY"),
        "KA209",
        line=None,
        exit=1,
    ),
    holding(
        "a PKCS #11 address where the key belongs",
        KEY,
        lambda _: b"pkcs11:pin-value=CANARY-PIN-771\n",
        "KA210",
        secrets=(b"CANARY-PIN-771",),
    ),
    case(
        "a PKCS #11 address beside the key", _address, "KA111", "enclaves/victim/key.p11", secrets=(b"CANARY-PIN-771",)
    ),
    case("a key that everybody can read", _chmod, "KA108", KEY, exit=1, options=MEDIUM),
    case(
        "an authority's key in the tree",
        _authority_key,
        "KA109",
        "private/permissions_ca.key.pem",
        exit=1,
        options=("--deployed",),
    ),
    case(
        "an authority's key in public/",
        _authority_key_in_public,
        "KA118",
        "public/ca.key.pem",
        exit=1,
        options=("--deployed",),
    ),
    case("Ed25519", keyed(ed25519.Ed25519PrivateKey.generate()), "KA217", CERT, line=1, exit=1, options=MEDIUM),
    case("P-384", keyed(ec.generate_private_key(ec.SECP384R1())), "KA217", CERT, line=1, exit=1, options=MEDIUM),
    case("RSA of 3,072 bits", keyed(rsa_key(3072)), "KA217", CERT, line=1, exit=1, options=MEDIUM),
    case("RSA of 1,024 bits", keyed(rsa_key(1024)), "KA216", CERT, line=1, exit=1),
)

LISTS: Final = tuple(
    holding(f"a list {what}", CRL, make, code, **{"exit": 1, "bystander_changes": True, **more})
    for what, make, code, more in (
        ("that revokes the enclave", _revoking, "KA212", {}),
        ("that is random", lambda _: pem(JUNK, "X509 CRL"), "KA213", {"exit": 4}),
        ("that is empty", lambda _: b"", "KA213", {"exit": 4, "line": None}),
        ("of somebody with the CA's name", _of_a_namesake, "KA213", {}),
        ("that is stale", lambda s: _revoking(s, end=START + timedelta(1)), "KA214", {}),
        ("that is never stale", lambda s: _revoking(s, end=FOREVER), "KA212", {}),
        ("of 3 MB", _long_list, "KA213", {}),
        ("of 5,000 serial numbers", _many, "KA215", {"line": None, "options": MEDIUM}),
    )
)

CASES: Final = CERTIFICATES + KEYS + LISTS
