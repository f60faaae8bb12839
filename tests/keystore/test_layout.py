"""Every layout that sros2 ever wrote, and the half-made ones."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from keystore_audit.errors import NothingToAudit
from keystore_audit.keystore import root as root_module
from keystore_audit.keystore.files import File, Status
from keystore_audit.keystore.layout import Layout, LayoutKind, Role, discover
from keystore_audit.keystore.root import Root
from tests.keystore.builder import certificate, flat, sros2


def read(path: Path) -> Layout:
    with Root.open(path) as opened:
        return discover(opened)


def paths(layout: Layout) -> list[str]:
    return [enclave.path for enclave in layout.enclaves]


def places(files: tuple[File, ...]) -> list[str]:
    return [file.path for file in files]


def test_root_enclave_nested_enclaves_and_namespaces(tmp_path: Path) -> None:
    layout = read(sros2(tmp_path / "k", ["/", "/a", "/a/b", "/ns/c/d"]))
    assert paths(layout) == ["/", "/a", "/a/b", "/ns/c/d"]
    assert [enclave.directory for enclave in layout.enclaves] == [
        "enclaves",
        "enclaves/a",
        "enclaves/a/b",
        "enclaves/ns/c/d",
    ]
    assert layout.enclaves[0].files[Role.GOVERNANCE].link is None
    assert Role.GOVERNANCE in layout.enclaves[0].unsigned


def test_a_deployed_tree_without_private_lacks_nothing(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k")
    shutil.rmtree(path / "private")
    layout = read(path)
    assert (layout.authority_keys, layout.expected) == ((), ())
    shutil.rmtree(path / "public")
    layout = read(path)
    assert len(layout.expected) == 2
    assert all(e.files[Role.IDENTITY_CA].status is Status.DANGLING for e in layout.enclaves)


PEM_OR_P11 = ("identity_ca.cert", "cert", "key", "permissions_ca.cert")
RUN_TIME = [f"{stem}.{form}" for stem in PEM_OR_P11 for form in ("pem", "p11")]


@pytest.mark.parametrize("name", [*RUN_TIME, "governance.p7s", "permissions.p7s"])
@pytest.mark.parametrize("dangling", [False, True])
def test_any_run_time_file_makes_an_enclave_below_enclaves(tmp_path: Path, name: str, dangling: bool) -> None:
    path = sros2(tmp_path / "k", ["/talker"])
    (path / "enclaves/ns/odd").mkdir(parents=True)
    if dangling:
        os.symlink("nowhere", path / "enclaves/ns/odd" / name)
    else:
        (path / "enclaves/ns/odd" / name).touch()
    assert paths(read(path)) == ["/ns/odd", "/talker"]
    own = name in ("cert.pem", "cert.p11", "key.pem", "key.p11", "permissions.p7s")
    shutil.move(path / "enclaves/ns/odd" / name, path / "enclaves" / (name if own else "x"))
    assert paths(read(path)) == (["/", "/talker"] if own else ["/talker"])


@pytest.mark.parametrize("name", ["crl.pem", "permissions.xml", "governance.xml", "README", "ca.cert.pem"])
def test_other_files_make_no_enclave(tmp_path: Path, name: str) -> None:
    path = sros2(tmp_path / "k", ["/talker"])
    (path / "enclaves/odd").mkdir()
    (path / "enclaves/odd" / name).touch()
    (path / "other").mkdir()
    (path / "other/cert.pem").touch()  # robots do not look beside enclaves/
    assert paths(read(path)) == ["/talker"]


def test_pkcs11_files_are_named_and_sealed(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/talker"])
    (path / "enclaves/talker/key.p11").write_text("pkcs11:object=x?pin-value=1234")
    (talker,) = read(path).enclaves
    assert set(talker.pkcs11) == {Role.KEY}
    assert talker.pkcs11[Role.KEY].status is Status.PRESENT
    assert talker.pkcs11[Role.KEY].content is None


def test_the_flat_layout_of_ardent_has_one_authority_for_both(tmp_path: Path) -> None:
    layout = read(flat(tmp_path / "k", ["talker", "listener"], ardent=True))
    assert layout.kind is LayoutKind.ARDENT
    for enclave in layout.enclaves:
        identity, permissions = enclave.files[Role.IDENTITY_CA], enclave.files[Role.PERMISSIONS_CA]
        assert identity is permissions
        assert identity.path == f"{enclave.directory}/ca.cert.pem"
        assert identity.status is Status.PRESENT


def test_one_folder_with_two_authorities_makes_the_layout_flat(tmp_path: Path) -> None:
    path = flat(tmp_path / "k", ["talker", "listener"], ardent=True)
    (path / "listener/identity_ca.cert.pem").write_bytes((path / "ca.cert.pem").read_bytes())
    layout = read(path)
    assert layout.kind is LayoutKind.FLAT
    assert layout.enclaves[1].files[Role.IDENTITY_CA].status is Status.MISSING


def test_nodes_called_public_private_and_enclaves_are_enclaves_in_a_flat_layout(tmp_path: Path) -> None:
    layout = read(flat(tmp_path / "k", ["public", "talker"]))
    assert paths(layout) == ["/public", "/talker"]
    layout = read(flat(tmp_path / "l", ["enclaves/talker", "listener"]))
    assert (layout.kind, paths(layout)) == (LayoutKind.FLAT, ["/enclaves/talker", "/listener"])
    assert "public/cert.pem" not in places(layout.authorities)


def test_the_folder_of_authorities_is_no_enclave(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k")
    (path / "enclaves").rename(path / "nodes")
    layout = read(path)
    assert layout.kind is LayoutKind.PARTIAL
    # `nodes` holds a governance.p7s: below a flat root that makes an enclave, here one that lacks the rest.
    assert paths(layout) == ["/nodes", "/nodes/listener", "/nodes/talker"]
    assert layout.expected


def test_a_single_enclave_s_folder(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/talker", "/talker/inner"], links=False)
    layout = read(path / "enclaves/talker")
    assert layout.kind is LayoutKind.ENCLAVE
    assert [(e.path, e.directory) for e in layout.enclaves] == [("/", "."), ("/inner", "inner")]
    assert (layout.authorities, layout.governance, layout.expected) == ((), None, ())
    ardent = read(flat(tmp_path / "a", ["talker"], ardent=True) / "talker")
    assert ardent.kind is LayoutKind.ENCLAVE
    assert ardent.enclaves[0].files[Role.PERMISSIONS_CA].path == "ca.cert.pem"
    assert ardent.authorities == ()


def test_the_folder_enclaves_given_alone_shows_its_links_as_leaving(tmp_path: Path) -> None:
    layout = read(sros2(tmp_path / "k") / "enclaves")
    assert paths(layout) == ["/listener", "/talker"]
    assert all(e.files[Role.IDENTITY_CA].status is Status.OUTSIDE for e in layout.enclaves)


def test_links_that_lead_out_from_where_enclaves_may_be_are_listed(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/talker"])
    (tmp_path / "outside").mkdir()
    (path / "shelf").mkdir()
    (path / "shelf/cert.pem").touch()
    (path / "enclaves/none").mkdir()
    for name, target in (
        ("inside", "../shelf"),
        ("circle", "."),
        ("outside", "../../outside"),
        ("absolute", "/etc"),
        ("file", "../public/ca.cert.pem"),
        ("dangling", "nowhere"),
        ("permissions.xml", "/etc"),  # whatever it is called: a robot that is told so takes it for an enclave
        ("ca.key.pem", "/etc"),
        ("certXpem", "/etc"),
        ("governance.xml", "/etc"),
        ("identity_ca.cert.pem", "/etc"),  # of no enclave
        ("talker/permissions.xml", "/etc"),
        ("talker/crl.pem", "/etc"),  # of one: a run time reads it
        ("none/permissions.xml", "/etc"),  # where there is no enclave, there is no document of one
    ):
        (path / "enclaves" / name).unlink(missing_ok=True)
        os.symlink(target, path / "enclaves" / name)
    os.symlink("/etc", path / "elsewhere")  # no robot looks there
    os.symlink("shelf", path / "also")
    layout = read(path)
    assert paths(layout) == ["/inside", "/talker"], "a link to a folder of the keystore is a way to it"
    assert {file.path: file.status for file in layout.directory_links} == {
        "enclaves/absolute": Status.OUTSIDE,
        "enclaves/ca.key.pem": Status.OUTSIDE,
        "enclaves/certXpem": Status.OUTSIDE,
        "enclaves/governance.xml": Status.OUTSIDE,
        "enclaves/identity_ca.cert.pem": Status.OUTSIDE,
        "enclaves/none/permissions.xml": Status.OUTSIDE,
        "enclaves/outside": Status.OUTSIDE,
        "enclaves/permissions.xml": Status.OUTSIDE,
        "enclaves/talker/permissions.xml": Status.OUTSIDE,
    }


def test_broken_enclaves_do_not_hide_others(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/a", "/b", "/c"])
    for name in ("cert.pem", "key.pem", "permissions.p7s"):
        (path / "enclaves/a" / name).unlink()
        (path / "enclaves/a" / name).mkdir()
    os.mkfifo(path / "enclaves/b/crl.pem")
    with (path / "enclaves/b/permissions.xml").open("wb") as stream:
        stream.truncate(10 * 1024**3)
    layout = read(path)
    assert paths(layout) == ["/a", "/b", "/c"]
    assert layout.enclaves[0].files[Role.KEY].status is Status.DIRECTORY
    assert layout.enclaves[1].files[Role.CRL].status is Status.SPECIAL
    assert layout.enclaves[1].unsigned[Role.PERMISSIONS].status is Status.TOO_LARGE


def test_names_that_are_no_utf8_and_names_that_look_alike_keep_apart(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/a"])
    for name in (b"caf\xe9", b"caf%E9", b"\x1b[31m", b"A", b"a b"):
        os.mkdir(bytes(path) + b"/enclaves/" + name)
        with open(bytes(path) + b"/enclaves/" + name + b"/cert.pem", "wb") as stream:
            stream.write(certificate("/x").pem)
    layout = read(path)
    assert paths(layout) == ["/%1B[31m", "/A", "/a", "/a b", "/caf%25E9", "/caf%E9"]
    assert all(enclave.files[Role.CERTIFICATE].status is Status.PRESENT for enclave in layout.enclaves)


def test_a_directory_over_the_limits_is_unreadable_and_never_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = sros2(tmp_path / "k", ["/a", "/b"])
    many = path / "enclaves/crowd"
    many.mkdir()
    for number in range(300):
        (many / str(number)).touch()
    (many / "cert.pem").touch()
    assert paths(read(path)) == ["/a", "/b", "/crowd"]
    monkeypatch.setattr(root_module, "MAX_ENTRIES", 200)
    layout = read(path)
    assert places(layout.unreadable_directories) == ["enclaves/crowd"]
    assert "more than 200 entries" in layout.unreadable_directories[0].detail
    assert paths(layout) == ["/a", "/b", "/crowd"]  # robots open its files by name, and so do we


def test_deep_directories_are_unreadable(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k", ["/a"])
    deep = path / "enclaves"
    for _ in range(130):
        deep = deep / "d"
    deep.mkdir(parents=True)
    layout = read(path)
    assert paths(layout) == ["/a"]
    assert places(layout.unreadable_directories) == ["enclaves/" + "/".join("d" * 128)]


def nothing(path: Path) -> str:
    with pytest.raises(NothingToAudit) as caught:
        read(path)
    assert caught.value.message.startswith(str(path))
    assert caught.value.message.endswith(".")
    return caught.value.message


def test_nothing_to_audit_says_what_was_expected_where(tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "is empty: expected a keystore" in nothing(empty)
    half = tmp_path / "half"
    for name in ("public", "private", "enclaves"):
        (half / name).mkdir(parents=True)
    assert "half-made keystore without any enclave" in nothing(half)
    none = sros2(tmp_path / "none", [])
    said = nothing(none)
    assert "is a keystore without any enclave" in said
    assert f"below {none}/enclaves" in said
    assert "cert.pem" in said
    other = tmp_path / "other"
    (other / "src").mkdir(parents=True)
    (other / "README").touch()
    assert "is no keystore" in nothing(other)
    assert "is no keystore" in nothing(flat(tmp_path / "flat", []))
    said = nothing_of_many(tmp_path)
    assert "holds 2 with enclaves/: name one of them (empty/k, none), or audit all with --recursive" in said
    for name in ("one", "two"):
        sros2(tmp_path / name, [])
    assert "holds 4 with enclaves/: name one of them (empty/k, none, one, ...), or" in nothing(tmp_path)


def nothing_of_many(tmp_path: Path) -> str:
    shutil.rmtree(tmp_path / "half")
    shutil.rmtree(tmp_path / "flat")
    sros2(tmp_path / "empty/k")
    return nothing(tmp_path)


def test_an_enclaves_folder_that_leads_out_is_said(tmp_path: Path) -> None:
    path = sros2(tmp_path / "k")
    (path / "enclaves").rename(tmp_path / "v2")
    os.symlink("../v2", path / "enclaves")
    assert "enclaves links to ../v2, outside the keystore" in nothing(path)
