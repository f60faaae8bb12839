"""`diff` with a policy, a graph and properties: what is not to be lost, and what is not to stay in use."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.cli import keystores
from tests.cli.keystores import AT, answer, keystore, rule
from tests.keystore.builder import authority, certificate
from tests.schemas import schema

POLICY = """<policy version="0.2.0"><enclaves><enclave path="/c"><profiles><profile ns="/" node="c">
<topics publish="ALLOW"><topic>x</topic></topics>
</profile></profiles></enclave></enclaves></policy>
"""
NODE = {"name": "c", "namespace": "/", "enclave": "/c", "publishers": [{"topic": "/x", "type": "std_msgs/msg/Empty"}]}
PROPERTY = '[[property]]\nname = "asked"\n{}\n'
READS = (rule(subscribe=("rt/x", "rt/y")),)


def publishing(root: Path, *topics: str) -> Path:
    return keystore(root, {"/c": (rule(publish=topics),), "/d": READS})


@pytest.fixture
def stores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Keystores of one pair of authorities by what /c may publish."""
    monkeypatch.setattr(keystores, "authority", cache(authority))
    identities = cache(lambda path: certificate(path, authorities("identityCA")))
    authorities = keystores.authority
    monkeypatch.setattr(keystores, "certificate", lambda path, _issuer, **_none: identities(path))

    def made(name: str, *topics: str) -> Path:
        return publishing(tmp_path / name, *topics)

    return made


def told(old: Path, new: Path, *words: str | Path) -> tuple[int, list[dict[str, Any]]]:
    code, out = answer("diff", old, new, "--at", AT, "--profile", "cyclonedds-11", "-f", "json", *words)
    document = json.loads(out)
    schema("diff").validate(document)
    return code, [each for each in document["changes"] if each["direction"] == "lost"]


def written(tmp_path: Path, name: str, text: str) -> Path:
    (tmp_path / name).write_text(text)
    return tmp_path / name


def test_without_a_word_of_it_a_right_that_stays_in_use_is_medium(stores: Any, tmp_path: Path) -> None:
    code, (lost,) = told(stores("old", "rt/x", "rt/y"), stores("new", "rt/x"))
    assert (code, lost["severity"], lost["until"], lost["fails"]) == (0, "medium", "2033-12-29T00:00:00Z", False)
    assert lost["what"] == "may still, until 2033-12-29T00:00:00Z, publish"
    for kind in ("text", "markdown"):
        _code, out = answer("diff", tmp_path / "old", tmp_path / "new", "--at", AT, "-f", kind)
        flat = " ".join(out.replace("\\", "").split())
        assert (
            "medium: still effective until 2033-12-29T00:00:00Z. Peers of NEW still accept what was signed before"
            in flat
        )
        assert "no longer publish" not in flat
    assert "revoke" in lost["remedy"]


def test_one_that_the_policy_forbids_is_high(stores: Any, tmp_path: Path) -> None:
    policy = written(tmp_path, "p.xml", POLICY)
    code, (lost,) = told(stores("old", "rt/x", "rt/y"), stores("new", "rt/x"), "--policy", policy)
    assert (code, lost["severity"], lost["fails"]) == (1, "high", True)
    assert lost["against"] == ["the policy does not let /c publish /y (topic)"]


def test_one_that_the_policy_names_is_not_to_be_lost(stores: Any, tmp_path: Path) -> None:
    policy = written(tmp_path, "p.xml", POLICY)
    old, new = stores("old", "rt/x", "rt/y"), stores("new", "rt/y")
    code, lost = told(old, new, "--policy", policy)
    assert code == 1
    assert [(each["kind"], each["enclaves"], each["fails"]) for each in lost if each["fails"]] == [
        ("needed", ["/c"], True)
    ]
    assert told(old, new)[0] == 0
    assert told(new, new, "--policy", policy) == (0, []), "it was lost before"


def test_more_rights_than_are_listed_are_compared_too(stores: Any, tmp_path: Path) -> None:
    policy = written(tmp_path, "p.xml", POLICY)
    many = tuple(f"rt/n{number}" for number in range(40))
    code, (lost,) = told(stores("old", "rt/x", *many, "rt/z"), stores("new", "rt/x", *many), "--policy", policy)
    assert (code, lost["severity"]) == (1, "high")


def test_one_that_a_node_needs_is_not_to_be_lost(stores: Any, tmp_path: Path) -> None:
    graph = written(tmp_path, "g.json", json.dumps({"schema_version": 1, "nodes": [NODE]}))
    old, new = stores("old", "rt/x", "rt/y"), stores("new", "rt/y")
    code, lost = told(old, new, "--graph", graph)
    assert (code, [each["against"] for each in lost if each["fails"]]) == (
        1,
        [["may no longer publish /x; /c needs it"]],
    )
    assert told(old, stores("other", "rt/x"), "--graph", graph)[0] == 0


@pytest.mark.parametrize(
    ("asked", "kind"),
    [
        ('able = { from = "/c", to = "/d" }', "needed"),
        ('no_flow = { from = "/c", to = "topic:/y", attacker = "source" }', "forbidden"),
        ('only_publish = { topic = "/y", enclaves = ["/d"] }', "forbidden"),
    ],
)
def test_properties(asked: str, kind: str, stores: Any, tmp_path: Path) -> None:
    settings = written(tmp_path, "s.toml", PROPERTY.format(asked))
    old, new = stores("old", "rt/x", "rt/y"), stores("new", *(("rt/x",) if kind == "forbidden" else ("rt/z",)))
    assert told(old, new)[0] == (0 if kind == "forbidden" else 1)  # /z is more than before
    code, lost = told(old, new, "--settings", settings)
    assert (code, [each["severity"] for each in lost if each["kind"] == kind]) == (1, ["high"])
    assert told(old, old, "--settings", settings) == (0, [])
