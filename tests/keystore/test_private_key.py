"""Private keys: the public half that OpenSSL sees, and never a byte of the private one."""

from __future__ import annotations

import base64
import pickle
import subprocess
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric import ec, ed448, ed25519, rsa
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.private_key import PrivateKey, read_private_key
from tests.keystore import libcrypto
from tests.keystore.builder import PrivateKey as AnyKey
from tests.keystore.builder import certificate, evidence, present, rsa_key
from tests.keystore.test_certificate import MUTATIONS, mutated

KEYS: dict[str, AnyKey] = {
    "EC secp256r1": ec.generate_private_key(ec.SECP256R1()),
    "EC secp384r1": ec.generate_private_key(ec.SECP384R1()),
    "EC secp256k1": ec.generate_private_key(ec.SECP256K1()),
    "RSA 2048": rsa_key(),
    "RSA 1024": rsa_key(1024),
    "Ed25519": ed25519.Ed25519PrivateKey.generate(),
    "Ed448": ed448.Ed448PrivateKey.generate(),
}
EC = KEYS["EC secp256r1"]


def encoded(key: AnyKey, form: PrivateFormat = PrivateFormat.PKCS8) -> bytes:
    return key.private_bytes(Encoding.PEM, form, NoEncryption())


def read(content: bytes) -> PrivateKey:
    found = read_private_key(present(content, "key.pem"))
    assert found.file.content is None
    return found


def only(content: bytes) -> tuple[Kind, str]:
    """The one defect of a key that cannot be read."""
    found = read(content)
    assert (found.key, found.key_kind) == (None, None)
    (defect,) = found.defects
    return defect.kind, defect.detail


@pytest.mark.parametrize(("kind", "key"), KEYS.items(), ids=KEYS.keys())
def test_the_public_half_is_the_certificate_s(kind: str, key: AnyKey) -> None:
    found = read(encoded(key))
    assert (found.key_kind, found.encrypted, found.defects) == (kind, False, ())
    assert found.key == evidence(certificate("/x", key=key)).key
    assert found.key != evidence(certificate("/x")).key


@pytest.mark.parametrize("kind", ["EC secp256r1", "EC secp384r1", "RSA 2048"])
def test_traditional_forms_are_read(kind: str) -> None:
    found = read(encoded(KEYS[kind], PrivateFormat.TraditionalOpenSSL))
    assert (found.key_kind, found.defects) == (kind, ())
    assert found.key == read(encoded(KEYS[kind])).key


def test_parameters_and_text_before_the_key_are_skipped_as_openssl_does(tmp_path: Path) -> None:
    path = tmp_path / "key.pem"
    subprocess.run(["openssl", "ecparam", "-name", "prime256v1", "-genkey", "-out", path], check=True)
    assert path.read_bytes().startswith(b"-----BEGIN EC PARAMETERS")
    assert read(b"Bag Attributes\n" + path.read_bytes()).key_kind == "EC secp256r1"


def test_the_first_of_several_keys_counts() -> None:
    other = encoded(KEYS["Ed25519"])
    assert read(encoded(EC) + other).key_kind == "EC secp256r1"
    assert read(other + encoded(EC)).key_kind == "Ed25519"


@pytest.mark.parametrize("sealed", [False, True])
def test_further_keys_are_known_by_their_public_halves(sealed: bool) -> None:
    """Behind a key that cannot be read too; what needs a password is somebody's."""
    password = BestAvailableEncryption(b"secret")
    locked = EC.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, password)
    found = read((locked if sealed else encoded(EC)) + encoded(KEYS["Ed25519"]) + locked)
    assert [other.key for other in found.others] == [read(encoded(KEYS["Ed25519"])).key, None]
    assert [each.line for each in found.defects if each.kind is Kind.SECOND_KEY] == [each.line for each in found.others]
    assert found.encrypted is sealed
    assert read(encoded(EC)).others == ()


def test_encrypted_keys_are_said_and_nothing_is_asked() -> None:
    password = BestAvailableEncryption(b"secret")
    modern = EC.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, password)
    old = EC.private_bytes(Encoding.PEM, PrivateFormat.TraditionalOpenSSL, password)
    assert b"Proc-Type: 4,ENCRYPTED" in old
    for content in (modern, old):
        found = read(content)
        assert found.encrypted
        assert [defect.kind for defect in found.defects] == [Kind.KEY_ENCRYPTED]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "found none"),
        (b"\0" * 100, "found none"),
        (b"pkcs11:token=robot;object=talker?pin-value=1234\n", "PKCS #11"),
        (b"  PKCS11:object=talker", "PKCS #11"),
        (EC.private_bytes(Encoding.DER, PrivateFormat.PKCS8, NoEncryption()), "found none"),
        (certificate("/x").pem, "found none"),
        (encoded(EC).replace(b"MI", b"M*"), "not base64"),
        (encoded(EC).replace(b"-----END", b"---END"), "does not end"),
        (b"-----BEGIN PRIVATE KEY-----\nAAAA\n-----END PRIVATE KEY-----\n", "other bytes"),
        (b"-----BEGIN PRIVATE KEY-----\n" + b"A" * 100_000 + b"\n-----END PRIVATE KEY-----\n", "other bytes"),
    ],
)
def test_what_cannot_be_read_is_said_in_words_of_our_own(content: bytes, words: str) -> None:
    kind, detail = only(content)
    assert kind is Kind.KEY_UNREADABLE
    assert words in detail
    assert "1234" not in detail


def test_a_file_that_could_not_be_read_is_a_defect_too() -> None:
    gone = File(path="key.pem", resolved=None, status=Status.UNREADABLE, detail="cannot be read: why")
    found = read_private_key(gone)
    assert [defect.kind for defect in found.defects] == [Kind.KEY_UNREADABLE]
    assert "cannot be read: why" in found.defects[0].detail


@settings(max_examples=400, deadline=None)
@given(
    st.one_of(
        st.binary(max_size=200),
        st.tuples(st.sampled_from(list(KEYS)), MUTATIONS).map(lambda case: mutated(encoded(KEYS[case[0]]), case[1])),
        st.tuples(st.sampled_from(list(KEYS)), MUTATIONS).map(
            lambda case: _pem(
                mutated(KEYS[case[0]].private_bytes(Encoding.DER, PrivateFormat.PKCS8, NoEncryption()), case[1])
            )
        ),
    )
)
def test_any_bytes_have_an_answer_that_openssl_shares(content: bytes) -> None:
    """Where we read a public half, OpenSSL reads the same or nothing; where we do not, there is a defect."""
    found = read(content)
    assert (found.key is None) is bool(found.defects)
    if found.key is not None:
        from cryptography.hazmat.primitives.serialization import load_der_public_key

        from keystore_audit.keystore import public_key

        theirs = libcrypto.load().public_half(content)
        if theirs is not None:
            assert public_key.identity(load_der_public_key(theirs)) == found.key


def _pem(der: bytes) -> bytes:
    return b"-----BEGIN PRIVATE KEY-----\n" + base64.encodebytes(der) + b"-----END PRIVATE KEY-----\n"


def test_no_byte_of_a_key_gets_out() -> None:
    """Not by repr, not by pickling the evidence, not in a defect."""
    for key in KEYS.values():
        whole = encoded(key)
        damaged = whole.replace(b"\n", b"\n ", 2)
        for content in (whole, damaged, whole[:-30], whole + whole):
            found = read(content)
            shown = repr(found).encode() + pickle.dumps(found)
            lines = [line for line in whole.split(b"\n")[1:-2] if len(line) > 8]
            assert lines
            for line in lines:
                assert line[:16] not in shown
                assert base64.b64decode(line[: len(line) // 4 * 4])[:12] not in shown


def test_rsa_keys_are_not_tested_for_primality() -> None:
    """That takes 42 ms a key (facts 3): 1,000 enclaves would take 42 s. So one that is no prime's is read, too."""
    one, two = KEYS["RSA 1024"].private_numbers(), KEYS["RSA 2048"].private_numbers()
    assert isinstance(one, rsa.RSAPrivateNumbers)
    assert isinstance(two, rsa.RSAPrivateNumbers)
    p, q = one.p * one.q, two.p
    d = pow(65537, -1, (one.p - 1) * (one.q - 1) * (q - 1))
    numbers = rsa.RSAPrivateNumbers(
        p, q, d, d % (p - 1), d % (q - 1), pow(q, -1, p), rsa.RSAPublicNumbers(65537, p * q)
    )
    content = encoded(numbers.private_key(unsafe_skip_rsa_key_validation=True))
    assert (read(content).key_kind, read(content).defects) == (f"RSA {(p * q).bit_length()}", ())
    with pytest.raises(ValueError, match="Invalid private key"):
        load_pem_private_key(content, None)
