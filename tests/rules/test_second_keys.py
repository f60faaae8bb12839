"""Private keys behind the first one in key.pem, or in another file: whose they are, and what that makes possible."""

from __future__ import annotations

from pathlib import Path

import pytest

from keystore_audit.findings import Severity
from keystore_audit.keystore.keystore import MAX_FURTHER_KEYS
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from tests.keystore.builder import certificate, key
from tests.model.comparing import AT, authority
from tests.model.single_changes import BASE


@pytest.mark.parametrize(
    ("second", "codes", "whose"),
    [
        (authority("permissionsCA").key_pem, {"KA109", "KA118"}, ", that of the authority 'CN=permissionsCA'"),
        (authority("identityCA").key_pem, {"KA109", "KA118"}, ", that of the authority 'CN=identityCA'"),
        (certificate("/listener", key=key("/listener")).key_pem, {"KA118"}, ", that of /listener"),
        (certificate("/else", key=key("nobody")).key_pem, {"KA118"}, ""),
        (b"", set(), ""),
    ],
)
def test_a_second_key_is_named(second: bytes, codes: set[str], whose: str, tmp_path: Path) -> None:
    root = BASE.write(tmp_path / "keystore")
    file = root / "enclaves/talker/key.pem"
    lines = len(file.read_text().splitlines())
    file.write_bytes(file.read_bytes() + second)
    report = audit(root, Options(at=AT, engine="native"))
    found = {each.code: each for each in report.findings if each.code in ("KA109", "KA118")}
    assert set(found) == codes
    for each in found.values():
        assert (each.severity, each.enclave) == (Severity.CRITICAL, "/talker")
        assert [(place.path, place.line) for place in each.locations] == [("enclaves/talker/key.pem", lines + 1)]
    if "KA118" in found:
        assert f"has a second private key{whose}: " in found["KA118"].message
    if "KA109" in found:
        assert "/talker has the private key of the authority" in found["KA109"].message


@pytest.mark.parametrize(
    ("place", "keys", "whose"),
    [
        ("enclaves/talker/identity_ca.cert.pem", ("identityCA",), ": that of the authority 'CN=identityCA'"),
        ("enclaves/listener/cert.pem", ("/talker",), ": that of /talker"),
        ("enclaves/talker/spare.pem", ("nobody", "permissionsCA"), ": that of the authority 'CN=permissionsCA'"),
        (
            "public/both.pem",
            ("permissionsCA", "identityCA"),
            ": those of the authority 'CN=permissionsCA', the authority 'CN=identityCA'",
        ),
        ("public/ca.key.pem", ("permissionsCA",), ": that of the authority 'CN=permissionsCA'"),
        ("public/notes.pem", ("nobody",), ""),
    ],
)
def test_whose_key_lies_in_another_file_is_said(place: str, keys: tuple[str, ...], whose: str, tmp_path: Path) -> None:
    root = BASE.write(tmp_path / "keystore")
    file = root / place
    file.parent.mkdir(exist_ok=True)
    pem = b"".join(
        (authority(each) if each.endswith("CA") else certificate(each, key=key(each))).key_pem for each in keys
    )
    file.write_bytes((file.read_bytes() if file.exists() else b"") + pem)
    report = audit(root, Options(at=AT, engine="native"))
    (found,) = (each for each in report.findings if each.code == "KA118")
    assert found.message == f"A private key is in {place}, which goes on robots{whose}."


def test_of_many_files_with_keys_only_the_first_are_looked_at(tmp_path: Path) -> None:
    root = BASE.write(tmp_path / "keystore")
    (root / "public").mkdir()
    for number in range(MAX_FURTHER_KEYS + 1):
        (root / f"public/{number:03}.pem").write_bytes(authority("identityCA").key_pem)
    found = [each for each in audit(root, Options(at=AT, engine="native")).findings if each.code == "KA118"]
    assert len(found) == MAX_FURTHER_KEYS + 1
    assert sum("that of the authority" in each.message for each in found) == MAX_FURTHER_KEYS
