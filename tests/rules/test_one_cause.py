"""What has one cause is one finding, however many enclaves it is about."""

from __future__ import annotations

from pathlib import Path

from keystore_audit.findings import Finding
from keystore_audit.options import Options
from keystore_audit.pipeline import audit
from tests.keystore.builder import sros2
from tests.rules.evidence import AT

NODES = tuple(f"/robot{number}" for number in range(8))


def found(root: Path, *enclaves: str, profiles: tuple[str, ...] = ()) -> list[Finding]:
    """What is at least high in a keystore of two authorities with these enclaves."""
    store = sros2(root / f"{len(enclaves)}{len(profiles)}", enclaves, split=True)
    report = audit(store, Options(at=AT, engine="native", profiles=profiles))
    return [each for each in report.findings if each.severity.rank < 2]


def test_an_identity_that_every_grant_names_is_one_cause(tmp_path: Path) -> None:
    """Cyclone DDS finds all of `CN=/` in every subject; a real keystore had such an enclave."""
    cause, property_violated = found(tmp_path, "/", *NODES)
    assert (cause.code, cause.severity.value) == ("KA519", "critical")
    assert "(and 7 more like it) names 'CN=/' too" in cause.message
    assert {each.path for each in cause.locations} >= {f"enclaves{path}/permissions.p7s" for path in NODES}
    assert property_violated.explained_by == (cause.fingerprint,)
    assert found(tmp_path, *NODES) == []
    assert found(tmp_path, "/", *NODES, profiles=("fastdds-3.6",))[0].severity.value == "high"
