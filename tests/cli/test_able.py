"""What must be possible: from each of the places to each of the others."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from tests.cli.keystores import AT, answer, document_of, grant_of, keystore, properties, rule
from tests.keystore.builder import GOVERNANCE, authority, certificate, crl, write_enclave

ENCLAVES = {
    "/button/left": (rule(("rt/stop",)),),
    "/button/right": (rule(("rt/stop",)),),
    "/button/broken": (rule(("rt/other",)),),
    "/motor": (rule((), ("rt/stop",)),),
    "/brake": (rule((), ("rt/stop",)),),
}


def asked(root: Path, able: str) -> dict[str, Any]:
    return properties(root, f'[[property]]\nname = "stop"\nable = {{ {able} }}\n', "--profile", "jazzy")["stop"]


def why(found: dict[str, Any]) -> str:
    text: str = found["profiles"]["fastdds-2.14"]["counterexample"]["text"]
    return text


@pytest.mark.parametrize(
    ("able", "cut_off"),
    [
        ('from = ["/button/left", "/button/right"], to = "/motor"', ""),
        ('from = ["/button/left", "/button/broken"], to = "/motor"', "from /button/broken to /motor"),
        ('from = "/button/*", to = "/motor"', "from /button/broken to /motor"),
        ('from = "/button/[lr]*", to = ["/motor", "/brake"]', ""),
        ('from = "/button/left", to = ["/motor", "/button/right"]', "from /button/left to /button/right"),
        ('from = "/button/left", to = "topic:/stop"', ""),
        ('from = "/button/left", to = ["topic:/stop", "topic:/other"]', "from /button/left to /other"),
        ('from = ["topic:/stop", "topic:/other"], to = "/motor"', "from /other to /motor"),
        ('from = "topic:/*", to = "/motor"', ""),
        ('from = ["/button/left", "/motor"], to = "/motor"', ""),
    ],
)
def test_every_pair_counts(tmp_path: Path, able: str, cut_off: str) -> None:
    found = asked(keystore(tmp_path / "keys", ENCLAVES), able)
    assert found["status"] == ("violated" if cut_off else "holds")
    if cut_off:
        assert cut_off in why(found).replace(" (topic)", "")


def test_one_that_does_not_start_is_cut_off(tmp_path: Path) -> None:
    root = keystore(tmp_path / "keys", ENCLAVES)
    able = 'from = ["/button/left", "/button/right"], to = "/motor"'
    assert asked(root, able)["status"] == "holds"
    (root / "enclaves/button/right/key.pem").unlink()
    found = asked(root, able)
    assert found["status"] == "violated"
    assert "from /button/right to /motor" in why(found)


def test_one_that_cannot_be_read_leaves_it_open(tmp_path: Path) -> None:
    root = keystore(tmp_path / "keys", ENCLAVES)
    able = 'from = ["/button/left", "/button/right"], to = "/motor"'
    (root / "enclaves/button/right/identity_ca.cert.pem").write_bytes(b"#" * 5_000_000)
    assert asked(root, able)["status"] != "holds"
    assert asked(root, 'from = "/button/left", to = "/motor"')["status"] == "holds"


def test_too_many_pairs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("keystore_audit.model.claims.ability.MAX_PAIRS", 3)
    settings = tmp_path / "keystore-audit.toml"
    settings.write_text('[[property]]\nname = "stop"\nable = { from = "/button/*", to = "/*" }\n', "utf-8")
    root = keystore(tmp_path / "keys", ENCLAVES)
    assert answer("audit", root, "--engine", "native", "--at", AT, "--settings", settings)[0] == 2


UNREAD = ("key.pem", "key.p11", "cert.pem", "permissions.p7s", "governance.p7s", "identity_ca.cert.pem", "crl.pem")


@pytest.mark.parametrize("name", UNREAD)
def test_what_could_not_be_read_cuts_nothing_off_for_certain(tmp_path: Path, name: str) -> None:
    """Whether it starts, and what it may, is unknown: of keys and permissions not read "violated" was said."""
    root = keystore(tmp_path / "keys", ENCLAVES)
    (root / "enclaves/button/left" / name).write_bytes(b"#" * 5_000_000)
    able = 'from = "/button/left", to = "/motor"'
    assert asked(root, able)["status"] == "unknown"
    (root / "enclaves/motor/key.pem").unlink()
    assert asked(root, able)["status"] == "violated"


@pytest.mark.parametrize(("size", "status"), [(0, "holds"), (5_000_000, "unknown")])
def test_permissions_that_could_not_be_read_are_signed_by_nobody_knows_whom(
    tmp_path: Path, size: int, status: str
) -> None:
    """They counted as no document at all, so that every document was signed."""
    root = keystore(tmp_path / "keys", ENCLAVES)
    if size:
        (root / "enclaves/motor/permissions.p7s").write_bytes(b"#" * size)
    code, text = answer("audit", root, "--engine", "native", "--at", AT, "-f", "json")
    found = {each["id"]: each["status"] for each in json.loads(text)["properties"]}
    assert (code == 4, found["documents-signed-by-the-permissions-ca"]) == (size > 0, status)


@pytest.mark.parametrize(("key", "status"), [("read", "violated"), ("too large", "unknown"), ("gone", "holds")])
def test_whether_one_starts_where_another_may_be_is_unknown_with_its_key(tmp_path: Path, key: str, status: str) -> None:
    """Fast DDS starts an enclave in a domain of which its rules say nothing, if it starts at all."""
    there = rule((), ("rt/y",)).replace("<id>0<", "<id>9<")
    governance = GOVERNANCE.replace(b"<id>0</id>", b"<id>0</id><id>9</id>")
    root = keystore(tmp_path / "keys", {"/e": (rule(("rt/x",)),), "/f": (there,)}, governance=governance)
    for file in () if key == "read" else (root / "enclaves/e/key.pem", root / "enclaves/f/key.pem"):
        file.unlink()
        if key == "too large":
            file.write_bytes(b"#" * 5_000_000)
    settings = '[[property]]\nname = "apart"\nnever_share_domain = ["/e", "/f"]\n'
    assert properties(root, settings, "--profile", "fastdds-3.6")["apart"]["status"] == status


SAME, OTHER = authority("identityCA", serial=8), authority("otherCA")


@pytest.mark.parametrize(
    ("talkers", "motors", "crl_by", "violated"),
    [
        ("AB", "BA", "", ()),
        ("AB", "BA", "B", ("spec", "fastdds-2.9", "fastdds-3.6")),  # no list of the button's authority
        ("AB", "BA", "A", ("spec", "fastdds-2.9", "fastdds-3.6")),  # nor of its own: it does not start
        ("AS", "SA", "", ("fastdds-2.9", "fastdds-3.6")),  # of one name; they try the first alone
        ("SA", "SA", "", ("fastdds-2.9", "fastdds-3.6")),  # the button does not start
        ("AS", "AS", "", ("fastdds-2.9", "fastdds-3.6")),  # nor does the motor
    ],
)
def test_one_whom_the_other_does_not_take_is_cut_off(
    talkers: str, motors: str, crl_by: str, violated: tuple[str, ...], tmp_path: Path
) -> None:
    """The identity of the button is of the authority A, that of the motor of the other one; both trust both."""
    authorities = {"A": authority("identityCA"), "B": OTHER, "S": SAME}
    permissions = authority("permissionsCA")
    for path, file, own in (("/button", talkers, "A"), ("/motor", motors, "SB"["B" in motors])):
        document = document_of(grant_of(path, rule(("rt/stop",), ("rt/stop",))))
        mine = authorities[own]
        folder = tmp_path / "keys/enclaves" / path[1:]
        write_enclave(folder, certificate(path, mine), document, mine, permissions, GOVERNANCE)
        (folder / "identity_ca.cert.pem").write_bytes(b"".join(authorities[each].pem for each in file))
        if crl_by and path == "/motor":
            (folder / "crl.pem").write_bytes(crl(authorities[crl_by]).public_bytes(Encoding.PEM))
    settings = '[[property]]\nname = "stop"\nable = { from = "/button", to = "/motor" }\n'
    profiles = [word for name in ("spec", "fastdds-2.9", "fastdds-3.6") for word in ("--profile", name)]
    found = properties(tmp_path / "keys", settings, *profiles)["stop"]["profiles"]
    assert {name: each["status"] for name, each in found.items()} == {
        name: "violated" if name in violated else "holds" for name in found
    }


def test_one_that_may_be_behind_a_link_leaves_it_open(tmp_path: Path) -> None:
    """Where a pattern may name it."""
    root = keystore(tmp_path / "keys", ENCLAVES)
    assert asked(root, 'from = "/button/*t", to = "/motor"')["status"] == "holds"
    (root / "enclaves/button/last").symlink_to(tmp_path)
    assert asked(root, 'from = "/button/*t", to = "/motor"')["status"] == "unknown"
    assert asked(root, 'from = ["/button/left", "/button/right"], to = "/motor"')["status"] == "holds"


def test_what_is_accepted_is_what_is_cut_off_for_certain(tmp_path: Path) -> None:
    """It is the same finding whether a pair that may be cut off can be read or not, and is about all that is read."""
    able = 'from = ["/button/left", "/button/broken"], to = "/motor"'
    root = keystore(tmp_path / "keys", ENCLAVES)
    settings = tmp_path / "keystore-audit.toml"

    def found() -> tuple[int, str, str]:
        assert asked(root, able)["status"] == "violated"
        every = ("--engine", "native", "--at", AT, "--profile", "jazzy", "--settings", settings, "-f", "json")
        code, text = answer("audit", root, *every)
        finding = next(each for each in json.loads(text)["findings"] if each["code"] == "KA740")
        return code, finding["fingerprint"], finding["meaning"]

    code, same, read = found()
    assert code == 1
    left = root / "enclaves/button/left/key.pem"
    key = left.read_bytes()
    left.write_bytes(b"#" * 5_000_000)
    assert found()[:2] == (4, same)
    left.unlink()
    assert found()[:2] == (1, same)
    assert found()[2] != read
    left.write_bytes(key)
    assert found() == (1, same, read)
