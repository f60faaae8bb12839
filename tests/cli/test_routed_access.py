"""`access --zenoh DIR`: what enclaves can do with their own files, and by others' files alone."""

from __future__ import annotations

import csv
import json
import shutil
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Network, Run
from tests.cli.test_routed import AT, peer
from tests.keystore.builder import PERMISSIONS, sros2
from tests.oracles.zenoh.deployment import Configuration, access, allow, session, tls, tool, written
from tests.schemas import schema

CHATTER = "0/chatter/*/*"
Rights = dict[tuple[str, str, str], tuple[str, str]]


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    """/talker and /listener are granted /chatter; /random, by a pattern, whatever begins with /random."""

    def document(path: str) -> str:
        name = "random*" if path == "/random" else "chatter"
        return PERMISSIONS.format(name=path).replace("rt/chatter", f"rt/{name}")

    return sros2(tmp_path / "keys", ("/talker", "/listener", "/random"), document=document)


def table(run: Run, keys: Path, folder: Path, *words: str, code: int = 0) -> tuple[dict[str, Any], Rights]:
    done = run("access", keys, "--zenoh", folder, "--at", AT, "-f", "json", *words)
    assert done.returncode == code, done.stderr
    document: dict[str, Any] = json.loads(done.stdout)
    schema("access_routed").validate(document)
    found: Rights = {}
    for right in document["rights"]:
        (both,) = {(each["decision"], each["effective"]) for each in right["decisions"].values()}
        found[right["enclave"], right["operation"], right["name"]] = both
    return document, found


def files() -> dict[str, Configuration]:
    """As the generator writes them: each restrains its owner alone."""
    return {
        "talker": peer("talker", **tool(publish="chatter")),
        "listener": peer("listener", **tool(subscribe="chatter")),
        "random": peer("random", **tool(publish="random")),
    }


def by_name(keys: Path, folder: Path) -> None:
    """The one change: /listener takes from /talker alone."""
    rules = [allow(CHATTER, "put", flows=["ingress"]), allow(CHATTER, "declare_subscriber", flows=["egress"])]
    named = peer("listener", **access(({"cert_common_names": ["/talker"]}, rules)))
    (folder / "listener.json5").write_text(written({**tls(keys, "listener"), **named}))


def text(run: Run, keys: Path, folder: Path) -> str:
    return run("access", keys, "--zenoh", folder, "--at", AT).stdout.decode()


def test_what_is_gained_by_dropping_a_file_stands_first(keystore_audit: Run, keys: Path, network: Network) -> None:
    folder, asked = network(**files()), ("/random", "publish", "/chatter")
    document, rights = table(keystore_audit, keys, folder)
    assert rights[asked] == ("deny", "allow")
    assert document["patterns"] == ["rt/random*"]
    assert {name for _enclave, _operation, name in rights} == {"/chatter", "/random"}
    first, *_rest = text(keystore_audit, keys, folder).splitlines()
    assert first.startswith("4 of 12 rights are gained by dropping the own file: /")
    by_name(keys, folder)
    _document, rights = table(keystore_audit, keys, folder)
    assert rights[asked] == ("deny", "deny")
    assert rights["/talker", "publish", "/chatter"] == ("allow", "allow")


def test_the_table_says_what_can_says(keystore_audit: Run, keys: Path, network: Network) -> None:
    folder = network(**files())
    _document, rights = table(keystore_audit, keys, folder)
    for (enclave, operation, name), both in rights.items():
        words = ("can", keys, enclave, operation, name, "--zenoh", folder, "--at", AT, "-f", "json")
        answers = json.loads(keystore_audit(*words).stdout)["decisions"].values()
        assert {(each["decision"], each["effective"]) for each in answers} == {both}
    rows = csv.DictReader(
        StringIO(keystore_audit("access", keys, "--zenoh", folder, "--at", AT, "-f", "csv").stdout.decode())
    )
    assert {
        (row["enclave"], row["operation"], row["name"]): (row["by own file"], row["by others' files"]) for row in rows
    } == rights


def test_whoever_listens_is_taken_at_its_own_address(keystore_audit: Run, keys: Path, network: Network) -> None:
    """/listener connects to /talker and listens nowhere; who has /talker's key waits there and needs no file."""
    named = access(({"cert_common_names": ["/talker"]}, [allow("0/**", "put", flows=["ingress"])]))
    listener = session("peer", connect=["tls/localhost:7448"], **named)
    folder = network(talker=peer("talker", **tool(publish="chatter")), listener=listener)
    (folder / "random.json5").write_text(written({**tls(keys, "random"), **session("peer"), **tool("random")}))
    _document, rights = table(keystore_audit, keys, folder)
    assert rights["/talker", "publish", "/random"] == ("deny", "allow")
    assert rights["/random", "publish", "/chatter"] == ("deny", "deny")


def test_services_and_other_domains(keystore_audit: Run, keys: Path, network: Network) -> None:
    served = {"talker": peer("talker", **tool(reply="go")), "listener": peer("listener", **tool(request="go"))}
    folder = network(**served)
    _document, rights = table(keystore_audit, keys, folder, code=4)  # there is no file of /random
    assert rights["/listener", "request", "/go"] == ("allow", "allow")
    assert rights["/random", "request", "/go"] == ("unknown", "allow")
    _document, rights = table(keystore_audit, keys, folder, "--domain", "1", code=4)
    assert {name for _enclave, _operation, name in rights} == {"/chatter"}


def test_what_cannot_be_told_denies_nothing(keystore_audit: Run, keys: Path, network: Network) -> None:
    folder = network(**files())
    (folder / "more.yaml").write_text("mode: peer")
    document, rights = table(keystore_audit, keys, folder, code=4)
    assert [Path(each["path"]).name for each in document["unknown"]] == ["more.yaml"]
    assert "deny" not in {each for both in rights.values() for each in both}


def test_too_many_rights_are_not_asked(keystore_audit: Run, keys: Path, network: Network) -> None:
    many = " ".join(f"topic{number}" for number in range(340))
    folder = network(talker=peer("talker", **tool(publish=many)))
    done = keystore_audit("access", keys, "--zenoh", folder, "--at", AT)
    assert done.returncode == 4
    assert b"More than 2000 rights" in done.stderr


def differing(run: Run, keys: Path, old: Path, new: Path, *words: str, code: int) -> dict[tuple[str, str, str], Any]:
    done = run("diff", keys, keys, "--zenoh", old, new, "--at", AT, "-f", "json", *words)
    assert done.returncode == code, done.stderr
    document = json.loads(done.stdout)
    schema("diff_routed").validate(document)
    return {(each["enclave"], each["operation"], each["name"]): each["gained"] for each in document["changes"]}


def test_what_changes_between_two_networks(keystore_audit: Run, keys: Path, network: Network, tmp_path: Path) -> None:
    """Once rules name who may send, nobody else gains by dropping his file; the way back is a gain."""
    old = network(**files())
    new = tmp_path / "new"
    shutil.copytree(old, new)
    by_name(keys, new)
    lost = differing(keystore_audit, keys, old, new, code=0)
    assert lost["/random", "publish", "/chatter"] is False
    assert set(lost.values()) == {False}
    gained = differing(keystore_audit, keys, new, old, code=1)
    assert gained == dict.fromkeys(lost, True)
    assert differing(keystore_audit, keys, new, old, "--fail-on", "none", code=0) == gained
    assert differing(keystore_audit, keys, old, new, "--fail-on", "any", code=1) == lost
    assert differing(keystore_audit, keys, old, old, code=0) == {}
    doubtful = tmp_path / "doubtful"
    shutil.copytree(new, doubtful)
    (doubtful / "more.yaml").write_text("mode: peer", "utf-8")
    assert differing(keystore_audit, keys, new, doubtful, code=4)["/random", "publish", "/chatter"] is None


def test_changes_in_words(keystore_audit: Run, keys: Path, network: Network, tmp_path: Path) -> None:
    old = network(**files())
    shutil.copytree(old, tmp_path / "new")
    by_name(keys, tmp_path / "new")
    said = keystore_audit("diff", keys, keys, "--zenoh", tmp_path / "new", old, "--at", AT).stdout.decode()
    assert " rights are gained, 0 lost or otherwise changed" in " ".join(said.split())
    assert ["gained", "/random", "publish", "/chatter", "deny", "/", "deny", "deny", "/", "allow"] in [
        line.split() for line in said.splitlines()
    ]
    done = keystore_audit("diff", keys, keys, "--zenoh", old, old, "--rolling", "--at", AT)
    assert (done.returncode, b"--rolling says nothing about files of sessions and routers" in done.stderr) == (2, True)
