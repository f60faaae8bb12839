"""What must be possible until a date, or as long as an audit is said to hold: lists and authorities leave gaps."""

from __future__ import annotations

import json
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from tests.cli.keystores import AT, answer, document_of, grant_of, rule
from tests.keystore.builder import END, GOVERNANCE, START, Signed, authority, certificate, crl, write_enclave

SOON, AGAIN, THEN = (datetime(2027, 1, day, tzinfo=timezone.utc) for day in (1, 15, 10))
CLAIMS = {"now": None, "soon": "2026-12-24", "later": "2027-06-30"}
HOLDS = dict.fromkeys(CLAIMS, "holds")
SAFE = "2027-01-01T00:00:01Z"

A, B = authority("identityCA"), authority("otherCA")
ENDING, RENEWED = authority("otherCA", end=SOON, key=B.key), authority("otherCA", start=AGAIN, key=B.key)


def lists(issuer: Signed, *, gap: bool) -> bytes:
    ends = [crl(issuer, end=SOON), crl(issuer, days=((AGAIN if gap else SOON) - START).days)]
    return b"".join(each.public_bytes(Encoding.PEM) for each in ends)


def forever(issuer: Signed) -> bytes:
    return crl(issuer, end=END).public_bytes(Encoding.PEM)


def written(root: Path, motors_authorities: bytes, motors_list: bytes, *rules: str) -> Path:
    """The identity of the button is of the authority B, that of the motor of A. `rules`: before those of both."""
    permissions = authority("permissionsCA")
    for path, own in (("/button", B), ("/motor", A)):
        folder = root / "enclaves" / path[1:]
        document = document_of(grant_of(path, *rules, rule(("rt/stop",), ("rt/stop",))))
        write_enclave(folder, certificate(path, own), document, own, permissions, GOVERNANCE)
        (folder / "identity_ca.cert.pem").write_bytes(B.pem + A.pem)
    motor = root / "enclaves/motor"
    (motor / "identity_ca.cert.pem").write_bytes(motors_authorities)
    if motors_list:
        (motor / "crl.pem").write_bytes(motors_list)
    return root


def audited(root: Path, at: str, engine: str = "native", claims: tuple[str, ...] = tuple(CLAIMS)) -> dict[str, Any]:
    settings = root.parent / "settings.toml"
    able = 'able = { from = "/button", to = "/motor" }\n'
    until = {name: "" if CLAIMS[name] is None else f"until = {CLAIMS[name]}\n" for name in claims}
    text = "".join(f'[[property]]\nname = "{name}"\n{until[name]}{able}' for name in claims)
    settings.write_text(text, "utf-8")
    words = ("--engine", engine, "--profile", "fastdds-3.6", "--at", at, "--settings", settings, "-f", "json")
    found: dict[str, Any] = json.loads(answer("audit", root, *words)[1])
    return found


def statuses(found: dict[str, Any]) -> dict[str, str]:
    return {each["id"]: each["status"] for each in found["properties"] if each["id"] in CLAIMS}


def why_later(found: dict[str, Any]) -> str:
    """Why "later" is violated, "" where it is not."""
    later = next(each for each in found["properties"] if each["id"] == "later")["profiles"]["fastdds-3.6"]
    return str((later["counterexample"] or {"text": ""})["text"])


REFUSED = "enclaves refuse identities of others"


@pytest.mark.parametrize(
    ("authorities", "listed", "told"),
    [
        (A.pem + B.pem + lists(B, gap=False), forever(A), ""),
        (A.pem + B.pem + crl(B, end=SOON).public_bytes(Encoding.PEM), forever(A), REFUSED),
        (A.pem + B.pem + lists(B, gap=True), forever(A), REFUSED),  # it has no list of the button's authority then
        (A.pem + B.pem + lists(A, gap=True) + forever(B), b"", "Nothing gets there"),  # nor of its own
        (A.pem + B.pem, b"", ""),
        (A.pem + ENDING.pem + RENEWED.pem, b"", REFUSED),
    ],
)
def test_what_is_possible_until_a_date_is_possible_at_each_instant(
    authorities: bytes, listed: bytes, told: str, tmp_path: Path
) -> None:
    root = written(tmp_path / "keys", authorities, listed)
    found = audited(root, AT)
    assert statuses(found) == HOLDS | ({"later": "violated"} if told else {})
    assert told in why_later(found)
    assert statuses(audited(root, f"{THEN:%Y-%m-%d}T00:00:00Z"))["now"] == ("violated" if told else "holds")
    alone = audited(root, AT, claims=("now",))
    assert statuses(alone) == {"now": "holds"}
    assert (alone["safe_until"] == SAFE) is bool(told)


def test_who_does_not_start_until_then_is_told(tmp_path: Path) -> None:
    """Who reads "nothing gets there" tries it today, and it does."""
    own_gap = written(tmp_path / "keys", A.pem + B.pem + lists(A, gap=True) + forever(B), b"")
    found = {
        each["id"]: each["profiles"]["fastdds-3.6"]["counterexample"] for each in audited(own_gap, AT)["properties"]
    }
    assert ": /motor can start now, but not at every instant until then" in found["later"]["text"]
    listed = written(tmp_path / "other", A.pem + B.pem + lists(B, gap=True), forever(A))
    found = {
        each["id"]: each["profiles"]["fastdds-3.6"]["counterexample"] for each in audited(listed, AT)["properties"]
    }
    assert "can start now" not in found["later"]["text"], "its peers refuse it, which is told"


OWN_GAP, OTHERS_GAP = (A.pem + B.pem + lists(A, gap=True) + forever(B), b""), (A.pem + ENDING.pem + RENEWED.pem, b"")
REFUSE = "their own implementations refuse some"


@pytest.mark.parametrize(
    ("motor", "topic", "domain", "told", "not_told"),
    [
        ((A.pem + B.pem, b""), "rt/stop", 5, REFUSE, REFUSED),
        (OWN_GAP, "rt/other", 5, ": /motor can start now", REFUSE),
        (OTHERS_GAP, "rt/other", 0, REFUSED, REFUSE),
        (OTHERS_GAP, "rt/stop", 0, "Nothing gets there with the rights that enclaves have.", REFUSED),
    ],
)
def test_what_is_told_is_what_keeps_it_from_getting_there(
    motor: tuple[bytes, bytes], topic: str, domain: int, told: str, not_told: str, tmp_path: Path
) -> None:
    """Not whatever there is besides. Fast DDS applies a denial of domain 5 to its own endpoints in domain 0."""
    denied = rule((topic,), (topic,), allow=False).replace("<id>0</id>", f"<id>{domain}</id>")
    why = why_later(audited(written(tmp_path / "keys", *motor, denied, rule(("rt/other",))), AT))
    assert told in why
    assert not_told not in why


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_both_engines_say_so(tmp_path: Path) -> None:
    root = written(tmp_path / "keys", A.pem + ENDING.pem + RENEWED.pem, b"")
    assert statuses(audited(root, AT, "both")) == HOLDS | {"later": "violated"}
