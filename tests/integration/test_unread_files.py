"""What could not be read may be anything: no property holds that is violated with the file as it was."""

from __future__ import annotations

import shutil
from datetime import datetime, timezone
from pathlib import Path

import pytest

from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from keystore_audit.properties.result import Status
from keystore_audit.report.content import Report

SAMPLES = Path(__file__).parents[2] / "sample_keystores"
AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
KEYSTORES = (
    "stock/talker_listener",
    *(f"rules/KA{code}/bad" for code in ("404-join-access-control-off", "406-write-access-control-off")),
    *(f"rules/KA{code}/bad" for code in ("411-metadata-protection-none", "414-samples-unauthenticated")),
)
HIDDEN = ("governance.p7s", "permissions.p7s", "cert.pem", "identity_ca.cert.pem", "permissions_ca.cert.pem")


def report(root: Path) -> Report:
    return audit(root, Options(at=AT, engine="native"))


def statuses(root: Path) -> dict[tuple[str, str], Status]:
    """Of every property under every profile."""
    found = report(root).properties
    return {(result.prop.id, name): answer.status for result in found for name, answer in result.profiles.items()}


@pytest.fixture(params=KEYSTORES)
def keystore(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    root = tmp_path / "keys"
    shutil.copytree(SAMPLES / request.param, root)  # links become files
    return root


def test_there_are_violations_to_lose() -> None:
    assert sum(status is Status.VIOLATED for status in statuses(SAMPLES / KEYSTORES[0]).values()) > 10


@pytest.mark.parametrize("name", HIDDEN)
def test_nothing_holds_for_want_of_a_file(keystore: Path, name: str) -> None:
    before = statuses(keystore)
    (place,) = sorted(keystore.glob(f"enclaves/**/{name}"))[:1]
    place.write_bytes(place.read_bytes() + b"\n" * 5_000_000)
    after = statuses(keystore)
    assert Status.UNKNOWN in after.values()
    lost = {key for key, status in after.items() if status is Status.HOLDS and before[key] is Status.VIOLATED}
    assert lost == set()
    accused = {key for key, status in after.items() if status is Status.VIOLATED and before[key] is Status.HOLDS}
    assert accused == set()


def test_the_folder_of_one_enclave_accuses_nobody_and_proves_nothing() -> None:
    """Its authorities are links that lead out of it."""
    whole, alone = SAMPLES / "stock/talker_listener", SAMPLES / "stock/talker_listener/enclaves/talker"
    assert "KA703" not in {finding.code for finding in report(alone).findings}
    holding = {prop for (prop, _profile), status in statuses(alone).items() if status is Status.HOLDS}
    violated = {prop for (prop, _profile), status in statuses(whole).items() if status is Status.VIOLATED}
    assert holding & violated == set()
