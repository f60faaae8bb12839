"""The commands of remedies do what they are given for: typed into a copy of a sample, they end the finding."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest

from keystore_audit.rules import BY_CODE, RULES
from tests.cli.keystores import answer
from tools.samples.store import copy_with_modes

STOCK = "stock/talker_listener"
ENCLAVES = ("/listener", "/talker")
TYPED = re.compile(r"(openssl|mv|ln|touch|printf) ")


@pytest.fixture
def stock(repository: Path, tmp_path: Path) -> Path:
    """A keystore as `ros2 security` makes it: one CA, and both roles links to it."""
    root = tmp_path / "keystore"
    copy_with_modes(repository / "sample_keystores" / STOCK, root, 0o600)
    return root


def commands(code: str) -> list[str]:
    """The commands for a shell that the rule's remedy gives, in its order."""
    return [each for each in BY_CODE[code].remedy.split("`")[1::2] if TYPED.match(each)]


def type_in(root: Path, command: str, words: Mapping[str, str] | None = None) -> str:
    """Run a command as printed, with its capitals replaced; what it printed."""
    for word, meant in (words or {}).items():
        command = re.sub(rf"\b{word}\b|{word}(?=_)", lambda _found, meant=meant: meant, command)
    done = subprocess.run(["sh", "-ec", command], cwd=root, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, f"{command}\n{done.stderr}"
    return done.stdout


def codes(root: Path) -> set[str]:
    """The codes of what an audit finds now."""
    _exit_code, report = answer("audit", root, "--engine", "native", "--format", "json")
    return {finding["code"] for finding in json.loads(report)["findings"]}


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


@pytest.mark.parametrize("code", ["KA213", "KA214", "KA229"])
def test_a_revocation_list_is_made_and_revokes(code: str, stock: Path) -> None:
    start, touch, revoke, make = commands(code)
    before = codes(stock)
    for command in (start, touch, make):
        type_in(stock, command)
    (stock / "enclaves/talker/crl.pem").write_bytes((stock / "crl.pem").read_bytes())
    assert codes(stock) == {*before, "KA215"}  # a good list, which one enclave alone has
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


@pytest.mark.parametrize(("role", "name"), [("identity", "identity_ca.cert.pem"), ("permissions", "governance.p7s")])
def test_a_dangling_link_is_made_again(role: str, name: str, stock: Path) -> None:
    link = stock / "enclaves/talker" / name
    meant = link.readlink()
    link.unlink()
    link.symlink_to("../../gone")
    assert "KA102" in codes(stock)
    (command,) = [command for command in commands("KA102") if ("governance" in command) is ("governance" in name)]
    type_in(stock, command, {"ENCLAVE": "/talker", "ROLE": role})
    assert link.readlink() == meant
    assert "KA102" not in codes(stock)


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
    (renew,) = commands("KA117")
    type_in(stock, renew.replace("-sha256", "-sha384"), {"ROLE": "permissions", "NAME": "sros2CA"})
    sign(stock, "KA222")
    assert "KA117" in codes(stock)
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
                assert re.search(r" -in enclaves/\S+\.xml -out enclaves/\S+\.p7s ", command), rule.code
                assert command.endswith(
                    " -signer public/permissions_ca.cert.pem -inkey private/permissions_ca.key.pem"
                ), rule.code
