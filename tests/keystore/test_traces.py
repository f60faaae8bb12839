"""What the bytes of a file tell: read as OpenSSL's own parsers read PEM and DER, and searched for nothing else."""

from __future__ import annotations

import base64
import hashlib
import os
import subprocess
from pathlib import Path

import pytest

from keystore_audit.keystore.traces import MAX_HASHED, Traces, look, search

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


def test_keys_are_seen_in_pem_and_der(key: Path) -> None:
    forms = [openssl("pkey", "-in", key, "-outform", form) for form in ("DER", "PEM")]
    if key.parent.name.rstrip("0123456789") in OLDER:
        forms += [openssl("pkey", "-in", key, "-traditional", "-outform", form) for form in ("DER", "PEM")]
    forms += [
        openssl("pkey", "-in", key, *LOCKED),
        b"key: |\n" + b"".join(b"  " + x for x in forms[1].splitlines(True)),
    ]
    assert [number for number, form in enumerate(forms) if not holds(form)[0]] == []
    assert [number for number, form in enumerate(forms) if look(form).opaque] == [], "all of it was read"


def test_certificates_are_seen_in_pem_and_der(certificate: Path, key: Path) -> None:
    forms = [openssl("x509", "-in", certificate, "-outform", form) for form in ("DER", "PEM")]
    forms.append(openssl("x509", "-in", certificate, "-trustout"))
    forms.append(openssl("crl2pkcs7", "-nocrl", "-certfile", certificate, "-outform", "PEM"))
    assert [number for number, form in enumerate(forms) if not holds(form)[1]] == []
    others = [openssl("pkey", "-in", key, *more) for more in ((), ("-outform", "DER"), ("-pubout", "-outform", "DER"))]
    others.append(openssl("req", "-new", "-key", key, "-subj", "/CN=e"))
    assert [number for number, form in enumerate(others) if holds(form)[1]] == []


def test_other_forms_are_not_searched_for_and_were_not_read(key: Path, certificate: Path) -> None:
    pem, der = openssl("pkey", "-in", key), openssl("pkey", "-in", key, "-outform", "DER")
    bag = openssl("pkcs12", "-export", "-inkey", key, "-in", certificate, "-passout", "pass:a")
    forms = [
        *(base64.b64encode(pem), base64.encodebytes(pem), b"key: " + base64.b64encode(der)),
        *(pem.decode().encode(encoding) for encoding in ("utf-16", "utf-16-be")),
        *(bag, base64.b64encode(bag)),
        openssl("pkcs8", "-topk8", "-in", key, "-outform", "DER", "-passout", "pass:a"),
        openssl("x509", "-in", certificate, "-outform", "DER") + der,
        openssl("crl2pkcs7", "-nocrl", "-certfile", certificate, "-outform", "DER"),
        b"PK\x03\x04" + bytes(90),
        "caf\u00e9".encode("latin-1"),
    ]
    assert [number for number, form in enumerate(forms) if not look(form).opaque] == []
    assert [number for number, form in enumerate(forms) if holds(form)[0]] == []


def test_plain_text_was_read(key: Path, certificate: Path) -> None:
    forms = [
        b"",
        "Gr\u00fc\u00dfe, and a path /usr/share/ros/foxy.\n".encode(),
        b"0" * 100,
        b"%s  cert.pem\n" % hashlib.sha256(b"").hexdigest().encode(),
        openssl("req", "-new", "-key", key, "-subj", "/CN=e"),
        openssl("pkey", "-in", key, "-pubout"),
        openssl("x509", "-in", certificate, "-text"),
    ]
    assert [number for number, form in enumerate(forms) if look(form).opaque] == []


PLACEHOLDERS = (
    b"A key begins with -----BEGIN PRIVATE KEY----- and is secret.\n",
    b"```\n-----BEGIN PRIVATE KEY-----\n...\n-----END PRIVATE KEY-----\n```\n",
    b"-----BEGIN PRIVATE KEY-----\nMIGHAgEAMBMGByqGSM49...\n-----END PRIVATE KEY-----\n",
    b"-----BEGIN PRIVATE KEY-----\nYOUR KEY GOES HERE\n-----END PRIVATE KEY-----\n",
    b"-----BEGIN CERTIFICATE-----\nMIIB\n-----END CERTIFICATE-----\n",
    b"Look for a line `Content-Type: multipart/signed`.\n\nContent-Type: multipart/signed\n\nbase64 follows here.\n",
    b"\nMIME-Version: 1.0\nContent-Type: multipart/signed; boundary=x\n\n--x\n<dds/>\n--x\nMIIC...\n--x--\n",
)


@pytest.mark.parametrize("text", PLACEHOLDERS)
def test_a_text_that_quotes_a_mark_holds_nothing(text: bytes) -> None:
    traces = look(text)
    assert (traces.holds_private_key, traces.holds_certificates, traces.concealed, traces.opaque) == (
        False,
        False,
        "",
        "",
    )


def test_what_only_looks_like_der_is_none(key: Path) -> None:
    public = openssl("pkey", "-in", key, "-pubout", "-outform", "DER")
    forms = [
        public,
        b"0",
        b"0\x80",
        b"0\xff" + bytes(70),
        b"\x3f" + b"\x80" * 5000,
        b"\x30\x03\x02\x01\x03",
        bytes(100),
    ]
    assert {holds(form) for form in forms} == {(False, False)}


MIB = 1024 * 1024


def searched(path: Path, content: bytes, most: int = MAX_HASHED) -> tuple[Traces, int]:
    path.write_bytes(content)
    descriptor = os.open(path, os.O_RDONLY)
    try:
        return search(descriptor, most)
    finally:
        os.close(descriptor)


@pytest.mark.parametrize("before", [0, 1, 5000, MIB - 20, MIB - 1, MIB, 3 * MIB + 17])
def test_marks_in_a_large_file_are_seen_across_its_pieces(before: int, tmp_path: Path) -> None:
    text = (b"log\n\n" * (before // 5 + 1))[:before]
    for mark, expected in (
        (b"-----BEGIN PRIVATE KEY-----", (True, False)),
        (b"-----BEGIN TRUSTED CERTIFICATE-----", (True, False)),
        (b"Content-Type: Application/X-PKCS7-mime", (False, True)),
        (b"-----BEGIN PKCS7-----", (True, True)),
        (b"-----BEGIN CERTIFICATE REQUEST-----", (False, False)),
        (b"", (False, False)),
    ):
        content = text + mark + b"\n" + bytes(MIB)
        traces, length = searched(tmp_path / "large", content)
        assert (traces.holds_certificates, traces.may_be_message) == expected
        assert (traces.sha256, length) == (hashlib.sha256(content).hexdigest(), len(content))


def test_what_is_larger_than_is_hashed_is_not_looked_at(tmp_path: Path) -> None:
    content = b"-----BEGIN PRIVATE KEY-----" + bytes(MIB)
    assert searched(tmp_path / "f", content, len(content) - 1) == (Traces(False, False, False, None), 0)
    assert searched(tmp_path / "f", content, len(content))[0].sha256 is not None
