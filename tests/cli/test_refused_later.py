"""`able` until a date: whom an implementation refuses is asked of each moment, and of no moment behind the date."""

from __future__ import annotations

import json
from datetime import datetime, timezone
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from tests.cli.keystores import AT, answer, document_of, grant_of, properties, rule, write_enclave
from tests.keystore.builder import END, GOVERNANCE, START, authority, certificate, crl

SETTINGS = "".join(
    f'[[property]]\nname = "{name}"\n{until}able = {{ from = "/button", to = "/motor" }}\n'
    for name, until in (("now", ""), ("soon", "until = 2027-02-01\n"), ("later", "until = 2027-06-30\n"))
)
EARLY, SOON, GAP = (datetime(2027, month, 1, tzinfo=timezone.utc) for month in (1, 3, 5))
ONE, OTHER, PERMISSIONS = authority("identityCA"), authority("otherCA"), authority("permissionsCA")
AGAIN = [
    certificate("identityCA", ca=True, key=ONE.key, serial=serial, start=start, end=end)
    for serial, start, end in ((8, START, SOON), (9, GAP, END))
]


def written(root: Path, trusted: bytes, lists: bytes = b"", mine: bytes = b"", *, apart: bool = True) -> Path:
    """The motor's identity is of another authority (if apart); it trusts these, the button both. Lists are the motor's.

    `mine`: lists of the button.
    """
    files = {
        "/button": (ONE, ONE.pem + OTHER.pem + mine),
        "/motor": (OTHER if apart else ONE, trusted + lists),
    }
    for path, (by, file) in files.items():
        folder = root / "enclaves" / path[1:]
        document = document_of(grant_of(path, rule(("rt/stop",), ("rt/stop",))))
        write_enclave(folder, certificate(path, by), document, by, PERMISSIONS, GOVERNANCE)
        (folder / "identity_ca.cert.pem").write_bytes(file)
    return root


def statuses(root: Path) -> list[str]:
    found = properties(root, SETTINGS, "--profile", "fastdds-3.6")
    return [found[name]["status"] for name in ("now", "soon", "later")]


def pem(*lists: object) -> bytes:
    return b"".join(each.public_bytes(Encoding.PEM) for each in lists)  # type: ignore[attr-defined]


BETWEEN = (SOON - START).days + 61
LISTS = {
    "stays": pem(crl(ONE), crl(OTHER)),
    "ends": pem(crl(ONE, end=SOON), crl(OTHER)),
    "has a gap": pem(crl(ONE, end=SOON), crl(ONE, days=BETWEEN), crl(OTHER)),
}


@pytest.mark.parametrize(("lists", "later"), [("stays", "holds"), ("ends", "violated"), ("has a gap", "violated")])
def test_lists_of_the_others_authority(lists: str, later: str, tmp_path: Path) -> None:
    root = written(tmp_path / "keys", OTHER.pem + ONE.pem, LISTS[lists])
    assert statuses(root) == ["holds", "holds", later]
    told = properties(root, SETTINGS, "--profile", "fastdds-3.6")["later"]["profiles"]["fastdds-3.6"]["counterexample"]
    assert told is None if later == "holds" else "enclaves refuse identities of others" in told["text"]


@pytest.mark.parametrize(("first", "later"), [(ONE, "holds"), (AGAIN[0], "violated")])
def test_dates_of_the_others_authority(first: object, later: str, tmp_path: Path) -> None:
    trusted = OTHER.pem + first.pem + AGAIN[1].pem  # type: ignore[attr-defined]
    assert statuses(written(tmp_path / "keys", trusted)) == ["holds", "holds", later]


def test_a_gap_between_lists_that_name_nobody_stops_who_carries_them(tmp_path: Path) -> None:
    gap = pem(crl(ONE, end=SOON), crl(ONE, days=BETWEEN))
    assert statuses(written(tmp_path / "keys", ONE.pem, gap, apart=False)) == ["holds", "holds", "violated"]
    assert statuses(written(tmp_path / "k", ONE.pem, pem(crl(ONE), crl(ONE, days=9)), apart=False)) == ["holds"] * 3


@pytest.mark.parametrize("lists", LISTS)
@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_both_engines_say_so(lists: str, tmp_path: Path) -> None:
    root = written(tmp_path / "keys", OTHER.pem + ONE.pem, LISTS[lists])
    file = tmp_path / "keystore-audit.toml"
    file.write_text(SETTINGS, "utf-8")
    words = ("--profile", "fastdds-3.6", "--engine", "both", "--at", AT, "--settings", file, "-f", "json")
    found = {each["id"]: each["status"] for each in json.loads(answer("audit", root, *words)[1])["properties"]}
    assert [found[name] for name in ("now", "soon", "later")] == ["holds", "holds", found["later"]]
    assert (found["later"] == "holds") == (lists == "stays")
