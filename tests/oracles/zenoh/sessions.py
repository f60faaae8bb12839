"""Run by a process of its own: opens the sessions of one case on loopback, tries one thing, and says what came of it.

Standard input: `{"sessions": {name: configuration}, "order": [name], "who", "whom", "does", "key", "at", "patience"}`;
output: `yes`, `no`, or `error: ...` where a configuration is refused.
"""

from __future__ import annotations

import json
import os
import sys
import time

import zenoh

LINKED = 0.8
"""Seconds for sessions to hear of each other."""
WAITED = 0.25
"""Seconds between tries."""
TRIES = 3


def main() -> str:
    case = json.load(sys.stdin)
    opened: dict[str, zenoh.Session] = {}
    for name in case["order"]:
        opened_or_not = opening(case["sessions"][name])
        if isinstance(opened_or_not, str):
            return "no" if "Unable to connect" in opened_or_not else f"error: {name}: {opened_or_not}"
        opened[name] = opened_or_not
    came = done(opened[case["who"]], opened[case["whom"]], case["does"], case["key"], case["at"], case["patience"])
    return "yes" if came else "no"


def opening(configuration: str) -> zenoh.Session | str:
    """A session, or why there is none."""
    try:
        return zenoh.open(zenoh.Config.from_json5(configuration))
    except zenoh.ZError as error:
        return f"{error}"


def done(who: zenoh.Session, whom: zenoh.Session, does: str, key: str, at: str, patience: int) -> bool:
    """Whether what `who` does on `key` comes to `whom`, who is at the key `at`; a busy machine needs `patience`."""
    got: list[object] = []
    if does in ("put", "delete"):
        kind = {"put": zenoh.SampleKind.PUT, "delete": zenoh.SampleKind.DELETE}[does]
        whom.declare_subscriber(at, lambda sample: got.append(sample) if sample.kind == kind else None)
        send = (lambda: who.put(key, b"x")) if does == "put" else (lambda: who.delete(key))
    elif does == "read":
        who.declare_subscriber(key, got.append)
        send = lambda: whom.put(at, b"x")  # noqa: E731
    elif does == "get":
        whom.declare_queryable(at, got.append)
        send = lambda: who.get(key, lambda _reply: None, timeout=0.2)  # noqa: E731
    elif does == "answer":
        who.declare_queryable(key, lambda query: query.reply(at, b"x"))
        send = lambda: whom.get(at, lambda reply: got.append(reply) if reply.ok else None, timeout=0.2)  # noqa: E731
    elif does == "token":
        whom.liveliness().declare_subscriber(at, got.append, history=True)
        send = lambda: who.liveliness().declare_token(key)  # noqa: E731
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
