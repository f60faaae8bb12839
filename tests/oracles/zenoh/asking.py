"""Asks real sessions and us about a case."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from pathlib import Path

from keystore_audit.keystore.keystore import Keystore
from keystore_audit.profiles import ROUTED, Release
from keystore_audit.zenoh.access_control import Key, Kind, Meant
from keystore_audit.zenoh.links import Links, Message, find_way
from keystore_audit.zenoh.network import read_network
from tests.oracles.zenoh.case import Case
from tests.oracles.zenoh.deployment import NOW, written

SECONDS = 60
TOGETHER = 6
"""Processes at a time: they wait more than they work."""
NEWEST = ROUTED["zenoh-1.7"]
OLDER = {"1.4.0": "zenoh-1.4", "1.6.2": "zenoh-1.6", "1.7.2": "zenoh-1.7"}
"""Older releases, of which `make test-long` makes environments, and their profiles."""


def real(case: Case, python: str = sys.executable, patience: int = 1) -> str:
    """What happens on real sessions, in a process of their own."""
    order = sorted(case.sessions, key=lambda name: bool(case.sessions[name]["connect"]["endpoints"]))
    asked = {
        "sessions": {name: written(each) for name, each in case.sessions.items()},
        **{name: getattr(case, name) for name in ("who", "whom", "does", "key", "at", "wire", "override")},
        "after": case.after.timestamp() if case.after is not None else 0,
        "order": order,
        "patience": patience,
    }
    script = Path(__file__).with_name("sessions.py")
    done = subprocess.run(
        [python, str(script)], input=json.dumps(asked), capture_output=True, text=True, timeout=SECONDS, check=True
    )
    return done.stdout.strip().partition(":")[0]


def real_answers(cases: Sequence[Case], expected: Mapping[str, str], python: str = sys.executable) -> dict[str, str]:
    """Those of all cases, several processes at a time, of the release that `python` has.

    A busy machine may be late: where something is expected to come and does not, it is asked again alone, more and more
    patiently.
    """
    with ThreadPoolExecutor(TOGETHER) as pool:
        answers = dict(
            zip((case.name for case in cases), pool.map(lambda case: real(case, python), cases), strict=True)
        )
    for patience in (4, 8, 16):
        late = [case for case in cases if expected[case.name] == "yes" != answers[case.name]]
        answers |= {case.name: real(case, python, patience) for case in late}
    return answers


_MESSAGES: dict[str, Callable[[Key, Key], tuple[Message, ...]]] = {
    "put": lambda key, at: (Message(Kind.PUT, True, key), Message(Kind.SUBSCRIBE, False, at)),
    "delete": lambda key, at: (Message(Kind.DELETE, True, key), Message(Kind.SUBSCRIBE, False, at)),
    "read": lambda key, at: (Message(Kind.SUBSCRIBE, True, key), Message(Kind.PUT, False, at)),
    "get": lambda key, at: (Message(Kind.QUERY, True, key), Message(Kind.SERVE, False, at)),
    "answer": lambda key, at: (
        Message(Kind.SERVE, True, key), Message(Kind.QUERY, False, at), Message(Kind.REPLY, True, at),
    ),
    "see": lambda key, at: (Message(Kind.TOKEN_SUBSCRIBE, True, key), Message(Kind.TOKEN, False, at)),
    "token": lambda key, at: (Message(Kind.TOKEN, True, key), Message(Kind.TOKEN_SUBSCRIBE, False, at)),
}  # fmt: skip
_MESSAGES["ask"] = _MESSAGES["get"]


def ours(case: Case, keystore: Keystore, folder: Path, release: Release = NEWEST, at: datetime = NOW) -> str:
    """What we say of the files of the case, at an aware instant."""
    for name in case.files:
        folder.mkdir(exist_ok=True)
        (folder / f"{name}.json5").write_text(written(case.sessions[name]), "utf-8")
    network = read_network(folder, keystore, at)
    if any(not each.says.starts for each in network.processes):
        return "error"
    links = Links(network)
    by_name = {Path(each.path).stem: each for each in network.processes}
    enclaves = {each.path: each for each in keystore.enclaves}
    own, mode = by_name.get(case.who), case.sessions[case.who]["mode"]
    attacks = (tie for tie in links.attacks(enclaves.get(f"/{case.as_if}")) if tie.mode.value == mode)
    begins = links.of(own) if own is not None else [tie for tie in attacks if tie.far is by_name.get(case.to, tie.far)]
    key, at = Key(case.key, Meant.ONE), Key(case.at, Meant.ONE)
    messages = _MESSAGES[case.does](key, at)
    for certain in (True, False):
        ends = by_name[case.whom]
        way = find_way(links, begins, messages, lambda each: each is ends, release, certain=certain)  # noqa: B023
        if way is not None:
            return "yes" if certain else "unknown"
    return "unknown" if network.doubts else "no"
