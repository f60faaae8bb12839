"""Cyclone DDS asks for a peer's permissions only where the peer says that its endpoint is under access control.

So an attacker with any identity that is let in publishes and subscribes everything, under sros2's own governance. No
keystore prevents it; reports of these profiles say that they assume it does not happen (`report.content.assumed_of`).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from keystore_audit.model.profiles import VARIANTS
from keystore_audit.report.content import assumed_of
from tests.oracles.vendors.enclave import publish, subscribe
from tests.oracles.vendors.pairs import pairs
from tests.oracles.vendors.pairs_case import CAS, Case, outcome
from tests.oracles.vendors.pairs_material import grant, permissions
from tests.oracles.xml.parsers import compiled, require_measured_versions

pytestmark = pytest.mark.xdist_group("vendors-pairs")

PATIENCE = 10.0
"""Seconds: the attacker announces its endpoints late."""

UNGRANTED = Case(
    title="presents a grant for the controls alone",
    presented=CAS.sign(permissions(grant("CN=/second"))),
    endpoints=(publish("a"), subscribe("a"), publish("b"), subscribe("c")),
)


def test_cyclone_dds_asks_no_permissions_of_what_is_not_declared(
    oracle: Callable[[str], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    require_measured_versions(oracle)
    source = Path(__file__).parent / "cyclonedds_undeclared.c"
    preloaded = compiled(oracle("cc"), source, tmp_path, "-shared", "-fPIC", "-ldl")
    with pairs(oracle, tmp_path) as both:
        declared = both["cyclone"].meet(*UNGRANTED.sides(tmp_path / "declared"))
        assert outcome(declared, UNGRANTED) == "...."
        monkeypatch.setenv("LD_PRELOAD", str(preloaded))
        left_out = both["cyclone"].meet(*UNGRANTED.sides(tmp_path / "left out"), PATIENCE)
    assert outcome(left_out, UNGRANTED) == "++++", "publishes what is heard, and hears what is published"
    assert VARIANTS["cyclonedds-0.10"].trust.trusts_declarations


def test_reports_say_so_of_cyclone_dds_alone() -> None:
    [said] = assumed_of(("spec", "fastdds-3.6", "cyclonedds-0.10", "cyclonedds-11"))
    assert said.startswith("Under cyclonedds-0.10, cyclonedds-11, an attacker")
    assert not list(assumed_of(name for name in VARIANTS if not name.startswith("cyclonedds")))
