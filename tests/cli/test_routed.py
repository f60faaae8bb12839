"""`--zenoh DIR`: what files of sessions and routers enforce, asked with `can` and audited."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Network, Run
from tests.keystore.builder import sros2
from tests.oracles.zenoh.deployment import Configuration, access, allow, deny, session, tls, tool, written
from tests.schemas import schema

CHATTER = "0/chatter/*/*"
AT = "2026-11-21T12:00:00Z"


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    return sros2(tmp_path / "keys", ("/talker", "/listener", "/random"))


def peer(name: str, **changed: Any) -> Configuration:
    """/talker listens, others connect to it and listen themselves."""
    ends = {"talker": {"listen": ["tls/localhost:7448"]}}
    others = {"listen": [f"tls/localhost:{7449 + len(name)}"], "connect": ["tls/localhost:7448"]}
    return session("peer", **ends.get(name, others), **changed)


def asked(run: Run, keys: Path, folder: Path, *words: str) -> tuple[int, dict[str, Any]]:
    done = run("can", keys, *words, "--zenoh", folder, "--at", AT, "-f", "json")
    assert done.returncode in (0, 1, 4), done.stderr
    document: dict[str, Any] = json.loads(done.stdout)
    schema("can_routed").validate(document)
    return done.returncode, document


def both(run: Run, keys: Path, folder: Path, *words: str) -> tuple[str, str]:
    """With its own file, and without; the same under all releases."""
    _code, document = asked(run, keys, folder, *words)
    (found,) = {(each["decision"], each["effective"]) for each in document["decisions"].values()}
    return found


def test_a_generated_file_restrains_only_its_owner(keystore_audit: Run, keys: Path, network: Network) -> None:
    """The same file of /listener, once from anybody and once from /talker alone: one change flips what /random can."""
    files = {"talker": peer("talker", **tool(publish="chatter")), "random": peer("random", **tool(publish="random"))}
    folder = network(**files, listener=peer("listener", **tool(subscribe="chatter")))
    assert both(keystore_audit, keys, folder, "/random", "publish", "/chatter") == ("deny", "allow")
    assert both(keystore_audit, keys, folder, "/talker", "publish", "/chatter") == ("allow", "allow")
    rules = [allow(CHATTER, "put", flows=["ingress"]), allow(CHATTER, "declare_subscriber", flows=["egress"])]
    named = peer("listener", **access(({"cert_common_names": ["/talker"]}, rules)))
    (folder / "listener.json5").write_text(written({**tls(keys, "listener"), **named}))
    assert both(keystore_audit, keys, folder, "/random", "publish", "/chatter") == ("deny", "deny")
    assert both(keystore_audit, keys, folder, "/talker", "publish", "/chatter") == ("allow", "allow")


def test_exit_codes_are_those_of_can(keystore_audit: Run, keys: Path, network: Network) -> None:
    folder = network(
        talker=peer("talker", **tool(publish="chatter")),
        listener=peer("listener", **tool(subscribe="chatter")),
        random=peer("random", **tool(publish="random")),
    )
    for words, code in (
        (("/talker", "publish", "/chatter"), 0),
        (("/random", "publish", "/chatter"), 1),
        (("/random", "publish", "/chatter", "--effective"), 0),
        (("/random", "publish", "/chatter", "--expect", "deny"), 0),
    ):
        assert asked(keystore_audit, keys, folder, *words)[0] == code, words
    text = keystore_audit("can", keys, "/random", "publish", "/chatter", "--zenoh", folder, "--at", AT).stdout.decode()
    assert "Without its file, it can" in text
    assert "it reaches /listener" in text


def test_an_enclave_without_a_file_is_unknown(keystore_audit: Run, keys: Path, network: Network) -> None:
    """It may start with the defaults, which are plain; what others let in does not hang on that."""
    folder = network(talker=peer("talker", **tool(publish="chatter")), listener=peer("listener", **tool("", "chatter")))
    assert both(keystore_audit, keys, folder, "/random", "publish", "/chatter") == ("unknown", "allow")


@pytest.mark.parametrize("operation", ["request", "call"])
def test_services_and_actions(keystore_audit: Run, keys: Path, network: Network, operation: str) -> None:
    served = (
        "go"
        if operation == "request"
        else " ".join(f"go/_action/{each}" for each in ("cancel_goal", "get_result", "send_goal"))
    )
    topics = "" if operation == "request" else "go/_action/feedback go/_action/status"
    folder = network(
        talker=peer("talker", **tool(reply=served, publish=topics)),
        listener=peer("listener", **tool(request=served, subscribe=topics)),
        random=peer("random", **tool(publish="random")),
    )
    assert both(keystore_audit, keys, folder, "/listener", operation, "/go") == ("allow", "allow")
    assert both(keystore_audit, keys, folder, "/random", operation, "/go") == ("deny", "allow")
    assert both(keystore_audit, keys, folder, "/listener", operation, "/stop") == ("deny", "deny")


def test_a_deny_rule_under_default_allow_keeps_no_attacker_out(
    keystore_audit: Run, keys: Path, network: Network
) -> None:
    section = access(({}, [deny(CHATTER, "put")]), default="allow")
    folder = network(
        talker=peer("talker", **section), listener=peer("listener", **section), random=peer("random", **section)
    )
    assert both(keystore_audit, keys, folder, "/random", "publish", "/chatter") == ("deny", "allow")


def test_releases_before_one_six_ask_one_subject_of_several(keystore_audit: Run, keys: Path, network: Network) -> None:
    two = access(({"link_protocols": ["tls"]}, [deny(CHATTER, "put")]), ({}, [allow("0/**")]))
    folder = network(talker=peer("talker", **tool("chatter")), listener=peer("listener", **two))
    _code, document = asked(
        keystore_audit,
        keys,
        folder,
        "/random",
        "publish",
        "/chatter",
        "--profile",
        "zenoh-1.4",
        "--profile",
        "zenoh-1.6",
    )
    assert {name: each["effective"] for name, each in document["decisions"].items()} == {
        "zenoh-1.4": "unknown",
        "zenoh-1.6": "allow",
    }


def test_a_field_that_a_release_may_refuse(keystore_audit: Run, keys: Path, network: Network) -> None:
    """`zids` is refused by 1.4.0 and taken by 1.5.1, which are one profile."""
    section = access(({"zids": ["ab"]}, [allow("0/**")]))
    folder = network(talker=peer("talker", **tool("chatter")), listener=peer("listener", **section))
    for profile, effective in (("zenoh-1.4", "unknown"), ("zenoh-1.6", "allow")):
        words = ("/random", "publish", "/chatter", "--profile", profile)
        _code, document = asked(keystore_audit, keys, folder, *words)
        assert document["decisions"][profile]["effective"] == effective


UNCLEAR: dict[str, dict[str, Any]] = {
    "yaml": {"more_yaml": "mode: peer"},
    "plugin": {"more": {**session(), "plugins": {"rest": {"http_port": 8000}}}},
    "unseen router": {"more": session(connect=["tls/elsewhere:7447"])},
    "other link": {"more": session("peer", listen=["unixpipe/a.pipe"])},
    "namespace": {"more": {**session(), "namespace": "robot1"}},
    "too deep": {"more": "[" * 100 + "]" * 100},
}


@pytest.mark.parametrize("name", UNCLEAR)
def test_what_cannot_be_told_denies_nothing(keystore_audit: Run, keys: Path, network: Network, name: str) -> None:
    files = {"talker": peer("talker", **tool("chatter")), "listener": peer("listener", **tool("", "chatter"))}
    folder = network(**files)
    asks = ("/listener", "publish", "/other")
    assert both(keystore_audit, keys, folder, *asks) == ("deny", "deny")
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()
    folder = network(**files, **UNCLEAR[name])
    assert both(keystore_audit, keys, folder, *asks) == ("unknown", "unknown")
    done = keystore_audit(keys, "--zenoh", folder, "--at", AT, "--engine", "native", "-f", "json")
    assert done.returncode == 4
    assert "KA826" in {each["code"] for each in json.loads(done.stdout)["findings"]}
    done = keystore_audit(keys, "--zenoh", folder, "--at", AT, "--engine", "native", "--ignore", "KA8")
    assert done.returncode == 4


PASSWORDS = {"auth": {"usrpwd": {"user": "a", "password": "b"}}}


@pytest.mark.parametrize(
    ("more", "effective"),
    [({"plugins": {"rest": {}}}, "allow"), ({"namespace": "robot1"}, "unknown"), (PASSWORDS, "unknown")],
)
def test_where_less_may_pass_nothing_is_allowed_for_certain(
    keystore_audit: Run, keys: Path, network: Network, more: Any, effective: str
) -> None:
    """Plugins let no less through."""
    listener = peer("listener", **tool("", "chatter"), **tls(keys, "listener"))
    listener |= {"transport": {**listener["transport"], **more}} if more is PASSWORDS else more
    folder = network(talker=peer("talker", **tool("chatter")), listener=listener)
    asks = ("/random", "publish", "/chatter")
    assert both(keystore_audit, keys, folder, *asks)[1] == effective


def test_usage(keystore_audit: Run, keys: Path, network: Network, tmp_path: Path) -> None:
    folder = network(talker=peer("talker", **tool("chatter")))
    empty = tmp_path / "empty"
    empty.mkdir()
    asks = ("/talker", "publish", "/chatter")
    for words, code, said in (
        ((keys, "--rmw", "zenoh"), 2, "--zenoh DIR"),
        (("can", keys, *asks, "--rmw", "rmw_zenoh_cpp"), 2, "--zenoh DIR"),
        (("can", keys, *asks, "--profile", "zenoh-1.6"), 2, "--zenoh DIR"),
        ((keys, keys, "--zenoh", folder), 2, "name one KEYSTORE"),
        (("can", keys, *asks, "--zenoh", folder, "--kind", "ros"), 2, "--kind"),
        (("can", keys, "/talker", "relay", "/chatter", "--zenoh", folder), 2, "relay"),
        (("can", keys, "/nobody", "publish", "/chatter", "--zenoh", folder), 2, "There is no enclave"),
        (("can", keys, *asks, "--zenoh", empty), 3, "no .json5 or .json file"),
        ((keys, "--zenoh", tmp_path / "none"), 3, "no directory"),
    ):
        done = keystore_audit(*words, "--at", AT)
        assert done.returncode == code, (words, done.stderr)
        assert said in done.stderr.decode(), words
    done = keystore_audit("can", keys, *asks, "--zenoh", folder, "--rmw", "zenoh", "--distro", "humble", "-f", "json")
    assert list(json.loads(done.stdout)["decisions"]) == ["zenoh-1.6"]


SECRETS = {
    "password": {"transport": {"auth": {"usrpwd": {"user": "a", "password": "sw0rdfish"}}}},
    "key": {"metadata": {"note": "-----BEGIN PRIVATE KEY-----\nsw0rdfish\n-----END PRIVATE KEY-----\n"}},
    "base64": {"transport": {"link": {"tls": {"listen_private_key_base64": "sw0rdfish"}}}},
}


@pytest.mark.parametrize("name", SECRETS)
@pytest.mark.parametrize("form", ["text", "json", "html", "sarif"])
def test_a_secret_is_critical_and_never_shown(
    keystore_audit: Run, keys: Path, network: Network, name: str, form: str
) -> None:
    folder = network(talker={**session("peer"), **SECRETS[name]})
    done = keystore_audit(keys, "--zenoh", folder, "--at", AT, "--engine", "native", "-v", "-f", form)
    assert b"KA825" in done.stdout
    assert b"sw0rdfish" not in done.stdout + done.stderr


def test_hostile_folders_are_read_within_bounds(
    keystore_audit: Run, keys: Path, network: Network, tmp_path: Path
) -> None:
    """No device is read, no link leads out, and what is not read is unknown."""
    folder = network(talker=peer("talker", **tool("chatter")), listener=peer("listener", **tool("", "chatter")))
    (tmp_path / "outside.json5").write_text('{"metadata": "outside"}')
    (folder / "link.json5").symlink_to("../outside.json5")
    os.mkfifo(folder / "pipe.json5")
    (folder / "large.json5").write_bytes(b" " * (5 * 1024 * 1024))
    (folder / "\x1b[31m.json5").write_bytes(b"\xff")
    (folder / "deeper").mkdir()
    (folder / "deeper" / "more.json").write_text("{")
    code, document = asked(keystore_audit, keys, folder, "/listener", "publish", "/other")
    assert code == 4
    unknown = {Path(each["path"]).name for each in document["unknown"]}
    assert unknown == {"link.json5", "pipe.json5", "large.json5"}
    done = keystore_audit(keys, "--zenoh", folder, "--at", AT, "--engine", "native")
    assert b"\x1b" not in done.stdout
    refused = [
        f
        for f in json.loads(
            keystore_audit(keys, "--zenoh", folder, "--at", AT, "--engine", "native", "-f", "json").stdout
        )["findings"]
        if f["code"] == "KA820"
    ]
    assert len(refused) == 2


@pytest.mark.parametrize("unread", [False, True])
def test_a_model_says_what_it_leaves_out(
    unread: bool, keystore_audit: Run, keys: Path, network: Network, tmp_path: Path
) -> None:
    folder = network(talker=peer("talker", **tool(publish="chatter")), **{"more_yaml": "mode: peer"} if unread else {})
    asked = ("model", keys, "--zenoh", folder, "-o", tmp_path / "model", "--at", AT)
    assert keystore_audit(*asked, "--domain", "0").returncode == 2
    assert keystore_audit(*asked).returncode == (4 if unread else 0)
    written = (tmp_path / "model/zenoh-1.7/asked.als").read_text()
    assert ("more.yaml: yaml is not read" in written) is unread
    assert "-- /talker" in (tmp_path / "model/zenoh-1.7/network.als").read_text()
