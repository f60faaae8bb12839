"""Until when an audit holds: the dates of revocation lists, which no system has."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from cryptography.x509 import load_pem_x509_certificate

from keystore_audit.audit import Options, audit
from keystore_audit.report.content import Report
from tests.keystore.builder import END, START, Signed, crl, sros2


def audited(root: Path, at: datetime, *, days: int = 0, end: datetime = END) -> Report:
    """The report about a keystore whose talker carries an empty list, in force `days` after START until `end`."""
    sros2(root)
    key = load_pem_private_key((root / "private/ca.key.pem").read_bytes(), None)
    certificate = load_pem_x509_certificate((root / "public/ca.cert.pem").read_bytes())
    made = crl(Signed(key, certificate), days=days, end=end)  # type: ignore[arg-type]
    (root / "enclaves/talker/crl.pem").write_bytes(made.public_bytes(Encoding.PEM))
    return audit(root, Options(at=at, engine="native"))


def usable(report: Report) -> bool | None:
    (talker,) = [enclave for enclave in report.enclaves if enclave.path == "/talker"]
    return talker.profiles["cyclonedds-0.10"].usable


@pytest.mark.parametrize(
    ("days", "end", "expected", "until"),
    [
        (0, START + timedelta(days=200), True, START + timedelta(days=200, seconds=1)),
        (150, END, False, START + timedelta(days=150)),
        (0, START + timedelta(days=50), False, END + timedelta(seconds=1)),
    ],
)
def test_a_revocation_list_has_its_days(
    tmp_path: Path, days: int, end: datetime, expected: bool, until: datetime
) -> None:
    report = audited(tmp_path / "keys", START + timedelta(days=100), days=days, end=end)
    assert usable(report) is expected
    assert report.safe_until == until
