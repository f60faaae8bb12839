"""Signed documents that no enclave carries: found by their header, as OpenSSL reads it, wherever they lie."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import subprocess
from base64 import b64encode, encodebytes
from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.foreign import DeclaredFiles
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.keystore.mime import MimeError, read_message
from keystore_audit.keystore.root import MAX_FILE_BYTES
from keystore_audit.keystore.smime import Candidates
from keystore_audit.keystore.traces import look
from keystore_audit.keystore.typed import GovernanceFile, PermissionsFile
from keystore_audit.keystore.unmanaged import MAX_UNMANAGED, read_unmanaged
from tests.conftest import libcrypto
from tests.keystore.builder import GOVERNANCE, PERMISSIONS, Signed, authority, present, signed_document, sros2
from tests.keystore.test_traces import PLACEHOLDERS

DOCUMENT = PERMISSIONS.format(name="/talker").replace("rt/chatter", "rt/old").encode()


class OpenSSL:
    """SMIME_read_PKCS7, the function with which every implementation reads a document."""

    def __init__(self) -> None:
        self._library = libcrypto()
        self._library.BIO_new_mem_buf.restype = ctypes.c_void_p
        self._library.SMIME_read_PKCS7.restype = ctypes.c_void_p

    def takes(self, data: bytes) -> bool:
        """Whether it takes the bytes for a signed message."""
        buffer = ctypes.create_string_buffer(data, len(data))
        bio = ctypes.c_void_p(self._library.BIO_new_mem_buf(buffer, len(data)))
        content = ctypes.c_void_p()
        found = ctypes.c_void_p(self._library.SMIME_read_PKCS7(bio, ctypes.byref(content)))
        self._library.BIO_free(bio)
        self._library.BIO_free(content)
        self._library.PKCS7_free(found)
        self._library.ERR_clear_error()
        return bool(found)


@pytest.fixture(scope="module")
def openssl() -> OpenSSL:
    return OpenSSL()


@pytest.fixture(scope="module")
def signer() -> Signed:
    return authority("permissionsCA")


@pytest.fixture(scope="module")
def message(signer: Signed) -> bytes:
    return signed_document(DOCUMENT, signer)


def authority_of(root: Path) -> Signed:
    """The authority of a built keystore."""
    private = load_pem_private_key((root / "private/ca.key.pem").read_bytes(), None)
    certificate = x509.load_pem_x509_certificate((root / "public/ca.cert.pem").read_bytes())
    return Signed(private, certificate)  # type: ignore[arg-type]


def places(keystore: Keystore) -> list[str]:
    return [stray.place for stray in keystore.unmanaged]


# --- what may be a message


def variants(message: bytes) -> dict[str, bytes]:
    """A message in forms that are hard to recognise."""
    head, body = message.split(b"\n", 1)
    kind, rest = body.split(b"\n", 1)
    return {
        "as it is": message,
        "lower case": b"\n".join((head.lower(), kind.replace(b"Content-Type", b"content-type"), rest)),
        "upper case": message.replace(b"multipart/signed", b"MULTIPART/SIGNED"),
        "no version": body,
        "a byte order mark": b"\xef\xbb\xbf" + message,
        "a byte order mark before the type": b"\xef\xbb\xbf" + body,
        "other headers": b"From: somebody\nX-Odd\n: \n" + message,
        "4,000 bytes of headers": b"X-Long: " + b"a" * 900 + b"\n" + b"X-Long: b\n" * 300 + message,
        "a blank line": b"\n" + message,
        "a blank line with a return": b"\r\n" + message,
        "a line of blanks": b"  \n" + message,
        "a NUL": b"\0" + message,
        "a NUL line in the header": head + b"\n\0\n" + body,
        "a prologue": b"# kept since 2023\n\n" + message,
        "old Macintosh line ends": message.replace(b"\r\n", b"\r").replace(b"\n", b"\r"),
        "LF line ends": message.replace(b"\r\n", b"\n"),
        "the type in the text alone": DOCUMENT.replace(b"rt/old", b"multipart/signed"),
        "XML": DOCUMENT,
        "nothing": b"",
    }


@pytest.mark.parametrize("name", variants(b"\n\n"))
def test_what_openssl_takes_for_a_message_may_be_one(name: str, message: bytes, openssl: OpenSSL) -> None:
    data = variants(message)[name]
    if openssl.takes(data):
        assert look(data).may_be_message
    if not look(data).may_be_message:
        with pytest.raises(MimeError) as refused:
            read_message(data)
        assert refused.value.kind in (Kind.NOT_SMIME, Kind.MIME_MALFORMED)


def test_the_oracle_takes_some_and_refuses_some(message: bytes, openssl: OpenSSL) -> None:
    taken = {name for name, data in variants(message).items() if openssl.takes(data)}
    assert {"as it is", "lower case", "upper case", "a byte order mark", "other headers"} <= taken
    assert not {"a blank line", "a prologue", "XML", "nothing", "the type in the text alone"} & taken


PIECES = st.sampled_from(
    (
        *(b"MIME-Version: 1.0", b"Content-Type: multipart/signed", b"content-type: Multipart/Signed", b"; boundary=x"),
        *(b"\n", b"\r\n", b"\n\n", b"\0", b" ", b"X: y", b'"', b"(", b")", b":", b"--x", b"application/pkcs7-mime"),
        b"\xef\xbb\xbf",
    )
)


@settings(
    max_examples=300, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(pieces=st.lists(PIECES, max_size=12))
def test_any_beginning_before_a_message(pieces: list[bytes], message: bytes, openssl: OpenSSL) -> None:
    data = b"".join(pieces) + message
    assert look(data).may_be_message or not openssl.takes(data)


# --- in a keystore


NAMES = (
    "permissions.p7s.bak",
    "old.txt",
    ".hidden",
    "archive/2023/permissions.p7s",
    "a b/\u00fcber",
    "private/x.pem",
    "x.xml",
)


@pytest.mark.parametrize("name", NAMES)
def test_a_message_is_found_whatever_it_is_called(name: str, tmp_path: Path) -> None:
    root = sros2(tmp_path / "keystore")
    place = root / name
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(signed_document(DOCUMENT, authority_of(root)))
    keystore = read_keystore(root)
    assert [stray.file.path for stray in keystore.unmanaged] == [name]
    (stray,) = keystore.unmanaged
    assert isinstance(stray.document, PermissionsFile)
    assert stray.document.permissions is not None
    assert stray.document.signed.signatures[0].verified_by
    assert stray.document.permissions.grants[0].rules[0].criteria[0].topics[0].text == "rt/old"


def test_copies_count_once_and_those_of_an_enclaves_document_not_at_all(tmp_path: Path) -> None:
    root = sros2(tmp_path / "keystore")
    message = signed_document(DOCUMENT, authority_of(root))
    for name in ("b", "a", "c"):
        (root / name).write_bytes(message)
    (root / "link").symlink_to("a")
    os.link(root / "a", root / "hard")
    for number, own in enumerate(("enclaves/talker/permissions.p7s", "enclaves/governance.p7s")):
        (root / f"copy{number}").write_bytes((root / own).read_bytes())
    assert places(read_keystore(root)) == ["a"]


def test_a_governance_is_told_from_permissions(tmp_path: Path) -> None:
    root = sros2(tmp_path / "keystore")
    ca = authority_of(root)
    (root / "governance").write_bytes(signed_document(GOVERNANCE.replace(b"SIGN", b"NONE"), ca))
    odd = DOCUMENT.replace(b"<dds ", b"<!-- domain_access_rules --><dds ", 1)
    (root / "permissions").write_bytes(signed_document(odd, ca))
    governance, permissions = read_keystore(root).unmanaged
    assert isinstance(governance.document, GovernanceFile)
    assert isinstance(permissions.document, PermissionsFile)
    assert permissions.document.permissions is not None


def test_what_is_not_read_is_a_document_where_it_has_the_mark_of_one(tmp_path: Path) -> None:
    root = sros2(tmp_path / "keystore")
    message = signed_document(DOCUMENT, authority_of(root))
    (root / "big").write_bytes(message + b"\n" * MAX_FILE_BYTES)
    (root / "recording.bag").write_bytes(b"\x93" * (20 * MAX_FILE_BYTES // 4))
    os.mkfifo(root / "pipe.p7s")
    (root / "public/permissions.p7s").symlink_to(tmp_path / "elsewhere")
    (tmp_path / "elsewhere").write_bytes(message)
    keystore = read_keystore(root)
    assert {stray.place: stray.document for stray in keystore.unmanaged} == {"big": None}
    unread = ["big", "pipe.p7s", "public/permissions.p7s", "recording.bag"]
    assert [file.place for file in keystore.unread_foreign] == unread
    accepted = {file.sha256 for file in keystore.unread_foreign if file.place == "recording.bag"}
    again = read_keystore(root, declared=DeclaredFiles(accepted=frozenset(filter(None, accepted))))
    assert [file.place for file in again.unread_foreign] == unread[:-1]
    assert [file.place for file in again.identities.unread] == ["public/permissions.p7s"], "outside may be anything"


def test_ten_thousand_strays_are_bounded_and_the_rest_is_unknown() -> None:
    header = b"MIME-Version: 1.0\nContent-Type: multipart/signed\n\n"
    files = (present(header + b"%d" % number, f"{number:05}") for number in range(10_000))
    numbered = [replace(file, sha256=file.path) for file in files]
    strays = list(read_unmanaged(numbered, (), Candidates(())))
    assert sum(stray.document is not None for stray in strays) == MAX_UNMANAGED
    (rest,) = [stray for stray in strays if stray.document is None]
    assert (rest.place, rest.file.content) == (numbered[MAX_UNMANAGED].path, None)
    assert rest.file.detail.startswith("10000 documents lie outside enclaves")


JUNK = (b"", b"\x00" * 9, b"MIME-Version: 1.0\n", b"Content-Type: multipart/signed", b"\xff" * 40)


@pytest.mark.parametrize("data", JUNK)
def test_junk_is_a_stray_only_where_openssl_may_read_on(data: bytes, tmp_path: Path) -> None:
    root = sros2(tmp_path / "keystore")
    (root / "junk").write_bytes(data)
    keystore = read_keystore(root)
    assert all(stray.document is not None and stray.document.signed.defects for stray in keystore.unmanaged)
    assert bool(keystore.unmanaged) is (b"multipart/signed" in data)


# --- marks of messages where OpenSSL reads none


def by_openssl(message: bytes, *options: str) -> bytes:
    """What the command line tool makes of a message."""
    command = ("openssl", "cms", "-cmsout", "-inform", "SMIME", *options)
    return subprocess.run(command, input=message, check=True, capture_output=True).stdout


CONCEALED: dict[str, Callable[[bytes], bytes]] = {
    "below a blank line": lambda message: b"\n" + message,
    "below a letter": lambda message: b"From: me\nSubject: rights\n\n" + message,
    "below CRLF": lambda message: b"Subject: rights\r\n\r\n" + message.replace(b"\n", b"\r\n"),
    "below another message": lambda message: message + message,
    "folded": lambda message: b"\n" + message.replace(b"Content-Type: multipart", b"Content-Type:\n multipart"),
    "indented": lambda message: b"\n" + message.replace(b"\n", b"\n  ").replace(b"\n  Content", b"\nContent"),
    "PEM": lambda message: b"notes\n" + by_openssl(message, "-outform", "PEM"),
    "a certificate's label": lambda message: by_openssl(message, "-outform", "PEM").replace(b" CMS-", b" CERTIFICATE-"),
    "a hyphen": lambda message: by_openssl(message, "-outform", "PEM").replace(b"\n-----END", b"\n-A\n-----END"),
}


@pytest.mark.parametrize("form", CONCEALED)
def test_a_message_where_openssl_reads_none_may_say_anything(form: str, message: bytes, tmp_path: Path) -> None:
    content = CONCEALED[form](message)
    assert look(content).concealed != ""
    if form in ("PEM", "a certificate's label", "a hyphen"):
        assert by_openssl(content, "-inform", "PEM").startswith(b"MIME-Version")
    root = sros2(tmp_path / "keys", ["/talker"])
    (root / "notes").write_bytes(content)
    (stray,) = read_keystore(root).unmanaged
    assert (stray.place, stray.document) == ("notes", None)
    assert "anybody can make a document of it" in stray.file.detail


def test_a_message_behind_an_enclaves_own_may_say_anything(tmp_path: Path) -> None:
    root = sros2(tmp_path / "keys", ["/talker"])
    own = root / "enclaves/talker/permissions.p7s"
    own.write_bytes(own.read_bytes() + b"\n" + signed_document(DOCUMENT, authority_of(root)))
    (stray,) = read_keystore(root).unmanaged
    assert (stray.place, stray.document) == ("enclaves/talker/permissions.p7s", None)


@pytest.mark.parametrize(
    "content",
    [
        b"See multipart/signed in RFC 8551.\n\nA Content-Type: multipart/signed in a line of text.\n",
        b"\n\nmultipart/signed\n",
        b"-----BEGIN PKCS7-----\n-----END CMS-----\n",
        b"0" * 100,
    ],
)
def test_what_only_speaks_of_messages_is_none(content: bytes, tmp_path: Path) -> None:
    root = sros2(tmp_path / "keys", ["/talker"])
    (root / "notes").write_bytes(content)
    assert read_keystore(root).unmanaged == ()


@pytest.mark.parametrize("text", PLACEHOLDERS)
def test_a_text_that_quotes_a_mark_is_no_document_and_no_identity(text: bytes, tmp_path: Path) -> None:
    root = sros2(tmp_path / "keys", ["/talker"])
    (root / "README.md").write_bytes(text)
    keystore = read_keystore(root)
    assert (keystore.unmanaged, keystore.identities.unread, keystore.identities.locked) == ((), (), ())
    assert (keystore.unread_foreign, [each.file.path for each in keystore.foreign]) == ((), ["README.md"])


UNREAD: dict[str, Callable[[bytes], bytes]] = {
    "DER": lambda message: by_openssl(message, "-outform", "DER"),
    "base64 of text": lambda message: b"data:\n  permissions.p7s: " + b64encode(message),
    "base64 of DER": lambda message: encodebytes(by_openssl(message, "-outform", "DER")),
    "UTF-16": lambda message: message.decode().encode("utf-16"),
}


@pytest.mark.parametrize("form", UNREAD)
def test_a_form_that_is_not_searched_for_is_a_file_that_was_not_read(form: str, message: bytes, tmp_path: Path) -> None:
    root = sros2(tmp_path / "keys", ["/talker"])
    (root / "notes").write_bytes(UNREAD[form](message))
    keystore = read_keystore(root)
    assert (keystore.unmanaged, [file.path for file in keystore.unread_foreign]) == ((), ["notes"])


def test_a_message_below_other_header_lines_is_read(message: bytes, openssl: OpenSSL, tmp_path: Path) -> None:
    root = sros2(tmp_path / "keys", ["/talker"])
    letter = b"From: me\nSubject: rights\n" + message
    assert openssl.takes(letter)
    (root / "letter.txt").write_bytes(letter)
    keystore = read_keystore(root)
    (stray,) = keystore.unmanaged
    assert isinstance(stray.document, PermissionsFile)
    assert keystore.unread_foreign == ()


def test_certificates_in_an_envelope_are_no_message(signer: Signed, tmp_path: Path) -> None:
    (tmp_path / "ca.pem").write_bytes(signer.pem)
    command = ("openssl", "crl2pkcs7", "-nocrl", "-certfile", str(tmp_path / "ca.pem"), "-outform", "PEM")
    assert look(subprocess.run(command, check=True, capture_output=True).stdout).concealed == ""


@pytest.mark.parametrize("piece", [b"multipart/signed", b"multipart/signed\n", b"-----BEGIN CMS-----", b"\n\n "])
def test_large_files_of_mentions_end(piece: bytes) -> None:
    content = b"\n" + piece * (MAX_FILE_BYTES // len(piece))
    assert look(content).concealed == ""
    assert look(content + b"YJKoZIhvcNAQcC").concealed == (
        "a signed message stands in it below other text" if b"multipart" in piece else ""
    )


def test_a_large_block_of_hyphens_conceals_nothing() -> None:
    """OpenSSL's base64 ends at the first."""
    assert look(b"-----BEGIN CERTIFICATE-----\n" + b"A-" * (MAX_FILE_BYTES // 2 - 30)).concealed == ""
