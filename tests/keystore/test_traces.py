"""Private keys and messages in files that nobody parses, in every form that openssl writes."""

from __future__ import annotations

import base64
import hashlib
import os
import subprocess
from pathlib import Path

import pytest

from keystore_audit.keystore.forms import MAX_HEADS
from keystore_audit.keystore.traces import LEAST, MAX_SEARCHED, look, search

FORMS = {
    "ec": ("genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-256"),
    "ec-explicit": (
        *("genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-256"),
        *("-pkeyopt", "ec_param_enc:explicit"),
    ),
    "rsa": ("genpkey", "-algorithm", "RSA", "-pkeyopt", "rsa_keygen_bits:2048"),
    "rsa-pss": ("genpkey", "-algorithm", "RSA-PSS", "-pkeyopt", "rsa_keygen_bits:2048"),
    "ed25519": ("genpkey", "-algorithm", "ED25519"),
}
OLDER = ("ec", "ec-explicit", "rsa")
"""Those that there are forms older than PKCS #8 for."""
LOCKED = ("-aes-256-cbc", "-passout", "pass:secret")


def holds(content: bytes) -> tuple[bool, bool]:
    """Whether a private key and whether a certificate may be in it."""
    return look(content)[:2]


def openssl(*arguments: str | Path) -> bytes:
    return subprocess.run(["openssl", *arguments], check=True, capture_output=True).stdout


@pytest.fixture(scope="module", params=sorted(FORMS))
def key(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp(request.param) / "key.pem"
    openssl(*FORMS[request.param], "-out", path)
    return path


@pytest.fixture(scope="module")
def certificate(key: Path) -> Path:
    path = key.with_name("cert.pem")
    openssl("req", "-x509", "-new", "-key", key, "-subj", "/CN=e", "-days", "30", "-out", path)
    return path


def test_every_form_of_a_key_is_seen(key: Path, certificate: Path) -> None:
    forms = [openssl("pkey", "-in", key, "-outform", form) for form in ("DER", "PEM")]
    if key.parent.name.rstrip("0123456789") in OLDER:
        forms += [openssl("pkey", "-in", key, "-traditional", "-outform", form) for form in ("DER", "PEM")]
    forms += [openssl("pkcs8", "-topk8", "-in", key, "-outform", form, "-passout", "pass:a") for form in ("DER", "PEM")]
    forms.append(
        openssl("pkcs8", "-topk8", "-in", key, "-outform", "DER", "-passout", "pass:a", "-v1", "PBE-SHA1-3DES")
    )
    forms.append(openssl("pkey", "-in", key, *LOCKED))
    forms.append(openssl("pkcs12", "-export", "-inkey", key, "-in", certificate, "-passout", "pass:a"))
    if key.parent.name.rstrip("0123456789") == "rsa":
        forms += [openssl("rsa", "-in", key, "-outform", *form) for form in (("MSBLOB",), ("PVK", "-pvk-none"))]
    assert [number for number, form in enumerate(forms) if not holds(form)[0]] == []


def test_a_key_is_seen_in_base64_and_in_utf_16(key: Path, certificate: Path) -> None:
    der = [openssl("pkey", "-in", key, "-outform", "DER")]
    pem = [openssl("pkey", "-in", key)]
    if key.parent.name.rstrip("0123456789") in OLDER:
        der.append(openssl("pkey", "-in", key, "-traditional", "-outform", "DER"))
        pem.append(openssl("pkey", "-in", key, "-traditional"))
    der.append(openssl("pkcs8", "-topk8", "-in", key, "-outform", "DER", "-passout", "pass:a"))
    forms = [encoded(each) for each in (*der, *pem) for encoded in (base64.b64encode, base64.encodebytes)]
    forms += [b"%sx\n" % (b"#" * before) + each for before in range(3) for each in pem]
    forms[-3 * len(pem) :] = map(base64.b64encode, forms[-3 * len(pem) :])
    forms += [each.decode().encode(encoding) for each in pem for encoding in ("utf-16", "utf-16-be")]
    assert [number for number, form in enumerate(forms) if not holds(b"KEY=" + form)[0]] == []
    assert [number for number, form in enumerate(forms) if holds(form)[1]] == [], "and no certificate"
    public = openssl("pkey", "-in", key, "-pubout", "-outform", "DER")
    request = openssl("req", "-new", "-key", key, "-subj", "/CN=e", "-outform", "DER")
    other = openssl("x509", "-in", certificate, "-outform", "DER")
    bag = openssl("pkcs12", "-export", "-inkey", key, "-in", certificate, "-passout", "pass:a")
    none, certified = (False, False), (False, True)
    assert [holds(base64.b64encode(each)) for each in (public, request, other)] == [none, none, certified]
    assert holds(base64.b64encode(bag)) == (True, True)
    assert {holds(base64.b64encode(each)[:60] + b"...") for each in (*der, bag, other)} == {none}, "abbreviated"


def test_every_form_of_a_certificate_is_seen(certificate: Path, key: Path) -> None:
    forms = [openssl("x509", "-in", certificate, "-outform", form) for form in ("DER", "PEM")]
    forms.append(openssl("x509", "-in", certificate, "-trustout"))
    bag = ("crl2pkcs7", "-nocrl", "-certfile", certificate, "-outform")
    forms += [openssl(*bag, form) for form in ("DER", "PEM")]
    assert [number for number, form in enumerate(forms) if not holds(form)[1]] == []
    others = [openssl("pkey", "-in", key, *more) for more in ((), ("-outform", "DER"), ("-pubout", "-outform", "DER"))]
    others.append(openssl("req", "-new", "-key", key, "-subj", "/CN=e"))
    assert [number for number, form in enumerate(others) if holds(form)[1]] == []


def loosened(der: bytes) -> bytes:
    """The same with longer lengths than needed, of the whole and of what it begins with, which DER forbids."""
    start = 2 + (der[1] & 0x7F if der[1] & 0x80 else 0)
    end = start + (int.from_bytes(der[2:start], "big") if der[1] & 0x80 else der[1])
    inner = loosened(der[start:end]) if der[0] & 0x20 else der[start:end]
    return der[:1] + b"\x85" + len(inner).to_bytes(5, "big") + inner + der[end:]


def test_what_is_no_der_and_openssl_reads_is_seen(key: Path, certificate: Path, tmp_path: Path) -> None:
    path = tmp_path / "loose"
    bag = ("pkcs12", "-export", "-inkey", key, "-in", certificate, "-passout", "pass:a")
    for made, read in (
        (("pkey", "-in", key, "-outform", "DER"), ("pkey", "-inform", "DER")),
        (("pkcs8", "-topk8", "-in", key, "-outform", "DER", "-passout", "pass:a"), ("pkey", "-passin", "pass:a")),
        (bag, ("pkcs12", "-passin", "pass:a", "-noenc")),
    ):
        path.write_bytes(loosened(openssl(*made)))
        assert b"PRIVATE KEY" in openssl(*read, "-in", path)
        assert holds(path.read_bytes())[0]
    der = openssl("x509", "-in", certificate, "-outform", "DER")
    content = der[4:]  # of more than 255 bytes and less than 64 kB
    for form in (loosened(der), b"0\x80" + content + b"\0\0"):
        path.write_bytes(form)
        assert b"BEGIN CERTIFICATE" in openssl("x509", "-inform", "DER", "-in", path)
        assert holds(form)[1]


def retagged(der: bytes, tag: bytes) -> bytes:
    return tag + der[1:]


def sized(content: bytes) -> bytes:
    return b"\x30\x82" + len(content).to_bytes(2, "big") + content


def content_of(der: bytes) -> bytes:
    return der[2 + (der[1] & 0x7F if der[1] & 0x80 else 0) :]


def test_tags_in_their_long_form_and_other_versions_hide_nothing(key: Path, certificate: Path, tmp_path: Path) -> None:
    path = tmp_path / "loose"
    der = openssl("pkey", "-in", key, "-outform", "DER")
    rest = content_of(der)[3:]  # behind the version
    forms = [retagged(der, b"\x3f\x10"), retagged(der, b"\x3f\x80\x80\x10")]
    forms += [sized(version + rest) for version in (b"\x1f\x02\x01\0", b"\x02\x01\x05", b"\x02\x02\x01\0")]
    if key.parent.name.rstrip("0123456789") == "ec":
        older = content_of(openssl("pkey", "-in", key, "-traditional", "-outform", "DER"))
        size = older[4]
        pieces = bytes([0x24, size + 2]) + older[3 : 5 + size]
        forms += [sized(b"\x02\x01\x05" + older[3:]), sized(older[:3] + pieces + older[5 + size :])]
    for form in forms:
        path.write_bytes(form)
        assert b"PRIVATE KEY" in openssl("pkey", "-inform", "DER", "-in", path)
        assert holds(form)[0]
    bag = openssl("pkcs12", "-export", "-inkey", key, "-in", certificate, "-passout", "pass:a")
    for form in (retagged(bag, b"\x3f\x10"), sized(b"\x1f" + content_of(bag))):
        path.write_bytes(form)
        assert b"PRIVATE KEY" in openssl("pkcs12", "-passin", "pass:a", "-noenc", "-in", path)
        assert holds(form)[0]
    form = retagged(openssl("x509", "-in", certificate, "-outform", "DER"), b"\x3f\x10")
    path.write_bytes(form)
    assert b"BEGIN CERTIFICATE" in openssl("x509", "-inform", "DER", "-in", path)
    assert holds(form)[1]


def test_what_is_no_key_is_none(key: Path, certificate: Path, tmp_path: Path) -> None:
    document = tmp_path / "d.xml"
    document.write_text("<dds/>")
    request = openssl("req", "-new", "-key", key, "-subj", "/CN=e", "-outform", "DER")
    forms = [
        openssl("x509", "-in", certificate, "-outform", "DER"),
        openssl("pkey", "-in", key, "-pubout", "-outform", "DER"),
        openssl("crl2pkcs7", "-nocrl", "-certfile", certificate, "-outform", "DER"),
        request,
        certificate.read_bytes(),
        b"",
        b"0",
        b"0\x80",
        b"0\xff" + bytes(70),
        b"\x3f",
        b"\x3f" + b"\x80" * 5000,
        b"\x3f\x81\x10\x03\x02\x01\0",
        openssl("rsa", "-in", key, "-pubout", "-outform", "MSBLOB") if key.parent.name.startswith("rsa0") else b"",
        openssl("rsa", "-in", key, "-RSAPublicKey_out", "-outform", "DER") if "rsa" in key.parent.name else b"",
        bytes(100),
        b"\x30\x03\x02\x01\x03",
    ]
    assert [number for number, form in enumerate(forms) if holds(form)[0]] == []


def searched(path: Path, content: bytes, most: int = MAX_SEARCHED) -> tuple[tuple[bool, bool], int]:
    path.write_bytes(content)
    descriptor = os.open(path, os.O_RDONLY)
    try:
        traces, length = search(descriptor, most)
    finally:
        os.close(descriptor)
    return (traces.private_key, traces.message), length


MIB = 1024 * 1024
KEY = b"-----BEGIN PRIVATE KEY-----\n"
TYPE = b"Content-Type: Application/X-PKCS7-mime\n"


@pytest.mark.parametrize("before", [0, 1, 5000, MIB - 20, MIB - 1, MIB, 3 * MIB + 17])
def test_a_large_file_is_searched_across_its_pieces(before: int, tmp_path: Path) -> None:
    text = (b"log\n\n" * (before // 5 + 1))[:before]
    for what, found in ((KEY, (True, False)), (TYPE, (False, True)), (b"-----BEGIN PKCS7-----\n", (False, True))):
        content = text + what + b"\n\n" + bytes(2 * MIB)
        assert searched(tmp_path / "large", content) == (found, len(content))
    assert searched(tmp_path / "large", text + b"\n\n" + bytes(2 * MIB))[0] == (False, False)


@pytest.mark.parametrize("before", [1, MIB - 50, 3 * MIB])
def test_other_forms_in_a_large_file_may_hold_anything(before: int, certificate: Path, tmp_path: Path) -> None:
    """Keys and certificates in one are those of an identity that could not be read."""
    path = tmp_path / "large"
    key = openssl("pkey", "-in", certificate.with_name("key.pem"), "-outform", "DER")
    der = openssl("x509", "-in", certificate, "-outform", "DER")
    bag = openssl("crl2pkcs7", "-nocrl", "-certfile", certificate, "-outform", "DER")
    for what, expected in (
        (base64.b64encode(key), (True, False)),
        (base64.b64encode(der), (True, False)),
        (base64.b64encode(bag), (True, True)),
        (base64.b64encode(KEY * 4), (True, False)),
        (base64.b64encode(TYPE * 4), (False, True)),
        (TYPE.decode().encode("utf-16-be"), (False, True)),
        (base64.b64encode(bytes(100)), (False, False)),
    ):
        path.write_bytes(b"x" * (before - 1) + b" " + what + b"\n\n" + bytes(MIB))
        descriptor = os.open(path, os.O_RDONLY)
        try:
            traces = search(descriptor, MAX_SEARCHED)[0]
        finally:
            os.close(descriptor)
        assert (traces.certificate, traces.message) == expected


@pytest.mark.parametrize("form", [b"MI" + b"A" * 46, b"MC4CAQAw" + b"A" * 40])
def test_more_beginnings_in_base64_than_are_looked_at_may_be_anything(form: bytes, tmp_path: Path) -> None:
    for number, found in ((MAX_HEADS - 1, False), (MAX_HEADS, True)):
        path = tmp_path / str(number)
        path.write_bytes(bytes(MIB) + b"\n\n" + (form + b"\n") * number)
        descriptor = os.open(path, os.O_RDONLY)
        try:
            traces = search(descriptor, MAX_SEARCHED)[0]
        finally:
            os.close(descriptor)
        assert (traces.certificate, traces.message) == (found, found)


@pytest.mark.parametrize("before", [0, MIB - 20, 3 * MIB])
def test_certificates_in_a_large_file(before: int, tmp_path: Path) -> None:
    """What was not searched to its end may hold some."""
    path = tmp_path / "large"
    for what, most, expected in (
        (b"-----BEGIN CERTIFICATE-----", MAX_SEARCHED, True),
        (b"-----BEGIN TRUSTED CERTIFICATE-----", MAX_SEARCHED, True),
        (b"-----BEGIN PKCS7-----", MAX_SEARCHED, True),
        (b"-----BEGIN CERTIFICATE REQUEST-----", MAX_SEARCHED, False),
        (b"", MIB, True),
    ):
        path.write_bytes(b"x" * before + what + bytes(MIB))
        descriptor = os.open(path, os.O_RDONLY)
        try:
            assert search(descriptor, most)[0].certificate is (expected and (what != b"" or before > 0))
        finally:
            os.close(descriptor)


def test_what_was_searched_to_its_end_has_a_hash(tmp_path: Path) -> None:
    for length in (0, 1, MIB - 1, MIB, 2 * MIB, 2 * MIB + 1):
        content = b"x" * length
        path = tmp_path / str(length)
        path.write_bytes(content)
        descriptor = os.open(path, os.O_RDONLY)
        try:
            for most, whole in ((2 * MIB, length <= 2 * MIB), (length, True), (length - 1, length <= LEAST)):
                sha256 = hashlib.sha256(content).hexdigest() if whole else None
                assert search(descriptor, most)[0].sha256 == sha256
        finally:
            os.close(descriptor)


def test_behind_what_is_searched_a_header_that_has_not_ended_may_be_one(tmp_path: Path) -> None:
    long_header = b"X: " + b"a" * 2 * LEAST
    assert searched(tmp_path / "f", long_header + b"\n" + TYPE, most=0) == ((False, True), LEAST)
    assert searched(tmp_path / "f", b"X: a\n\n" + long_header + TYPE, most=0) == ((False, False), LEAST)
    assert searched(tmp_path / "f", long_header, most=4 * LEAST) == ((False, False), len(long_header))
