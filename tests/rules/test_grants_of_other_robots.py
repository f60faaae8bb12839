"""KA512 over several robots: whose the enclave is that a grant in another robot's document names."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.keystores import AT, answer
from tests.keystore.builder import PERMISSIONS, signed_document
from tests.rules.test_provisioning_rules import Fleet


@pytest.fixture(scope="module")
def fleet() -> Fleet:
    return Fleet()


def grants(fleet: Fleet, root: Path, *names: str) -> None:
    """The talker's document of a robot has a grant for each of these names, in this order."""
    head, end = PERMISSIONS.split("<grant ")[0], PERMISSIONS.split("</grant>")[1]
    grant = PERMISSIONS.removeprefix(head).removesuffix(end)
    text = head + "".join(grant.format(name=name) for name in names) + end
    (root / "enclaves/talker/permissions.p7s").write_bytes(signed_document(text.encode(), fleet.permissions))


def told(*roots: Path) -> list[list[dict[str, object]]]:
    """The findings of KA512 in the report of each."""
    _code, out = answer("audit", *roots, "--engine", "native", "--format", "json", "--at", AT)
    report = json.loads(out)
    return [[f for f in each["findings"] if f["code"] == "KA512"] for each in report.get("reports", [report])]


def test_a_grant_for_an_enclave_of_another_robot_says_whose_it_is(fleet: Fleet, tmp_path: Path) -> None:
    one, two = fleet.robot(tmp_path / "one", "/talker"), fleet.robot(tmp_path / "two", "/arm")
    grants(fleet, one, "/talker", "/arm")
    ((alone,),) = told(one)
    assert "also grants rights to 'CN=/arm': whoever" in str(alone["message"])
    (beside,), nothing = told(one, two)
    assert f"also grants rights to 'CN=/arm' (/arm in '{two}'): whoever" in str(beside["message"])
    assert nothing == []
    assert beside["fingerprint"] == alone["fingerprint"], "who accepted it alone accepts it beside others"
    assert [place["path"] for place in beside["locations"]] == [
        "enclaves/talker/permissions.p7s",
        f"{two}/enclaves/arm/cert.pem",
    ]


def test_an_enclave_that_nobody_here_trusts_is_another_one(fleet: Fleet, tmp_path: Path) -> None:
    one, stranger = fleet.robot(tmp_path / "one", "/talker"), Fleet().robot(tmp_path / "two", "/arm")
    grants(fleet, one, "/talker", "/arm")
    (found,), _nothing = told(one, stranger)
    assert "also grants rights to 'CN=/arm': whoever" in str(found["message"])


def test_the_document_of_another_robot_in_the_place_of_the_own_one(fleet: Fleet, tmp_path: Path) -> None:
    """Alone it could be a misspelt name; beside the other robot it is not."""
    one, two = fleet.robot(tmp_path / "one", "/talker"), fleet.robot(tmp_path / "two", "/arm")
    grants(fleet, one, "/arm")
    assert told(one) == [[]]
    (found,), _nothing = told(one, two)
    assert f"'CN=/arm' (/arm in '{two}')" in str(found["message"])
