"""One function for each reader: it takes any bytes, and raises AssertionError where the reader breaks a promise.

Hypothesis (test_readers.py) and atheris (run.py) call the same functions. The promises: a reader never raises, gives
the same evidence each time, says something about every file (it is read, or there is a defect), points at lines that
the file has, and prints nothing of a private key.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from functools import lru_cache
from pathlib import Path
from typing import Final, TypeVar

from msgspec.structs import asdict

from keystore_audit.keystore.certificate import Certificate, read_certificates
from keystore_audit.keystore.cms import CmsError, SignedData, read_signed_data
from keystore_audit.keystore.crl import CrlFile, read_crl
from keystore_audit.keystore.defect import Defect, Kind
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.mime import Message, MimeError, read_message
from keystore_audit.keystore.pem import Block, read_pem
from keystore_audit.keystore.private_key import read_private_key
from keystore_audit.keystore.smime import Candidates, SignedDocument, read_signed
from keystore_audit.keystore.typed import read_governance, read_permissions
from keystore_audit.keystore.xml import read_xml

Target = Callable[[bytes], None]

MAX_INPUT: Final = 1 << 16

MAX_STEPS: Final = 1_000_000
"""Lines of keystore_audit for one input of at most MAX_INPUT bytes: what takes more is not linear."""

CORPUS: Final = Path(__file__).parent / "corpus"
PATH: Final = "enclaves/talker/file"
HEADER: Final = (
    b'MIME-Version: 1.0\nContent-Type: multipart/signed; protocol="application/x-pkcs7-signature"; '
    b'micalg="sha-256"; boundary="----0000"\n\nThis is an S/MIME signed message\n\n------0000\n'
    b"Content-Type: text/plain\r\n\r\n"
)
FOOTER: Final = (
    b"\r\n------0000\nContent-Type: application/x-pkcs7-signature; name=\"smime.p7s\"\n"
    b'Content-Transfer-Encoding: base64\nContent-Disposition: attachment; filename="smime.p7s"\n\n'
    b"MAA=\n\n------0000--\n\n"
)  # fmt: skip


def present(data: bytes) -> File:
    return File(path=PATH, resolved=PATH, status=Status.PRESENT, content=data, sha256="0", mode=0o644)


def told(defects: Collection[Defect], data: bytes, last: int | None = None) -> None:
    """Every defect names the file, a line that it has, and what is wrong."""
    lines = data.count(b"\n") + 1 if last is None else last
    for defect in defects:
        assert defect.path == PATH
        assert defect.detail
        assert defect.line is None or 1 <= defect.line <= lines, (defect, lines)
        defect.detail.encode()


T = TypeVar("T")


def twice(read: Callable[[bytes], T], data: bytes, said: Callable[[T], object] = repr) -> T:
    """What a reader makes of it, the same each time."""
    first = read(data)
    assert said(first) == said(read(data))
    return first


def certificate(data: bytes) -> None:
    first = twice(lambda data: read_certificates(present(data)), data)
    assert first.certificates or first.defects
    told(first.defects, data)
    for each in first.certificates:
        assert data.count(b"\n", 0) + 1 >= each.line >= 1
        assert each.subject_der in each.parsed.tbs_certificate_bytes


def said_of(file: CrlFile) -> object:
    """All but the library's own objects, of which each is another."""
    lists = [asdict(each) for each in file.revocation_lists]
    return repr([file.defects, *({name: each[name] for name in sorted(each.keys() - {"parsed"})} for each in lists)])


def crl(data: bytes) -> None:
    first = twice(lambda data: read_crl(present(data)), data, said_of)
    assert first.revocation_lists or first.defects
    told(first.defects, data)


def private_key(data: bytes) -> None:
    first = twice(lambda data: read_private_key(present(data)), data)
    assert first.file.content is None
    assert first.key is not None or first.defects
    assert first.key is None or {defect.kind for defect in first.defects} <= {Kind.SECOND_KEY}
    told(first.defects, data)
    shown = repr(first)
    for secret in re.findall(rb"[A-Za-z0-9+/=]{24,}", data):
        assert secret.decode() not in shown


def pem(data: bytes) -> None:
    first = twice(read_pem, data)
    assert bool(first.parts) == (b"-----BEGIN" in data)
    assert first.parts or first.texts or not data.strip()
    lines = [part.line for part in first.parts]
    assert lines == sorted(lines)
    assert all(1 <= part.line <= data.count(b"\n") + 1 for part in (*first.parts, *first.texts))
    for part in first.parts:
        if isinstance(part, Block):
            assert f"-----BEGIN {part.label}-----".encode() in data


def _message(data: bytes) -> Message | MimeError:
    try:
        return read_message(data)
    except MimeError as error:
        return error


def mime(data: bytes) -> None:
    last = data.count(b"\n") + 1
    message = _message(data)
    if isinstance(message, MimeError):
        assert 1 <= message.line <= last
        assert message.detail
        return
    again = read_message(data)
    assert (message.entity, message.signature, message.unsigned) == (again.entity, again.signature, again.unsigned)
    assert 1 <= message.entity_line <= last
    assert 1 <= message.signature_line <= last
    assert all(1 <= line <= last and detail for line, detail in message.unsigned)
    if message.entity is not None:
        assert message.entity.count(b"\n") == message.entity.count(b"\r\n"), "not in canonical form"


def _signed_data(data: bytes) -> SignedData | CmsError:
    try:
        return read_signed_data(data)
    except CmsError as error:
        return error


def cms(data: bytes) -> None:
    signed = _signed_data(data)
    if isinstance(signed, CmsError):
        assert signed.detail
        return
    assert repr(signed) == repr(read_signed_data(data))
    assert signed.signers or signed.problems
    assert all(signer.issuer_der in data and signer.signature in data for signer in signed.signers)
    assert all(certificate in data for certificate in signed.certificates)
    assert signed.content is None or signed.content in data


@lru_cache(maxsize=1)
def _authorities() -> tuple[Certificate, ...]:
    """Those that signed the seeds of `smime`."""
    paths = sorted((CORPUS / "certificate").glob("signer-*.pem"))
    return tuple(each for path in paths for each in read_certificates(present(path.read_bytes())).certificates)


@lru_cache(maxsize=1)
def _signed_texts() -> frozenset[bytes]:
    """What the authorities did sign."""
    documents = (_read(path.read_bytes()) for path in (CORPUS / "smime").glob("*.p7s"))
    return frozenset(each.content for each in documents if each.content is not None and _is_signed(each))


def _read(data: bytes) -> SignedDocument:
    return read_signed(present(data), Candidates(_authorities()))


def _is_signed(document: SignedDocument) -> bool:
    return any(
        each.digest_matches is not False and each.verified_by and set(each.verified_by) <= set(_authorities())
        for each in document.signatures
    )


def smime(data: bytes) -> None:
    """No text is taken for signed but those that the authorities signed, whatever a mutation does."""
    first = twice(_read, data)
    assert first.content is not None or first.defects
    assert first.signatures or first.defects
    told(first.defects, data)
    if first.content is not None and _is_signed(first) and not _opaque(first.defects):
        assert first.content in _signed_texts(), "a forgery"


def _document(content: bytes) -> SignedDocument:
    return SignedDocument(file=present(content), content=content, first_line=1, embedded=(), signatures=(), defects=())


def xml(data: bytes) -> None:
    root, defects = read_xml(_document(data))
    again, defects_again = read_xml(_document(data))
    assert defects == defects_again
    assert (root is None) == (again is None)
    assert root is not None or defects
    told(defects, data)
    if not defects:
        assert root is not None
        assert b"<!DOCTYPE" not in data
        assert b"<![CDATA[" not in data
        assert b"\0" not in data


def governance(data: bytes) -> None:
    """`data` is the text that is signed."""
    message = HEADER + data + FOOTER
    first = twice(
        lambda data: read_governance(present(data), ()), message, lambda read: repr((read.readings, read.defects))
    )
    told(first.defects, message)
    assert (first.governance is not None) or first.signed.content is None or _opaque(first.defects)
    assert first.readings.common is None or not _opaque(first.defects)
    if first.governance is not None:
        assert all(rule.topic_rules for rule in first.governance.domain_rules)


def permissions(data: bytes) -> None:
    """`data` is the text that is signed."""
    message = HEADER + data + FOOTER
    first = twice(
        lambda data: read_permissions(present(data), ()), message, lambda read: repr((read.readings, read.defects))
    )
    told(first.defects, message)
    assert (first.permissions is not None) or first.signed.content is None or _opaque(first.defects)
    assert first.readings.common is None or not _opaque(first.defects)
    if first.permissions is not None:
        for grant in first.permissions.grants:
            assert grant.subject_name.text
            assert all(topic.text for rule in grant.rules for each in rule.criteria for topic in each.topics)


def _opaque(defects: Collection[Defect]) -> bool:
    return any(defect.kind.opaque for defect in defects)


READERS: Final[dict[str, Target]] = {
    each.__name__: each for each in (certificate, crl, private_key, pem, mime, cms, smime, xml, governance, permissions)
}
