"""CMS SignedData byte by byte: one strict reading, and every departure from it next to what OpenSSL does."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import pytest
from cryptography import x509
from cryptography.hazmat import asn1
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, padding, rsa, utils
from cryptography.hazmat.primitives.serialization import Encoding
from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.keystore.cms import MAX_EMBEDDED, MAX_SIGNERS, CmsError, read_signed_data
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.smime import SignedDocument, read_signed
from keystore_audit.model.trust import Verdict, document_verdict
from tests.keystore.builder import GOVERNANCE, Signed, authority, certificate, crl, evidence, present, read
from tests.keystore.messages import by_openssl, taken_apart, with_signature
from tests.keystore.smime_oracle import Oracle, disagreement, running

CA = authority()
RSA_CA = authority(key=rsa.generate_private_key(65537, 2048))
ED_CA = authority(key=ed25519.Ed25519PrivateKey.generate())
LEAF = certificate("/talker", CA)
ENTITY = b"Content-Type: text/plain\r\n\r\n" + GOVERNANCE.replace(b"\n", b"\r\n")
MESSAGE = by_openssl(("smime", "-text"), CA)


# --- DER by hand: what no library would write


def tlv(tag: int, *contents: bytes) -> bytes:
    content = b"".join(contents)
    length = len(content)
    if length < 0x80:
        return bytes((tag, length)) + content
    size = (length.bit_length() + 7) // 8
    return bytes((tag, 0x80 | size)) + length.to_bytes(size, "big") + content


def oid(dotted: str) -> bytes:
    return asn1.encode_der(x509.ObjectIdentifier(dotted))


def integer(number: int) -> bytes:
    return tlv(2, number.to_bytes(number.bit_length() // 8 + 1, "big"))


def algorithm(dotted: str, *parameters: bytes) -> bytes:
    return tlv(0x30, oid(dotted), *parameters)


def attribute(dotted: str, *values: bytes) -> bytes:
    return tlv(0x30, oid(dotted), tlv(0x31, *values))


SHA256, SHA1, SHA512 = "2.16.840.1.101.3.4.2.1", "1.3.14.3.2.26", "2.16.840.1.101.3.4.2.3"
SIGNED_DATA, DATA = "1.2.840.113549.1.7.2", "1.2.840.113549.1.7.1"
ECDSA_SHA256, ECDSA_SHA384 = "1.2.840.10045.4.3.2", "1.2.840.10045.4.3.3"
RSA, RSA_PSS, ED25519 = "1.2.840.113549.1.1.1", "1.2.840.113549.1.1.10", "1.3.101.112"
NULL = b"\x05\x00"
CONTENT_TYPE = attribute("1.2.840.113549.1.9.3", oid(DATA))
MESSAGE_DIGEST = attribute("1.2.840.113549.1.9.4", tlv(4, hashlib.sha256(ENTITY).digest()))
OTHER_DIGEST = attribute("1.2.840.113549.1.9.4", tlv(4, hashlib.sha256(b"evil").digest()))
SIGNING_TIME = attribute("1.2.840.113549.1.9.5", tlv(0x17, b"240101000000Z"))


def sign(signer: Signed, data: bytes) -> bytes:
    key = signer.key
    if isinstance(key, ec.EllipticCurvePrivateKey):
        return key.sign(data, ec.ECDSA(hashes.SHA256()))
    if isinstance(key, rsa.RSAPrivateKey):
        return key.sign(data, padding.PKCS1v15(), hashes.SHA256())
    return key.sign(data)


@dataclass(frozen=True, kw_only=True)
class Info:
    """A SignerInfo; `attributes` as they stand in it, `order` as they are signed."""

    signer: Signed = CA
    version: bytes = tlv(2, b"\x01")
    identifier: bytes | None = None
    digest: bytes = algorithm(SHA256, NULL)
    attributes: tuple[bytes, ...] | None = (CONTENT_TYPE, SIGNING_TIME, MESSAGE_DIGEST)
    sort: bool = True
    label: bytes = algorithm(ECDSA_SHA256)
    signature: bytes | None = None
    make: Callable[[Signed, bytes], bytes] = sign
    unsigned: bytes = b""

    def der(self) -> bytes:
        certificate = self.signer.certificate
        name = tlv(0x30, certificate.issuer.public_bytes(), integer(certificate.serial_number))
        attributes = self.attributes
        if attributes is not None and self.sort:
            attributes = tuple(sorted(attributes))
        covered = ENTITY if attributes is None else tlv(0x31, *attributes)
        signature = self.signature if self.signature is not None else self.make(self.signer, covered)
        return tlv(
            0x30,
            self.version,
            self.identifier or name,
            self.digest,
            b"" if attributes is None else tlv(0xA0, *attributes),
            self.label,
            tlv(4, signature),
            self.unsigned,
        )


@dataclass(frozen=True, kw_only=True)
class Cms:
    """A ContentInfo with a SignedData."""

    type: str = SIGNED_DATA
    version: bytes = tlv(2, b"\x01")
    digests: tuple[bytes, ...] = (algorithm(SHA256, NULL),)
    content: bytes = tlv(0x30, oid(DATA))
    certificates: bytes = field(default_factory=lambda: tlv(0xA0, CA.certificate.public_bytes(Encoding.DER)))
    crls: bytes = b""
    infos: tuple[bytes | Info, ...] = (Info(),)
    trailing: bytes = b""

    def der(self) -> bytes:
        infos = [info.der() if isinstance(info, Info) else info for info in self.infos]
        data = tlv(
            0x30,
            self.version,
            tlv(0x31, *self.digests),
            self.content,
            self.certificates,
            self.crls,
            tlv(0x31, *infos),
        )
        return tlv(0x30, oid(self.type), tlv(0xA0, data)) + self.trailing


GOOD = Cms()


def changed(**info: object) -> Cms:
    """The good message with another SignerInfo."""
    return replace(GOOD, infos=(replace(Info(), **info),))  # type: ignore[arg-type]


def indefinite(der: bytes) -> bytes:
    """The outermost element with an indefinite length (BER)."""
    return b"\x30\x80" + der[4:] + b"\x00\x00"


def padded(der: bytes) -> bytes:
    """The outermost length in a byte more than needed (BER)."""
    return b"\x30\x83\x00" + der[2:]


KEY_IDENTIFIER = tlv(0x80, b"\x01" * 20)
BY_RSA = Info(signer=RSA_CA, label=algorithm(RSA, NULL))
TWO_INFOS = tuple(sorted((Info().der(), Info(signer=LEAF).der())))
MALFORMED, NOT_DER = {Kind.CMS_MALFORMED}, {Kind.CMS_NOT_DER}

CRAFTED: dict[str, tuple[bytes, set[Kind]]] = {
    # Read without a word:
    "good": (GOOD.der(), set()),
    "digest algorithm without NULL": (
        replace(changed(digest=algorithm(SHA256)), digests=(algorithm(SHA256),)).der(),
        set(),
    ),
    "one with NULL, one without": (changed(digest=algorithm(SHA256)).der(), set()),
    "more digest algorithms than needed": (
        replace(GOOD, digests=tuple(sorted((algorithm(SHA256, NULL), algorithm(SHA512, NULL))))).der(),
        set(),
    ),
    "no signing time": (changed(attributes=(CONTENT_TYPE, MESSAGE_DIGEST)).der(), set()),
    "an attribute of nobody's": (
        changed(attributes=(CONTENT_TYPE, MESSAGE_DIGEST, attribute("1.2.3.4", NULL))).der(),
        set(),
    ),
    "signing time that is none": (
        changed(attributes=(CONTENT_TYPE, MESSAGE_DIGEST, attribute("1.2.840.113549.1.9.5", NULL))).der(),
        set(),
    ),
    "no certificates": (replace(GOOD, certificates=b"").der(), set()),
    "two certificates out of order": (
        replace(
            GOOD,
            certificates=tlv(
                0xA0, *sorted((s.certificate.public_bytes(Encoding.DER) for s in (CA, LEAF)), reverse=True)
            ),
        ).der(),
        set(),
    ),
    # Said, and read:
    "no attributes": (changed(attributes=None).der(), {Kind.NO_SIGNED_ATTRIBUTES}),
    "other digest in the attributes": (
        changed(attributes=(CONTENT_TYPE, OTHER_DIGEST)).der(),
        {Kind.DIGEST_MISMATCH},
    ),
    "two signers": (replace(GOOD, infos=TWO_INFOS).der(), {Kind.SEVERAL_SIGNERS}),
    "signature of nobody": (changed(signature=b"\x00" * 70).der(), set()),
    "empty signature": (changed(signature=b"").der(), set()),
    "signed by another key": (changed(make=lambda _, data: sign(LEAF, data)).der(), set()),
    "other serial number": (
        changed(identifier=tlv(0x30, CA.certificate.issuer.public_bytes(), b"\x02\x01\x05")).der(),
        set(),
    ),
    "no attributes, signed another text": (
        changed(attributes=None, make=lambda signer, _: sign(signer, b"x")).der(),
        {Kind.NO_SIGNED_ATTRIBUTES},
    ),
    # Refused by every run time:
    "no signer": (replace(GOOD, infos=()).der(), {Kind.NO_SIGNER}),
    "certificates alone": (replace(GOOD, infos=(), digests=()).der(), {Kind.NO_SIGNER}),
    "data": (tlv(0x30, oid(DATA), tlv(0xA0, tlv(4, b"x"))), {Kind.NO_SIGNER}),
    "enveloped data": (replace(GOOD, type="1.2.840.113549.1.7.3").der(), {Kind.NO_SIGNER}),
    # Not ours to interpret:
    "bytes behind": (replace(GOOD, trailing=b"\x00").der(), NOT_DER),
    "structure behind": (replace(GOOD, trailing=GOOD.der()).der(), NOT_DER),
    "indefinite length": (indefinite(GOOD.der()), NOT_DER),
    "length in more bytes than needed": (padded(GOOD.der()), NOT_DER),
    "text inside too": (
        replace(GOOD, content=tlv(0x30, oid(DATA), tlv(0xA0, tlv(4, b"evil")))).der(),
        {Kind.TWO_CONTENTS},
    ),
    "digest algorithms empty": (replace(GOOD, digests=()).der(), MALFORMED),
    "digest algorithms without the one": (replace(GOOD, digests=(algorithm(SHA512, NULL),)).der(), MALFORMED),
    "digest algorithms with parameters": (
        replace(GOOD, digests=(algorithm(SHA256, tlv(4, b"x")),)).der(),
        MALFORMED,
    ),
    "digest algorithm with parameters": (changed(digest=algorithm(SHA256, tlv(4, b"x"))).der(), MALFORMED),
    "digest algorithm is no algorithm": (changed(digest=tlv(4, b"x")).der(), MALFORMED),
    "version 3": (replace(GOOD, version=tlv(2, b"\x03")).der(), MALFORMED),
    "signer of version 3": (changed(version=tlv(2, b"\x03")).der(), MALFORMED),
    "signer by key identifier": (changed(identifier=KEY_IDENTIFIER, version=tlv(2, b"\x03")).der(), MALFORMED),
    "content of another type": (replace(GOOD, content=tlv(0x30, oid("1.2.3.4"))).der(), MALFORMED),
    "revocation lists": (
        replace(GOOD, crls=tlv(0xA1, crl(CA).public_bytes(Encoding.DER))).der(),
        MALFORMED,
    ),
    "a certificate that is none": (replace(GOOD, certificates=tlv(0xA0, tlv(0x30, NULL))).der(), MALFORMED),
    "a certificate whose name is no string": (
        replace(
            GOOD,
            certificates=tlv(
                0xA0, CA.certificate.public_bytes(Encoding.DER).replace(b"\x0c\x07sros2CA", b"\x04\x07sros2CA")
            ),
        ).der(),
        MALFORMED,
    ),
    "no content type": (changed(attributes=(MESSAGE_DIGEST,)).der(), MALFORMED),
    "content type of another type": (
        changed(attributes=(attribute("1.2.840.113549.1.9.3", oid("1.2.3.4")), MESSAGE_DIGEST)).der(),
        MALFORMED,
    ),
    "content type twice": (changed(attributes=(CONTENT_TYPE, CONTENT_TYPE, MESSAGE_DIGEST)).der(), MALFORMED),
    "no message digest": (changed(attributes=(CONTENT_TYPE,)).der(), MALFORMED),
    "message digest twice, the good one first": (
        changed(attributes=(CONTENT_TYPE, MESSAGE_DIGEST, OTHER_DIGEST), sort=False).der(),
        MALFORMED,
    ),
    "message digest twice, the good one last": (
        changed(attributes=(CONTENT_TYPE, OTHER_DIGEST, MESSAGE_DIGEST), sort=False).der(),
        MALFORMED,
    ),
    "message digest with two values": (
        changed(
            attributes=(
                CONTENT_TYPE,
                attribute(
                    "1.2.840.113549.1.9.4",
                    *sorted(tlv(4, hashlib.sha256(text).digest()) for text in (ENTITY, b"evil")),
                ),
            )
        ).der(),
        MALFORMED,
    ),
    "message digest that is no octet string": (
        changed(attributes=(CONTENT_TYPE, attribute("1.2.840.113549.1.9.4", NULL))).der(),
        MALFORMED,
    ),
    "attributes out of order": (
        changed(attributes=(MESSAGE_DIGEST, SIGNING_TIME, CONTENT_TYPE), sort=False).der(),
        MALFORMED,
    ),
    "empty attributes": (changed(attributes=(), make=lambda signer, _: sign(signer, ENTITY)).der(), MALFORMED),
    "signers out of order": (
        replace(GOOD, infos=tuple(sorted((Info().der(), BY_RSA.der()), reverse=True))).der(),
        MALFORMED,
    ),
    "unsigned attributes": (changed(unsigned=tlv(0xA1, attribute("1.2.3.4", NULL))).der(), MALFORMED),
    "label of another digest": (changed(label=algorithm(ECDSA_SHA384)).der(), MALFORMED),
    "label of another key": (changed(label=algorithm(RSA, NULL)).der(), MALFORMED),
    "label with parameters": (changed(label=algorithm(ECDSA_SHA256, tlv(4, b"x"))).der(), MALFORMED),
    "label of nothing known": (changed(label=algorithm("1.2.3.4")).der(), {Kind.UNSUPPORTED_ALGORITHM}),
    "digest of nothing known": (
        changed(digest=algorithm("1.2.3.4"), label=algorithm(ECDSA_SHA256)).der(),
        {Kind.UNSUPPORTED_ALGORITHM, Kind.CMS_MALFORMED},
    ),
    "label of Ed25519": (
        changed(label=algorithm(ED25519)).der(),
        {Kind.UNSUPPORTED_ALGORITHM, Kind.CMS_MALFORMED},
    ),
    "too many signers": (
        replace(GOOD, infos=tuple(sorted(Info().der() for _ in range(MAX_SIGNERS + 1)))).der(),
        MALFORMED,
    ),
    "too many certificates": (
        replace(GOOD, certificates=tlv(0xA0, CA.certificate.public_bytes(Encoding.DER) * (MAX_EMBEDDED + 1))).der(),
        MALFORMED,
    ),
    "nothing": (b"", MALFORMED),
    "a sequence of nothing": (b"\x30\x00", MALFORMED),
    "cut off": (GOOD.der()[:-1], MALFORMED),
    "random": (hashlib.sha512(b"random").digest(), MALFORMED),
}  # fmt: skip
"""What is said of each; the order of the groups is that of what it means."""

ACCEPTED_BY_OPENSSL_ALONE = {
    # Stricter than OpenSSL, with the reason: these are `unknown`, never "refused".
    "bytes behind": "not strict DER",
    "structure behind": "not strict DER",
    "indefinite length": "not strict DER",
    "length in more bytes than needed": "not strict DER",
    "text inside too": "two texts, and readers differ in which they take",
    "digest algorithms with parameters": "parameters mean nothing here",
    "digest algorithm with parameters": "parameters mean nothing here",
    "version 3": "says that the structure is one that it is not",
    "signer of version 3": "says that the structure is one that it is not",
    "content of another type": "no DDS document",
    "revocation lists": "nobody reads them",
    "no content type": "RFC 5652, 5.3: MUST",
    "content type of another type": "RFC 5652, 11.1: MUST",
    "content type twice": "RFC 5652, 11.1: MUST NOT",
    "message digest twice, the good one first": "OpenSSL takes the first, others the last",
    "message digest with two values": "OpenSSL takes the first",
    "attributes out of order": "DER; the signature is over what stands there, or over what should",
    "signers out of order": "DER",
    "unsigned attributes": "anybody can add them",
    "label of another digest": "OpenSSL ignores the signature algorithm",
    "label of another key": "OpenSSL ignores the signature algorithm",
    "label with parameters": "OpenSSL ignores the signature algorithm",
    "label of nothing known": "OpenSSL ignores the signature algorithm",
    "label of Ed25519": "OpenSSL ignores the signature algorithm",
    "empty attributes": "OpenSSL takes them for none",
    "too many signers": "the limit",
    "too many certificates": "the limit",
}


def document(der: bytes, signer: Signed = CA) -> SignedDocument:
    return read_signed(present(with_signature(MESSAGE, der)), [evidence(signer)])


@pytest.fixture(scope="module")
def answers(oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Oracle]:
    trusted = CA.pem + RSA_CA.pem + ED_CA.pem
    with running(oracle, tmp_path_factory.mktemp("oracle"), trusted) as running_oracle:
        yield running_oracle


def test_the_builder_builds_what_openssl_builds() -> None:
    assert document(taken_apart(MESSAGE)[1]).defects == document(GOOD.der()).defects == ()


def test_every_departure_is_named_and_none_contradicts_openssl(answers: Oracle) -> None:
    alone = set()
    for title, (der, expected) in CRAFTED.items():
        read_document = document(der)
        accepted = answers.content(with_signature(MESSAGE, der))
        assert {defect.kind for defect in read_document.defects} == expected, title
        assert disagreement(read_document, read(CA.pem), accepted) is None, title
        if (
            accepted is not None
            and document_verdict(read_document, read(CA.pem), pins_signer=True) is not Verdict.ACCEPTED
        ):
            alone.add(title)
    assert alone == set(ACCEPTED_BY_OPENSSL_ALONE), "the list of what we are stricter in does not grow unnoticed"


def test_defects_stand_where_the_signature_begins() -> None:
    (defect,) = document(GOOD.der() + b"\0").defects
    assert defect.line is not None
    assert with_signature(MESSAGE, GOOD.der()).split(b"\n")[defect.line - 1].startswith(b"MII")


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
        (by_rsa(algorithm(RSA_PSS, PSS_PARAMETERS), pss), RSA_CA, True, {Kind.UNSUPPORTED_ALGORITHM}),
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
    assert disagreement(read_document, read(signer.pem), answers.content(with_signature(MESSAGE, der))) is None


def test_a_digest_that_the_curve_does_not_match_is_still_checked() -> None:
    data = tlv(0x31, *sorted((CONTENT_TYPE, SIGNING_TIME, MESSAGE_DIGEST)))
    prehashed = CA.key.sign(hashlib.sha256(data).digest(), ec.ECDSA(utils.Prehashed(hashes.SHA256())))  # type: ignore[union-attr, call-arg, arg-type]
    assert document(changed(signature=prehashed).der()).signatures[0].verified_by == (evidence(CA),)


# --- reading alone


def test_what_is_read() -> None:
    data = read_signed_data(replace(GOOD, content=tlv(0x30, oid(DATA), tlv(0xA0, tlv(4, b"text")))).der())
    (signer,) = data.signers
    assert data.content == b"text"
    assert data.certificates == (CA.certificate.public_bytes(Encoding.DER),)
    assert (signer.serial, signer.digest) == (CA.certificate.serial_number, "sha256")
    assert signer.issuer_der == CA.certificate.issuer.public_bytes()
    assert signer.message_digest == hashlib.sha256(ENTITY).digest()
    assert signer.signing_time is not None
    assert signer.signing_time.isoformat() == "2024-01-01T00:00:00+00:00"


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
