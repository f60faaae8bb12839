"""The commands of remedies do what they are given for: typed into a copy of a sample, they end the finding."""

from __future__ import annotations

import json
import os
import re
import shutil
import ssl
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from keystore_audit.keystore.layout import LayoutKind
from keystore_audit.rules import BY_CODE, RULES
from keystore_audit.rules.commands import COPIES, are_copied, for_layout
from tests.cli.keystores import answer
from tools.samples.store import copy_with_modes

STOCK = "stock/talker_listener"
ENCLAVES = ("/listener", "/talker")
TYPED = re.compile(r"(openssl|mkdir|mv|ln|touch|printf|rm) ")


@pytest.fixture
def stock(repository: Path, tmp_path: Path) -> Path:
    """A keystore as `ros2 security` makes it: one CA, and both roles links to it."""
    root = tmp_path / "keystore"
    copy_with_modes(repository / "sample_keystores" / STOCK, root, 0o600)
    return root


def commands(code: str) -> list[str]:
    """The commands for a shell that the rule's remedy gives, in its order."""
    return typed(BY_CODE[code].remedy)


def typed(remedy: str) -> list[str]:
    """The commands for a shell in a remedy."""
    return [each for each in remedy.split("`")[1::2] if TYPED.match(each)]


def type_in(root: Path, command: str, words: Mapping[str, str] | None = None) -> str:
    """Run a command as printed, with its capitals replaced; what it printed."""
    for word, meant in (words or {}).items():
        command = re.sub(rf"\b{word}\b|{word}(?=_)", lambda _found, meant=meant: meant, command)
    done = subprocess.run(["sh", "-ec", command], cwd=root, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, f"{command}\n{done.stderr}"
    return done.stdout


def found(root: Path) -> list[dict[str, Any]]:
    """What an audit finds now."""
    _exit_code, report = answer("audit", root, "--engine", "native", "--format", "json")
    findings: list[dict[str, Any]] = json.loads(report)["findings"]
    return findings


def codes(root: Path) -> set[str]:
    """The codes of what an audit finds now."""
    return {finding["code"] for finding in found(root)}


def sign(root: Path, code: str) -> None:
    """Sign what is there with the commands of the rule's remedy, permissions for each enclave."""
    for command in commands(code):
        if "smime -sign" in command:
            for enclave in ENCLAVES if "ENCLAVE" in command else ("",):
                type_in(root, command, {"ENCLAVE": enclave})


def test_a_second_authority_takes_nothing_from_the_first(stock: Path) -> None:
    """Both names of the permissions CA are links to the one CA: written through them, its key would be gone."""
    kept = {path: path.read_bytes() for path in (stock / "private/ca.key.pem", stock / "public/ca.cert.pem")}
    before = codes(stock)
    assert {"KA222", "KA705", "KA722", "KA723"} <= before
    making = [command for command in commands("KA222") if "smime" not in command]
    for command in making:
        type_in(stock, command)
        assert {path: path.read_bytes() for path in kept} == kept, command
    sign(stock, "KA222")
    after = codes(stock)
    assert not after & {"KA222", "KA705", "KA706", "KA722", "KA723"}
    assert after <= before


def test_an_identity_is_issued_without_ros2(stock: Path) -> None:
    (command,) = commands("KA209")
    before = codes(stock)
    for enclave in ENCLAVES:
        for name in ("cert.pem", "key.pem"):
            (stock / "enclaves" / enclave[1:] / name).unlink()
        type_in(stock, command, {"ENCLAVE": enclave, "NAME": enclave.replace("/", r"\/")})
    assert codes(stock) == {*before, "KA513"}  # a year, as KA665 asks for, is less than the sample's grants last


AGAIN = re.compile("ign (it|the document|the governance) again")


@pytest.mark.parametrize("code", [rule.code for rule in RULES if AGAIN.search(rule.remedy)])
def test_whoever_is_to_sign_again_is_told_by_which_command(code: str) -> None:
    assert [each for each in commands(code) if each.startswith("rm -f signed.new && openssl smime -sign -text ")]


@pytest.mark.parametrize("code", ["KA213", "KA214", "KA229"])
def test_a_revocation_list_is_made_and_revokes(code: str, stock: Path) -> None:
    start, touch, revoke, make = commands(code)
    before = codes(stock)
    for command in (start, touch, make):
        type_in(stock, command)
    (stock / "enclaves/talker/crl.pem").write_bytes((stock / "crl.pem").read_bytes())
    assert codes(stock) == {*before, "KA121", "KA215"}  # a good list, which one enclave alone has, and what made it
    type_in(stock, revoke, {"ENCLAVE": "/listener"})
    type_in(stock, make)
    for enclave in ("talker", "listener"):
        (stock / "enclaves" / enclave / "crl.pem").write_bytes((stock / "crl.pem").read_bytes())
    assert codes(stock) - before >= {"KA212"}
    assert not codes(stock) & {"KA213", "KA214", "KA215", "KA229"}


def test_the_subject_is_printed_as_grants_have_it(stock: Path) -> None:
    show, again = commands("KA503")
    words = {"ENCLAVE": "/talker"}
    document = stock / "enclaves/talker/permissions.xml"
    right = document.read_text()
    document.write_text(right.replace("CN=/talker", "CN=/another"))
    type_in(stock, again, words)
    assert "KA503" in codes(stock)
    document.write_text(document.read_text().replace("CN=/another", type_in(stock, show, words).strip()))
    assert document.read_text() == right
    type_in(stock, again, words)
    assert "KA503" not in codes(stock)


@pytest.mark.parametrize("name", ["identity_ca.cert.pem", "permissions_ca.cert.pem", "governance.p7s"])
@pytest.mark.parametrize(("target", "code"), [("../../gone", "KA102"), ("/etc/hostname", "KA103")])
def test_a_link_that_leads_elsewhere_is_made_again(name: str, target: str, code: str, stock: Path) -> None:
    link = stock / "enclaves/talker" / name
    meant, before = link.readlink(), codes(stock)
    link.unlink()
    link.symlink_to(target)
    (said,) = [each for each in found(stock) if each["code"] == code]
    (command,) = typed(said["remedy"])
    type_in(stock, command, {"ENCLAVE": "/talker"})
    assert link.readlink() == meant
    assert codes(stock) == before


@pytest.mark.parametrize("name", ["identity_ca.cert.pem", "governance.p7s"])
@pytest.mark.parametrize("absolute", [True, False])
def test_a_link_by_the_place_of_the_keystore_is_made_one_that_goes_with_it(
    name: str, absolute: bool, stock: Path
) -> None:
    """Copied, the keystore had another file there, or none."""
    before = codes(stock)
    link = stock / "enclaves/talker" / name
    meant, there = link.readlink(), link.parent.joinpath(link.readlink())
    link.unlink()
    link.symlink_to(os.path.normpath(there) if absolute else f"../../../{stock.name}/{os.path.relpath(there, stock)}")
    (said,) = [each for each in found(stock) if each["code"] == "KA120"]
    deployed = json.loads(answer("audit", stock, "--engine", "native", "--deployed", "-f", "json")[1])["findings"]
    worth = [each["severity"] for each in deployed if each["code"] == "KA120"]
    assert (said["severity"], worth, said["enclave"]) == ("medium", ["high"], "/talker")
    copy = stock.with_name("copy")
    shutil.copytree(stock, copy, symlinks=True)
    assert "KA103" in codes(copy)
    (command,) = typed(said["remedy"])
    type_in(stock, command, {"ENCLAVE": "/talker"})
    assert link.readlink() == meant
    assert codes(stock) == before


@pytest.mark.parametrize("absolute", [True, False])
def test_a_link_by_the_place_of_the_keystore_that_others_lead_over_is_told_once(absolute: bool, stock: Path) -> None:
    """All enclaves have their governance over it: the tree passed with --deployed, and its copy had none."""
    link, kept = stock / "enclaves/governance.p7s", stock / "enclaves/kept.p7s"
    link.rename(kept)
    link.symlink_to("kept.p7s")
    assert "KA120" not in codes(stock)
    link.unlink()
    link.symlink_to(kept if absolute else f"../../{stock.name}/enclaves/kept.p7s")
    (said,) = [each for each in found(stock) if each["code"] == "KA120"]
    assert (said["enclave"], said["locations"][0]["path"]) == (None, "enclaves/governance.p7s")
    copy = stock.with_name("copy")
    shutil.copytree(stock, copy, symlinks=True)
    assert "KA103" in codes(copy)


def test_a_link_to_what_nobody_shares_is_made_a_file(stock: Path) -> None:
    before = codes(stock)
    link = stock / "enclaves/talker/permissions.p7s"
    link.unlink()
    link.symlink_to("../../gone")
    (said,) = [each for each in found(stock) if each["code"] == "KA102"]
    (command,) = typed(said["remedy"])
    type_in(stock, command, {"ENCLAVE": "/talker"})
    assert codes(stock) == before


def test_a_renewed_authority_goes_on_vouching(stock: Path) -> None:
    """One CA has both roles here: signatures name its old certificate until the documents are signed again."""
    before = codes(stock)
    (renew,) = commands("KA208")
    type_in(stock, renew, {"ROLE": "identity", "NAME": "sros2CA"})
    assert (stock / "public/identity_ca.cert.pem").is_symlink()
    assert "KA316" in codes(stock) - before
    sign(stock, "KA222")
    assert codes(stock) == before


def test_an_authority_that_does_not_load_is_renewed(stock: Path) -> None:
    """Fast DDS loads no CA that is signed over SHA-384 (measured)."""
    before = codes(stock)
    renew, _issue = commands("KA117")
    type_in(stock, renew.replace("-sha256", "-sha384"), {"ROLE": "permissions", "NAME": "sros2CA"})
    sign(stock, "KA222")
    said = [each["remedy"] for each in found(stock) if each["code"] == "KA117"]
    assert [typed(remedy) for remedy in said] == [[renew], [renew]], "and no identity is issued again"
    type_in(stock, renew, {"ROLE": "permissions", "NAME": "sros2CA"})
    sign(stock, "KA222")
    assert codes(stock) == before


@pytest.mark.parametrize("document", ["governance", "/talker/permissions"])
def test_a_document_is_signed_again(document: str, stock: Path) -> None:
    before = codes(stock)
    signed = stock / f"enclaves/{document}.p7s"
    signed.write_bytes(signed.read_bytes().replace(b"<dds", b"<dds "))
    assert "KA303" in codes(stock)
    for code in ("KA303", "KA703"):
        (command,) = commands(code)
        type_in(stock, command, {"DOCUMENT": document})
    assert codes(stock) == before


@pytest.mark.parametrize(
    ("document", "today", "old", "severity"),
    [
        # Both vendors read permissions in another order as meant: measured_local.json.
        ("talker/permissions", r"( +<publish>.*?</publish>\n)( +<subscribe>.*?</subscribe>\n)", r"\2\1", "medium"),
        ("governance", r" +<enable_liveliness_protection>\w+</enable_liveliness_protection>\n", "", "high"),
    ],
)
def test_a_document_of_the_older_form_gets_that_of_today(
    document: str, today: str, old: str, severity: str, stock: Path
) -> None:
    before = codes(stock)
    unsigned = stock / f"enclaves/{document}.xml"
    right = unsigned.read_text()
    for text in (re.sub(today, old, right, count=1, flags=re.DOTALL), right):
        unsigned.write_text(text)
        (command,) = [each for each in commands("KA421") if ("governance" in each) is (document == "governance")]
        type_in(stock, command, {"ENCLAVE": "/talker"})
        said = [(each["severity"], typed(each["remedy"])) for each in found(stock) if each["code"] == "KA421"]
        assert said == ([] if text == right else [(severity, [command])])
    assert codes(stock) == before


def test_an_unsigned_document_is_made_what_is_signed(stock: Path) -> None:
    before = codes(stock)
    unsigned = stock / "enclaves/talker/permissions.xml"
    changed = unsigned.read_text().replace("rt/chatter", "rt/chat")
    again, show = commands("KA110")
    unsigned.write_text(changed)
    assert "KA110" in codes(stock)
    unsigned.write_text(type_in(stock, show, {"DOCUMENT": "/talker/permissions"}))
    assert codes(stock) == before
    unsigned.write_text(changed)
    type_in(stock, again, {"DOCUMENT": "/talker/permissions"})
    assert "KA110" not in codes(stock)


@pytest.mark.parametrize(
    "name", ["governance.p7s", "permissions.p7s", "identity_ca.cert.pem", "permissions_ca.cert.pem", "cert.pem"]
)
def test_a_missing_file_is_made_and_permissions_stay(name: str, stock: Path) -> None:
    """create_enclave would put permissions that allow everything over those there are."""
    before = codes(stock)
    permissions = (stock / "enclaves/talker/permissions.xml").read_bytes()
    (stock / "enclaves/talker" / name).unlink()
    (remedy,) = [each["remedy"] for each in found(stock) if each["code"] == "KA101"]
    if name == "cert.pem":
        (stock / "enclaves/talker/key.pem").unlink()
    (command,) = typed(remedy)
    type_in(stock, command, {"ENCLAVE": "/talker", "NAME": r"\/talker"})
    assert codes(stock) - {"KA513"} == before
    assert (stock / "enclaves/talker/permissions.xml").read_bytes() == permissions


def test_an_enclave_of_which_there_is_nothing_is_created(stock: Path) -> None:
    for each in (stock / "enclaves/talker").iterdir():
        if each.name != "key.pem":
            each.unlink()
    remedies = {each["remedy"] for each in found(stock) if each["code"] == "KA101"}
    assert [each.partition(",")[0] for each in remedies] == [
        "Make what is missing: `ros2 security create_enclave KEYSTORE ENCLAVE`"
    ]


def test_the_governance_of_the_root_enclave_is_no_link(stock: Path) -> None:
    """The others link to it."""
    before = codes(stock)
    root = stock / "enclaves"
    for each in (root / "talker").iterdir():
        if each.name != "governance.p7s":
            each.rename(root / each.name)
    for name in ("identity_ca.cert.pem", "permissions_ca.cert.pem"):
        (root / name).unlink()
        (root / name).symlink_to(f"../public/{name}")
    shutil.rmtree(root / "talker")
    (root / "governance.p7s").unlink()
    (remedy,) = [each["remedy"] for each in found(stock) if each["code"] == "KA101"]
    (command,) = typed(remedy)
    type_in(stock, command)
    assert codes(stock) == before | {"KA220"}


def test_an_authority_whose_key_went_on_robots_is_made_again(stock: Path) -> None:
    """The one CA has both roles, and so have its successors: whoever has its key has nothing then."""
    before = codes(stock)
    leaked = stock / "enclaves/talker/ca.key.pem"
    copy_with_modes(stock / "private", stock / "old", 0o600)
    leaked.write_bytes((stock / "private/ca.key.pem").read_bytes())
    (remedy,) = [each["remedy"] for each in found(stock) if each["code"] == "KA118"]
    leaked.unlink()
    shutil.rmtree(stock / "old")
    for command in typed(remedy):
        for enclave in ENCLAVES if "ENCLAVE" in command else ("",):
            type_in(stock, command, {"ENCLAVE": enclave, "NAME": enclave.replace("/", r"\/")})
    assert codes(stock) == before - {"KA222", "KA705", "KA706", "KA722", "KA723"} | {"KA513"}
    for role in ("identity", "permissions"):
        assert not (stock / f"public/{role}_ca.cert.pem").is_symlink()


def test_an_enclave_that_was_renamed_gets_its_name_or_its_rights_back(stock: Path) -> None:
    """Another identity alone would be named by no grant: a note would become an enclave that does not start."""
    before = codes(stock)
    folder = stock / "enclaves/chatter"
    (stock / "enclaves/talker").rename(folder)
    assert codes(stock) == before | {"KA220"}
    sign_it, issue = commands("KA220")
    assert BY_CODE["KA220"].remedy.startswith("If the enclave's folder was renamed, give it its old name again.")
    for name in ("cert.pem", "key.pem"):
        (folder / name).unlink()
    type_in(stock, issue, {"ENCLAVE": "/chatter", "NAME": r"\/chatter"})
    assert "KA503" in codes(stock)
    document = folder / "permissions.xml"
    document.write_text(document.read_text().replace("CN=/talker", "CN=/chatter"))
    type_in(stock, sign_it, {"ENCLAVE": "/chatter"})
    assert codes(stock) == before | {"KA513"}


@pytest.mark.parametrize("document", ["enclaves/governance", "enclaves/talker/permissions"])
def test_the_document_that_names_the_wrong_domain_is_signed_again(document: str, stock: Path) -> None:
    before = codes(stock)
    unsigned = stock / f"{document}.xml"
    right = unsigned.read_text()
    (command,) = [each for each in commands("KA508") if each.count("governance") == document.count("governance") * 2]
    for text, there in ((right.replace("<id>0</id>", "<id>7</id>"), True), (right, False)):
        unsigned.write_text(text)
        type_in(stock, command, {"ENCLAVE": "/talker"})
        assert ("KA508" in codes(stock)) is there
    assert codes(stock) == before


def test_another_governance_gives_way_to_that_of_the_others(stock: Path) -> None:
    before = codes(stock)
    own = stock / "enclaves/talker/governance.p7s"
    own.unlink()
    shared = stock / "enclaves/governance.xml"
    right = shared.read_text()
    shared.write_text(re.sub("<id>0</id>", "<id>7</id>", right))
    (sign_it,) = commands("KA408")
    type_in(stock, sign_it.replace(" enclaves/governance.p7s", " enclaves/talker/governance.p7s"))
    shared.write_text(right)
    assert {"KA416", "KA508"} <= codes(stock)
    (link,) = commands("KA416")
    type_in(stock, link, {"ENCLAVE": "/talker"})
    assert codes(stock) == before
    assert "KA416" in BY_CODE["KA508"].remedy


@pytest.mark.parametrize("code", ["KA222", "KA301", "KA302", "KA303"])
def test_who_signs_what_others_may_have_written_is_told_to_read_it(code: str) -> None:
    """The unsigned files are signed as they are, with edits that nobody signed."""
    before, _, _ = BY_CODE[code].remedy.partition("KA110" if code == "KA222" else "`openssl smime")
    assert re.search("[Rr]ead ", before), code


@pytest.mark.parametrize("kind", LayoutKind)
def test_commands_for_another_layout_say_so(kind: LayoutKind) -> None:
    """In a flat keystore there are no folders of these names, and openssl finds nothing."""
    told = "The commands are for the layout since Foxy, which this keystore does not have (KA115). "
    older = kind in (LayoutKind.FLAT, LayoutKind.ARDENT)
    for code, in_folders in (("KA222", True), ("KA209", True), ("KA108", False), ("KA115", False)):
        remedy = BY_CODE[code].remedy
        assert for_layout(remedy, kind) == (f"{told}{remedy}" if older and in_folders else remedy)


def test_a_flat_keystores_findings_say_whose_layout_the_commands_are_for(stock: Path) -> None:
    flat = stock.parent / "flat"
    shutil.copytree(stock / "enclaves", flat)
    shutil.copy(stock / "public/ca.cert.pem", flat)
    for root, says in ((stock, False), (flat, True)):
        (remedy,) = {each["remedy"] for each in found(root) if each["code"] == "KA222"}
        assert remedy.startswith("The commands are for the layout since Foxy") is says


@pytest.mark.parametrize("names", [("identity_ca.cert.pem", "permissions_ca.cert.pem"), ("ca.cert.pem",)])
def test_an_older_keystore_is_given_the_layout_of_today(names: tuple[str, ...], stock: Path) -> None:
    """Of Crystal to Eloquent, and of Ardent and Bouncy: files in the root, and copies in every enclave."""
    after = codes(stock)
    flat = stock.parent / "flat"
    shutil.copytree(stock / "enclaves", flat)
    for enclave in ENCLAVES:
        for role in ("identity", "permissions"):
            (flat / enclave[1:] / f"{role}_ca.cert.pem").unlink()
        for name in names:
            shutil.copy(stock / "public/ca.cert.pem", flat / enclave[1:] / name)
    shutil.copy(stock / "public/ca.cert.pem", flat)
    shutil.copy(stock / "private/ca.key.pem", flat)
    assert "KA115" in codes(flat)
    for command in commands("KA115"):
        for enclave in ENCLAVES if "ENCLAVE" in command or "FOLDER" in command else ("",):
            for role in ("identity", "permissions") if "ROLE" in command else ("",):
                type_in(flat, command, {"ENCLAVE": enclave, "FOLDER": enclave[1:], "ROLE": role})
    assert codes(flat) - {"KA121"} == after  # of Ardent, ca.cert.pem stays in the folders


def test_whoever_is_told_to_create_an_enclave_is_told_of_its_permissions() -> None:
    """create_enclave writes permissions that allow everything, also where there were others."""
    for rule in RULES:
        if "`ros2 security create_enclave KEYSTORE ENCLAVE`" in rule.remedy:
            behind = rule.remedy.split("create_enclave", 1)[1]
            assert "`ros2 security create_permission KEYSTORE ENCLAVE policy.xml`" in behind, rule.code


def test_one_command_signs_from_the_root() -> None:
    """Where the files lie is the same in every remedy."""
    for rule in RULES:
        for command in rule.remedy.split("`")[1::2]:
            if "smime -sign" in command:
                keys = "-signer public/permissions_ca.cert.pem -inkey private/permissions_ca.key.pem"
                told = rf" -in (enclaves/\S+)\.xml -out signed\.new {keys} && mv signed\.new \1\.p7s$"
                assert re.search(told, command), rule.code


@pytest.mark.parametrize("key", [None, b"another"])
def test_what_cannot_be_signed_stays_what_it_was(stock: Path, key: bytes | None) -> None:
    """openssl empties its output before it looks at the key, which robots do not have."""
    document = stock / "enclaves/governance.p7s"
    before = document.read_bytes()
    (stock / "private/ca.key.pem").unlink()
    if key is not None:
        (stock / "private/ca.key.pem").write_bytes(key)
    (sign_it,) = commands("KA408")
    assert subprocess.run(["sh", "-c", sign_it], cwd=stock, capture_output=True, check=False, timeout=60).returncode
    assert document.read_bytes() == before


@pytest.mark.parametrize(
    ("code", "folder", "names"),
    [
        ("KA408", "", ("signed.new",)),
        ("KA222", "", ("signed.new", "private/new.key.pem", "public/new.cert.pem")),
        ("KA211", "enclaves/talker", ("new.pem",)),
    ],
)
def test_what_is_written_first_follows_no_link(code: str, folder: str, names: Sequence[str], stock: Path) -> None:
    """A keystore of somebody else may hold one, to a file that runs what the document says, or that others read."""
    mine = stock.with_name("mine")
    mine.write_text("mine")
    for name in names:
        (stock / folder / name).symlink_to(mine)
    for command in commands(code):
        type_in(stock / folder, command, {"ENCLAVE": "/talker"})
    assert mine.read_text() == "mine"
    assert not [path for path in stock.rglob("*") if path.is_symlink() and path.resolve() == mine]


def test_where_enclaves_have_copies_what_is_signed_again_has_to_get_there(stock: Path, tmp_path: Path) -> None:
    """The command writes enclaves/governance.p7s, and nobody reads that one."""
    copies = tmp_path / "copies"
    shutil.copytree(stock, copies)
    remedies = [{each["remedy"] for each in found(root) if each["code"] == "KA408"} for root in (stock, copies)]
    assert remedies == [{BY_CODE["KA408"].remedy}, {f"{BY_CODE['KA408'].remedy} {COPIES}"}]
    for code, path, told in (
        ("KA209", "enclaves/a/governance.p7s", False),
        ("KA222", "enclaves/a/permissions_ca.cert.pem", True),
        ("KA222", "public/ca.cert.pem", False),
        ("KA301", "enclaves/governance.p7s", False),
        ("KA301", "enclaves/a/governance.p7s", True),
        ("KA301", "enclaves/a/permissions.p7s", False),
    ):
        remedy = BY_CODE[code].remedy
        said = for_layout(remedy, LayoutKind.SROS2, [path], copies=are_copied([path]))
        assert said == (f"{remedy} {COPIES}" if told else remedy)


def test_a_copy_of_one_enclave_is_told_wherever_files_of_all_are_made(stock: Path) -> None:
    """The finding may be told at what the others have."""
    (stock / "enclaves/talker/permissions_ca.cert.pem").unlink()
    assert not [each for each in found(stock) if COPIES in each["remedy"]], "there is nothing"
    shutil.copy(stock / "public/permissions_ca.cert.pem", stock / "enclaves/talker")
    told = {each["code"] for each in found(stock) if COPIES in each["remedy"]}
    assert told == {"KA222", "KA230", "KA408", "KA722", "KA723", "KA724"}


def test_authorities_that_stand_for_each_other_are_exchanged_and_nothing_is_signed(
    repository: Path, tmp_path: Path
) -> None:
    """To sign or issue anything again would fail: the keys belong to the other certificates."""
    root = tmp_path / "keystore"
    copy_with_modes(repository / "sample_keystores/healthy/talker_listener", root, 0o600)
    before = codes(root)
    identity, permissions = (root / f"public/{role}_ca.cert.pem" for role in ("identity", "permissions"))
    first, second = identity.read_bytes(), permissions.read_bytes()
    identity.write_bytes(second)
    permissions.write_bytes(first)
    told = [each for each in found(root) if each["code"] in ("KA207", "KA301")]
    assert sorted(each["code"] for each in told) == ["KA207", "KA207", "KA301", "KA301", "KA301"]
    assert len({each["remedy"] for each in told}) == 1
    said = " The files of the two authorities hold each other's certificate."
    assert all(each["message"].endswith(said) for each in told)
    for command in typed(told[0]["remedy"]):
        type_in(root, command)
    assert codes(root) == before
    permissions.write_bytes(first)
    assert not any(said in each["message"] for each in found(root)), "one of them alone is another mistake"


def test_copies_that_stand_for_each_other_are_exchanged_and_not_what_public_has(
    repository: Path, tmp_path: Path
) -> None:
    root = tmp_path / "keystore"
    copy_with_modes(repository / "sample_keystores/healthy/talker_listener", root, 0o600)
    for folder in (root / "enclaves").glob("*/"):
        for name, other in (("identity", "permissions"), ("permissions", "identity")):
            (folder / f"{name}_ca.cert.pem").unlink()
            shutil.copy(root / f"public/{other}_ca.cert.pem", folder / f"{name}_ca.cert.pem")
    told = [each for each in found(root) if each["code"] in ("KA207", "KA301")]
    assert len(told) == 5
    for each in told:
        assert "The files of the two authorities hold each other's certificate." in each["message"]
        assert "in the folders of the enclaves" in each["remedy"]
        assert "`" not in each["remedy"], "public/ is as it ought to be"


@pytest.mark.parametrize(
    ("name", "other", "code"),
    [
        ("cert.pem", "Cert.pem", "KA668"),
        ("cert.pem", "talker.crt", "KA668"),
        ("key.pem", "talker.key", "KA118"),
        ("permissions.p7s", "permission.p7s", "KA660"),
        ("key.pem", "talker key", None),
    ],
)
def test_a_file_of_another_name_gets_that_under_which_it_is_looked_for(
    name: str, other: str, code: str | None, stock: Path
) -> None:
    before = codes(stock)
    folder = stock / "enclaves/talker"
    (folder / name).rename(folder / other)
    said = [(each["code"], typed(each["remedy"])) for each in found(stock) if "(KA101), give it" in each["remedy"]]
    assert [each for each, _commands in said] == ([] if code is None else [code]), "or a shell would read two names"
    for _code, (rename, *_others) in said:
        type_in(stock, rename)
        assert codes(stock) == before
    if code is not None:  # the enclave lacks nothing now
        shutil.copy(folder / name, folder / other)
        assert not [each for each in found(stock) if "(KA101), give it" in each["remedy"]]


@pytest.mark.parametrize("name", ["enclaves/talker/cert.pem", "public/ca.cert.pem"])
def test_a_certificate_in_der_is_written_in_pem(name: str, stock: Path) -> None:
    """It is the enclave's own (KA668 says nothing), and nothing is issued or renewed for its form."""
    before = codes(stock)
    certificate = stock / name
    certificate.write_bytes(ssl.PEM_cert_to_DER_cert(certificate.read_text()))
    told = [each for each in found(stock) if each["code"] in ("KA201", "KA668")]
    assert [each["code"] for each in told] == ["KA201"]
    (command,) = typed(told[0]["remedy"])
    type_in(stock, command, {"FILE": name})
    assert codes(stock) == before
    certificate.write_text("")
    (empty,) = [each for each in found(stock) if each["code"] == "KA201"]
    assert ("-key private/ROLE_ca.key.pem" in empty["remedy"]) is name.startswith("public/"), "an authority is renewed"


def test_a_password_is_taken_off_where_the_key_is(stock: Path) -> None:
    folder = stock / "enclaves/talker"
    before = codes(stock)
    type_in(folder, "openssl pkey -aes256 -passout pass:x -in key.pem -out other.pem && mv other.pem key.pem")
    assert "KA211" in codes(stock)
    remedy = BY_CODE["KA211"].remedy
    assert "in the enclave's folder" in remedy
    commands = remedy.split("`")[1::2]
    key = (folder / "key.pem").read_bytes()
    for command in commands:  # somebody mistypes it
        wrong = command.replace("openssl pkey", "openssl pkey -passin pass:y")
        subprocess.run(["sh", "-c", wrong], cwd=folder, capture_output=True, check=False, timeout=60)
    assert (folder / "key.pem").read_bytes() == key
    for command in commands:
        type_in(folder, command.replace("openssl pkey", "openssl pkey -passin pass:x"))
    assert codes(stock) == before
