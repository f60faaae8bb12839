"""What somebody does whom a finding of KA8 warns of, with the files of its samples; and what is no attack, and why."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from tests.oracles.zenoh.case import K
from tests.oracles.zenoh.deployment import Configuration, session, tls
from tools.samples.base import IDENTITY_CA, PERMISSIONS_CA
from tools.samples.certificates import Certificate
from tools.samples.identity_stories import STOLEN
from tools.samples.keys import Key
from tools.samples.network_stories import HOST, NEXT_CA, OPENS, PAIR

THIEVES = Path("/etc/thieves")
"""Where attackers have their keys: the place is written over, as that of the keystore is."""
SECRET = "0/secret/T/H"
IMAGE = "0/image/T/H"
RAW = "0/image/raw/T/H"
TOKEN = "@ros2_lv/0/z/0"


class Attack(Struct, frozen=True, kw_only=True):
    """`who` does something on `key` to `whom`, who is at `at`: bad files let it, good ones do not.

    `own`: what `who` starts with, where it is none of the sample's; if it is, it drops its rules, and connects to all
    that listen, but where a link of its own is the question. `instead`: of whom nothing starts, since somebody is in
    its place. `default`: with what somebody starts of whom there is no file.
    """

    who: str = "thief"
    whom: str = "listener"
    does: str = "put"
    key: str = K
    at: str = K
    own: Configuration | None = None
    instead: str = ""
    default: tuple[str, Configuration] | None = None


class Effect(Struct, frozen=True, kw_only=True):
    """No attack: what comes of what is meant, as `talker` sends it, with the bad files and with the good ones, and why.

    `drops`: who starts without rules.
    """

    bad: str
    why: str
    good: str = "yes"
    who: str = "talker"
    whom: str = "listener"
    drops: str = ""


def _thief(name: str | None, mode: str = "client", **more: object) -> Configuration:
    """A session with somebody's key, None: with none, that takes whomever it reaches."""
    return session(mode, **more, **tls(THIEVES, name))


_HEARD = {"multicast": {"enabled": True}, "gossip": {"enabled": True}}
_DROPPED = Attack(who="talker", key=SECRET, at=SECRET)
_BEYOND = Attack(who="random")
_IN_PLACE = _thief("random", "peer", listen=[OPENS])
_ELSEWHERE = "tcp/127.0.0.1:7448"

ATTACKS: Mapping[str, Attack] = {
    "KA801": Attack(own=_thief(None, connect=[OPENS]), whom="talker", does="link"),
    "KA802": Attack(own=session(connect=["tcp/127.0.0.1:7447"]), whom="talker", does="link"),
    "KA803": Attack(own=session("peer", listen=["udp/224.0.0.224:7446"]), whom="talker", does="read"),
    "KA804": _DROPPED,
    "KA805": _DROPPED,
    "KA806": replace(_DROPPED, key="**"),
    "KA807": Attack(own=_IN_PLACE, instead="talker"),
    "KA808": _BEYOND,
    "KA809": Attack(who="talker", does="link"),
    "KA810": Attack(own=session("peer", listen=[_ELSEWHERE]) | {"scouting": _HEARD}, whom="talker", does="link"),
    "KA811": Attack(own=_thief("hostless", "peer", listen=[OPENS]), instead="talker", does="link"),
    "KA812": Attack(who="camera", whom="viewer", key=RAW, at=RAW),
    "KA814": Attack(own=_thief("stolen", connect=[OPENS]), whom="talker", does="link"),
    "KA815": Attack(own=_thief("certified", connect=[OPENS]), whom="talker", does="read"),
    "KA818": Attack(own=_thief("talkr", "peer", listen=[OPENS]), instead="talker"),
    "KA822": _BEYOND,
    "KA824": Attack(
        own=session(connect=[_ELSEWHERE]), default=("listener", session("peer", listen=[_ELSEWHERE], gossip=True))
    ),
    "KA827": _DROPPED,
    "KA828": _BEYOND,
    "KA835": Attack(own=_IN_PLACE, instead="talker", does="token", key=TOKEN, at=TOKEN),
}  # fmt: skip

EFFECTS: Mapping[str, Effect] = {
    "KA816": Effect(bad="error", why="with the key of another the process does not start"),
    "KA817": Effect(bad="error", why="the process does not start where there is no such file"),
    "KA820": Effect(bad="error", why="the file is refused"),
    "KA821": Effect(bad="no", good="no", who="listener", whom="talker", drops="talker", why="the rule has no effect"),
    "KA823": Effect(bad="no", why="nothing comes through"),
    "KA825": Effect(bad="yes", why="whoever reads the file has the password; to the process it is nothing"),
    "KA826": Effect(bad="yes", why="another file is not read by us; the process that it is of starts with it"),
    "KA836": Effect(bad="no", why="nothing comes through"),
}

ENDING = "KA813"
"""A link outlives a certificate: this one is asked while one ends."""

_RANDOM = Certificate(key=Key(label="rules /random"), subject="/random", issuer=IDENTITY_CA, host=HOST)
STOLEN_KEYS: Mapping[str, Certificate] = {
    "random": _RANDOM,
    "hostless": replace(_RANDOM, host=None),
    "stolen": STOLEN,
    "certified": replace(_RANDOM, subject="/listener", issuer=PERMISSIONS_CA),
    "talkr": replace(_RANDOM, subject="/talkr"),
    "talker": _RANDOM,
}
"""By name. In the place of `talker` the tests' sections find the CAs that whoever attacks takes for right."""


def write_identities(root: Path, identities: Mapping[str, Certificate]) -> Path:
    """Certificates with their keys, each beside the CAs that made the samples' identities."""
    for name, certificate in identities.items():
        folder = root / "enclaves" / name
        folder.mkdir(parents=True)
        (folder / "cert.pem").write_bytes(certificate.pem())
        (folder / "key.pem").write_bytes(certificate.key.pem())
        (folder / "identity_ca.cert.pem").write_bytes(IDENTITY_CA.pem() + NEXT_CA.pem())
    return root


def ending_at(instant: datetime) -> Mapping[str, Certificate]:
    """The identities of the samples, of which that of /listener ends then (aware UTC)."""
    talking, listening = (each.certificate for each in PAIR.enclaves)
    return {"talker": talking, "listener": replace(listening, not_after=instant)}
