"""`explain CODE --for KEYSTORE`: its scripts, run as printed, end the finding and change nothing else."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import ssl
import subprocess
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec

from keystore_audit.findings import FixKind
from keystore_audit.rules import RULES
from tests.amount import SHARE, tried
from tests.cli.keystores import answer
from tests.keystore.builder import Signed, certificate
from tools.samples.store import copy_with_modes

STAGE = ".keystore-audit.new"
TALKER = "enclaves/talker"
FLAT = "healthy/dashing_flat"


@pytest.fixture
def stock(repository: Path, tmp_path: Path) -> Path:
    """A keystore as `ros2 security` makes it: one CA, and both roles links to it."""
    root = tmp_path / "keystore"
    copy_with_modes(repository / "sample_keystores/stock/talker_listener", root, 0o600)
    return root


def openssl(root: Path, *arguments: str) -> bytes:
    """Run openssl in the keystore's root; what it printed."""
    return subprocess.run(["openssl", *arguments], cwd=root, capture_output=True, check=True, timeout=60).stdout


def found(root: Path, *options: str) -> list[dict[str, Any]]:
    """What an audit finds."""
    findings: list[dict[str, Any]] = json.loads(answer("audit", root, "--engine", "native", "-f", "json", *options)[1])[
        "findings"
    ]
    return findings


def codes(root: Path, *options: str) -> set[str]:
    """The codes of what an audit finds."""
    return {finding["code"] for finding in found(root, *options)}


def printed(root: Path, code: str, *options: str) -> Path:
    """The script, in a file outside the keystore."""
    exit_code, script = answer("explain", code, "--for", root, *options)
    assert exit_code == 0, script
    file = root.with_name(f"{code}.sh")
    file.write_text(script, "utf-8", newline="")
    return file


def run(script: Path, **environment: str) -> tuple[int, str]:
    """Run a script as a user does; its exit code, and all that it said."""
    done = subprocess.run(
        ["sh", str(script)],
        cwd=script.parent,
        capture_output=True,
        text=True,
        errors="surrogateescape",
        check=False,
        timeout=60,
        env={**os.environ, **environment},
    )
    return done.returncode, done.stdout + done.stderr


def tree(root: Path) -> dict[str, tuple[object, ...]]:
    """All that is there: links by what they say, files by mode and content; not the script's own folder."""
    seen: dict[str, tuple[object, ...]] = {}
    for path in sorted(root.rglob("*")):
        name = os.fsencode(path.relative_to(root)).decode("latin-1")
        if name.startswith(STAGE):
            continue
        if path.is_symlink():
            seen[name] = ("link", os.readlink(path))
        elif path.is_dir():
            seen[name] = ("folder",)
        else:
            seen[name] = (path.stat().st_mode & 0o777, hashlib.sha256(path.read_bytes()).hexdigest())
    return seen


def enclaves_of(root: Path) -> list[dict[str, Any]]:
    """The enclaves of the report."""
    enclaves: list[dict[str, Any]] = json.loads(answer("audit", root, "--engine", "native", "-f", "json")[1])[
        "enclaves"
    ]
    return enclaves


def starting(root: Path) -> set[tuple[str, str]]:
    """The enclaves that start, with the implementation."""
    return {
        (enclave["path"], name)
        for enclave in enclaves_of(root)
        for name, each in enclave["profiles"].items()
        if each["usable"]
    }


# What is wrong with the keystore


def break_signature(root: Path) -> None:
    document = root / TALKER / "permissions.p7s"
    document.write_bytes(document.read_bytes().replace(b"<dds", b"<dds "))


def sign_governance_by_stranger(root: Path) -> None:
    (root / "stranger").mkdir()
    openssl(
        root, "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
        "-subj", "/CN=other", "-keyout", "stranger/key", "-out", "stranger/cert",
    )  # fmt: skip
    signed = openssl(
        root, "smime", "-sign", "-text", "-in", "enclaves/governance.xml", "-signer", "stranger/cert",
        "-inkey", "stranger/key",
    )  # fmt: skip
    (root / "enclaves/governance.p7s").write_bytes(signed)
    shutil.rmtree(root / "stranger")


def unsign(root: Path) -> None:
    shutil.copyfile(root / TALKER / "permissions.xml", root / TALKER / "permissions.p7s")


def sign_otherwise(*more: str) -> Callable[[Path], None]:
    def sign(root: Path) -> None:
        signed = openssl(
            root, "smime", "-sign", *more, "-in", f"{TALKER}/permissions.xml", "-signer", "public/ca.cert.pem",
            "-inkey", "private/ca.key.pem",
        )  # fmt: skip
        (root / TALKER / "permissions.p7s").write_bytes(signed)

    return sign


def exchange_key(root: Path) -> None:
    openssl(
        root, "genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-out", f"{TALKER}/key.pem"
    )


def identity(key: str = "EC -pkeyopt ec_paramgen_curve:prime256v1", days: int = 30) -> Callable[[Path], None]:
    """Another identity under the CA, which ends so many days after now."""

    def issue(root: Path) -> None:
        openssl(root, "genpkey", "-algorithm", *key.split(), "-out", f"{TALKER}/key.pem")
        (root / TALKER / "key.pem").chmod(0o600)
        own = serialization.load_pem_private_key((root / TALKER / "key.pem").read_bytes(), None)
        authority = serialization.load_pem_private_key((root / "private/ca.key.pem").read_bytes(), None)
        assert isinstance(authority, ec.EllipticCurvePrivateKey)
        until = datetime.now(timezone.utc) + timedelta(days=days)
        ca = Signed(authority, x509.load_pem_x509_certificate((root / "public/ca.cert.pem").read_bytes()))
        made = certificate("/talker", ca, key=own, ca=None, start=until - timedelta(days=100), end=until)  # type: ignore[arg-type]
        (root / TALKER / "cert.pem").write_bytes(made.pem)

    return issue


def sign_by_sha1(root: Path) -> None:
    request = root.with_name("request")
    request.write_bytes(openssl(root, "req", "-new", "-key", f"{TALKER}/key.pem", "-subj", r"/CN=\/talker"))
    text = openssl(
        root, "x509", "-req", "-in", str(request), "-CA", "public/ca.cert.pem", "-CAkey", "private/ca.key.pem", "-sha1",
        "-days", "30", "-set_serial", "77",
    )  # fmt: skip
    (root / TALKER / "cert.pem").write_bytes(text)


def self_sign(root: Path) -> None:
    openssl(
        root, "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
        "-subj", r"/CN=\/talker", "-keyout", f"{TALKER}/key.pem", "-out", f"{TALKER}/cert.pem",
    )  # fmt: skip


def spoil(name: str) -> Callable[[Path], None]:
    def write(root: Path) -> None:
        (root / TALKER / name).write_text("-----BEGIN X-----\n")

    return write


def spoil_certificate(root: Path) -> None:
    text = (root / TALKER / "cert.pem").read_text().splitlines()
    text[2] = text[2][::-1]
    (root / TALKER / "cert.pem").write_text("\n".join(text) + "\n")


def remove(name: str) -> Callable[[Path], None]:
    def unlink(root: Path) -> None:
        (root / TALKER / name).unlink()

    return unlink


def lead(name: str, target: str) -> Callable[[Path], None]:
    def link(root: Path) -> None:
        (root / TALKER / name).unlink()
        (root / TALKER / name).symlink_to(target.replace("ROOT", str(root)))

    return link


def renew(*more: str) -> Callable[[Path], None]:
    """One CA has both roles: the signatures name its old certificate."""

    def make(root: Path) -> None:
        openssl(
            root, "req", "-x509", "-new", "-sha256", "-days", "3650", "-key", "private/ca.key.pem",
            "-subj", "/CN=sros2CA", *more, "-out", "public/ca.cert.pem",
        )  # fmt: skip

    return make


renew_otherwise = renew("-addext", "keyUsage=digitalSignature")
"""Such a certificate may not issue any."""


def open_key(root: Path) -> None:
    (root / TALKER / "key.pem").chmod(0o644)


def open_authority(root: Path) -> None:
    (root / "private/ca.key.pem").chmod(0o644)


def open_folder(root: Path) -> None:
    (root / TALKER).chmod(0o777)
    (root / "enclaves/governance.p7s").chmod(0o666)


def nothing(_root: Path) -> None:
    """It is as `ros2 security` made it."""


CASES: dict[str, list[tuple[Callable[[Path], None], str]]] = {
    "KA101": [
        (remove(name), name) for name in ("governance.p7s", "identity_ca.cert.pem", "cert.pem", "permissions.p7s")
    ],
    "KA102": [(lead("governance.p7s", "../../gone"), ""), (lead("permissions_ca.cert.pem", "../../gone"), "")],
    "KA103": [(lead("governance.p7s", "/etc/hostname"), "")],
    "KA108": [(open_key, "")],
    "KA116": [(open_authority, "")],
    "KA119": [(open_folder, "")],
    "KA120": [(lead("governance.p7s", "ROOT/enclaves/governance.p7s"), "")],
    "KA201": [(spoil_certificate, "")],
    "KA203": [(identity(days=-1), "")],
    "KA207": [(self_sign, "")],
    "KA208": [(renew_otherwise, "")],
    "KA209": [(exchange_key, "")],
    "KA210": [(spoil("key.pem"), "")],
    "KA205": [(identity(days=2), "")],
    "KA216": [(identity("RSA -pkeyopt rsa_keygen_bits:1024"), "")],
    "KA217": [(identity("RSA -pkeyopt rsa_keygen_bits:3072"), "")],
    "KA218": [(sign_by_sha1, "")],
    "KA222": [(nothing, "")],
    "KA301": [(sign_governance_by_stranger, "")],
    "KA303": [(break_signature, "")],
    "KA304": [(unsign, "")],
    "KA307": [(sign_otherwise(), "")],
    "KA313": [(sign_otherwise("-text", "-noattr"), "")],
    "KA316": [(renew(), "")],
    "KA706": [(nothing, "")],
}
"""How each mechanical remedy comes to be needed."""

EACH = [pytest.param(code, spoil_it, id=f"{code}-{name}") for code, all_ in CASES.items() for spoil_it, name in all_]


@pytest.mark.parametrize(("code", "spoil_it"), EACH)
def test_a_mechanical_script_ends_its_finding_and_nothing_else(
    code: str, spoil_it: Callable[[Path], None], stock: Path
) -> None:
    """A year is less than the sample's grants last (KA513); a new identity has not the serial numbers of old ones."""
    healthy, starts = codes(stock), starting(stock)
    spoil_it(stock)
    said = [each for each in found(stock) if each["code"] == code]
    assert said
    assert {each["fix"]["kind"] for each in said} == {"mechanical"}
    assert all(each["fix"]["command"] == ["keystore-audit", "explain", code, "--for", str(stock)] for each in said)
    script = printed(stock, code)
    exit_code, told = run(script, REVIEWED="yes")
    assert exit_code == 0, told
    after = found(stock)
    assert {each["code"] for each in after} - healthy <= {"KA513"}
    assert code not in {each["code"] for each in after}
    assert starting(stock) >= starts
    assert not (stock / STAGE).exists()
    keys = [path for path in (*stock.glob("enclaves/*/key.pem"), *stock.glob("private/*.pem")) if not path.is_symlink()]
    assert {path.stat().st_mode & 0o777 for path in keys} == {0o600}
    before = tree(stock)
    run(script, REVIEWED="yes")
    assert tree(stock) == before, "a second run changes nothing"


def test_every_mechanical_rule_has_its_script_tried() -> None:
    """By itself, or by one whose remedy is the same and is about the same kind of file."""
    alike = {
        "KA221": "KA201", "KA224": "KA201", "KA227": "KA201", "KA231": "KA201", "KA206": "KA208",
        "KA219": "KA209", "KA228": "KA209", "KA702": "KA207", "KA704": "KA209", "KA703": "KA303",
        **dict.fromkeys(("KA305", "KA306", "KA308", "KA309", "KA310", "KA311", "KA312", "KA314", "KA315"), "KA304"),
    }  # fmt: skip
    assert {*alike.values()} <= {*CASES}
    own = {"KA101", "KA103", "KA120"}  # general otherwise, and mechanical where sros2 has a link or the .xml is there
    assert {rule.code for rule in RULES if rule.remedy.kind is FixKind.MECHANICAL} | own == {*CASES, *alike} - {"KA102"}


def test_the_new_authority_is_declared_as_printed(stock: Path) -> None:
    _exit_code, told = run(printed(stock, "KA222"))
    (fingerprint,) = re.findall(r'permissions = \["(sha256:[0-9a-f]{64})"\]', told)
    certificate = ssl.PEM_cert_to_DER_cert((stock / "public/permissions_ca.cert.pem").read_text())
    assert fingerprint == f"sha256:{hashlib.sha256(certificate).hexdigest()}"
    own = hashlib.sha256(ssl.PEM_cert_to_DER_cert((stock / "public/ca.cert.pem").read_text())).hexdigest()
    declared = ("--expect-identity-ca", f"sha256:{own}", "--expect-permissions-ca")
    assert "KA223" not in codes(stock, *declared, fingerprint)
    assert "KA223" in codes(stock, *declared, f"sha256:{own}")


COMMANDS = ("openssl", "mkdir", "mv", "cp", "ln", "chmod", "rm", "readlink", "cut", "tr", "cmp", "diff", "cat", "sed")


STRIDE = 3 if SHARE < 1 else 1
"""Every command in the long run, some of them in the short one."""


def failing_path(folder: Path, number: int) -> str:
    """A PATH on which the command of this number, counted over all, fails."""
    folder.mkdir()
    for name in COMMANDS:
        wrapper = folder / name
        wrapper.write_text(
            f"#!/bin/sh\nat={folder}\necho >> $at/count\n"
            f"[ $({shutil.which('wc')} -l < $at/count) -ge {number} ] && "
            f"{shutil.which('ln')} $at/count $at/failed 2> /dev/null && exit 1\n"
            f'exec {shutil.which(name)} "$@"\n'
        )
        wrapper.chmod(0o755)
    return f"{folder}:{os.environ['PATH']}"


@pytest.mark.parametrize(("code", "spoil_it"), [("KA222", nothing), ("KA209", exchange_key)])
def test_a_failure_at_any_command_leaves_old_or_new(
    code: str, spoil_it: Callable[[Path], None], stock: Path, tmp_path: Path
) -> None:
    spoil_it(stock)
    script = printed(stock, code)
    before, copy = tree(stock), tmp_path / "kept"
    shutil.copytree(stock, copy, symlinks=True)
    undone = 0
    for number in range(1, 300, STRIDE):
        path = failing_path(tmp_path / f"bin{number}", number)
        exit_code, _told = run(script, PATH=path)
        reached = (tmp_path / f"bin{number}/failed").exists()
        if tree(stock) == before:
            assert exit_code != 0
            undone += 1
        else:
            assert code not in codes(stock), number
            shutil.rmtree(stock)
            shutil.copytree(copy, stock, symlinks=True)
        shutil.rmtree(stock / STAGE, ignore_errors=True)
        if not reached:
            break
    assert not reached
    assert undone > tried(15)


@pytest.mark.parametrize(
    ("code", "spoil_it"), [("KA303", break_signature), ("KA209", exchange_key), ("KA208", renew_otherwise)]
)
def test_a_missing_or_wrong_key_stops_before_the_first_write(
    code: str, spoil_it: Callable[[Path], None], stock: Path
) -> None:
    spoil_it(stock)
    script = printed(stock, code)
    key = stock / "private/ca.key.pem"
    kept = key.read_bytes()
    other = openssl(stock, "genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:prime256v1")
    for content in (None, other, b""):
        key.unlink(missing_ok=True)
        if content is not None:
            key.write_bytes(content)
        before = tree(stock)
        exit_code, told = run(script, REVIEWED="yes")
        assert exit_code == 1
        assert "private/ca.key.pem is " in told
        assert tree(stock) == before
        assert not (stock / STAGE).exists()
    key.write_bytes(kept)


HOSTILE = (
    b"it's", b"$(touch hacked)", b"`touch hacked`", b"a\nb", b"end\n", b"\x1b[2J", "ü".encode(), b"-rf",
    b"a b;touch hacked", b"\xff\xfe", b"100%", b'"', b"*",
)  # fmt: skip


def test_a_hostile_name_never_becomes_shell(stock: Path) -> None:
    """Each is one quoted argument; no identity is issued to such a name."""
    for name in HOSTILE:
        shutil.copytree(stock / TALKER, stock / "enclaves" / os.fsdecode(name), symlinks=True)
    assert len(enclaves_of(stock)) == 15
    shared = [each for each in found(stock) if each["code"] == "KA219"]
    assert {each["fix"]["kind"] for each in shared} == {"decision"}
    signed = {path: path.read_bytes() for path in stock.glob("enclaves/*/permissions.p7s")}
    assert len(signed) == 15
    exit_code, told = run(printed(stock, "KA222"))
    assert exit_code == 0, told
    assert not [*stock.parent.rglob("hacked")]
    assert all(path.read_bytes() != content for path, content in signed.items())
    assert "KA222" not in codes(stock)
    assert printed(stock, "KA219").read_bytes().isascii()


def replace_by_link(path: Path, target: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    path.symlink_to(target)


@pytest.mark.parametrize(
    "name",
    [TALKER, "enclaves", f"{TALKER}/permissions.p7s", f"{TALKER}/permissions.xml", "enclaves/governance.p7s", "private",
     "public/permissions_ca.cert.pem", STAGE],
)  # fmt: skip
def test_nothing_is_written_through_a_link_that_came_later(name: str, stock: Path, tmp_path: Path) -> None:
    script = printed(stock, "KA222")
    victim = tmp_path / "victim"
    if (stock / name).is_dir() or name == STAGE:
        shutil.copytree(stock / name, victim, symlinks=True) if name != STAGE else victim.mkdir()
    else:
        victim.write_text("mine")
    replace_by_link(stock / name, victim)
    before = tree(tmp_path)
    exit_code, told = run(script, REVIEWED="yes")
    assert exit_code == 1
    assert tree(tmp_path) == before
    assert told


def test_what_would_be_blessed_is_shown_first(stock: Path) -> None:
    """An edit that nobody signed is not signed in passing, and steers no terminal."""
    document = stock / TALKER / "permissions.xml"
    document.write_text(document.read_text().replace("rt/chatter", "rt/\x1b[2Jevil"))
    script, before = printed(stock, "KA222"), tree(stock)
    exit_code, told = run(script)
    assert exit_code == 1
    assert "enclaves/talker/permissions.xml: what is signed (-), and what would be signed now (+)" in told
    assert re.search(r"^- +<topic>rt/chatter</topic>$", told, re.MULTILINE)
    assert re.search(r"^\+ +<topic>rt/\^\[\[2Jevil</topic>$", told, re.MULTILINE)
    assert "\x1b" not in told
    assert "REVIEWED=yes" in told
    assert tree(stock) == before
    document.write_text(document.read_text().replace("\x1b[2J", ""))
    assert run(script, REVIEWED="yes")[0] == 1, "and not what came after the script"
    assert run(printed(stock, "KA222"), REVIEWED="yes")[0] == 0


def test_a_decision_names_place_and_edit_and_signs_what_was_edited(stock: Path) -> None:
    """Of an enclave with a governance of its own, that one: to sign the shared one would change nothing."""
    own = stock / TALKER / "governance.p7s"
    own.unlink()
    for name in ("governance.p7s", "governance.xml"):
        shutil.copyfile(stock / "enclaves" / name, stock / TALKER / name)
    shared = (stock / "enclaves/governance.p7s").read_bytes()
    script = printed(stock, "KA408")
    text = script.read_text()
    assert re.search(
        r"# decision: .*Set <rtps_protection_kind> to ENCRYPT.*\[enclaves/talker/governance.p7s:\d+\]", text
    )
    before = tree(stock)
    exit_code, told = run(script, REVIEWED="yes")
    assert (exit_code, "edit it first" in told, tree(stock) == before) == (1, True, True)
    for folder in (stock / "enclaves", stock / TALKER):
        document = folder / "governance.xml"
        document.write_text(
            document.read_text().replace("<rtps_protection_kind>SIGN<", "<rtps_protection_kind>ENCRYPT<")
        )
    assert run(script)[0] == 1
    assert run(script, REVIEWED="yes")[0] == 0
    assert "KA408" not in codes(stock)
    assert (stock / "enclaves/governance.p7s").read_bytes() != shared


def test_a_robot_with_the_authority_s_key_gets_no_script_that_keeps_the_authority(stock: Path) -> None:
    (stock / TALKER / "key.pem").write_bytes((stock / "private/ca.key.pem").read_bytes())
    said = [each for each in found(stock) if each["code"] == "KA109" and each["enclave"] == "/talker"]
    assert [each["fix"]["kind"] for each in said] == ["decision"]
    acts = [step.get("act") for step in said[0]["fix"]["steps"]]
    assert acts == [None, "new-permissions-ca", "new-identity-ca"]


def test_an_enclave_of_copies_gets_the_new_authority(stock: Path) -> None:
    """In place of links, as a robot may have them."""
    for name in ("identity_ca.cert.pem", "permissions_ca.cert.pem", "governance.p7s"):
        content = (stock / TALKER / name).read_bytes()
        (stock / TALKER / name).unlink()
        (stock / TALKER / name).write_bytes(content)
    starts = starting(stock)
    assert run(printed(stock, "KA222"))[0] == 0
    assert not codes(stock) & {"KA222", "KA223", "KA416", "KA705", "KA706"}
    assert starting(stock) == starts


def test_a_leaked_authority_is_replaced_in_both_roles(stock: Path) -> None:
    """The one CA has both roles, and so have its successors: whoever has its key has nothing then."""
    before = codes(stock)
    leaked = stock / TALKER / "ca.key.pem"
    leaked.write_bytes((stock / "private/ca.key.pem").read_bytes())
    (said,) = [each for each in found(stock) if each["code"] == "KA118"]
    assert said["fix"]["kind"] == "decision"
    script = printed(stock, "KA118")
    assert "# decision: Remove the key from the file." in script.read_text()
    leaked.unlink()
    exit_code, told = run(script)
    assert exit_code == 0, told
    assert told.count("sha256:") == 2
    assert codes(stock) - {"KA513", "KA109"} == before - {"KA222", "KA705", "KA706", "KA722", "KA723", "KA109"}


@pytest.mark.parametrize("code", ["KA109", "KA112"])
def test_what_no_script_does_is_said_in_a_script_that_does_nothing(code: str, stock: Path) -> None:
    (stock / "public/identity_ca.cert.pem").unlink()
    script, before = printed(stock, code), tree(stock)
    assert all(line.startswith("#") or line == "exit 1" for line in script.read_text().splitlines())
    assert (run(script)[0], tree(stock)) == (1, before)


def test_scripts_are_for_the_layout_since_foxy(repository: Path, tmp_path: Path) -> None:
    root = tmp_path / "keystore"
    copy_with_modes(repository / "sample_keystores" / FLAT, root, 0o644)
    assert printed(root, "KA408").read_text().splitlines()[-1] == "exit 1"
