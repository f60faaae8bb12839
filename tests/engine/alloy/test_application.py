"""The application in Alloy: what is wired and what is permitted, as `--graph` finds it in Python (KA650, KA651)."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit import resources
from keystore_audit.circumstances import Circumstances
from keystore_audit.engine.alloy.export import (
    APPLICATION,
    MODULE,
    NODES,
    WIRED,
    WIRING,
    write_nodes,
    write_wiring_commands,
)
from keystore_audit.engine.alloy.facts import KEYSTORE, facts
from keystore_audit.engine.alloy.user_file import CONSISTENT, read_user_file
from keystore_audit.engine.alloy.user_properties import job
from keystore_audit.export import export_model
from keystore_audit.findings import Location
from keystore_audit.given import GivenFile
from keystore_audit.intent.graph import read_graph
from keystore_audit.intent.intent import Intent
from keystore_audit.intent.policy import read_policy
from keystore_audit.intent.source import Source
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.formal.system import NodeAtom, System
from keystore_audit.model.intended.observed import Observation, observe
from keystore_audit.model.intended.observed_rights import wiring
from keystore_audit.model.interpret import interpret
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.profiles import resolve
from tests.engine.alloy_batch import evaluate, outcomes, shipped
from tests.engine.systems import CHATTER, LISTENER, TALKER, healthy, stock

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

SAMPLES = Path(__file__).resolve().parents[3] / "sample_keystores"
AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
SPEC = resolve(("spec",))
GRAPHS = [f"{story}{kind}" for story in ("turtlesim", "vehicle") for kind in ("", "-missing-grant", "-excess-grant")]


def told(story: str, intents: list[Intent]) -> tuple[System, Observation]:
    """The keystore with its nodes, and what the native comparison says of them."""
    keystore = read_keystore(SAMPLES / "healthy" / story)
    accesses = AccessViews(documents_of(keystore), AT, None)
    nodes = wiring(intents, keystore.layout.kind)
    meaning = interpret(keystore, SPEC, AT, accesses, Usabilities(None, accesses), nodes=nodes)
    return meaning.systems[0], observe(intents, keystore, SPEC, AT, accesses)


def modules(system: System) -> dict[str, str]:
    texts = shipped()
    return texts | {KEYSTORE: facts(system), NODES: write_nodes(system), APPLICATION: write_wiring_commands()}


@pytest.mark.parametrize("name", GRAPHS)
def test_alloy_finds_the_missing_and_the_unused_rights_that_graphs_show(name: str, tmp_path: Path) -> None:
    story = name.partition("-")[0]
    system, observed = told(story, [read_graph(SAMPLES / "graphs" / f"{name}.graph.json")])
    asked = ["publishes_without_right", "subscribes_without_right", "unused_to_write", "unused_to_read"]
    union = "{{ {who}, c: Channel | some r: TrustDomain | c in {who_}.({name}[r]) }}"
    expressions = [union.format(who="n: Node", who_="n", name=each) for each in asked[:2]]
    expressions += [union.format(who="e: Enclave", who_="e", name=each) for each in asked[2:]]
    texts = modules(system)
    lacks_write, lacks_read, more_write, more_read = evaluate(tmp_path, texts, expressions, opening="application")
    missing = {
        (system.enclaves[system.nodes[node].enclave or 0].label, operation, system.channels[channel].topic)
        for operation, pairs in ((Operation.PUBLISH, lacks_write), (Operation.SUBSCRIBE, lacks_read))
        for node, channel in pairs
    }
    denied = {(one.need.enclave, *channel) for one in observed.missing for channel in one.need.channels}
    assert missing <= denied
    for one in observed.missing:  # a service is two operations, of which one may be denied
        assert missing & {(one.need.enclave, *channel) for channel in one.need.channels}
    assert bool(missing) is ("missing" in name)
    for excess in observed.excess:
        for granted in excess.names:
            pairs = more_write if granted.operation is Operation.PUBLISH else more_read
            unused = {(system.enclaves[e].label, system.channels[c].topic) for e, c in pairs}
            assert (excess.enclave, granted.topic) in unused
    found = outcomes(tmp_path, texts, APPLICATION)
    assert found == {
        WIRED: True,
        "NodesHaveEnclaves": False,
        "NodesHaveTheRightsThatTheyNeed": bool(missing),
        "WiredFlowsArePermitted": bool(missing),
        "RightsAreUsed": bool(more_write | more_read),
    }
    assert bool(observed.excess) <= found["RightsAreUsed"]


def test_a_policy_wires_what_it_allows(tmp_path: Path) -> None:
    """The keystore was made from it, so that no wire lacks a right."""
    system, _ = told("turtlesim", [read_policy(SAMPLES / "policies" / "turtlesim.policy.xml").intent])
    assert {node.label for node in system.nodes} == {"/multiplexer", "/turtlesim", "/keyboard", "/random"}
    found = outcomes(tmp_path, modules(system), APPLICATION)
    assert found[WIRED]
    assert not found["NodesHaveTheRightsThatTheyNeed"]
    assert not found["WiredFlowsArePermitted"]


def wired() -> System:
    """The talker's node and the listener's, another beside the listener's, and one of an enclave that is not there."""
    system = healthy()

    def node(label: str, enclave: int | None, publishes: list[int], subscribes: list[int]) -> NodeAtom:
        return NodeAtom(
            label=label,
            location=system.enclaves[0].location,
            enclave=enclave,
            publishes=frozenset(publishes),
            subscribes=frozenset(subscribes),
        )

    nodes = (
        node("/talker", TALKER, [CHATTER], []),
        node("/listener", LISTENER, [], [CHATTER]),
        node("/liar", LISTENER, [CHATTER], []),
        node("/lost", None, [CHATTER], []),
    )
    return replace(system, nodes=nodes)


QUESTIONS = """module asked
open keystore_audit
pred talks[a, b: Node] { some c: Channel | wired[a, b, c] and permitted[a, b, c] }
check WiredAndPermitted { all a, b: Node | talks[a, b] implies a.runs_in != b.runs_in } for 0
run LiarIsWiredAndNotPermitted { some a, b: Node, c: Channel | wired_but_not_permitted[a, b, c] } for 0
run PermittedNotWired { some a, b: Node, c: Channel | permitted_but_not_wired[a, b, c] } for 0
check ListenersTellNobody { all n: Node | no n.publishes_to implies keeps_to_itself[n, n] } for 0
check TalkersTellNobody { all n: Node | some n.runs_in implies keeps_to_itself[n, n] } for 0
check NodesHaveEnclaves for 0
"""


def test_users_files_speak_of_nodes_where_there_are_some(tmp_path: Path) -> None:
    file = read_user_file(Source(file=GivenFile.of("asked.als", b""), real="/asked.als", text=QUESTIONS))
    run = job(file, wired())
    found = outcomes(tmp_path, dict(run.files), run.main)
    assert {name: answer for name, answer in found.items() if "RangeOf" not in name} == {
        "WiredAndPermitted": False,
        "LiarIsWiredAndNotPermitted": True,
        "PermittedNotWired": True,
        "ListenersTellNobody": False,
        "TalkersTellNobody": True,
        "NodesHaveEnclaves": True,
        CONSISTENT: True,
    }


def test_the_exported_model_has_the_nodes(tmp_path: Path) -> None:
    graph = read_graph(SAMPLES / "graphs" / "vehicle-missing-grant.graph.json")
    given = Circumstances(at=AT, profiles=resolve(("spec",)))
    export_model(SAMPLES / "healthy" / "vehicle", tmp_path / "m", given, intents=[graph])
    found = outcomes(tmp_path / "m", {}, APPLICATION)
    assert [name for name in WIRING if found[name]] == ["NodesHaveTheRightsThatTheyNeed", "WiredFlowsArePermitted"]
    assert "| `N0_" in (tmp_path / "m" / "README.md").read_text()


def example() -> System:
    """The nodes of the example in the source tree: a talker and a listener as sros2 makes their enclaves."""

    def node(label: str, enclave: int, line: int, *, talks: bool) -> NodeAtom:
        channels = frozenset({CHATTER})
        return NodeAtom(
            label=label,
            location=Location(path="talker_listener.graph.json", line=line, beside=True),
            enclave=enclave,
            publishes=channels if talks else frozenset(),
            subscribes=frozenset() if talks else channels,
        )

    nodes = (node("/talker", TALKER, 4, talks=True), node("/listener", LISTENER, 12, talks=False))
    return replace(stock(), nodes=nodes)


def test_the_module_opens_and_runs_beside_the_example_of_the_source_tree(tmp_path: Path) -> None:
    folder = resources.alloy()
    assert (folder / NODES).read_text() == write_nodes(example())
    texts = {path.name: path.read_text() for path in folder.glob("*.als")}
    found = outcomes(tmp_path, texts | {APPLICATION: write_wiring_commands()}, APPLICATION)
    assert found == {WIRED: True} | dict.fromkeys(WIRING, False)


def theorems() -> dict[str, str]:
    return shipped() | {path.name: path.read_text() for path in (Path(__file__).parent / "any_keystore").glob("*.als")}


@pytest.mark.slow
def test_theorems_about_every_application_hold(tmp_path: Path) -> None:
    assert outcomes(tmp_path, theorems(), "application_theorems.als") == {
        "WhatNodesTellIsAHop": False,
        "NodesTellWhatIsWiredAndPermitted": False,
        "OwnRightsAreRights": False,
        "TheFourQuestionsDiffer": False,
        "RightsCarryFlows": False,
        "AFlowIsWiredAndPermitted": True,
        "AFlowIsWiredAndNotPermitted": True,
        "AFlowIsPermittedAndNotWired": True,
    }


MUTANTS = {
    "a writer's own trust domain is enough": (" & writes_by_own[receiving]", "", "WhatNodesTellIsAHop"),
    "a reader's own trust domain is enough": (" & reads_by_own[sending]", "", "WhatNodesTellIsAHop"),
    "nodes without an enclave tell": ("\tnodes_of[sending] <: runs_in.", "\tNode <: runs_in.", "WhatNodesTellIsAHop"),
    "what is wired is permitted": (
        "\tsome sending, receiving: TrustDomain |\n",
        "\tsome Channel or some sending, receiving: TrustDomain |\n",
        "AFlowIsWiredAndNotPermitted",
    ),
    "who may tell, tells": ("(publishes_to & may_publish[", "(may_publish[", "NodesTellWhatIsWiredAndPermitted"),
}
"""Changes of application.als, and the theorem that finds each out."""


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTANTS)
def test_a_change_of_the_module_breaks_a_theorem(name: str, tmp_path: Path) -> None:
    old, new, broken = MUTANTS[name]
    text = (resources.alloy() / MODULE).read_text()
    assert text.count(old) == 1
    texts = theorems() | {MODULE: text.replace(old, new)}
    found = outcomes(tmp_path, texts, "application_theorems.als", names=[broken])
    assert found[broken] is not broken.startswith("AFlow")


def test_names_of_nodes_are_no_part_of_the_model() -> None:
    system = wired()
    hostile = replace(system.nodes[0], label="/x\n} fact { no Enclave } /* */ one")
    text = write_nodes(replace(system, nodes=(hostile, *system.nodes[1:])))
    assert "\n}" not in text.replace("\n}\n", "")
    assert [line for line in text.splitlines() if "fact" in line] == [
        line for line in text.splitlines() if line.startswith("-- ") and "fact" in line
    ]
