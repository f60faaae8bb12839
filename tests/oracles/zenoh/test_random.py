"""Small deployments by chance, asked of real sessions and of us: what we are certain of is what happens."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest
from msgspec.structs import replace

from keystore_audit.keystore.keystore import read_keystore
from tests.amount import tried
from tests.oracles.zenoh import deployment
from tests.oracles.zenoh.asking import ours, real_answers
from tests.oracles.zenoh.case import Case, K
from tests.oracles.zenoh.deployment import Configuration, access, allow, deny, session, tls

FIRST_PORT = 23000
pytestmark = pytest.mark.xdist_group("sessions")  # ports and time: one worker for all
KEYS = (K, "0/**", "0/chatter/**", "0/*/T/H", "**", "0/other/**", "0/ch$*r/T/H")
WIDE = (K, K, K, "0/**", "0/*/T/H")
NAMES = ("talker", "listener", "random", "p384")


def deployed(chance: Random, root: Path, number: int) -> Case:
    """One or two routers, two to four sessions, rules here and there, and something that one of them does."""
    port, secured, gossip = FIRST_PORT + 8 * number, chance.random() < 0.5, chance.random() < 0.5
    protocol = "tls" if secured else "tcp"
    ends = [f"{protocol}/127.0.0.1:{port + each}" for each in range(8)]
    there: dict[str, Configuration] = {}
    for each in range(chance.choice((1, 1, 2))):
        more = {"connect": [ends[0]]} if each else {}
        there[f"router{each}"] = session(
            "router", listen=[ends[each]], gossip=gossip, **more, **_of(root, secured, "zenohd")
        )
    routers = [*there]
    for each in range(chance.choice((2, 3, 4))):
        mode = chance.choice(("peer", "client"))
        shared: dict[str, Any] = {"connect": [ends[chance.randrange(len(routers))]], "gossip": gossip}
        listens = {"listen": [ends[4 + each]]} if mode == "peer" else {}
        there[f"session{each}"] = session(mode, **shared, **listens, **_of(root, secured, NAMES[each]))
    for name in there:
        if chance.random() < 0.5:
            there[name] |= _rules(chance, secured)
    who, whom = chance.sample([name for name in there if name not in routers], 2)
    does = chance.choice(("put", "put", "delete", "read", "get", "answer"))
    return Case(f"{number}", "", there, tuple(there), who, whom, does, chance.choice(WIDE))


def _of(root: Path, secured: bool, name: str) -> Configuration:
    return tls(root, name) if secured else {}


def _rules(chance: Random, secured: bool) -> Configuration:
    given = []
    for _ in range(chance.choice((1, 1, 2, 3))):
        properties: dict[str, Any] = {}
        if secured and chance.random() < 0.5:
            properties["cert_common_names"] = [f"/{each}" for each in chance.sample((*NAMES, "zenohd"), 2)]
        if chance.random() < 0.2:
            properties["link_protocols"] = [chance.choice(("tcp", "tls"))]
        rules = []
        for _ in range(chance.choice((1, 2, 3))):
            messages = deployment.ALL if chance.random() < 0.5 else chance.sample(deployment.ALL, 2)
            flows = chance.choice((None, None, ["ingress"], ["egress"]))
            rules.append(chance.choice((allow, allow, deny))(chance.choice(KEYS), *messages, flows=flows))
        given.append((properties, rules))
    return access(*given, default=chance.choice(("allow", "deny")))


def attacked(chance: Random, root: Path, number: int) -> Case:
    """The same, where whoever does something has an enclave's key, no rules, and connects as whatever it likes."""
    case = deployed(chance, root, number)
    there = {name: each for name, each in case.sessions.items() if name != case.who}
    to = chance.choice([name for name, each in there.items() if each["listen"]["endpoints"]])
    (end, *_), name = there[to]["listen"]["endpoints"], chance.choice(NAMES)
    mode, protocol = chance.choice(("client", "peer", "router")), end.partition("/")[0]
    listens = {} if mode == "client" else {"listen": [f"{protocol}/127.0.0.1:0"]}
    mine = session(mode, connect=[end], **listens, **_of(root, protocol == "tls", name))
    return replace(case, sessions={**there, "who": mine}, files=tuple(there), who="who", as_if=name, to=to)


@pytest.mark.slow
@pytest.mark.parametrize("making", [deployed, attacked])
def test_what_we_are_certain_of_happens(tmp_path: Path, making: Callable[[Random, Path, int], Case]) -> None:
    root = deployment.keystore(tmp_path / "keystore")
    cases = [making(Random(seed), root, seed) for seed in range(tried(60))]
    keystore = read_keystore(root)
    said = {case.name: ours(case, keystore, tmp_path / case.name) for case in cases}
    answers = real_answers(cases, said)
    wrong = {name: (said[name], answer) for name, answer in answers.items() if said[name] not in (answer, "unknown")}
    assert wrong == {}
    assert sum(each == "unknown" for each in said.values()) * 10 <= len(cases)
