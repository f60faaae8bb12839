"""Who is revoked until a date: of several lists another one counts once the newest is over, or has begun."""

from __future__ import annotations

import json
from datetime import datetime, timezone
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from tests.cli.keystores import AT, answer, document_of, grant_of, properties, rule
from tests.keystore.builder import END, GOVERNANCE, START, authority, certificate, crl, write_enclave

UNTIL, THEN = "2027-06-30", "2027-06-29T12:00:00Z"
SETTINGS = "".join(
    f'[[property]]\nname = "{name}"\n{until}no_flow = {{ from = "/talker", to = "/motor", attacker = "source" }}\n'
    for name, until in (("now", ""), ("later", f"until = {UNTIL}\n"))
)
SOON = datetime(2027, 1, 1, tzinfo=timezone.utc)


def written(root: Path, end: datetime, days: int, *, spared: bool) -> Path:
    """/third, which passes on, is on a list that ends then; one in the CA file begins so many days after the start."""
    identity, permissions = authority("identityCA"), authority("permissionsCA")
    rights = {
        "/talker": rule(("rt/a",)),
        "/third": rule(("rt/b",), ("rt/a",)),
        "/motor": rule((), ("rt/b",)),
    }
    for number, (path, text) in enumerate(rights.items(), 100):
        folder = root / "enclaves" / path[1:]
        own = certificate(path, identity, serial=number)
        write_enclave(folder, own, document_of(grant_of(path, text)), identity, permissions, GOVERNANCE)
        first = crl(identity, (101,), end=end, days=2).public_bytes(Encoding.PEM)
        other = crl(identity, () if spared else (101,), days=days).public_bytes(Encoding.PEM)
        (folder / "crl.pem").write_bytes(first)
        (folder / "identity_ca.cert.pem").write_bytes(identity.pem + other)
    return root


def statuses(root: Path, at: str, engine: str) -> dict[str, str]:
    settings = root.parent / "settings.toml"
    settings.write_text(SETTINGS, "utf-8")
    words = ("--engine", engine, "--profile", "fastdds-3.6", "--at", at, "--settings", settings, "-f", "json")
    found = json.loads(answer("audit", root, *words)[1])
    return {each["id"]: each["status"] for each in found["properties"] if each["id"] in ("now", "later")}


@pytest.mark.parametrize(
    ("end", "days", "spared", "later"),
    [
        (SOON, 1, True, "violated"),  # the older one lives longer
        (END, 1, True, "holds"),
        (SOON, 1, False, "holds"),
        (END, (SOON - START).days, True, "violated"),  # a newer one begins
    ],
)
def test_what_holds_until_a_date_holds_then(end: datetime, days: int, spared: bool, later: str, tmp_path: Path) -> None:
    root = written(tmp_path / "keys", end, days, spared=spared)
    assert statuses(root, AT, "native") == {"now": "holds", "later": later}
    assert statuses(root, THEN, "native")["now"] == later


@pytest.mark.alloy
@pytest.mark.xdist_group("alloy")
def test_both_engines_say_so(tmp_path: Path) -> None:
    root = written(tmp_path / "keys", SOON, 1, spared=True)
    assert statuses(root, AT, "both") == {"now": "holds", "later": "violated"}


@pytest.mark.parametrize(("names", "status"), [('"/motor"', "violated"), ('"/motor", "/late"', "holds")])
def test_who_is_revoked_before_its_grant_begins_is_somebody_else_then(names: str, status: str, tmp_path: Path) -> None:
    """Whoever has the name by another certificate has the grant, which nobody here has at any moment."""
    identity, permissions = authority("identityCA"), authority("permissionsCA")
    begins = grant_of("/late", rule(("rt/a",))).replace("<not_before>2024-01", "<not_before>2027-03")
    for number, (path, grant) in enumerate({"/motor": grant_of("/motor", rule(("rt/a",))), "/late": begins}.items()):
        folder = tmp_path / "keys/enclaves" / path[1:]
        own = certificate(path, identity, serial=100 + number)
        write_enclave(folder, own, document_of(grant), identity, permissions, GOVERNANCE)
        lists = [crl(identity, revoked, days=at) for revoked, at in (((), 0), ((101,), (SOON - START).days))]
        (folder / "crl.pem").write_bytes(lists[0].public_bytes(Encoding.PEM))
        (folder / "identity_ca.cert.pem").write_bytes(identity.pem + lists[1].public_bytes(Encoding.PEM))
    settings = f'[[property]]\nname = "a"\nuntil = {UNTIL}\nonly_publish = {{ topic = "/a", enclaves = [{names}] }}\n'
    assert properties(tmp_path / "keys", settings, "--profile", "fastdds-3.6")["a"]["status"] == status
