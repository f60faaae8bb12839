"""What `suggest` writes, on real sessions: what is granted comes through, and what is not does not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.keystores import answer, keystore, rule
from tests.oracles.zenoh.asking import real_answers
from tests.oracles.zenoh.cases import Case

FIRST_PORT = 20480
pytestmark = pytest.mark.xdist_group("sessions")  # ports and time: one worker for all
TRIED = (
    ("client", "put", "server", "chatter", False, "yes"),
    ("random", "put", "server", "chatter", False, "no"),
    ("random", "put", "server", "chatter", True, "no"),
    ("random", "read", "client", "chatter", True, "no"),
    ("client", "get", "server", "add", False, "yes"),
    ("server", "answer", "client", "add", False, "yes"),
    ("random", "get", "server", "add", True, "no"),
    ("random", "answer", "client", "add", True, "no"),
)
"""Who does what to whom, whether it drops the rules of its own file, and whether that comes through."""


def test_what_is_granted_comes_through_and_nothing_else(tmp_path: Path) -> None:
    request, reply = ("rq/addRequest",), ("rr/addReply",)
    keys, folder = tmp_path / "keys", tmp_path / "network"
    rules = {
        "/client": rule(("rt/chatter", *request), reply),
        "/server": rule(reply, ("rt/chatter", *request)),
        "/random": rule(("rt/random",), ("rt/random",)),
        "/zenohd": rule(("rt/zenohd",)),
    }
    keystore(keys, {path: (each,) for path, each in rules.items()}, host="localhost")
    assert answer("suggest", keys, "--as", "zenoh", "--router", "/zenohd", "-o", folder) == (0, "")
    texts = {each.parent.name: each.read_text() for each in folder.rglob("*.json5")}
    cases, expected = [], {}
    for number, (who, does, whom, topic, drops, comes) in enumerate(TRIED):
        sessions = {name: json.loads(text.replace("7447", f"{FIRST_PORT + number}")) for name, text in texts.items()}
        if drops:
            del sessions[who]["access_control"]
        key = f"0/{topic}/std_msgs::msg::dds_::String_/RIHS01_0"
        cases.append(Case(f"{number}", "", sessions, (), who, whom, does, key=key, at=key))
        expected[f"{number}"] = comes
    assert real_answers(cases, expected) == expected
