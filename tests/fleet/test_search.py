"""The keystores below a directory: each found once, and nothing passed over in silence."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.fleet.search import find_keystores
from keystore_audit.keystore.keystore import read_keystore

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
    assert names(tmp_path) == ["a/deep/er", "b/keys", "c"]
    assert names(tmp_path / "b/keys") == ["."]
    assert names(tmp_path / "c/logs") == []


paths = st.lists(
    st.tuples(st.lists(st.sampled_from(["a", "b", "enclaves"]), max_size=4), st.sampled_from((*RUN_TIME, "readme"))),
    max_size=6,
)


@given(paths)
def test_every_file_of_an_enclave_is_in_one_keystore(tmp_path_factory: pytest.TempPathFactory, files: list) -> None:  # type: ignore[type-arg]
    root = tmp_path_factory.mktemp("tree")
    for folders, name in files:
        root.joinpath(*folders).mkdir(parents=True, exist_ok=True)
        root.joinpath(*folders, name).touch()
    found = [Path(path) for path in find_keystores(str(root)).keystores]
    for folders, name in files:
        holders = [path for path in found if root.joinpath(*folders).is_relative_to(path)]
        if name in RUN_TIME or "enclaves" in folders:
            assert len(holders) == 1
    assert not [path for path in found for other in found if path != other and path.is_relative_to(other)]


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
