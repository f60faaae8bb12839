"""Run by a process of its own: opens the sessions of one case on loopback, tries one thing, and says what came of it.

Standard input: `{"sessions": {name: configuration}, "order": [name], "who", "whom", "does", "key", "at", "after",
"wire", "override", "patience"}`; output: `yes`, `no`, or `error: ...` where a configuration is refused.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections.abc import Mapping
from threading import Thread

import zenoh

LINKED = 0.8
"""Seconds for sessions to hear of each other."""
WAITED = 0.25
"""Seconds between tries."""
TRIES = 3
PAYLOAD = b"said in the clear"


def main() -> str:
    case = json.load(sys.stdin)
    opened: dict[str, zenoh.Session] = {}
    read = tapped(*case["wire"]) if case["wire"] is not None else None
    for name in case["order"]:
        opened_or_not = opening(case["sessions"][name], case["override"])
        if isinstance(opened_or_not, str):
            return "no" if "Unable to connect" in opened_or_not else f"error: {name}: {opened_or_not}"
        opened[name] = opened_or_not
    time.sleep(max(0, case["after"] - time.time()))
    came = done(opened[case["who"]], opened[case["whom"]], case["does"], case["key"], case["at"], case["patience"])
    if read is not None and not came:
        raise RuntimeError("nothing came over the wire")
    return "yes" if (came if read is None else any(PAYLOAD in each for each in read)) else "no"


def opening(configuration: str, override: Mapping[str, str]) -> zenoh.Session | str:
    """A session, or why there is none."""
    try:
        made = zenoh.Config.from_json5(configuration)
        for path, value in override.items():
            made.insert_json5(path, value)
        return zenoh.open(made)
    except zenoh.ZError as error:
        return f"{error}"


def tapped(port: int, real: int) -> list[bytes]:
    """What comes to a port, which hands it on."""
    read: list[bytes] = []

    def hand_on(near: socket.socket, far: socket.socket) -> None:
        while data := near.recv(65536):
            read.append(data)
            far.sendall(data)

    def serve(waiting: socket.socket) -> None:
        near, far = waiting.accept()[0], socket.create_connection(("127.0.0.1", real))
        for ends in ((near, far), (far, near)):
            Thread(target=hand_on, args=ends, daemon=True).start()

    Thread(target=serve, args=(socket.create_server(("127.0.0.1", port)),), daemon=True).start()
    return read


def linked(one: zenoh.Session, other: zenoh.Session) -> bool:
    """Whether one has a link to the other; of clients none are told."""
    return f"{other.info.zid()}" in map(str, (*one.info.peers_zid(), *one.info.routers_zid()))


def done(who: zenoh.Session, whom: zenoh.Session, does: str, key: str, at: str, patience: int) -> bool:
    """Whether what `who` does on `key` comes to `whom`, who is at the key `at`; a busy machine needs `patience`."""
    got: list[object] = []
    if does in ("put", "delete"):
        kind = {"put": zenoh.SampleKind.PUT, "delete": zenoh.SampleKind.DELETE}[does]
        whom.declare_subscriber(at, lambda sample: got.append(sample) if sample.kind == kind else None)
        send = (lambda: who.put(key, PAYLOAD)) if does == "put" else (lambda: who.delete(key))
    elif does == "read":
        who.declare_subscriber(key, got.append)
        send = lambda: whom.put(at, PAYLOAD)  # noqa: E731
    elif does in ("get", "ask"):
        if does == "get":
            whom.declare_queryable(at, got.append)
        asked = key if does == "get" else f"@/{whom.info.zid()}/**"  # each session answers about itself
        heard = got.append if does == "ask" else lambda _reply: None
        send = lambda: who.get(asked, lambda reply: heard(reply) if reply.ok else None, timeout=0.2)  # noqa: E731
    elif does == "answer":
        who.declare_queryable(key, lambda query: query.reply(at, PAYLOAD))
        send = lambda: whom.get(at, lambda reply: got.append(reply) if reply.ok else None, timeout=0.2)  # noqa: E731
    elif does in ("token", "see"):
        tells, sees = (who, whom) if does == "token" else (whom, who)
        told, seen = (key, at) if does == "token" else (at, key)
        sees.liveliness().declare_subscriber(seen, got.append, history=True)
        send = lambda: tells.liveliness().declare_token(told)  # noqa: E731
    elif does == "link":
        send = lambda: got.extend([1] * (linked(who, whom) or linked(whom, who)))  # noqa: E731
    else:
        raise ValueError(does)
    time.sleep(LINKED * patience)
    kept = []
    for _ in range(TRIES):
        kept.append(send())
        time.sleep(WAITED * patience)
        if got:
            return True
    return False


if __name__ == "__main__":
    print(main(), flush=True)
    os._exit(0)  # sessions take seconds to close
