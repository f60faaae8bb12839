"""Runs against vacuity beyond the audit's own three: flows, their places, and wiring say so where there is nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.engine.alloy.claims import FLOW_EXERCISED, INHABITED
from keystore_audit.engine.alloy.export import APPLICATION, NODES, WIRED, commands, write_nodes, write_wiring_commands
from keystore_audit.engine.alloy.facts import KEYSTORE, MAIN, facts
from keystore_audit.model.formal.asked import ClaimAtom, Place
from keystore_audit.model.formal.system import NodeAtom, System
from tests.engine.alloy.flow_builders import at, chain, claim
from tests.engine.alloy_batch import outcomes, shipped
from tests.engine.systems import CHATTER, LISTENER, TALKER, healthy, healthy_builder

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]


def exercised(system: System, asked: ClaimAtom, directory: Path) -> dict[str, bool]:
    system = replace(system, claims=(asked,))
    texts = shipped()
    found = outcomes(directory, texts | {KEYSTORE: facts(system), MAIN: commands((), system)})
    return {name: found[name] for name in (FLOW_EXERCISED, INHABITED)}


def test_flows_say_whether_anything_flows_and_anybody_is_there(tmp_path: Path) -> None:
    ends = claim(at(TALKER), at(LISTENER))
    assert exercised(chain().system(), ends, tmp_path) == {FLOW_EXERCISED: True, INHABITED: True}
    silent = healthy_builder()
    silent.rules.clear()
    assert exercised(silent.system(), ends, tmp_path) == {FLOW_EXERCISED: False, INHABITED: True}
    nobody = replace(ends, target=Place())
    assert exercised(healthy(), nobody, tmp_path) == {FLOW_EXERCISED: True, INHABITED: False}


@pytest.mark.parametrize("subscribes", [True, False])
def test_wiring_says_whether_anything_is_wired(subscribes: bool, tmp_path: Path) -> None:
    system = healthy()
    place, channels = system.enclaves[0].location, frozenset({CHATTER})
    talker = NodeAtom(label="/t", location=place, enclave=TALKER, publishes=channels, subscribes=channels)
    heard = channels if subscribes else frozenset[int]()
    listener = NodeAtom(label="/l", location=place, enclave=LISTENER, publishes=frozenset(), subscribes=heard)
    system = replace(system, nodes=(talker, listener))
    texts = shipped()
    texts |= {KEYSTORE: facts(system), NODES: write_nodes(system), APPLICATION: write_wiring_commands()}
    assert outcomes(tmp_path, texts, APPLICATION)[WIRED] is subscribes, "to tell itself something is no wire"
