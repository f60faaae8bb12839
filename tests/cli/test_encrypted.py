"""Whether a topic is encrypted, whoever writes it and whoever may join: also those who are no enclaves here."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.keystores import document_of, grant_of, keystore, properties, signed_keystore
from tests.cli.keystores import rule as plain
from tests.keystore.builder import GOVERNANCE, authority, certificate, write_enclave

SETTINGS = """[[property]]
name = "outside"
encrypted = { topic = "/x" }
[[property]]
name = "inside"
encrypted = { topic = "/x", against = "insider" }
"""
PROFILE = "cyclonedds-11"
PAYLOADS_OPEN = (
    GOVERNANCE.replace(b"<metadata_protection_kind>ENCRYPT", b"<metadata_protection_kind>NONE")
    .replace(b"<data_protection_kind>ENCRYPT", b"<data_protection_kind>NONE")
    .replace(b"<rtps_protection_kind>SIGN", b"<rtps_protection_kind>ENCRYPT")
)
ALL_OPEN = PAYLOADS_OPEN.replace(b"<rtps_protection_kind>ENCRYPT", b"<rtps_protection_kind>NONE")


def rule(publish: str = "", subscribe: str = "") -> str:
    """Allows these topics in every partition."""
    return plain((publish,) if publish else (), (subscribe,) if subscribe else (), partition="*")


def found(root: Path, governance: bytes, *grants: tuple[str, str]) -> dict[str, str]:
    """Of a robot that subscribes to the topic. `grants`: whom else its document names, and by which rules."""
    document = document_of(grant_of("/listener", rule(subscribe="rt/x")), *(grant_of(*each) for each in grants))
    signed_keystore(root, {"/listener": document}, governance=governance)
    every = properties(root, SETTINGS, "--profile", PROFILE)
    return {name: every[name]["status"] for name in ("outside", "inside")}


@pytest.mark.parametrize(("governance", "status"), [(ALL_OPEN, "violated"), (PAYLOADS_OPEN, "holds")])
@pytest.mark.parametrize("camera", [(), (("/camera", rule("rt/x")),)])
def test_what_nobody_here_writes_is_in_the_clear_all_the_same(
    tmp_path: Path, governance: bytes, status: str, camera: tuple[tuple[str, str], ...]
) -> None:
    """A robot reads what another one writes: nobody would read what nobody wrote."""
    assert found(tmp_path / "keys", governance, *camera)["outside"] == status


@pytest.mark.parametrize(
    ("rules", "status"),
    [(rule("rt/y"), "violated"), (rule("rt/y", "rt/x"), "holds")],
)
def test_who_is_no_enclave_here_may_join_and_overhear(tmp_path: Path, rules: str, status: str) -> None:
    """The keys of messages go to all that join, whether they may read or not."""
    assert found(tmp_path / "keys", PAYLOADS_OPEN, ("/ghost", rules)) == {"outside": "holds", "inside": status}
    every = properties(tmp_path / "keys", SETTINGS, "--profile", PROFILE)
    told = every["inside"]["profiles"][PROFILE]["counterexample"]
    if status == "holds":
        assert told is None
        return
    assert told["text"].startswith("Whoever is CN=/ghost, which is no enclave of this keystore, can read ")
    assert told["steps"][0]["path"] == "enclaves/listener/permissions.p7s"


def test_who_is_no_enclave_here_opens_no_payload_that_is_encrypted_for_its_readers(tmp_path: Path) -> None:
    assert found(tmp_path / "keys", GOVERNANCE, ("/ghost", rule("rt/y"))) == {"outside": "holds", "inside": "holds"}


ASKED, JOINING = b"<enable_read_access_control>true", b"<enable_join_access_control>true"
UNASKED = GOVERNANCE.replace(ASKED, b"<enable_read_access_control>false")
VENDORS = ("spec", "fastdds-3.6", "cyclonedds-11")


def inside(root: Path, governance: bytes, *enclaves: str) -> dict[str, str]:
    """Why the topic is not encrypted against insiders, by profile. `/listener` subscribes to it, the others do not."""
    others = {path: (rule(subscribe="rt/y"),) for path in enclaves}
    keystore(root, {"/listener": (rule(subscribe="rt/x"),), **others}, governance=governance)
    told = properties(root, SETTINGS, *(word for name in VENDORS for word in ("--profile", name)))["inside"]["profiles"]
    assert {each["status"] for each in told.values()} <= {"holds", "violated"}
    return {name: each["counterexample"]["text"] for name, each in told.items() if each["status"] == "violated"}


@pytest.mark.parametrize(
    ("governance", "why"),
    [(UNASKED, "enable_read_access_control is false"), (PAYLOADS_OPEN, "data_protection_kind NONE")],
)
def test_whoever_has_an_identity_reads_where_nobody_asks_who_joins(tmp_path: Path, governance: bytes, why: str) -> None:
    """There are more than are here: the CA vouches for other robots, too."""
    assert inside(tmp_path / "kept-out", governance) == {}
    told = inside(tmp_path / "let-in", governance.replace(JOINING, b"<enable_join_access_control>false"))
    assert set(told) == {*VENDORS}
    for profile, text in told.items():
        some = " and some grant of the permissions CA" if profile.startswith("fastdds") else ""
        assert text.startswith(f"Anybody with an identity of the CA{some} can read ")
        assert why in text


def test_who_signs_itself_a_grant_is_not_entitled_by_it(tmp_path: Path) -> None:
    """One CA for both roles, and implementations that take what it vouches for as a signer."""
    ca = authority("robotCA")
    for path, topic in (("/listener", "rt/x"), ("/other", "rt/y")):
        document = document_of(grant_of(path, rule(subscribe=topic)))
        write_enclave(tmp_path / "keys/enclaves" / path[1:], certificate(path, ca), document, ca, ca, GOVERNANCE)
    options = ("--profile", "cyclonedds-0.10", "--profile", "cyclonedds-11")
    told = properties(tmp_path / "keys", SETTINGS, *options)["inside"]["profiles"]
    assert {name: each["status"] for name, each in told.items()} == {
        "cyclonedds-0.10": "violated",
        "cyclonedds-11": "holds",
    }
    text = told["cyclonedds-0.10"]["counterexample"]["text"]
    assert text.endswith(": it can sign its own permissions, and its peers accept them.")


def test_whom_a_document_lets_in_that_could_not_be_read_is_not_known(tmp_path: Path) -> None:
    assert found(tmp_path / "keys", PAYLOADS_OPEN)["inside"] == "holds"
    (tmp_path / "keys/enclaves/listener/permissions.p7s").write_bytes(b"#" * 5_000_000)
    assert properties(tmp_path / "keys", SETTINGS, "--profile", PROFILE)["inside"]["status"] == "unknown"


@pytest.mark.parametrize(("profile", "status"), [("cyclonedds-0.10", "violated"), ("cyclonedds-11", "holds")])
def test_whoever_has_an_identity_of_the_one_ca_signs_itself_a_grant_to_read(
    tmp_path: Path, profile: str, status: str
) -> None:
    one = authority("sros2CA")
    document = document_of(grant_of("/listener", rule(subscribe="rt/x")))
    write_enclave(tmp_path / "keys/enclaves/listener", certificate("/listener", one), document, one, one, GOVERNANCE)
    asked = properties(tmp_path / "keys", SETTINGS, "--profile", profile)["inside"]
    assert asked["status"] == status
    if status == "violated":
        told = asked["profiles"][profile]["counterexample"]["text"]
        assert "Anybody with an identity of the CA that is fit to sign can read " in told
