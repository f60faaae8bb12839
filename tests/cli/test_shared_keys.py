"""What users claim of enclaves of which one has the key of another: it joins and reads as that one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.keystores import AT, DOCUMENT, answer, rule, write_enclave
from tests.keystore.builder import GOVERNANCE, authority, certificate

SETTINGS = """[[property]]
name = "apart"
never_share_domain = ["/talker", "/listener"]
[[property]]
name = "encrypted"
encrypted = { topic = "/y", against = "insider" }
[[property]]
name = "alone"
only_publish = { topic = "/z", enclaves = "/third" }
"""
AUTHENTIC = GOVERNANCE.replace(b"<id>0</id>", b"<id>0</id><id>5</id>").replace(
    b"<rtps_protection_kind>SIGN<", b"<rtps_protection_kind>ENCRYPT_WITH_ORIGIN_AUTHENTICATION<"
)


def built(root: Path, *, one_key: bool) -> Path:
    """The third publishes and reads in domain 5, where the listener is; the talker has no rights but in domain 0."""
    identity, permissions = authority("identityCA"), authority("permissionsCA")
    talker = certificate("/talker", identity)
    rules = {
        "/talker": rule(("rt/x",)),
        "/listener": rule(("rt/y",)).replace("<id>0<", "<id>5<"),
        "/third": rule(("rt/z",), ("rt/y",)).replace("<id>0<", "<id>5<"),
    }
    for path, text in rules.items():
        shared = {"key": talker.key} if one_key and path == "/third" else {}
        own = talker if path == "/talker" else certificate(path, identity, **shared)
        document = DOCUMENT.format(path=path, rules=text, default="DENY").encode()
        write_enclave(root / "enclaves" / path[1:], own, document, identity, permissions, AUTHENTIC)
    return root


def properties(tmp_path: Path, *, one_key: bool, engine: str = "native") -> dict[str, Any]:
    settings = tmp_path / "keystore-audit.toml"
    settings.write_text(SETTINGS, "utf-8")
    keys = built(tmp_path / "keys", one_key=one_key)
    options = ("--engine", engine, "--at", AT, "--profile", "cyclonedds-11", "--settings", settings, "-f", "json")
    return {each["id"]: each for each in json.loads(answer("audit", keys, *options)[1])["properties"]}


@pytest.mark.parametrize(("one_key", "status"), [(True, "violated"), (False, "holds")])
def test_who_has_the_key_of_another_joins_and_reads_as_that_one(tmp_path: Path, one_key: bool, status: str) -> None:
    found = properties(tmp_path, one_key=one_key)
    assert {found[name]["status"] for name in ("apart", "encrypted")} == {status}
    assert found["alone"]["status"] == "holds"


def test_the_reader_says_whose_key_it_has(tmp_path: Path) -> None:
    told = properties(tmp_path, one_key=True)["encrypted"]["profiles"]["cyclonedds-11"]["counterexample"]
    assert "/talker, which may not, can read /y" in told["text"]
    assert "it has the key of /third" in told["text"]
