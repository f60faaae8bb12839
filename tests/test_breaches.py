"""Who accepts that a property of its own is violated accepts what violates it now, and nothing that comes later."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from keystore_audit.engine import breaches
from tests.cli import keystores
from tests.cli.keystores import AT, answer, document_of, grant_of, keystore, rule, signed_keystore
from tests.keystore.builder import GOVERNANCE

PROPERTIES = {
    "only_publish": 'only_publish = { topic = "/cmd", enclaves = ["/planner"] }',
    "no_flow": 'no_flow = { from = ["/info", "/diag"], to = "/motor" }',
}
BEFORE = {
    "/planner": (rule(("rt/cmd",)),),
    "/motor": (rule((), ("rt/cmd", "rt/dbg")),),
    "/joy": (rule(("rt/cmd",)),),
    "/diag": (rule(("rt/dbg",)),),
    "/info": (rule(("rt/info",)),),
}
WORSE = {
    "only_publish": {"/info": (rule(("rt/info", "rt/cmd")),)},
    "no_flow": {"/diag": (rule(("rt/dbg",), ("rt/info",)),)},
}
OTHERWISE = {"/joy": (rule(("rt/cmd", "rt/joy"), ("rt/joy",)),)}
"""A right that no property speaks of: an answer rests on all documents, and a new one may bring another way."""


@pytest.fixture(autouse=True)
def _same_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keystores of one test differ in what they say alone: another key would be another thing to accept."""
    for name in ("authority", "certificate"):
        monkeypatch.setattr(keystores, name, cache(getattr(keystores, name)))


def asserted(path: Path, *names: str) -> Path:
    text = "".join(f'[[property]]\nname = "{name.replace("_", "-")}"\n{PROPERTIES[name]}\n' for name in names)
    path.write_text(text, "utf-8")
    return path


def audited(root: Path, *options: str | Path) -> tuple[int, dict[str, dict[str, Any]]]:
    """The exit code, and what is said of each property that is asserted, by its name."""
    code, text = answer("audit", root, "--engine", "native", "--at", AT, "--fail-on", "high", "-f", "json", *options)
    findings = [each for each in json.loads(text)["findings"] if each["code"] == "KA740"]
    return code, {each["message"].split(" is violated")[0].strip("'"): each for each in findings}


def accepted(tmp_path: Path, root: Path, settings: Path) -> Path:
    """A baseline of all that is found now."""
    path = tmp_path / "baseline.toml"
    why = ("--reason", "known", "--owner", "Ada", "--until", "2027-01-31")
    made = answer(
        "baseline", "create", root, "-o", path, "--engine", "native", "--at", AT, "--settings", settings, *why
    )
    assert made == (0, "")
    return path


def changed(tmp_path: Path, name: str, rules: Mapping[str, tuple[str, ...]]) -> Path:
    return keystore(tmp_path / name, {**BEFORE, **rules})


@pytest.mark.parametrize("name", ["only_publish", "no_flow"])
def test_another_violation_of_an_accepted_property_is_not_accepted(name: str, tmp_path: Path) -> None:
    settings = asserted(tmp_path / "keystore-audit.toml", name)
    root = changed(tmp_path, "before", {})
    assert set(audited(root, "--settings", settings)[1]) == {name.replace("_", "-")}
    options = ("--settings", settings, "--baseline", accepted(tmp_path, root, settings))
    code, found = audited(root, *options)
    assert code == 0
    assert all(each["suppressed"] for each in found.values())

    for after, rules in (("otherwise", OTHERWISE), ("worse", WORSE[name])):
        code, found = audited(changed(tmp_path, after, rules), *options)
        assert code == 1
        assert [each["suppressed"] for each in found.values()] == [None]


OPEN_TO_THE_CA = GOVERNANCE.replace(b"rtps_protection_kind>SIGN", b"rtps_protection_kind>ENCRYPT")
for each in (b"join", b"read", b"write"):
    OPEN_TO_THE_CA = OPEN_TO_THE_CA.replace(b"_%s_access_control>true" % each, b"_%s_access_control>false" % each)
for each in (b"metadata", b"data"):
    OPEN_TO_THE_CA = OPEN_TO_THE_CA.replace(b"<%s_protection_kind>ENCRYPT" % each, b"<%s_protection_kind>NONE" % each)


@pytest.mark.parametrize(
    ("asked", "flag", "worse"),
    [
        ('only_publish = { topic = "/cmd", enclaves = "/*" }', b"unauthenticated_participants>false", b"true"),
        ('encrypted = { topic = "/cmd", against = "insider" }', b"rtps_protection_kind>ENCRYPT", b"SIGN"),
    ],
)
def test_what_others_of_the_ca_may_is_another_violation_where_anybody_may(
    tmp_path: Path, asked: str, flag: bytes, worse: bytes
) -> None:
    """Neither these nor those have a name."""
    settings = tmp_path / "keystore-audit.toml"
    settings.write_text(f'[[property]]\nname = "x"\n{asked}\n', "utf-8")
    prints = []
    for governance in (OPEN_TO_THE_CA, OPEN_TO_THE_CA.replace(flag, flag.partition(b">")[0] + b">" + worse)):
        root = keystore(tmp_path / str(len(prints)), BEFORE, governance=governance)
        prints.append(audited(root, "--settings", settings, "--profile", "cyclonedds-11")[1]["x"]["meaning"])
    assert prints[0] != prints[1]


VALID = b"<not_before>2024-01-01T00:00:00</not_before><not_after>2034-01-01T00:00:00</not_after>"
LATE = {
    "no_flow": VALID.replace(b"2024", b"2028"),  # it begins
    "able": VALID.replace(b"2034", b"2028"),  # it ends
}


@pytest.mark.parametrize("kind", ["no_flow", "able"])
def test_what_is_accepted_of_a_later_day_is_not_accepted_of_today(kind: str, tmp_path: Path) -> None:
    settings = tmp_path / "keystore-audit.toml"
    asked = f'{kind} = {{ from = "/talker", to = "/motor" }}'
    settings.write_text(f'[[property]]\nname = "x"\nuntil = 2030-01-01\n{asked}\n', "utf-8")
    topic = {"no_flow": "rt/cmd", "able": "rt/other"}[kind]  # what violates it today

    def fingerprint(name: str, topic: str, validity: bytes) -> str:
        rights = {"/talker": rule((topic,)), "/motor": rule((), ("rt/cmd",))}
        documents = {path: document_of(grant_of(path, text)) for path, text in rights.items()}
        documents["/talker"] = documents["/talker"].replace(VALID, validity)
        root = signed_keystore(tmp_path / name, documents)
        found = audited(root, "--settings", settings, "--profile", "spec")[1]["x"]["meaning"]
        assert isinstance(found, str)
        return found

    later = fingerprint("later", "rt/cmd", LATE[kind])
    assert fingerprint("another_day", "rt/cmd", LATE[kind].replace(b"2028", b"2029")) == later
    assert fingerprint("today", topic, VALID) != later


def test_a_weaker_attacker_is_another_violation(tmp_path: Path) -> None:
    """Before: only if /diag forges, since it may read what it may not write."""
    settings = asserted(tmp_path / "keystore-audit.toml", "no_flow")
    rights = {"/diag": (rule((), ("rt/info", "rt/dbg")),), "/motor": (rule((), ("rt/dbg",)),)}
    attacked = {**rights, "/joy": (rule(("rt/dbg",)),)}
    root = changed(tmp_path, "before", attacked)
    found = audited(root, "--settings", settings)[1]
    assert "attack" in found["no-flow"]["message"] or "compromised" in found["no-flow"]["message"]
    options = ("--settings", settings, "--baseline", accepted(tmp_path, root, settings))
    assert audited(root, *options)[0] == 0
    by_right = {**attacked, "/diag": (rule(("rt/dbg",), ("rt/info", "rt/dbg")),)}
    assert audited(changed(tmp_path, "worse", by_right), *options)[0] == 1


TOPICS = {
    "from-topics": 'no_flow = { from = "topic:/in/*", to = "/motor" }',
    "to-topics": 'no_flow = { from = "/planner", to = "topic:/out/*" }',
    "publishers": 'only_publish = { topic = "/out/*", enclaves = ["/motor"] }',
}
SOME = {
    "/planner": (rule(("rt/out/led", "rt/in/radio", "rt/in/cmd")),),
    "/motor": (rule(("rt/x",), ("rt/in/radio", "rt/out/led", "rt/out/arm")),),
}
MORE = {
    "from-topics": {"/motor": (rule(("rt/x",), ("rt/in/radio", "rt/in/cmd", "rt/out/led", "rt/out/arm")),)},
    "to-topics": {"/planner": (rule(("rt/out/led", "rt/out/arm", "rt/in/radio", "rt/in/cmd")),)},
}
MORE["publishers"] = MORE["to-topics"]


@pytest.mark.parametrize("name", TOPICS)
def test_a_flow_of_another_topic_is_another_violation(name: str, tmp_path: Path) -> None:
    """Though rules that tell topics no longer apart make one channel of them."""
    settings = tmp_path / "keystore-audit.toml"
    settings.write_text(f'[[property]]\nname = "{name}"\n{TOPICS[name]}\n', "utf-8")
    root = keystore(tmp_path / "before", SOME)
    assert set(audited(root, "--settings", settings)[1]) == {name}
    options = ("--settings", settings, "--baseline", accepted(tmp_path, root, settings))
    assert audited(root, *options)[0] == 0
    code, found = audited(keystore(tmp_path / "worse", {**SOME, **MORE[name]}), *options)
    assert (code, [each["suppressed"] for each in found.values()]) == (1, [None])


def test_all_claims_together_have_a_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Those beyond it are accepted with the keystore as a whole, so that any change of it counts."""
    monkeypatch.setattr(breaches, "MAX_STEPS", 1)
    settings = asserted(tmp_path / "keystore-audit.toml", "no_flow")
    root = changed(tmp_path, "before", {})
    options = ("--settings", settings, "--baseline", accepted(tmp_path, root, settings))
    assert audited(root, *options)[0] == 0
    assert audited(changed(tmp_path, "otherwise", OTHERWISE), *options)[0] == 1
