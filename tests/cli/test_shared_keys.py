"""What users claim of enclaves of which one has the key of another: it joins and reads as that one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.cli.keystores import document_of, grant_of, properties, rule
from tests.keystore.builder import GOVERNANCE, authority, certificate, write_enclave

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
        document = document_of(grant_of(path, text))
        write_enclave(root / "enclaves" / path[1:], own, document, identity, permissions, AUTHENTIC)
    return root


def asked(keys: Path, settings: str = SETTINGS) -> dict[str, Any]:
    return properties(keys, settings, "--profile", "cyclonedds-11")


@pytest.mark.parametrize(("one_key", "status"), [(True, "violated"), (False, "holds")])
def test_who_has_the_key_of_another_joins_and_reads_as_that_one(tmp_path: Path, one_key: bool, status: str) -> None:
    found = asked(built(tmp_path / "keys", one_key=one_key))
    assert {found[name]["status"] for name in ("apart", "encrypted")} == {status}
    assert found["alone"]["status"] == "holds"
    assert ("/talker" in found["alone"].get("forgers", [])) is one_key


@pytest.mark.parametrize(("one_key", "status"), [(True, "violated"), (False, "holds")])
def test_who_reads_in_one_domain_carries_into_another_as_whose_key_it_has(
    tmp_path: Path, one_key: bool, status: str
) -> None:
    """Two enclaves with one key are one on the network."""
    bridges = asked(built(tmp_path / "keys", one_key=one_key))["no-enclave-bridges-domains"]
    assert bridges["status"] == status
    told = bridges["profiles"]["cyclonedds-11"]["counterexample"]
    assert (
        told is None
        if status == "holds"
        else told["text"].startswith(
            "/third can read /y (topic) in domain 5 and write /x (topic) in domain 0 as /talker, whose key it has: "
        )
    )


def test_the_reader_says_whose_key_it_has(tmp_path: Path) -> None:
    told = asked(built(tmp_path / "keys", one_key=True))["encrypted"]["profiles"]["cyclonedds-11"]["counterexample"]
    assert "/talker can read /y" in told["text"]
    assert "it has the key of /third" in told["text"]


@pytest.mark.parametrize(("subscribed", "status"), [("rt/x", "holds"), ("rt/y", "violated")])
def test_a_second_certificate_reads_for_the_enclave_that_has_its_key(
    tmp_path: Path, subscribed: str, status: str
) -> None:
    """What the enclave may read itself is nothing that its second certificate gets at."""
    identity, permissions = authority("identityCA"), authority("permissionsCA")
    own = certificate("/third", identity)
    again = certificate("/admin", identity, key=own.key)
    grants = {"/third": rule((), ("rt/x",)), "/admin": rule((), (subscribed,)), "/writer": rule(("rt/x", "rt/y"))}
    for path, text in grants.items():
        document = document_of(grant_of(path, text))
        mine = own if path == "/third" else certificate(path, identity)
        write_enclave(tmp_path / "keys/enclaves" / path[1:], mine, document, identity, permissions, AUTHENTIC)
    (tmp_path / "keys/enclaves/third/cert.pem").write_bytes(own.pem + again.pem)
    settings = "".join(
        f'[[property]]\nname = "{topic}"\nencrypted = {{ topic = "/{topic}", against = "insider" }}\n' for topic in "xy"
    )
    found = asked(tmp_path / "keys", settings)
    assert (found["x"]["status"], found["y"]["status"]) == ("holds", status)


@pytest.mark.parametrize(
    ("apart", "told"),
    [
        (["/talker", "/third"], "As /talker, whose key /third has too, both sides can join domain 0."),
        (["/talker", "/listener"], "/third, whose key /talker has too, and /listener can both join domain 5."),
        (["/listener", "/third"], "/listener and /third, whose key /talker has too, can both join domain 5."),
    ],
)
def test_who_is_together_by_the_key_of_another_is_told(tmp_path: Path, apart: list[str], told: str) -> None:
    settings = f'[[property]]\nname = "apart"\nnever_share_domain = {apart}\n'
    found = asked(built(tmp_path / "keys", one_key=True), settings)["apart"]
    assert found["profiles"]["cyclonedds-11"]["counterexample"]["text"] == told


@pytest.mark.parametrize("with_key", [True, False])
def test_no_enclave_is_not_the_one_writer(tmp_path: Path, with_key: bool) -> None:
    """The one who may publish is an identity that lies about, or that lies elsewhere."""
    identity, permissions = authority("identityCA"), authority("permissionsCA")
    document = document_of(grant_of("/ghost", rule(("rt/x",))))
    keys = tmp_path / "keys"
    write_enclave(
        keys / "enclaves/talker", certificate("/talker", identity), document, identity, permissions, AUTHENTIC
    )
    ghost = certificate("/ghost", identity)
    (keys / "backup").mkdir()
    (keys / "backup/cert.pem").write_bytes(ghost.pem)
    if with_key:
        (keys / "backup/key.pem").write_bytes(ghost.key_pem)
    assert asked(keys, 'single_writer = ["/x"]\n')["single-writer-x"]["status"] == "violated"
