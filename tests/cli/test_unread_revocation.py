"""A crl.pem that cannot be read: nobody knows whom it takes back, so nothing is said as if there were none."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding
from msgspec import Struct

from tests.cli.keystores import AT, answer
from tests.keystore.builder import crl
from tests.keystore.documents import criterion, grant, permissions, rule
from tests.model.comparing import Member, Store, authority

TALKER, LISTENER = "enclaves/talker/crl.pem", "enclaves/listener/crl.pem"
STORE = Store(
    members={
        "/talker": Member(permissions=permissions(grant("/talker", rule(criterion("publish", "rt/x")))), serial=100),
        "/listener": Member(
            permissions=permissions(grant("/listener", rule(criterion("subscribe", "rt/x")))), serial=9
        ),
    }
)
LIST = crl(authority("identityCA"), (100,)).public_bytes(Encoding.PEM)
"""Takes /talker back."""


class Asked(Struct, frozen=True):
    """A question, and the exit code where the file has no list, the list, and one that nobody can read."""

    words: tuple[str, ...]
    file: str
    codes: tuple[int, int, int]


QUESTIONS = {
    "can": Asked(("can", "K", "/talker", "publish", "/x", "--expect", "allow"), TALKER, (0, 1, 4)),
    "can, peers": Asked(("can", "K", "/talker", "publish", "/x", "--effective"), "both", (0, 1, 4)),
    "access": Asked(("access", "K"), TALKER, (0, 0, 4)),
    "access, peers": Asked(("access", "K"), LISTENER, (0, 0, 4)),
    "flow": Asked(("flow", "K", "/talker", "/listener", "--attacker", "honest"), LISTENER, (1, 0, 4)),
    "flow back": Asked(("flow", "K", "/talker", "/listener", "--attacker", "honest"), TALKER, (1, 1, 4)),
    "stolen key": Asked(("flow", "K", "--from-compromised", "/talker"), LISTENER, (1, 1, 4)),
    "diff": Asked(("diff", "none", "K"), LISTENER, (0, 0, 4)),
    "diff back": Asked(("diff", "K", "none"), LISTENER, (0, 1, 4)),
    "diff of lists": Asked(("diff", "K", "listed"), LISTENER, (0, 0, 4)),
}


def _too_large(file: Path) -> None:
    file.write_bytes(b"# comment\n" * 500_000 + LIST)


def _elsewhere(file: Path) -> None:
    file.symlink_to("/nowhere/crl.pem")


def _no_list(file: Path) -> None:
    file.write_bytes(b"-----BEGIN X509 CRL-----\nAAAA\n-----END X509 CRL-----\n")


def _listing(file: Path) -> None:
    file.write_bytes(LIST)


UNREAD: dict[str, Callable[[Path], None]] = {"large": _too_large, "link": _elsewhere, "garbage": _no_list}


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Keystores that differ in crl.pem alone, by what it is and who has it."""
    root = tmp_path_factory.mktemp("stores")
    STORE.write(root / "none")
    for file in (TALKER, LISTENER, "both"):
        for name, make in {**UNREAD, "listed": _listing}.items():
            copy = root / f"{name} {file.replace('/', ' ')}"
            shutil.copytree(root / "none", copy)
            for each in (TALKER, LISTENER) if file == "both" else (file,):
                make(copy / each)
    (root / "listed").symlink_to(root / f"listed {LISTENER.replace('/', ' ')}")
    return root


def asked(words: tuple[str, ...], store: str, stores: Path, *profiles: str) -> tuple[int, str]:
    named = {"K": stores / store, "none": stores / "none", "listed": stores / "listed"}
    chosen = [word for profile in profiles or ("humble",) for word in ("--profile", profile)]
    return answer(*(named.get(word, word) for word in words), "--at", AT, *chosen)


@pytest.mark.parametrize("question", QUESTIONS)
@pytest.mark.parametrize("unread", UNREAD)
def test_one_that_could_not_be_read_is_not_taken_for_none(question: str, unread: str, stores: Path) -> None:
    put = QUESTIONS[question]
    where = put.file.replace("/", " ")
    codes = [asked(put.words, store, stores)[0] for store in ("none", f"listed {where}", f"{unread} {where}")]
    assert tuple(codes) == put.codes


@pytest.mark.parametrize(
    ("store", "status"), [("none", "holds"), ("listed", "violated"), *((u, "unknown") for u in UNREAD)]
)
@pytest.mark.parametrize("file", [TALKER, LISTENER])
def test_able(file: str, store: str, status: str, stores: Path, tmp_path: Path) -> None:
    settings = tmp_path / "able.toml"
    settings.write_text('[[property]]\nname = "able"\nable = { from = "/talker", to = "/listener" }\n')
    name = store if store == "none" else f"{store} {file.replace('/', ' ')}"
    words = ("audit", "K", "--settings", str(settings), "--engine", "native", "-f", "json")
    found = json.loads(asked(words, name, stores)[1])
    assert [each["status"] for each in found["properties"] if each["id"] == "able"] == [status]


def test_who_reads_no_lists_is_not_in_doubt_about_one(stores: Path) -> None:
    """OpenDDS."""
    flow = QUESTIONS["flow"].words
    unread = f"large {LISTENER.replace('/', ' ')}"
    assert [asked(flow, unread, stores, profile)[0] for profile in ("opendds", "cyclonedds")] == [1, 4]


def test_a_list_in_the_ca_file_counts_no_more_for_certain(stores: Path, tmp_path: Path) -> None:
    """A newer one in crl.pem, without /talker, would go before it."""
    shutil.copytree(stores / "none", tmp_path / "k")
    file = tmp_path / "k/enclaves/listener/identity_ca.cert.pem"
    file.write_bytes(file.read_bytes() + LIST)
    words = ("flow", str(tmp_path / "k"), *QUESTIONS["flow"].words[2:])
    assert asked(words, "", stores, "fastdds")[0] == 0
    _too_large(tmp_path / "k" / LISTENER)
    assert asked(words, "", stores, "fastdds")[0] == 4


def test_a_list_that_all_share_is_everybodys_doubt(stores: Path, tmp_path: Path) -> None:
    """diff said that /talker gains what peers accept: it took it for read, since the place was told of /listener."""
    shutil.copytree(stores / "none", tmp_path / "k")
    (tmp_path / "k/public").mkdir()
    _no_list(tmp_path / "k/public/crl.pem")
    for file in (TALKER, LISTENER):
        (tmp_path / "k" / file).symlink_to("../../public/crl.pem")
    code, told = asked(("diff", str(tmp_path / "k"), "none", "-f", "json"), "", stores)
    assert (code, json.loads(told)["changes"]) == (4, [])


def test_a_ca_file_that_all_share_is_everybodys_doubt(stores: Path, tmp_path: Path) -> None:
    """diff stopped with a fault: it looked for /talker where all that was not read had been left out."""
    shutil.copytree(stores / "none", tmp_path / "k")
    (tmp_path / "k/public").mkdir()
    (tmp_path / "k/public/ca.pem").write_bytes(b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n")
    for path in ("talker", "listener"):
        file = tmp_path / "k/enclaves" / path / "identity_ca.cert.pem"
        file.unlink()
        file.symlink_to("../../public/ca.pem")
    code, told = asked(("diff", str(tmp_path / "k"), "none", "-f", "json"), "", stores)
    assert (code, {each["layer"] for each in json.loads(told)["changes"]}) == (4, {"trust"})
