"""The keystores below a directory: each found once, and nothing passed over in silence."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.errors import NothingToAudit
from keystore_audit.fleet.run import find_keystores
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.keystore.layout import discover
from keystore_audit.keystore.root import Root

RUN_TIME = ("cert.pem", "key.p11", "permissions.p7s", "governance.p7s", "identity_ca.cert.pem", "ca.cert.pem")


def names(directory: Path) -> list[str]:
    return [os.path.relpath(path, directory) for path in find_keystores(str(directory)).keystores]


def test_every_sample_is_found_once_and_is_one(repository: Path) -> None:
    folder = repository / "sample_keystores" / "healthy"
    found = find_keystores(str(folder))
    assert [Path(path).parent for path in found.keystores] == [folder] * len(found.keystores)
    assert len(found.keystores) == len([path for path in folder.iterdir() if path.is_dir()])
    for path in found.keystores:
        assert read_keystore(path).enclaves


def test_the_topmost_counts(tmp_path: Path) -> None:
    for folder in ("b/keys/enclaves/talker", "b/keys/backup/enclaves/talker", "a/deep/er/enclaves", "c/logs"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "c/cert.pem").touch()
    assert names(tmp_path) == ["a/deep/er", "b/keys", "b/keys/backup", "c"]
    assert names(tmp_path / "b/keys") == [".", "backup"]
    assert names(tmp_path / "c/logs") == []


def touch(root: Path, *paths: str) -> None:
    for path in paths:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).touch()


def test_keystores_and_enclaves_in_a_keystore_are_found_too(tmp_path: Path) -> None:
    whole = ("cert.pem", "key.p11", "permissions.p7s", "governance.p7s", "ca.cert.pem")
    touch(tmp_path, "enclaves/robot0/enclaves/talker/cert.pem", "public/ca.cert.pem", "private/ca.key.pem")
    touch(tmp_path, "public/robot1/enclaves/talker/cert.pem", "old/robot1/robot2/enclaves/listener/cert.pem")
    touch(tmp_path, *(f"old/talker/{name}" for name in whole))
    touch(tmp_path, *(f"old/half/{name}" for name in whole[1:]))
    touch(tmp_path, "old/documents/permissions.p7s", "old/documents/governance.p7s", "old/lone/cert.pem")  # of nobody
    assert names(tmp_path) == [".", "old/half", "old/robot1/robot2", "old/talker", "public/robot1"]


def test_a_keystore_laid_around_an_enclave_takes_no_audit_from_it(tmp_path: Path) -> None:
    """Whatever one of its files is missing: then its audit fails, and that is what somebody may want to hide."""
    for left_out in RUN_TIME:
        place = tmp_path / left_out
        touch(place, *(f"robot/{name}" for name in RUN_TIME if name != left_out))
        assert names(place) == ["robot"]
        touch(place, "enclaves/talker/cert.pem", "public/ca.cert.pem")
        assert names(place) == [".", "robot"]


def test_before_foxy_whatever_is_below_is_an_enclave(tmp_path: Path) -> None:
    """There `enclaves` is a namespace like another."""
    touch(tmp_path, "ca.cert.pem", "governance.p7s", "enclaves/talker/cert.pem", "robot1/enclaves/talker/cert.pem")
    assert names(tmp_path) == ["."]
    touch(tmp_path, "public/ca.cert.pem")
    assert names(tmp_path) == [".", "robot1"]


def test_a_link_out_of_a_keystore_is_said(tmp_path: Path) -> None:
    touch(tmp_path, "outside/enclaves/talker/cert.pem", "robot/enclaves/talker/cert.pem")
    for name in ("robot/robot1", "robot/public", "robot/private", "robot/enclaves/more"):
        (tmp_path / name).symlink_to(tmp_path / "outside")
    found = find_keystores(str(tmp_path / "robot"))
    assert found.keystores == (str(tmp_path / "robot"),)
    said = [os.path.relpath(path, tmp_path / "robot") for path, _reason in found.unseen]
    assert said == ["private", "public", "robot1"]  # the other is its audit's
    named = find_keystores(str(tmp_path / "robot"), beside=[str(tmp_path / "outside")])
    assert named.unseen == ()


paths = st.lists(
    st.tuples(st.lists(st.sampled_from(["a", "b", "enclaves"]), max_size=4), st.sampled_from((*RUN_TIME, "readme"))),
    max_size=6,
)


@given(paths)
def test_every_file_of_an_enclave_has_its_audit(tmp_path_factory: pytest.TempPathFactory, files: list) -> None:  # type: ignore[type-arg]
    root = tmp_path_factory.mktemp("tree")
    for folders, name in files:
        root.joinpath(*folders).mkdir(parents=True, exist_ok=True)
        root.joinpath(*folders, name).touch()
    found = [Path(path) for path in find_keystores(str(root)).keystores]
    for folders, name in files:
        holders = [path for path in found if root.joinpath(*folders).is_relative_to(path)]
        if name in RUN_TIME or "enclaves" in folders:
            assert holders
    for path in found:  # what an audit says that it does not judge is what has an audit of its own
        within = {other for other in found if path in other.parents}
        topmost = {other for other in within if not within.intersection(other.parents)}
        with suppress(NothingToAudit), Root.open(path) as opened:
            nested = {path / each.path for each in discover(opened).nested} - {path}  # an enclave in its root has none
            assert topmost <= nested
            assert all(within.intersection((each, *each.parents)) for each in nested)


def test_a_link_that_leads_out_is_said_and_one_within_is_not(tmp_path: Path) -> None:
    (tmp_path / "outside/enclaves").mkdir(parents=True)
    (tmp_path / "fleet/releases/12/enclaves").mkdir(parents=True)
    (tmp_path / "fleet/current").symlink_to("releases/12")
    (tmp_path / "fleet/other").symlink_to(tmp_path / "outside")
    found = find_keystores(str(tmp_path / "fleet"))
    assert found.keystores == (str(tmp_path / "fleet/releases/12"),)
    assert [path for path, _reason in found.unseen] == [str(tmp_path / "fleet/other")]


def test_a_link_of_which_nobody_knows_where_it_leads_is_said(tmp_path: Path) -> None:
    (tmp_path / "circle").symlink_to("circle")
    (tmp_path / "nowhere").symlink_to("gone")
    (tmp_path / "file").symlink_to(__file__)
    assert [path for path, _reason in find_keystores(str(tmp_path)).unseen] == [f"{tmp_path}/circle"]


def test_what_cannot_be_listed_is_said(tmp_path: Path) -> None:
    found = find_keystores(str(tmp_path / "nowhere"))
    assert (found.keystores, [path for path, _reason in found.unseen]) == ((), [str(tmp_path / "nowhere")])
