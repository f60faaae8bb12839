"""Links to directories are followed as the kernel does, within the roots, to one canonical file."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from keystore_audit.errors import NothingToAudit
from keystore_audit.keystore import root as root_module
from keystore_audit.keystore.files import Status
from keystore_audit.keystore.foreign import DeclaredFiles
from keystore_audit.keystore.keystore import Keystore, read_keystore
from keystore_audit.keystore.layout import Role
from tests.keystore.builder import sros2


def enclaves(keystore: Keystore) -> list[str]:
    return [each.path for each in keystore.enclaves]


def foreign(keystore: Keystore) -> list[str]:
    return [each.file.path for each in keystore.foreign]


def mounted(folder: Path) -> None:
    """Make the folder one as Kubernetes mounts it: names lead over `..data`, which is swapped at once."""
    data = folder / "..2026_11_23_10_00_00.123456"
    names = sorted(each.name for each in folder.iterdir())
    data.mkdir()
    for name in names:
        (folder / name).rename(data / name)
        (folder / name).symlink_to(f"..data/{name}")
    (folder / "..data").symlink_to(data.name)


def copied(tmp_path: Path, *paths: str) -> Path:
    return sros2(tmp_path / "k", [*paths], links=False)


def same_answers(one: Keystore, other: Keystore) -> None:
    for each, twin in zip(one.enclaves, other.enclaves, strict=True):
        assert each.path == twin.path
        assert {r: f.sha256 for r, f in each.files.files.items()} == {r: f.sha256 for r, f in twin.files.files.items()}


def test_a_mounted_secret_of_one_enclave_is_that_enclave(tmp_path: Path) -> None:
    path = copied(tmp_path, "/motor", "/talker")
    before = read_keystore(path)
    mounted(path / "enclaves/motor")
    after = read_keystore(path)
    same_answers(before, after)
    assert after.layout.directory_links == ()
    assert foreign(after) == []
    assert after.digest != before.digest


def test_a_mounted_volume_of_a_whole_keystore_is_that_keystore(tmp_path: Path) -> None:
    path = copied(tmp_path, "/motor", "/talker")
    before = read_keystore(path)
    mounted(path)
    after = read_keystore(path)
    same_answers(before, after)
    assert (foreign(after), after.layout.nested, after.layout.kind) == ([], (), before.layout.kind)
    assert [file.file.place for file in after.authorities] == [
        "..2026_11_23_10_00_00.123456/public/ca.cert.pem"
    ] * 1 + [each.file.place for each in after.authorities[1:]]


def test_what_else_lies_in_a_mounted_volume_is_foreign_and_read(tmp_path: Path) -> None:
    path = copied(tmp_path, "/motor", "/talker")
    mounted(path / "enclaves/motor")
    (volume,) = (path / "enclaves/motor").glob("..2026*")
    talker = path / "enclaves/talker"
    for name in ("cert.pem", "key.pem"):
        shutil.copy(talker / name, volume / f"other-{name}")
    shutil.rmtree(talker)
    keystore = read_keystore(path)
    assert foreign(keystore) == [f"enclaves/motor/{volume.name}/other-{name}" for name in ("cert.pem", "key.pem")]
    assert [each.certificate.path for each in keystore.identities.found] == [foreign(keystore)[0]]


def test_dots_alone_hide_no_enclave(tmp_path: Path) -> None:
    """Nothing leads over the link: these folders are no volume's."""
    path = copied(tmp_path, "/motor")
    shutil.copytree(path / "enclaves/motor", path / "enclaves/ns/..2026")
    (path / "enclaves/ns/..data").symlink_to("..2026")
    assert enclaves(read_keystore(path)) == ["/motor", "/ns/..2026", "/ns/..data"]


@pytest.fixture
def versions(tmp_path: Path) -> Path:
    path = copied(tmp_path, "/motor")
    (path / "enclaves/motor").rename(path / "enclaves/motor-v2")
    (path / "enclaves/motor").symlink_to("motor-v2")
    return path


def test_two_paths_to_one_folder_are_two_enclaves_of_one_identity(versions: Path) -> None:
    keystore = read_keystore(versions)
    assert enclaves(keystore) == ["/motor", "/motor-v2"]
    motor, again = keystore.enclaves
    assert motor.identity is again.identity
    assert motor.files.files[Role.KEY].resolved == "enclaves/motor-v2/key.pem"
    assert foreign(keystore) == []


def test_one_that_settings_call_an_alias_is_none(versions: Path) -> None:
    for alias, expected in (("/motor-v2", ["/motor"]), ("/motor", ["/motor-v2"])):
        keystore = read_keystore(versions, declared=DeclaredFiles(aliases=(alias,)))
        assert (enclaves(keystore), foreign(keystore)) == (expected, [])


@pytest.mark.parametrize("aliases", [("/motor", "/motor-v2"), ("/motor-v1",), ("/moto",)])
def test_an_alias_takes_no_enclave_away(aliases: tuple[str, ...], versions: Path) -> None:
    shutil.copytree(versions / "enclaves/motor-v2", versions / "enclaves/motor-v1")
    assert enclaves(read_keystore(versions, declared=DeclaredFiles(aliases=aliases))) == [
        "/motor",
        "/motor-v1",
        "/motor-v2",
    ]


def test_a_link_beside_enclaves_is_seen_where_it_leads(tmp_path: Path) -> None:
    path = copied(tmp_path, "/motor")
    (path / "maps/v2").mkdir(parents=True)
    (path / "maps/v2/map.yaml").write_text("a map")
    (path / "maps/latest").symlink_to("v2")
    keystore = read_keystore(path)
    assert foreign(keystore) == ["maps/latest", "maps/v2/map.yaml"]
    assert {each.top for each in keystore.foreign} == {"maps"}
    assert keystore.unread_foreign == ()


def test_circles_end(tmp_path: Path) -> None:
    path = copied(tmp_path, "/a", "/b")
    (path / "enclaves/a/up").symlink_to("..")
    (path / "enclaves/a/self").symlink_to(".")
    (path / "enclaves/a/b").symlink_to("../b")
    (path / "enclaves/b/a").symlink_to("../a")
    assert enclaves(read_keystore(path)) == ["/a", "/a/b", "/b", "/b/a"]


def test_ways_beyond_number_are_bounded_and_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = copied(tmp_path, "/a")
    for number in range(40):
        (path / f"enclaves/d{number}").mkdir()
        for name in "xy":
            (path / f"enclaves/d{number}" / name).symlink_to(f"../d{number + 1}")
    monkeypatch.setattr(root_module, "MAX_ENTRIES", 5_000)
    keystore = read_keystore(path)
    assert any("more than 5000 entries" in each.detail for each in keystore.layout.unreadable_directories)
    assert "/a" in enclaves(keystore)


def test_the_digest_covers_what_links_lead_to(tmp_path: Path) -> None:
    path = copied(tmp_path, "/motor")
    (path / "enclaves/motor").rename(path / "v2")
    (path / "enclaves/motor").symlink_to("../v2")
    before = read_keystore(path).digest
    (path / "v2/permissions.xml").write_text("<other/>")
    assert read_keystore(path).digest != before


# --- further roots


@pytest.fixture
def split(tmp_path: Path) -> tuple[Path, Path]:
    """A keystore whose enclave is on a read-only image."""
    path, image = copied(tmp_path, "/motor"), tmp_path / "image"
    image.mkdir()
    (path / "enclaves/motor").rename(image / "motor")
    (path / "enclaves/motor").symlink_to(image / "motor")
    return path, image


def test_a_path_out_of_the_roots_is_unknown(split: tuple[Path, Path]) -> None:
    with pytest.raises(NothingToAudit):
        read_keystore(split[0])
    shutil.copytree(split[1] / "motor", split[0] / "enclaves/other")
    keystore = read_keystore(split[0])
    assert [(file.path, file.status) for file in keystore.layout.directory_links] == [
        ("enclaves/motor", Status.OUTSIDE)
    ]


def test_a_root_that_is_named_may_be_led_into(split: tuple[Path, Path]) -> None:
    path, image = split
    declared = DeclaredFiles(roots=(str(image),))
    keystore = read_keystore(path, declared=declared)
    assert (enclaves(keystore), keystore.layout.directory_links, foreign(keystore)) == (["/motor"], (), [])
    assert keystore.enclaves[0].files.files[Role.KEY].status is Status.PRESENT
    assert ("enclaves/motor/permissions.p7s", keystore.enclaves[0].files.files[Role.PERMISSIONS].sha256) in {
        *keystore.contents
    }
    (image / "motor/notes").write_text("x")
    again = read_keystore(path, declared=declared)
    assert (foreign(again), again.digest != keystore.digest) == (["enclaves/motor/notes"], True)


def test_a_single_file_in_another_root(split: tuple[Path, Path], tmp_path: Path) -> None:
    path, image = split
    shutil.copytree(image / "motor", path / "enclaves/talker")
    own = path / "enclaves/talker/permissions.p7s"
    own.rename(image / "talker.p7s")
    own.symlink_to("../../../image/talker.p7s")
    read = read_keystore(path, declared=DeclaredFiles(roots=(str(image),)))
    talker = next(each for each in read.enclaves if each.path == "/talker")
    assert talker.files.files[Role.PERMISSIONS].status is Status.PRESENT
    (image / "talker.p7s").write_bytes(b"x")
    assert read_keystore(path, declared=read.declared).digest != read.digest
    (image / "deeper").symlink_to(tmp_path.parent)
    (path / "enclaves/out").symlink_to("../../image/deeper")
    again = read_keystore(path, declared=read.declared)
    assert [file.path for file in again.layout.directory_links] == ["enclaves/out"]


def test_a_root_that_is_not_there_is_said(split: tuple[Path, Path]) -> None:
    with pytest.raises(NothingToAudit, match="nowhere does not exist"):
        read_keystore(split[0], declared=DeclaredFiles(roots=(os.fspath(split[1] / "nowhere"),)))
