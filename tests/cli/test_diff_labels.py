"""`diff --label`: only changes about what has the label fail, and none about it is missed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.cli.program import run
from tests.cli.keystores import AT
from tests.keystore.builder import certificate, key
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule, topic_rule
from tests.model.comparing import Member, Store, authority

SETTINGS = """
[lattice]
levels = ["open", "secret"]
[[label]]
label = "open"
enclaves = "/a"
[[label]]
label = "secret"
enclaves = "/s*"
topics = "/own"
"""


def says(path: str, *rules: str) -> Member:
    return Member(permissions=permissions(grant(path, *rules)), serial=101 + len(path))


SAFE = says("/safe", rule(criterion("publish", "rt/told", "rt/rosout"), criterion("subscribe", "rt/heard")))
LISTENS = rule(criterion("subscribe", "rt/x"), criterion("publish", "rt/own"))
A = (rule(criterion("publish", "rt/x"), criterion("subscribe", "rt/x")),)
BASE = Store(members={"/a": says("/a", *A), "/bb": says("/bb", LISTENS), "/safe": SAFE})


def gains(operation: str, topic: str) -> Store:
    return replace(BASE, members={**BASE.members, "/a": says("/a", *A, rule(criterion(operation, topic)))})


def unprotected(topic: str, **flags: str) -> Store:
    flags = flags or {"data": "NONE", "metadata": "NONE"}
    rules = topic_rule(topic, **flags) + topic_rule()
    return replace(BASE, governance=governance(domain_rule(rules)))


def added(path: str, *rules: str) -> Store:
    return replace(BASE, members={**BASE.members, path: says(path, *rules)})


def compared(tmp_path: Path, new: Store, *arguments: str) -> int:
    settings = tmp_path / "settings.toml"
    settings.write_text(SETTINGS)
    sides = [store.write(tmp_path / name) for name, store in (("old", BASE), ("new", new))]
    named = () if "--settings" in arguments else ("--settings", str(settings))
    return run(["diff", *map(str, sides), "--at", AT, *named, *arguments])


@pytest.mark.parametrize(
    ("new", "concerned"),
    [
        (gains("publish", "rt/elsewhere"), False),
        (gains("publish", "rt/rosout"), False),
        (gains("publish", "rt/own"), True),
        (gains("publish", "rt/heard"), True),
        (gains("subscribe", "rt/told"), True),
        (gains("publish", "*"), True),
        (unprotected("rt/x", discovery="false"), False),
        (unprotected("rt/told", discovery="false"), True),
        (unprotected("rt/x"), True),  # /safe can read it now, without a right
        (unprotected("rt/told"), True),
        (unprotected("rt/own"), True),
        (added("/new", rule(criterion("publish", "rt/x"))), False),
        (added("/new", rule(criterion("publish", "rt/heard"))), True),
        (added("/store"), True),
        (replace(BASE, permissions=(authority("other"),)), True),
        (BASE.member("/a", key="/bb"), True),  # /bb may publish /own: whoever passes for it may too
        (BASE.member("/a", private_key="/safe"), True),
        (BASE.member("/a", private_key="permissionsCA"), True),  # it signs any right
        (BASE.member("/a", private_key="identityCA"), True),
        (BASE.member("/a", private_key="of nobody here"), True),
        (added("/new").member("/a", private_key="/new"), False),
    ],
)
def test_what_concerns_a_label_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], new: Store, *, concerned: bool
) -> None:
    assert compared(tmp_path, new, "--label", "secret", "-f", "json") == concerned
    answer = json.loads(capsys.readouterr().out)
    assert answer["labels"] == ["secret"]
    assert any(change["direction"] in ("gained", "mixed") for change in answer["changes"])
    assert [change["fails"] for change in answer["changes"]] == [
        bool(change["labels"]) and change["direction"] in ("gained", "mixed") for change in answer["changes"]
    ]


def test_a_key_that_is_certified_again_concerns_all(tmp_path: Path) -> None:
    """Grants name it by its subject, each implementation in its own way: here /a comes to go as /safe."""
    settings = tmp_path / "settings.toml"
    settings.write_text(SETTINGS)
    sides = [BASE.write(tmp_path / name) for name in ("old", "new")]
    again = certificate("/safe", authority("identityCA"), key=key("/a"))
    (sides[1] / "public").mkdir()
    (sides[1] / "public/x_ca.cert.pem").write_bytes(again.pem)
    arguments = ["diff", *map(str, sides), "--at", AT, "--settings", str(settings), "--label", "secret"]
    assert run(arguments) == 1


def test_what_hands_on_to_a_label_concerns_it(tmp_path: Path) -> None:
    """/a reaches /safe through /bb, which alone has a right to what /safe hears."""
    between = {"/bb": says("/bb", rule(criterion("publish", "rt/heard", "rt/own")))}
    old = replace(BASE, members={**BASE.members, **between})
    hears = {"/bb": says("/bb", rule(criterion("publish", "rt/heard", "rt/own"), criterion("subscribe", "rt/x")))}
    settings = tmp_path / "settings.toml"
    settings.write_text(SETTINGS)
    sides = [old.write(tmp_path / "old"), replace(old, members={**old.members, **hears}).write(tmp_path / "new")]
    arguments = ["diff", *map(str, sides), "--at", AT, "--settings", str(settings), "--label", "secret"]
    assert run(arguments) == 1


@pytest.mark.parametrize(("topic", "concerned"), [("rt/heard", True), ("rt/elsewhere", False)])
def test_who_takes_the_identity_of_one_that_a_label_hears_concerns_it(
    tmp_path: Path, topic: str, *, concerned: bool
) -> None:
    """/a gets the key of /teller, which may publish the topic."""
    told = replace(BASE, members={**BASE.members, "/teller": says("/teller", rule(criterion("publish", topic)))})
    settings = tmp_path / "settings.toml"
    settings.write_text(SETTINGS)
    sides = [told.write(tmp_path / "old"), told.member("/a", private_key="/teller").write(tmp_path / "new")]
    arguments = ["diff", *map(str, sides), "--at", AT, "--settings", str(settings), "--label", "secret"]
    assert run(arguments) == concerned


def test_unknown_stays_unknown(tmp_path: Path) -> None:
    broken = BASE.members["/bb"].permissions.replace("<dds>", "<!DOCTYPE dds><dds>")
    assert compared(tmp_path, BASE.member("/bb", permissions=broken), "--label", "secret") == 4


@pytest.mark.parametrize("wrong", [["--label", "nobody"], ["--label", "secret", "--settings", "missing.toml"]], ids=str)
def test_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str], wrong: list[str]) -> None:
    assert compared(tmp_path, BASE, *wrong) == 2
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(("old", "new"), [('"/s*"', '"/typo"'), ('"/own"', '"/typo"')])
def test_a_glob_of_nothing_is_no_pass(tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str) -> None:
    settings = tmp_path / "typo.toml"
    settings.write_text(SETTINGS.replace(old, new))
    store = gains("publish", "rt/own")
    assert compared(tmp_path, store, "--label", "secret", "--settings", str(settings)) == 2
    assert "/typo" in capsys.readouterr().err
