"""`audit --graph` and `--launch`, on the samples: each variant shows the one thing that it differs in."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.keystores import AT, answer

STORIES = ("turtlesim", "vehicle")


def audited(samples: Path, story: str, *args: str | Path) -> tuple[int, list[dict[str, Any]]]:
    """The exit code and what KA65x finds."""
    root = samples / "healthy" / story
    code, text = answer("audit", "--engine", "native", "--at", AT, "-f", "json", root, *args)
    return code, [finding for finding in json.loads(text)["findings"] if finding["code"].startswith("KA65")]


@pytest.fixture(scope="module")
def samples(repository: Path) -> Path:
    return repository / "sample_keystores"


@pytest.mark.parametrize("story", STORIES)
@pytest.mark.parametrize(
    "name", ["graphs/{}.graph.json", *(f"launch/{{}}.launch.{end}" for end in ("xml", "yaml", "py"))]
)
def test_the_nodes_of_a_healthy_sample_do_what_they_may(story: str, name: str, samples: Path) -> None:
    option = "--graph" if name.startswith("graphs") else "--launch"
    assert audited(samples, story, option, samples / name.format(story)) == (0, [])


def test_graph_and_launch_file_together(samples: Path) -> None:
    """What the one shows excuses what the other does not."""
    excess = samples / "graphs/turtlesim-excess-grant.graph.json"
    whole = samples / "launch/turtlesim.launch.xml"
    assert audited(samples, "turtlesim", "--graph", excess, "--launch", whole) == (0, [])


def test_a_graph_does_not_weaken_the_gate(samples: Path) -> None:
    root = samples / "healthy/turtlesim"
    graph = samples / "graphs/turtlesim.graph.json"
    _code, text = answer("audit", "--engine", "native", "-f", "json", root, "--graph", graph)
    assert json.loads(text)["weakened"] == []


def test_enclaves_that_a_graph_leaves_out_are_said_not_to_be_compared(samples: Path, tmp_path: Path) -> None:
    """A right that is too much in an enclave without a node is no finding, so that the report has to say it."""
    whole = json.loads((samples / "graphs/turtlesim.graph.json").read_text())
    nodes = [node for node in whole["nodes"] if node["enclave"] != "/keyboard"]
    assert len(nodes) < len(whole["nodes"])
    part = tmp_path / "part.graph.json"
    part.write_text(json.dumps({**whole, "nodes": nodes}))
    for graph, said in ((part, True), (samples / "graphs/turtlesim.graph.json", False)):
        _code, text = answer(
            "audit", "--engine", "native", "--at", AT, samples / "healthy/turtlesim", "--graph", graph, "-v"
        )
        assert ("What /keyboard may do: no node of" in " ".join(text.split())) is said


@pytest.mark.parametrize(("name", "code"), [("talker", 0), ("talker-elsewhere", 4)])
def test_a_launch_file_that_is_not_read_as_a_whole(name: str, code: int, samples: Path) -> None:
    """It is a note, and with --launch-complete the audit is incomplete."""
    launched = ("--launch", samples / f"launch/{name}.launch.xml", "--fail-on", "critical")
    asked = ("audit", "--engine", "native", "--at", AT, samples / "rules/KA654-observation-incomplete/good", *launched)
    assert [answer(*asked)[0], answer(*asked, "--launch-complete")[0]] == [0, code]


def test_launch_complete_is_about_launch_files(samples: Path) -> None:
    code, _text = answer("audit", samples / "healthy/turtlesim", "--launch-complete")
    assert code == 2
