"""The whole keystore: every layout read end to end, each distinct file once, and nothing hides anything."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec import Struct
from msgspec.structs import astuple

from keystore_audit.errors import NothingToAudit
from keystore_audit.keystore.defect import Kind
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.keystore.layout import Role
from tests.keystore.builder import authority, certificate, signed_document, sros2


def test_what_is_shared_is_one_object(tmp_path: Path) -> None:
    keystore = read_keystore(sros2(tmp_path / "k", ["/a", "/b"]))
    a, b = keystore.enclaves
    assert a.identity_ca is b.identity_ca is a.permissions_ca is keystore.authorities[0]
    assert a.governance is b.governance
    assert a.permissions is not b.permissions
    assert a.certificate is not b.certificate


def test_copies_are_verified_once_and_keep_their_places(tmp_path: Path) -> None:
    keystore = read_keystore(sros2(tmp_path / "k", ["/a", "/b"], links=False))
    a, b = keystore.enclaves
    assert a.governance is not None
    assert b.governance is not None
    assert a.governance.governance is b.governance.governance
    assert a.governance.signed.content is b.governance.signed.content
    assert a.governance.signed.signatures == b.governance.signed.signatures
    assert a.governance.signed.file.path == "enclaves/a/governance.p7s"
    assert b.governance.signed.file.path == "enclaves/b/governance.p7s"
    assert b.governance.signed.file is b.files.files[Role.GOVERNANCE]
    broken = (tmp_path / "k/enclaves/a/governance.p7s").read_bytes().replace(b"ENCRYPT", b"SIGN")
    for name in "ab":
        (tmp_path / f"k/enclaves/{name}/governance.p7s").write_bytes(broken)
    for enclave in read_keystore(tmp_path / "k").enclaves:
        assert enclave.governance is not None
        found = (*enclave.governance.signed.defects, *enclave.governance.defects)
        assert found
        assert {defect.path for defect in found} == {f"{enclave.files.directory}/governance.p7s"}


def test_copies_of_certificates_are_parsed_once_and_keep_their_places(tmp_path: Path) -> None:
    enclaves = read_keystore(sros2(tmp_path / "k", ["/a", "/b"], links=False)).enclaves
    first, *others = (
        c for each in enclaves for role in (Role.IDENTITY_CA, Role.PERMISSIONS_CA) for c in each.trusts(role)
    )
    assert all(each.parsed is first.parsed for each in others)
    files = [f"enclaves/{name}/{role}_ca.cert.pem" for name in "ab" for role in ("identity", "permissions")]
    assert [each.path for each in (first, *others)] == files


def test_a_stranger_s_certificate_has_the_place_of_each_copy_that_holds_it(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/a", "/b"], links=False)
    stranger = authority("stranger")
    for name in "ab":
        (path / f"enclaves/{name}/governance.p7s").write_bytes(signed_document(b"<dds/>", stranger))
    for enclave in read_keystore(path).enclaves:
        assert enclave.governance is not None
        signed = enclave.governance.signed
        (signature,) = signed.signatures
        found = (*signed.embedded, *signature.named, *signature.verified_by)
        assert [(each.subject, each.path) for each in found] == [("CN=stranger", signed.file.place)] * 3
        assert signed.file.place == f"{enclave.files.directory}/governance.p7s"


def test_anybody_in_the_tree_may_turn_out_to_be_the_signer(tmp_path: Path) -> None:
    """A document signed by an enclave's own key is named as that, not as signed by nobody (CVE-2023-24010)."""
    path = sros2(tmp_path / "k", ["/a", "/b"])
    ca = authority()
    mallory = certificate("/a", ca)
    (path / "enclaves/a/cert.pem").write_bytes(mallory.pem)
    for enclave in "ab":
        document = (path / f"enclaves/{enclave}/permissions.xml").read_bytes()
        (path / f"enclaves/{enclave}/permissions.p7s").write_bytes(signed_document(document, mallory))
    for found in read_keystore(path).enclaves:
        assert found.permissions is not None
        (signature,) = found.permissions.signed.signatures
        assert [signer.subject for signer in signature.named] == ["CN=/a"]
        assert [signer.path for signer in signature.verified_by] == ["enclaves/a/cert.pem"]


def test_broken_enclaves_do_not_hide_others(tmp_path: Path) -> None:
    names = [f"/e{number}" for number in range(9)]
    path = sros2(tmp_path / "k", names, links=False)
    broken = path / "enclaves"
    for role_file in ("cert.pem", "key.pem", "identity_ca.cert.pem", "governance.p7s", "permissions.p7s"):
        (broken / "e0" / role_file).write_bytes(b"\0\xff" * 1000)
        (broken / "e1" / role_file).write_bytes(b"")
        (broken / "e2" / role_file).unlink()
        (broken / "e3" / role_file).unlink()
        (broken / "e3" / role_file).mkdir()
        (broken / "e4" / role_file).unlink()
        os.mkfifo(broken / "e4" / role_file)
        (broken / "e5" / role_file).unlink()
        os.symlink("/dev/zero", broken / "e5" / role_file)
        (broken / "e6" / role_file).unlink()
        with (broken / "e6" / role_file).open("wb") as stream:
            stream.truncate(10 * 1024**3)
        (broken / "e7" / role_file).write_bytes(b"-----BEGIN CERTIFICATE-----\n" * 140_000)
    keystore = read_keystore(path)
    assert [enclave.path for enclave in keystore.enclaves] == names
    for enclave in keystore.enclaves[:2] + keystore.enclaves[7:8]:
        assert enclave.certificate is not None
        assert enclave.certificate.first is None
        assert {defect.kind for defect in enclave.certificate.defects} == {Kind.CERTIFICATE_UNREADABLE}
        assert enclave.key is not None
        assert [defect.kind for defect in enclave.key.defects] == [Kind.KEY_UNREADABLE]
        assert enclave.permissions is not None
        assert enclave.permissions.permissions is None
        assert any(defect.kind for defect in enclave.permissions.signed.defects)
    statuses = (Status.MISSING, Status.DIRECTORY, Status.SPECIAL, Status.OUTSIDE, Status.TOO_LARGE)
    for enclave, status in zip(keystore.enclaves[2:7], statuses, strict=True):
        assert enclave.files.files[Role.CERTIFICATE].status is status
        assert enclave.files.files[Role.KEY].status is status
        assert (enclave.certificate, enclave.key, enclave.governance, enclave.permissions) == (None,) * 4
        assert enclave.permissions_ca is not None
    healthy = keystore.enclaves[8]
    assert healthy.permissions is not None
    assert healthy.permissions.permissions is not None
    assert healthy.permissions.defects == healthy.permissions.signed.defects == ()


def test_a_single_enclave_s_folder_is_named_by_its_certificate(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/ns/talker", "/ns/talker/inner"], links=False) / "enclaves/ns/talker"
    keystore = read_keystore(path)
    assert [enclave.path for enclave in keystore.enclaves] == ["/ns/talker", "/ns/talker/inner"]
    assert keystore.layout.enclaves == tuple(enclave.files for enclave in keystore.enclaves)
    (path / "cert.pem").write_bytes(certificate("talker").pem)  # Ardent has no slash
    assert [enclave.path for enclave in read_keystore(path).enclaves] == ["/", "/inner"]
    (path / "cert.pem").unlink()
    assert [enclave.path for enclave in read_keystore(path).enclaves] == ["/", "/inner"]


def test_enclaves_whose_paths_come_close_are_all_kept(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/talker", "/talker/talker"], links=False) / "enclaves/talker"
    (path / "cert.pem").write_bytes(certificate("/").pem)
    (path / "inner").mkdir()
    (path / "inner/cert.pem").write_bytes(certificate("/talker").pem)
    keystore = read_keystore(path)
    assert [(e.path, e.files.directory) for e in keystore.enclaves] == [
        ("/", "."),
        ("/inner", "inner"),
        ("/talker", "talker"),
    ]


def test_nothing_to_audit_passes_through(tmp_path: Path) -> None:
    with pytest.raises(NothingToAudit):
        read_keystore(tmp_path)
    with pytest.raises(NothingToAudit):
        read_keystore(str(tmp_path / "none"))


def test_no_key_byte_is_left_in_the_evidence(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/a"])
    (path / "enclaves/a/key.p11").write_text("pkcs11:object=x?pin-value=1234")
    keys = [file.read_bytes() for file in (*path.rglob("*key.pem"), path / "enclaves/a/key.p11")]
    assert len(keys) >= 4
    seen: list[object] = []

    def visit(value: object) -> None:
        if isinstance(value, Struct):
            visit(astuple(value))
        elif isinstance(value, dict):
            visit(tuple(value.values()))
        elif isinstance(value, tuple | list | frozenset):
            for item in value:
                visit(item)
        else:
            seen.append(value)

    keystore = read_keystore(path)
    visit(keystore)
    contents = [value for value in seen if isinstance(value, bytes)]
    assert contents
    for key in keys:
        assert all(key[-60:] not in content for content in contents)
        assert key.decode()[-60:].strip() not in repr(keystore)


def digest(path: Path) -> str:
    return read_keystore(path).digest


def test_the_digest_is_what_the_design_says(tmp_path: Path) -> None:
    """Computed here again, from os.walk: SHA-256 over the sorted (path, type, content or link target)."""
    path = sros2(tmp_path / "k", ["/a", "/b/c"])
    (path / "empty").mkdir()
    os.mkfifo(path / "fifo")
    records = [(b"", b"directory", b"")]
    for directory, below, names in os.walk(bytes(path)):
        for name in (*below, *names):
            full = os.path.join(directory, name)
            relative = os.path.relpath(full, bytes(path))
            if os.path.islink(full):
                records.append((relative, b"link", os.readlink(full)))
            elif os.path.isdir(full):
                records.append((relative, b"directory", b""))
            elif os.path.isfile(full):
                with open(full, "rb") as stream:
                    records.append((relative, b"file", hashlib.sha256(stream.read()).hexdigest().encode()))
            else:
                records.append((relative, b"special", b"special"))
    joined = b"".join(part + b"\0" for record in sorted(records) for part in record)
    assert digest(path) == hashlib.sha256(joined).hexdigest()


def test_the_digest_changes_with_every_change_and_with_nothing_else(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/a"])
    copy = tmp_path / "copy"
    shutil.copytree(path, copy, symlinks=True)
    (copy / "enclaves/a/key.pem").chmod(0o600)
    os.utime(copy / "enclaves/a/cert.pem", (0, 0))
    first = digest(path)
    assert first == digest(path) == digest(copy)
    seen = {first}

    def changed() -> None:
        now = digest(copy)
        assert now not in seen
        seen.add(now)

    (copy / "README").write_text("x")
    changed()
    (copy / "README").write_text("y")
    changed()
    (copy / "README").rename(copy / "READ")
    changed()
    (copy / "directory").mkdir()
    changed()
    (copy / "private/ca.key.pem").write_text("")
    changed()
    (copy / "link").symlink_to("nowhere")
    changed()
    (copy / "link").unlink()
    (copy / "link").symlink_to("nowhere else")
    changed()
    (copy / "large").write_bytes(b"x" * (5 * 1024**2))
    changed()


def test_nothing_is_written_to_stderr_and_no_warning_leaves(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/a"])
    der = certificate("/a", serial=0x11).certificate.public_bytes(Encoding.DER)
    negative = der.replace(b"\x02\x01\x11", b"\x02\x01\x81", 1)
    lines = subprocess.run(
        ["openssl", "x509", "-inform", "DER"], input=negative, capture_output=True, check=True
    ).stdout
    (path / "enclaves/a/cert.pem").write_bytes(lines)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (enclave,) = read_keystore(path).enclaves
    assert enclave.certificate is not None
    assert enclave.certificate.first is not None
    assert enclave.certificate.first.serial < 0
    program = f"from keystore_audit.keystore.keystore import read_keystore; read_keystore({str(path)!r})"
    run = subprocess.run([sys.executable, "-W", "always", "-c", program], capture_output=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, b"", b"")


def test_a_hundred_megabytes_of_pem_are_refused_at_once(tmp_path: Path) -> None:
    """Killed after ten seconds, and with 300 MB of memory above what Python and the libraries take."""
    path = sros2(tmp_path / "k", ["/a", "/b"])
    (path / "enclaves/a/cert.pem").write_bytes(certificate("/a").pem * 230_000)
    (path / "enclaves/b/cert.pem").write_bytes(certificate("/b").pem * 5_000)  # under the limit of one file
    assert (path / "enclaves/a/cert.pem").stat().st_size > 90 * 1024**2
    program = (
        "import resource; resource.setrlimit(resource.RLIMIT_AS, (700 * 1024**2,) * 2);"
        "from keystore_audit.keystore.keystore import read_keystore;"
        f"print([e.files.files for e in read_keystore({str(path)!r}).enclaves][0])"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=10, check=False)
    assert "too-large" in run.stdout, run.stderr
