"""CMS SignedData byte by byte: one strict reading, and every departure from it next to what OpenSSL does."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Iterator

import pytest
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, padding, rsa, utils
from cryptography.hazmat.primitives.serialization import Encoding
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.keystore.cms import CmsError, read_signed_data
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.der import well_formed
from keystore_audit.keystore.smime import SignedDocument, read_signed
from tests.keystore.builder import Signed, evidence, present
from tests.keystore.messages import taken_apart, with_signature
from tests.oracles.smime.comparison import compare
from tests.oracles.smime.der import (
    DATA,
    ECDSA_SHA256,
    ED25519,
    NULL,
    RSA,
    RSA_PSS,
    SHA256,
    algorithm,
    attribute,
    oid,
    tlv,
)
from tests.oracles.smime.oracle import Oracle, running
from tests.oracles.smime.signed_data import (
    CA,
    CONTENT_TYPE,
    ED_CA,
    ENTITY,
    GOOD,
    MESSAGE,
    MESSAGE_DIGEST,
    RSA_CA,
    SIGNING_TIME,
    Info,
    changed,
    sign,
)


def document(der: bytes, signer: Signed = CA) -> SignedDocument:
    return read_signed(present(with_signature(MESSAGE, der)), [evidence(signer)])


@pytest.fixture(scope="module")
def answers(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Oracle]:
    trusted = CA.pem + RSA_CA.pem + ED_CA.pem
    with running(oracle, tmp_path_factory.mktemp("oracle"), trusted) as running_oracle:
        yield running_oracle


def test_the_builder_builds_what_openssl_builds() -> None:
    assert document(taken_apart(MESSAGE)[1]).defects == document(GOOD.der()).defects == ()


def test_the_signature_over_the_attributes_does_not_pass_for_one_over_a_text() -> None:
    """RFC 5652, 5.4, and the attack on it: signed attributes presented as the content of a message without."""
    covered = tlv(0x31, *sorted((CONTENT_TYPE, SIGNING_TIME, MESSAGE_DIGEST)))
    signature = sign(CA, covered)
    assert document(changed(attributes=None, signature=signature).der()).signatures[0].verified_by == ()
    inside = tlv(0x30, oid(DATA), tlv(0xA0, tlv(4, covered)))
    opaque = replace(GOOD, content=inside, infos=(Info(attributes=None, signature=signature),))
    message = b"Content-Type: application/pkcs7-mime\n\n" + base64.encodebytes(opaque.der())
    read_document = read_signed(present(message), [evidence(CA)])
    assert read_document.signatures[0].verified_by == (evidence(CA),), "as a signature it is one"
    assert read_document.content is None
    assert Kind.NO_TEXT_PLAIN in {defect.kind for defect in read_document.defects}


# --- algorithms


def by_rsa(label: bytes, make: Callable[[Signed, bytes], bytes] = sign) -> bytes:
    return replace(
        GOOD,
        certificates=tlv(0xA0, RSA_CA.certificate.public_bytes(Encoding.DER)),
        infos=(Info(signer=RSA_CA, label=label, make=make),),
    ).der()


def pss(signer: Signed, data: bytes) -> bytes:
    assert isinstance(signer.key, rsa.RSAPrivateKey)
    return signer.key.sign(data, padding.PSS(mgf=padding.MGF1(hashes.SHA256()), salt_length=32), hashes.SHA256())


SHA256_WITH_RSA = "1.2.840.113549.1.1.11"
MGF1 = algorithm("1.2.840.113549.1.1.8", algorithm(SHA256, NULL))
PSS_PARAMETERS = tlv(0x30, tlv(0xA0, algorithm(SHA256, NULL)), tlv(0xA1, MGF1), tlv(0xA2, tlv(2, b"\x20")))
SHA1_MASK = tlv(0x30, tlv(0xA0, algorithm(SHA256, NULL)), tlv(0xA2, tlv(2, b"\x20")))


@pytest.mark.parametrize(
    ("der", "signer", "verified", "kinds"),
    [
        (by_rsa(algorithm(RSA, NULL)), RSA_CA, True, set()),
        (by_rsa(algorithm(RSA)), RSA_CA, True, set()),
        (by_rsa(algorithm(SHA256_WITH_RSA, NULL)), RSA_CA, True, set()),
        (by_rsa(algorithm(RSA_PSS, PSS_PARAMETERS), pss), RSA_CA, False, {Kind.UNSUPPORTED_ALGORITHM}),
        (by_rsa(algorithm(RSA_PSS, PSS_PARAMETERS)), RSA_CA, False, {Kind.UNSUPPORTED_ALGORITHM}),
        (by_rsa(algorithm(RSA_PSS, SHA1_MASK), pss), RSA_CA, False, {Kind.UNSUPPORTED_ALGORITHM}),
        (by_rsa(algorithm(RSA_PSS), pss), RSA_CA, False, {Kind.UNSUPPORTED_ALGORITHM}),
        (by_rsa(algorithm(RSA, NULL), pss), RSA_CA, False, set()),
        (by_rsa(algorithm(ECDSA_SHA256)), RSA_CA, False, {Kind.CMS_MALFORMED}),
        (
            replace(GOOD, certificates=b"", infos=(Info(signer=ED_CA, label=algorithm(ED25519)),)).der(),
            ED_CA,
            True,
            {Kind.UNSUPPORTED_ALGORITHM},
        ),
        (
            replace(GOOD, certificates=b"", infos=(Info(signer=ED_CA, label=algorithm(ECDSA_SHA256)),)).der(),
            ED_CA,
            False,
            {Kind.CMS_MALFORMED},
        ),
    ],
    ids=[
        *("RSA", "RSA, no NULL", "sha256WithRSA", "PSS", "PSS label", "PSS, SHA-1 mask", "PSS, no parameters"),
        *("PSS labelled RSA", "RSA labelled ECDSA", "Ed25519", "Ed25519 labelled ECDSA"),
    ],
)  # fmt: skip
def test_signature_algorithms(der: bytes, signer: Signed, verified: bool, kinds: set[Kind], answers: Oracle) -> None:
    read_document = document(der, signer)
    (signature,) = read_document.signatures
    said = {defect.kind for defect in read_document.defects}
    assert (bool(signature.verified_by), said - {Kind.UNSUPPORTED_ALGORITHM}) == (
        verified,
        kinds - {Kind.UNSUPPORTED_ALGORITHM},
    )
    assert said >= kinds
    contradictions = compare(answers, with_signature(MESSAGE, der), (signer,)).contradictions()
    assert [text for text in contradictions if text.startswith("pinned")] == []


def test_a_digest_that_the_curve_does_not_match_is_still_checked() -> None:
    data = tlv(0x31, *sorted((CONTENT_TYPE, SIGNING_TIME, MESSAGE_DIGEST)))
    prehashed = CA.key.sign(hashlib.sha256(data).digest(), ec.ECDSA(utils.Prehashed(hashes.SHA256())))  # type: ignore[union-attr, call-arg, arg-type]
    assert document(changed(signature=prehashed).der()).signatures[0].verified_by == (evidence(CA),)


# --- reading alone


@pytest.mark.parametrize(
    ("time", "expected"),
    [
        (tlv(0x18, b"20510101000000Z"), "2051-01-01T00:00:00+00:00"),
        (tlv(0x17, b"491231235959Z"), "2049-12-31T23:59:59+00:00"),
        (tlv(0x17, b"241301000000Z"), None),
        (tlv(0x17, b"2401010000Z"), None),
        (tlv(0x18, b"2051"), None),
        (tlv(4, b"x"), None),
    ],
)
def test_the_signing_time_is_a_hint_that_may_be_missing(time: bytes, expected: str | None) -> None:
    signing_time = attribute("1.2.840.113549.1.9.5", time)
    (signer,) = read_signed_data(changed(attributes=(CONTENT_TYPE, MESSAGE_DIGEST, signing_time)).der()).signers
    assert (signer.signing_time and signer.signing_time.isoformat()) == expected


@given(st.binary(max_size=300))
def test_no_bytes_raise_anything_else(der: bytes) -> None:
    with pytest.raises(CmsError):
        read_signed_data(der)


@given(st.integers(0, len(GOOD.der()) - 1), st.integers(0, 255), st.sampled_from(["set", "insert", "delete"]))
def test_no_change_of_a_byte_raises(place: int, value: int, how: str) -> None:
    der = GOOD.der()
    middle = {"set": bytes([value]), "insert": bytes([value]) + der[place : place + 1], "delete": b""}[how]
    read_document = document(der[:place] + middle + der[place + 1 :])
    assert read_document.content == ENTITY[len(b"Content-Type: text/plain\r\n\r\n") :]


@given(st.lists(st.sampled_from([0x00, 0x01, 0x7F, 0x80, 0x81, 0xFF]), max_size=8).map(bytes))
def test_an_identifier_is_well_formed_by_its_subidentifiers(content: bytes) -> None:
    parts, begin = [], 0
    for position, byte in enumerate(content):
        if byte < 0x80:
            parts.append(content[begin : position + 1])
            begin = position + 1
    whole = bool(content) and begin == len(content)
    assert well_formed(0x06, content) == (whole and all(part[0] != 0x80 for part in parts))
