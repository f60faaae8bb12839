"""`flow --compromised` says the smallest change of rights after which nothing gets through: signed anew, it is so."""

from __future__ import annotations

import json
import random
from collections.abc import Collection, Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest

from tests.amount import tried
from tests.cli.keystores import AT, answer, keystore, rule
from tests.schemas import schema

Rights = tuple[str, str, str]
"""An enclave, `publish` or `subscribe`, and an expression."""

ABLE = '[[property]]\nname = "needed"\nable = {{ from = "{}", to = "{}" }}\n'

BESIDE = [
    ("/camera", "publish", "rt/image"),
    ("/logger", "subscribe", "rt/*"),
    ("/logger", "publish", "rt/log"),
    ("/arm", "subscribe", "rt/log"),
    ("/arm", "subscribe", "rt/command"),
    ("/console", "publish", "rt/command"),
    ("/console", "subscribe", "rt/image"),
]
"""From /camera to /arm over /logger, and over /console."""


def store(root: Path, rights: Collection[Rights]) -> Path:
    """A rule each, so that each stands in a line of its own."""
    rules: dict[str, tuple[str, ...]] = {}
    for enclave, operation, topic in rights:
        listed = rule((topic,)) if operation == "publish" else rule((), (topic,))
        rules[enclave] = (*rules.get(enclave, ()), listed)
    return keystore(root, {f"/{name}": rules.get(f"/{name}", ()) or (rule(("rt/idle",)),) for name in NAMES})


NAMES = ("camera", "logger", "arm", "console")


def fallen(root: Path, most: int, *options: str | Path) -> tuple[int, dict[str, Any]]:
    asked = ("flow", root, "/camera", "/arm", "--compromised", str(most), "--profile", "jazzy", "--at", AT)
    code, said = answer(*asked, "-f", "json", *options)
    told: dict[str, Any] = json.loads(said)
    schema("fallen").validate(told)
    return code, told


def needing(folder: Path, source: str, target: str) -> tuple[str, Path]:
    settings = folder / "settings.toml"
    settings.write_text(ABLE.format(source, target), "utf-8")
    return "--settings", settings


def named(taken: Collection[Mapping[str, Any]], root: Path) -> set[Rights]:
    """The rights that are meant, by what stands in those lines."""
    found = set()
    for each in taken:
        line = (root / each["path"]).read_text("utf-8").splitlines()[each["line"] - 1]
        assert f"<topic>{each['expression']}</topic>" in line
        found.add((each["enclave"], "publish" if "<publish>" in line else "subscribe", each["expression"]))
    return found


def test_both_ways_are_cut_and_what_is_needed_stays(tmp_path: Path) -> None:
    root = store(tmp_path / "keys", BESIDE)
    code, told = fallen(root, 0)
    assert (code, {each["enclave"] for each in told["take"]}, len(told["take"])) == (1, {"/camera"}, 1)
    code, told = fallen(root, 0, *needing(tmp_path, "/camera", "/console"))
    taken = named(told["take"], root)
    assert (code, len(taken)) == (1, 2)
    assert fallen(store(tmp_path / "changed", [each for each in BESIDE if each not in taken]), 0)[0] == 0
    assert is_able(tmp_path / "changed")
    assert not is_able(store(tmp_path / "less", BESIDE[1:]))


def is_able(root: Path) -> bool:
    audited = ("audit", root, "--engine", "native", "--at", AT, "--profile", "jazzy", "-f", "json")
    _code, said = answer(*audited, *needing(root.parent, "/camera", "/console"))
    statuses = {each["id"]: each["status"] for each in json.loads(said)["properties"]}
    return bool(statuses["needed"] == "holds")


def test_what_is_needed_itself_cannot_be_restored(tmp_path: Path) -> None:
    root = store(tmp_path / "keys", BESIDE)
    code, told = fallen(root, 0, *needing(tmp_path, "/camera", "/arm"))
    assert (code, told["take"]) == (1, None)
    said = answer(
        "flow", root, "/camera", "/arm", "--compromised", "0", "--at", AT, *needing(tmp_path, "/camera", "/arm")
    )
    assert "No small change of rights restores it." in said[1]


def test_who_reads_can_forge_so_that_reading_is_taken(tmp_path: Path) -> None:
    """The way names the governance there, and no right of whom it keeps from nothing."""
    rights = [
        ("/console", "publish", "rt/command"),
        ("/arm", "subscribe", "rt/command"),
        ("/camera", "subscribe", "rt/command"),
    ]
    root = store(tmp_path / "keys", rights)
    code, told = fallen(root, 1, *needing(tmp_path, "/console", "/arm"))
    assert (code, named(told["take"], root)) == (1, {rights[2]})
    assert fallen(store(tmp_path / "changed", rights[:2]), 1)[0] == 0


def test_who_survives_is_told_to_change_nothing(tmp_path: Path) -> None:
    code, told = fallen(store(tmp_path / "keys", BESIDE[:1]), 0)
    assert (code, told["take"]) == (0, None)


@pytest.mark.parametrize("seed", range(tried(25)))
def test_no_smaller_change_is_enough(seed: int, tmp_path: Path) -> None:
    chance = random.Random(seed)
    topics = ("rt/a", "rt/b", "rt/c")
    every = [(f"/{who}", way, topic) for who in NAMES for way in ("publish", "subscribe") for topic in topics]
    rights = sorted({*chance.sample(every, 6), ("/camera", "publish", "rt/a"), ("/arm", "subscribe", "rt/a")})
    root = store(tmp_path / "keys", rights)
    code, told = fallen(root, 1)
    assert code == 1
    taken = named(told["take"], root)
    smaller = [set(each) for size in range(1, len(taken)) for each in combinations(rights, size)]
    stores = [taken, *smaller]
    survived = []
    for number, gone in enumerate(stores):
        changed = store(tmp_path / f"changed{number}", [each for each in rights if each not in gone])
        survived.append(fallen(changed, 1)[0] == 0)
    assert survived == [True, *[False] * len(smaller)]


@pytest.mark.alloy
def test_both_engines_confirm_it(tmp_path: Path) -> None:
    root = store(tmp_path / "keys", BESIDE)
    told = [fallen(root, 1, "--engine", engine)[1]["take"] for engine in ("native", "both")]
    assert told[0] == told[1] != []
