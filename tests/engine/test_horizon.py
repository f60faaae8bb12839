"""Until when an audit holds: the dates of revocation lists, which a system has of several alone."""

from __future__ import annotations

import re
import shutil
from datetime import datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from cryptography.hazmat.primitives.serialization import Encoding, load_pem_private_key
from cryptography.x509 import load_pem_x509_certificate
from msgspec.structs import replace

from keystore_audit.engine.native import NativeEngine
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.report.content import Report
from tests.engine.systems import TALKER, healthy
from tests.keystore.builder import END, START, Signed, crl, signed_document, sros2


def audited(root: Path, at: datetime, *, days: int = 0, end: datetime = END) -> Report:
    """The report about a keystore whose talker carries an empty list, in force `days` after START until `end`."""
    sros2(root)
    key = load_pem_private_key((root / "private/ca.key.pem").read_bytes(), None)
    certificate = load_pem_x509_certificate((root / "public/ca.cert.pem").read_bytes())
    made = crl(Signed(key, certificate), days=days, end=end)  # type: ignore[arg-type]
    (root / "enclaves/talker/crl.pem").write_bytes(made.public_bytes(Encoding.PEM))
    return audit(root, Options(at=at, engine="native"))


def usable(report: Report) -> bool:
    (talker,) = [enclave for enclave in report.enclaves if enclave.path == "/talker"]
    return talker.profiles["cyclonedds-0.10"].usable.must


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


def with_grants(root: Path, *grants: tuple[str, str, str]) -> Path:
    """A keystore whose talker has grants of one topic expression each, with dates; the first wins where both count."""
    sros2(root)
    key = load_pem_private_key((root / "private/ca.key.pem").read_bytes(), None)
    certificate = load_pem_x509_certificate((root / "public/ca.cert.pem").read_bytes())
    written = "".join(
        f'<grant name="g"><subject_name>CN=/talker</subject_name><validity><not_before>{start}</not_before>'
        f"<not_after>{end}</not_after></validity><allow_rule><domains><id>0</id></domains><publish><topics><topic>{topic}"
        "</topic></topics></publish></allow_rule><default>DENY</default></grant>"
        for topic, start, end in grants
    )
    document = f"<dds><permissions>{written}</permissions></dds>".encode()
    signed = signed_document(document, Signed(key, certificate))  # type: ignore[arg-type]
    (root / "enclaves/talker/permissions.p7s").write_bytes(signed)
    return root


WIDER_LATER = (
    ("*", "2025-01-01T00:00:00", "2033-01-01T00:00:00"),
    ("rt/a", "2024-01-01T00:00:00", "2033-01-01T00:00:00"),
)


@pytest.mark.parametrize(
    ("zone", "until"),
    [
        (None, "2024-12-31T10:00:00+00:00"),
        ("UTC", "2025-01-01T00:00:00+00:00"),
        ("Asia/Tokyo", "2024-12-31T15:00:00+00:00"),
    ],
)
def test_a_wider_grant_that_begins_ends_what_the_audit_says(tmp_path: Path, zone: str | None, until: str) -> None:
    """Fast DDS reads local time: without the zone, what it says may change 14 hours before."""
    options = Options(
        at=START + timedelta(days=100),
        engine="native",
        profiles=("fastdds-3.6",),
        time_zone=ZoneInfo(zone) if zone else None,
    )
    report = audit(with_grants(tmp_path / "keys", *WIDER_LATER), options)
    assert report.safe_until == datetime.fromisoformat(until)
    assert report.safe_until_why == "/talker: its grants give it other rights"


def test_a_grant_that_begins_and_gives_no_more_changes_nothing(tmp_path: Path) -> None:
    same = (("rt/a", WIDER_LATER[0][1], WIDER_LATER[0][2]), WIDER_LATER[1])
    options = Options(at=START + timedelta(days=100), engine="native", profiles=("spec",))
    assert audit(with_grants(tmp_path / "keys", *same), options).safe_until > datetime.fromisoformat(
        "2030-01-01T00:00:00+00:00"
    )


def test_a_date_that_is_read_in_the_robots_zone_is_named(tmp_path: Path) -> None:
    keystore = with_grants(tmp_path / "keys", ("rt/a", "2020-01-01T00:00:00", "2025-01-01T00:00:00"))
    for profiles, who in (
        (("spec", "fastdds-3.6"), "Fast DDS"),
        (("fastdds-3.6", "fastdds-2.6", "opendds"), "Fast DDS and OpenDDS"),
    ):
        options = Options(at=START + timedelta(days=100), engine="native", profiles=profiles)
        report = audit(keystore, options)
        assert report.safe_until == datetime.fromisoformat("2024-12-31T10:00:00+00:00")
        told = re.fullmatch(
            r"a grant ends 2025-01-01T00:00:00 in the robots' time zone under (.*) "
            r"\(enclaves/talker/permissions\.p7s:[0-9]+; --time-zone\)",
            report.safe_until_why,
        )
        assert told is not None
        assert told[1] == who


def test_how_many_dates_fall_then_is_said(repository: Path) -> None:
    samples = repository / "sample_keystores/healthy"
    options = Options(at=START, engine="native", profiles=("fastdds",))
    for name, said in (
        ("talker_listener", "; 1 more date of grants falls then"),
        ("turtlesim", "; 3 more dates of grants fall then"),
    ):
        assert audit(samples / name, options).safe_until_why.endswith(f"--time-zone){said}")


def test_whoever_is_revoked_later_changes_what_holds_then() -> None:
    system, identity = healthy(), healthy().enclaves[TALKER].identity
    assert identity is not None
    then = 2 * system.now + 1
    changing = [
        replace(trust_domain, revoked_later=((then, frozenset({identity})),)) for trust_domain in system.trust_domains
    ]
    native = NativeEngine([replace(system, trust_domains=tuple(changing))])
    assert native.statuses(then) != native.statuses(2 * system.now) == NativeEngine([system]).statuses(then)


def test_whoever_starts_no_longer_is_named_as_an_enclave(repository: Path, tmp_path: Path) -> None:
    """Also where an enclave's folder is the keystore, and has no other name than `.`."""
    keystore, one = repository / "sample_keystores/stock/turtlesim", tmp_path / "one"
    shutil.copytree(keystore / "enclaves/keyboard", one)
    options = Options(at=datetime.fromisoformat("2026-11-21T12:00:00+00:00"), engine="native", profiles=("spec",))
    for folder, said in ((keystore, "/keyboard and 3 more: "), (one, "/keyboard: ")):
        assert audit(folder, options).safe_until_why.startswith(said)
