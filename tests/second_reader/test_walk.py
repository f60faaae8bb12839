"""The second reader's own walk: names, links and what is foreign."""

from __future__ import annotations

from pathlib import Path

from tests.second_reader.walk import Tree


def _write(root: Path, *files: str, **links: str) -> Tree:
    for path in files:
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(path)
    for path, target in links.items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).symlink_to(target)
    return Tree(root)


def _names(tree: Tree) -> list[str]:
    return [each.name for each in tree.enclaves]


def test_an_enclave_is_a_folder_with_one_of_the_six_files(tmp_path: Path) -> None:
    tree = _write(
        tmp_path, "enclaves/a/cert.pem", "enclaves/a/b/governance.p7s", "enclaves/c/crl.pem", "public/x/key.pem"
    )
    assert tree.layout == "sros2"
    assert _names(tree) == ["/a", "/a/b"]


def test_the_root_enclave_needs_a_file_of_its_own(tmp_path: Path) -> None:
    assert _names(_write(tmp_path, "enclaves/governance.p7s", "enclaves/a/key.pem")) == ["/a"]
    assert _names(_write(tmp_path, "enclaves/permissions.p7s")) == ["/", "/a"]


def test_links_are_followed_as_the_kernel_does(tmp_path: Path) -> None:
    links = {
        "enclaves/motor": "motor-v2",
        "enclaves/circle": "..",
        "enclaves/away": "/usr",
        "enclaves/motor-v2/key.pem": "../../private/deep/../k",
        "private/deep": "folder",
        "enclaves/motor-v2/crl.pem": "../../../elsewhere",
    }
    tree = _write(tmp_path, "enclaves/motor-v2/cert.pem", "k", "private/folder/x", **links)
    assert _names(tree) == ["/motor", "/motor-v2"]
    first, second = tree.enclaves
    assert first.files["cert"] == second.files["cert"]
    assert first.files["key"].missing  # private/deep/.. is private, where no k is
    assert first.files["crl"].unread
    (tmp_path / "private/k").write_text("key")
    assert Tree(tmp_path).enclaves[0].files["key"].place == "private/k"


def test_a_mounted_volume_is_one_enclave(tmp_path: Path) -> None:
    links = {"enclaves/a/..data": "..2026_11_23", "enclaves/a/cert.pem": "..data/cert.pem"}
    tree = _write(tmp_path, "enclaves/a/..2026_11_23/cert.pem", **links)
    assert _names(tree) == ["/a"]
    assert tree.enclaves[0].files["cert"].place == "enclaves/a/..2026_11_23/cert.pem"
    assert tree.foreign == ()


def test_foreign_is_what_neither_sros2_nor_the_plugins_know_by_place_and_name(tmp_path: Path) -> None:
    known = (
        "public/ca.cert.pem",
        "private/ca.key.pem",
        "enclaves/governance.xml",
        "enclaves/a/cert.pem",
        "enclaves/a/crl.pem",
    )
    foreign = (
        "README",
        "enclaves/a/cert.pem.bak",
        "private/ca.cert.pem",
        "public/old.cert.pem",
        "enclaves/a/ecdsaparam",
    )
    tree = _write(tmp_path, *known, *foreign, **{"enclaves/a/key.pem": "../../keys/a"})
    assert set(tree.foreign) == set(foreign)
    (tmp_path / "keys").mkdir()
    (tmp_path / "keys/a").write_text("where a known link leads")
    assert set(Tree(tmp_path).foreign) == set(foreign)


def test_older_layouts(tmp_path: Path) -> None:
    tree = _write(
        tmp_path,
        "ca.cert.pem",
        "governance.p7s",
        "ecdsaparam",
        "1000.pem",
        "talker/cert.pem",
        "talker/ca.cert.pem",
        "x",
    )
    assert tree.layout == "flat"
    (talker,) = tree.enclaves
    assert talker.name == "/talker"
    assert talker.files["identity_ca"].place == talker.files["permissions_ca"].place == "talker/ca.cert.pem"
    assert tree.foreign == ("x",)
