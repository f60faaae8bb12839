"""KA119: modes of files and folders as they are on disk decide who may write what enclaves trust."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from tests.cli.keystores import AT, answer
from tests.keystore.builder import sros2

CA = "public/permissions_ca.cert.pem"
PERMISSIONS = "enclaves/talker/permissions.p7s"
PRIVATE = "the group of its owner"
STRANGERS = "a group of others"


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A keystore of two enclaves that the user who runs the tests owns, as does a group of that number."""
    root = sros2(tmp_path / "k", split=True)
    for place in (root, *root.rglob("*")):
        if not place.is_symlink():
            place.chmod(0o755 if place.is_dir() else 0o644)
    return root


def given_to(group: str, place: Path) -> None:
    """Give it to a group: to one of another number than the owner's only root may, or a member."""
    try:
        os.chown(place, -1, place.stat().st_uid + (group == STRANGERS))
    except PermissionError:
        pytest.skip("only root gives files to any group")


def found(root: Path, *options: str) -> list[tuple[str, list[str]]]:
    """Severity and places of each finding of KA119 in a tree that goes on a robot."""
    _code, out = answer("audit", "--engine", "native", "-f", "json", "--at", AT, "--deployed", *options, root)
    return rated(out)


def rated(report: str) -> list[tuple[str, list[str]]]:
    return [
        (each["severity"], [place["path"] for place in each["locations"]])
        for each in json.loads(report)["findings"]
        if each["code"] == "KA119"
    ]


@pytest.mark.parametrize(
    ("path", "mode", "group", "severity"),
    [
        (CA, 0o644, STRANGERS, None),
        (CA, 0o664, PRIVATE, None),
        (CA, 0o664, STRANGERS, "high"),
        (CA, 0o646, PRIVATE, "high"),
        (PERMISSIONS, 0o664, PRIVATE, None),
        (PERMISSIONS, 0o664, STRANGERS, "medium"),
        (PERMISSIONS, 0o666, PRIVATE, "medium"),
        ("enclaves/governance.p7s", 0o666, PRIVATE, "medium"),
        ("enclaves/talker/cert.pem", 0o666, PRIVATE, "medium"),
        (".", 0o775, PRIVATE, None),
        (".", 0o775, STRANGERS, "high"),
        (".", 0o777, PRIVATE, "high"),
        (".", 0o1777, PRIVATE, None),
        ("enclaves/talker", 0o777, PRIVATE, "high"),
        ("enclaves/talker", 0o1777, PRIVATE, "high"),
        ("public", 0o757, PRIVATE, "high"),
        ("enclaves/talker/permissions.xml", 0o666, PRIVATE, None),
    ],
)
def test_who_may_write_it(path: str, mode: int, group: str, severity: str | None, store: Path) -> None:
    place = store / path
    given_to(PRIVATE, place)
    assert found(store) == []
    given_to(group, place)
    place.chmod(mode)
    assert found(store) == ([] if severity is None else [(severity, [path])])


def test_where_keystores_are_made_it_weighs_a_step_less(store: Path) -> None:
    """GitLab checks out with umask 0 by default: no pipeline that ships nothing is stopped by that."""
    for path in (CA, PERMISSIONS):
        (store / path).chmod(0o666)
    code, out = answer("audit", "--engine", "native", "-f", "json", "--at", AT, store)
    assert rated(out) == [("medium", [CA]), ("low", [PERMISSIONS])]
    assert code == 0
    assert found(store) == [("high", [CA]), ("medium", [PERMISSIONS])]


def test_a_thousand_places_are_three_findings(store: Path) -> None:
    for place in (store, *store.rglob("*")):
        if not place.is_symlink():
            place.chmod(0o777 if place.is_dir() else 0o666)
    enclaves = ["enclaves/listener", "enclaves/talker"]
    own = [f"{enclave}/{name}" for enclave in enclaves for name in ("cert.pem", "permissions.p7s")]
    by_place = {places[0]: (severity, sorted(places)) for severity, places in found(store)}
    assert by_place.pop("public/identity_ca.cert.pem") == ("high", ["public/identity_ca.cert.pem", CA])
    assert by_place.pop(".") == ("high", [".", "enclaves", *enclaves, "public"])
    assert list(by_place.values()) == [("medium", sorted([*own, "enclaves/governance.p7s"]))]


def test_what_enclaves_have_copies_of_counts_by_each_copy(tmp_path: Path) -> None:
    root = sros2(tmp_path / "k", links=False)
    (root / "enclaves/talker/identity_ca.cert.pem").chmod(0o646)
    assert found(root) == [("high", ["enclaves/talker/identity_ca.cert.pem"])]


def test_a_folder_that_links_of_run_times_lead_over_counts(store: Path) -> None:
    (store / "notes").mkdir()
    (store / "notes").chmod(0o777)
    (store / "notes/ca.pem").symlink_to("../public/identity_ca.cert.pem")
    assert found(store) == []
    (store / "enclaves/talker/identity_ca.cert.pem").unlink()
    (store / "enclaves/talker/identity_ca.cert.pem").symlink_to("../../notes/ca.pem")
    assert found(store) == [("high", ["notes"])], "a link on the way is as good as the file"
