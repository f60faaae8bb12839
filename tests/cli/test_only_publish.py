"""Who alone may publish: what the keystore grants to somebody else, what anybody can do, and who could forge."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.cli.keystores import AT, DOCUMENT, answer, properties, rule, signed_keystore
from tests.keystore.builder import GOVERNANCE

SETTINGS = """single_writer = ["/x"]
[[property]]
name = "only-talker"
only_publish = { topic = "/x", enclaves = "/talker" }
"""
PROFILE = ("--profile", "cyclonedds-11")
GRANT = DOCUMENT[DOCUMENT.index("    <grant") : DOCUMENT.index("  </permissions>")]
OPEN = (
    GOVERNANCE.replace(b">ENCRYPT<", b">NONE<")
    .replace(b">SIGN<", b">NONE<")
    .replace(b"<allow_unauthenticated_participants>false", b"<allow_unauthenticated_participants>true")
)


def built(root: Path, *, ghost: str = "", governance: bytes = GOVERNANCE) -> Path:
    """`ghost`: the rules that the talker's document has for somebody who is no enclave here."""
    talker = DOCUMENT.format(path="/talker", rules=rule(("rt/x",)), default="DENY")
    if ghost:
        grant = GRANT.format(path="/ghost", rules=ghost, default="DENY")
        talker = talker.replace("  </permissions>", f"{grant}  </permissions>")
    listener = DOCUMENT.format(path="/listener", rules=rule((), ("rt/x",)), default="DENY")
    return signed_keystore(root, {"/talker": talker.encode(), "/listener": listener.encode()}, governance=governance)


def found(root: Path) -> dict[str, Any]:
    every = properties(root, SETTINGS, *PROFILE)
    return {name: every[name] for name in ("only-talker", "single-writer-x")}


@pytest.mark.parametrize(("ghost", "status"), [("rt/x", "violated"), ("rt/y", "holds")])
def test_a_grant_for_a_subject_that_no_enclave_has_counts(tmp_path: Path, ghost: str, status: str) -> None:
    answers = found(built(tmp_path / "keys", ghost=rule((ghost,))))
    assert {each["status"] for each in answers.values()} == {status}
    told = answers["only-talker"]["profiles"]["cyclonedds-11"]["counterexample"]
    if status == "violated":
        assert "CN=/ghost" in told["text"]
        step = told["steps"][0]
        assert step["path"] == "enclaves/talker/permissions.p7s"
        assert f"{step['path']}:{step['line']}" in told["text"]


def test_a_grant_after_one_for_the_same_subject_does_not_count(tmp_path: Path) -> None:
    """The first grant that names a subject decides, whoever has it."""
    talker = DOCUMENT.format(path="/talker", rules=rule(("rt/x",)), default="DENY")
    denied, allowed = (GRANT.format(path="/ghost", rules=rule((each,)), default="DENY") for each in ("rt/y", "rt/x"))
    for grants, status in ((denied + allowed, "holds"), (allowed + denied, "violated")):
        whole = talker.replace("  </permissions>", f"{grants}  </permissions>")
        root = signed_keystore(tmp_path / status, {"/talker": whole.encode()})
        assert found(root)["only-talker"]["status"] == status


@pytest.mark.parametrize(("governance", "status"), [(OPEN, "violated"), (GOVERNANCE, "holds")])
def test_where_anybody_joins_and_is_heard_anybody_publishes(tmp_path: Path, governance: bytes, status: str) -> None:
    answers = found(built(tmp_path / "keys", governance=governance))
    assert {each["status"] for each in answers.values()} == {status}
    told = answers["only-talker"]["profiles"]["cyclonedds-11"]["counterexample"]
    assert told is None if status == "holds" else told["text"].startswith("Anybody on the network may join")


def test_an_outsider_that_only_forges_is_said_beside_and_violates_nothing(tmp_path: Path) -> None:
    closed = OPEN.replace(b"<allow_unauthenticated_participants>true", b"<allow_unauthenticated_participants>false")
    answers = found(built(tmp_path / "keys", governance=closed))
    assert {each["status"] for each in answers.values()} == {"holds"}
    assert {tuple(each["forgers"]) for each in answers.values()} == {("/listener", "anybody on the network")}


@pytest.mark.parametrize("form", ["text", "html", "markdown", "junit"])
def test_who_could_forge_is_said_where_the_property_holds(tmp_path: Path, form: str) -> None:
    root = built(tmp_path / "keys")
    assert found(root)["only-talker"]["forgers"] == ["/listener"]
    words = ("--engine", "native", "--at", AT, *PROFILE, "--settings", tmp_path / "keystore-audit.toml", "-f", form)
    text = " ".join(answer("audit", root, *words)[1].replace("\\", "").split())
    assert text.count("Could pass for a permitted publisher: /listener, with the keys they hold.") == 2
