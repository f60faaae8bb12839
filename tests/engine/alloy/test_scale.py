"""A keystore that is too large for Alloy: the native engine decides, and it is said; or it is no answer."""

from __future__ import annotations

import json
from itertools import combinations, islice
from pathlib import Path

import pytest

from keystore_audit.engine.alloy.runner import MAX_ATOMS
from tests.cli.keystores import AT, answer, keystore, rule

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

ENCLAVES = 40

TOPICS = MAX_ATOMS + 10
"""No two of them have the same writer and the same two readers, so that nothing can be merged."""


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A keystore in which every topic has other rights."""
    paths = [f"/part{number}" for number in range(ENCLAVES)]
    publish: dict[str, list[str]] = {path: [] for path in paths}
    subscribe: dict[str, list[str]] = {path: [] for path in paths}
    for number, (writer, *readers) in enumerate(islice(combinations(paths, 3), TOPICS)):
        publish[writer].append(f"rt/topic{number}")
        for reader in readers:
            subscribe[reader].append(f"rt/topic{number}")
    return keystore(
        tmp_path_factory.mktemp("large") / "keys",
        {path: (rule(tuple(publish[path]), tuple(subscribe[path])),) for path in paths},
    )


@pytest.mark.usefixtures("analyzer")
@pytest.mark.parametrize("choice", ["auto", "both", "alloy"])
def test_out_of_scale_end_to_end(choice: str, large: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    options = ("--profile", "spec", "--at", AT, "--engine", choice, "--offline", "--output", f"json={report}")
    code, text = answer(large, *options)
    told = json.loads(report.read_text())
    assert told["engines"]["alloy"]["status"] == "out_of_scale"
    assert "after merging" in told["engines"]["alloy"]["reason"]
    assert told["engines"]["alloy"]["atoms"]["asked"] > MAX_ATOMS
    found = [finding for finding in told["findings"] if finding["name"] == "engine-out-of-scale"]
    assert [finding["severity"] for finding in found] == ["info"]
    statuses = {prop["status"] for prop in told["properties"]}
    if choice == "auto":
        assert code != 4
        assert "unknown" not in statuses
        assert "was not started, the model being too large for it" in "\n".join(text.splitlines()[:16])
    else:
        assert code == 4
    if choice == "alloy":
        assert statuses == {"unknown"}


@pytest.mark.usefixtures("analyzer")
def test_sizes_are_in_the_report(tmp_path: Path) -> None:
    robots = {f"/robot{n}": (rule((f"rt/robot{n}/odom",), ("rt/map",)),) for n in range(30)}
    keys = keystore(tmp_path / "keys", robots)
    (tmp_path / "one.p7s").write_bytes((keys / "enclaves/robot0/governance.p7s").read_bytes())
    for folder in (keys / "enclaves").iterdir():
        (folder / "governance.p7s").write_bytes((tmp_path / "one.p7s").read_bytes())
    options = ("--profile", "spec", "--at", AT, "--engine", "both", "--verbose")
    report = tmp_path / "report.json"
    _, text = answer(keys, *options, "--output", f"json={report}")
    atoms = json.loads(report.read_text())["engines"]["alloy"]["atoms"]
    assert atoms["keystore"] > 150
    assert atoms["asked"] < 60
    assert f"asked about {atoms['asked']} of {atoms['keystore']} atoms" in " ".join(text.split())
    assert json.loads(report.read_text())["engines"]["native"]["atoms"] is None
