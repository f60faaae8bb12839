"""Private keys behind the first one in an enclave's key.pem: whose they are is said, and what that makes possible."""

from __future__ import annotations

from pathlib import Path

import pytest

from keystore_audit.findings import Severity
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from tests.keystore.builder import certificate
from tests.model.comparing import AT, authority, key
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
