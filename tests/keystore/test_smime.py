"""Signed documents: what OpenSSL accepts and reads, byte for byte, and nothing that it refuses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.name import _ASN1Type
from cryptography.x509.oid import NameOID
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.keystore import smime
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.smime import Candidates, SignedDocument, read_signed
from keystore_audit.model.trust.verdicts import document_verdict
from keystore_audit.truth import Truth
from tests.keystore import messages
from tests.keystore.builder import GOVERNANCE, Signed, authority, certificate, evidence, present, read, signed_document
from tests.keystore.messages import by_openssl, with_signature
from tests.oracles.smime.comparison import PINNED
from tests.oracles.smime.oracle import running
from tests.oracles.smime.textual import textual
from tests.steps import steps

CA = authority()
LEAF = certificate("/talker", CA)
TRUSTED = read(CA.pem)
STOCK = by_openssl(("smime", "-text"), CA)
SROS2 = signed_document(GOVERNANCE, CA)
CRLF_GOVERNANCE = GOVERNANCE.replace(b"\n", b"\r\n")


def document(message: bytes, *candidates: Signed) -> SignedDocument:
    trusted = [evidence(signed) for signed in candidates or (CA,)]
    return read_signed(present(message, "enclaves/governance.p7s"), trusted)


def kinds(message: bytes, *candidates: Signed) -> list[Kind]:
    return [defect.kind for defect in document(message, *candidates).defects]


def verdict(message: bytes) -> Truth:
    return document_verdict(document(message), TRUSTED, PINNED)


# --- the two real writers


@pytest.mark.parametrize(
    "spoil",
    [
        lambda m: m,
        lambda m: b"X: y\nY: x\n" + m,
        lambda m: m.replace(b"\r\n", b"\n"),
        lambda m: m.replace(b"\r\n", b"\n").replace(b"\n", b"\r\r\n"),
    ],
)
@pytest.mark.parametrize("message", [STOCK, SROS2], ids=["openssl", "pyca"])
def test_lines_are_those_of_the_file(message: bytes, spoil: Callable[[bytes], bytes]) -> None:
    message = spoil(message)
    read_document = document(message)
    assert read_document.content is not None
    lines = message.split(b"\n")
    for number, text in enumerate(read_document.content.split(b"\r\n")[:-1], 1):
        line = read_document.line(number)
        assert line is not None
        assert lines[line - 1].rstrip(b"\r") == text
    assert read_document.line(None) is None


def test_a_line_longer_than_the_buffer_is_one_line() -> None:
    content = b"<dds>" + b"<!-- " + b"x" * 5000 + b" --></dds>\n"
    for message in (by_openssl(("smime", "-text"), CA, content=content), signed_document(content, CA)):
        read_document = document(message)
        assert (read_document.content, read_document.defects) == (content.replace(b"\n", b"\r\n"), ())


# --- text that nothing signs


UNSIGNED_AT = {
    "extra header": 1,
    "preamble": 4,
    "preamble line added": 6,
    "long line in the preamble": 4,
    "signature extra header": 37,
    "epilogue": STOCK.count(b"\n") + 1,
}
"""OpenSSL accepts these (tests/oracles/smime): the line at which the text stands that was added."""


@pytest.mark.parametrize("title", sorted(UNSIGNED_AT))
def test_unsigned_text_is_found_at_its_line(title: str) -> None:
    (found, *_) = document(textual(STOCK)[title]).defects
    assert (found.kind, found.line) == (Kind.UNSIGNED_TEXT, UNSIGNED_AT[title])


# --- who signed


def test_a_signer_that_only_the_message_knows_is_found_in_it() -> None:
    message = by_openssl(("smime", "-text"), LEAF)
    read_document = document(message, CA)
    (signature,) = read_document.signatures
    (embedded,) = read_document.embedded
    assert (embedded.subject, embedded.path) == ("CN=/talker", "enclaves/governance.p7s")
    assert message.split(b"\n")[embedded.line - 1].startswith(b"MII")
    assert (signature.named, signature.verified_by) == ((embedded,), (embedded,))


def test_without_embedded_certificates_a_stranger_stays_unknown() -> None:
    (signature,) = document(by_openssl(("smime", "-text", "-nocerts"), LEAF), CA).signatures
    assert (signature.named, signature.verified_by, signature.digest_matches) == ((), (), True)


def test_every_signature_is_checked() -> None:
    read_document = document(by_openssl(("smime", "-text"), CA, LEAF), CA, LEAF)
    assert [defect.kind for defect in read_document.defects] == [Kind.SEVERAL_SIGNERS]
    assert sorted(c.subject for s in read_document.signatures for c in s.verified_by) == ["CN=/talker", "CN=sros2CA"]
    assert document_verdict(read_document, TRUSTED, PINNED) is Truth.NO


def test_an_authority_renewed_with_its_key_verifies_but_is_not_named() -> None:
    renewed = certificate("sros2CA", ca=True, key=CA.key)
    (signature,) = document(SROS2, renewed).signatures
    assert evidence(renewed) in signature.verified_by
    assert evidence(renewed) not in signature.named
    without = document(by_openssl(("smime", "-text", "-nocerts"), CA), renewed)
    assert without.signatures[0].named == ()
    assert without.signatures[0].verified_by == (evidence(renewed),)
    assert document_verdict(without, read(renewed.pem), PINNED) is Truth.NO


def test_another_authority_with_the_same_name_verifies_nothing() -> None:
    impostor = authority()
    read_document = document(by_openssl(("smime", "-text", "-nocerts"), impostor), CA)
    assert [(s.named, s.verified_by) for s in read_document.signatures] == [((), ())]


def test_a_certificate_with_the_serial_number_of_the_authority_does_not_pass_for_it() -> None:
    impostor = certificate("sros2CA", ca=True, serial=CA.certificate.serial_number)
    message = by_openssl(("smime", "-text"), impostor)
    (signature,) = document(message, CA).signatures
    assert len(signature.named) == 2, "the candidate and the one in the message"
    assert [c.sha256 for c in signature.verified_by] == [evidence(impostor).sha256]
    assert verdict(message) is Truth.NO
    both = document(message, CA, impostor)
    assert [c.sha256 for c in both.signatures[0].verified_by] == [evidence(impostor).sha256]


def test_an_issuer_written_in_other_bytes_leaves_the_signer_open(oracle: Callable[[str], str], tmp_path: Path) -> None:
    """OpenSSL compares names by meaning, so what we cannot match may be matched by a run time."""
    attribute = x509.NameAttribute(NameOID.COMMON_NAME, "sros2CA", _type=_ASN1Type.PrintableString)
    printable = certificate(x509.Name([attribute]), ca=True, key=CA.key, serial=CA.certificate.serial_number)
    message = by_openssl(("smime", "-text", "-nocerts"), CA)
    read_document = document(message, printable)
    with running(oracle, tmp_path, printable.pem) as answers:
        assert answers.content(message) is not None
    assert [defect.kind for defect in read_document.defects] == [Kind.CMS_MALFORMED]
    assert document_verdict(read_document, read(printable.pem), PINNED) is Truth.UNKNOWN


def test_unnamed_keys_are_tried_up_to_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smime, "MAX_KEYS_TRIED", 2)
    renewed = certificate("sros2CA", ca=True, key=CA.key)
    strangers = [certificate(f"/{n}", CA) for n in range(3)]
    message = by_openssl(("smime", "-text", "-nocerts"), CA)
    assert document(message, *strangers, renewed).signatures[0].verified_by == ()
    assert document(message, renewed, *strangers).signatures[0].verified_by == (evidence(renewed),)


def test_more_named_keys_than_can_be_tried_leave_the_signer_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smime, "MAX_KEYS_TRIED", 2)
    same = [certificate("sros2CA", ca=True, serial=CA.certificate.serial_number) for _ in range(3)]
    assert kinds(by_openssl(("smime", "-text", "-nocerts"), CA), *same, CA) == [Kind.CMS_MALFORMED]


def test_candidates_are_found_by_name_and_by_key() -> None:
    ca, leaf, renewed = (evidence(signed) for signed in (CA, LEAF, certificate("sros2CA", ca=True, key=CA.key)))
    candidates = Candidates([ca, leaf, ca, renewed])
    assert list(candidates.by_digest.values()) == [ca, leaf, renewed]
    assert candidates.by_name[leaf.issuer_der, leaf.serial] == [leaf]
    assert candidates.by_key[ca.key] == [ca, renewed]
    assert [each[0] for each in candidates.by_key.values()] == [ca, leaf]


# --- only what is signed counts


def test_a_decoy_around_the_signed_text_changes_nothing() -> None:
    decoy = b"<dds><permissions>evil</permissions></dds>\n"
    mark = b"\n------"
    message = STOCK.replace(mark, b"\n" + decoy + mark[1:], 1) + decoy * 3
    assert document(message).content == CRLF_GOVERNANCE


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (GOVERNANCE, "XML without a signature"),
        (CA.pem, "a PEM file"),
        (messages.taken_apart(STOCK)[1], "binary DER"),
        (b"", "nothing"),
        (STOCK.decode().encode("utf-16"), "neither"),
        (b"MIME-Version: 1.0\nContent-Type: text/plain\n\nmultipart/signed\n", "neither"),
    ],
)
def test_what_is_no_signed_message_is_called_by_its_name(content: bytes, found: str) -> None:
    (defect,) = document(content).defects
    assert defect.kind is Kind.NOT_SMIME
    assert found in defect.detail


def test_a_second_text_inside_the_signature_is_not_overlooked() -> None:
    """The detached text is one, the text inside the structure another: readers differ in which they take."""
    opaque = messages.taken_apart(by_openssl(("smime", "-text", "-nodetach"), CA))[1]
    read_document = document(with_signature(STOCK, opaque))
    assert Kind.TWO_CONTENTS in [defect.kind for defect in read_document.defects]
    assert verdict(with_signature(STOCK, opaque)) is Truth.UNKNOWN


# --- hostile sizes: an answer, soon

HUGE = 4 << 20
TYPE = b'Content-Type: multipart/signed; boundary="B2"\n'
HOSTILE = {
    "250,000 headers": b"".join(b"X-%d: y\n" % number for number in range(250_000)) + TYPE,
    "one header of 4 MB": TYPE.replace(b"B2", b"B" * HUGE),
    "300,000 boundaries": TYPE + b"\n" + b"--B2\nx\n" * 300_000,
    "300,000 empty parts": TYPE + b"\n" + b"--B2\n" * 300_000,
    "a million boundaries inside a line": TYPE + b"\n" + b"--B2" * (HUGE // 4),
    "short lines with boundaries inside": TYPE + b"\n" + b" --B2\n" * (HUGE // 6),
    "4 MB of CR": TYPE + b"\n--B2\n" + b"\r" * HUGE + b"\n--B2\n\nx\n--B2--\n",
    "4 MB of CR lines": TYPE + b"\n--B2\n" + b"\r\r\n" * (HUGE // 3) + b"--B2\n\nx\n--B2--\n",
    "4 MB of LF": TYPE + b"\n--B2\n" + b"\n" * HUGE + b"--B2\n\nx\n--B2--\n",
    "4 MB of blanks in a header": b"Content-Type:" + b" " * HUGE + b"multipart/signed\n\n",
    "4 MB of base64": TYPE + b"\n--B2\n\nx\n--B2\nContent-Type: application/pkcs7-signature\n\n"
    + (b"MDAw" * 16 + b"\n") * (HUGE // 65) + b"--B2--\n",
    "deep DER": with_signature(STOCK, b"\x30\x80" * 1_000_000),
    "deep definite DER": with_signature(STOCK, b"\x30\x00" * 1_000_000),
    "length of 2^64": with_signature(STOCK, b"\x30\x88" + b"\xff" * 8 + b"\x00" * 64),
    "preamble of 4 MB": STOCK.replace(b"This is", b"\n" * HUGE + b"This is"),
}  # fmt: skip


@pytest.mark.parametrize("title", HOSTILE)
def test_hostile_sizes(title: str) -> None:
    """Work that C does not do at once grows with the lines or structures at most."""
    steps(lambda: document(HOSTILE[title]), most=500_000)


# --- anything at all


@given(st.binary(max_size=400))
def test_no_bytes_raise(content: bytes) -> None:
    read_document = document(content)
    assert read_document.content is None or read_document.signatures == ()


PIECES = [
    *(b"MIME-Version: 1.0", TYPE[:-1], b"--B2", b"--B2--", b"Content-Type: text/plain", b"", b"\n", b"\r\n", b"\n\n"),
    *(
        b"Content-Type: application/x-pkcs7-signature",
        b"Content-Type: application/pkcs7-mime",
        b"MIIB",
        b'"',
        b"(",
        b";",
    ),
    *(b"x=", b" ", b"boundary=", b"\x00", b"\xff", b"<dds/>", b"MIIBMDCB" * 8),
]


@settings(max_examples=300)
@given(st.lists(st.sampled_from(PIECES), max_size=40))
def test_no_arrangement_of_mime_raises(pieces: list[bytes]) -> None:
    read_document = document(b"".join(pieces))
    assert document_verdict(read_document, TRUSTED, PINNED) is not Truth.YES


@given(st.binary(min_size=1, max_size=60), st.integers(0, 2000))
def test_no_insertion_into_a_real_message_raises(inserted: bytes, place: int) -> None:
    at = place % len(STOCK)
    read_document = document(STOCK[:at] + inserted + STOCK[at:])
    if document_verdict(read_document, TRUSTED, PINNED) is Truth.YES:
        assert read_document.content == CRLF_GOVERNANCE
