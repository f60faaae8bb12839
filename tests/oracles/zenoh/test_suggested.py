"""What `suggest` writes, on real sessions: what is granted comes through, and what is not does not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.keystores import answer, keystore, rule
from tests.oracles.zenoh.asking import real_answers
from tests.oracles.zenoh.case import Case

FIRST_PORT = 20440
pytestmark = pytest.mark.xdist_group("sessions")  # ports and time: one worker for all
PLACES = ("7447", "7448")
ROUTER = "/zenohd"
TRIED = (
    ("client", "put", "server", "chatter", False, "yes"),
    ("random", "put", "server", "chatter", False, "no"),
    ("random", "put", "server", "chatter", True, "no"),
    ("random", "read", "client", "chatter", True, "no"),
    ("client", "get", "server", "add", False, "yes"),
    ("server", "answer", "client", "add", False, "yes"),
    ("random", "get", "server", "add", True, "no"),
    ("random", "answer", "client", "add", True, "no"),
    ("random", "put", "server", "low", False, "yes"),
    ("random", "put", "client", "low", True, "no"),
)
"""Who does what to whom, whether it drops the rules of its own file, and whether that comes through."""


@pytest.mark.parametrize(
    ("number", "form", "host"),
    [
        (0, ("--router", ROUTER), "localhost"),
        (1, ("--router", ROUTER, "--listen", f"{ROUTER}=localhost:7447"), None),
        (2, ("--listen", "/server=localhost:7447", "--listen", "/client=localhost:7448"), None),
    ],
)
def test_what_is_granted_comes_through_and_nothing_else(
    number: int, form: tuple[str, ...], host: str | None, tmp_path: Path
) -> None:
    """Certificates for no host are those of sros2. Whoever drops its rules connects to all that listen."""
    request, reply = ("rq/addRequest",), ("rr/addReply",)
    keys, folder = tmp_path / "keys", tmp_path / "network"
    rules = {
        "/client": rule(("rt/chatter", *request), reply),
        "/server": rule(reply, ("rt/chatter", "rt/low", *request)),
        "/random": rule(("rt/random", "rt/low"), ("rt/random",)),
        ROUTER: rule(("rt/nothing",)),
    }
    keystore(keys, {path: (each,) for path, each in rules.items()}, host=host)
    assert answer("suggest", keys, "--as", "zenoh", *form, "-o", folder) == (0, "")
    texts = {each.parent.name: each.read_text() for each in folder.rglob("*.json5")}
    cases, expected = [], {}
    for tried, (who, does, whom, topic, drops, comes) in enumerate(TRIED):
        port = FIRST_PORT + 2 * (tried + number * len(TRIED))
        sessions = {
            name: json.loads(text.replace(PLACES[0], f"{port}").replace(PLACES[1], f"{port + 1}"))
            for name, text in texts.items()
        }
        if drops:
            del sessions[who]["access_control"]
            ends = [end for each in sessions.values() for end in each["listen"]["endpoints"]]
            sessions[who]["connect"]["endpoints"] = [f"{end}#verify_name_on_connect=false" for end in ends]
        key = f"0/{topic}/std_msgs::msg::dds_::String_/RIHS01_0"
        cases.append(Case(f"{tried}", "", sessions, (), who, whom, does, key=key, at=key))
        expected[f"{tried}"] = comes
    assert real_answers(cases, expected) == expected
