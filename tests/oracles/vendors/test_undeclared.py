"""Cyclone DDS asks for a peer's permissions only where the peer says that its endpoint is under access control.

So an attacker with any identity that is let in publishes and subscribes everything, under sros2's own governance. No
keystore prevents it; what holds under these profiles holds if it does not happen (docs/assumptions.md).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from keystore_audit.access import Access
from keystore_audit.assumptions import EVERY, Assumption, holds_if
from keystore_audit.circumstances import Circumstances
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.question import Question
from keystore_audit.profiles import VARIANTS
from keystore_audit.report.content import answered_if
from keystore_audit.truth import Truth
from tests.oracles.vendors import recipe
from tests.oracles.vendors.enclave import publish, subscribe
from tests.oracles.vendors.pairs import pairs
from tests.oracles.vendors.pairs_case import CAS, KEYSTORE, Case, outcome
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


def test_without_the_assumption_our_answer_is_that_of_the_vendor(tmp_path: Path) -> None:
    """Whether or not an attacker tells the truth: "no" as long as it does, and "yes" else, on Cyclone DDS alone."""
    UNGRANTED.sides(tmp_path)
    names = ("cyclonedds-0.10", "cyclonedds-11", "fastdds-2.9", "spec")
    profiles = [VARIANTS[name] for name in names]
    question = Question(enclave="/second", operation=Operation.PUBLISH, topic="b")
    told = {}
    for assumed in (EVERY, EVERY - {Assumption.TRUTHFUL_ANNOUNCEMENTS}):
        access = Access(
            tmp_path / KEYSTORE, [question], Circumstances(profiles=profiles, at=recipe.NOW, assumed=assumed)
        )
        told[assumed] = [answer.effective for answer in access.answers(question).values()]
    told_truly, told_anything = told.values()
    assert told_truly == [Truth.NO] * 4
    assert told_anything == [Truth.YES, Truth.YES, Truth.NO, Truth.NO]


def test_conditions_say_so_of_cyclone_dds_alone() -> None:
    assert "peers announce endpoints truthfully (Cyclone DDS does not check)" in holds_if(answered_if(VARIANTS))
    others = [name for name in VARIANTS if not name.startswith("cyclonedds")]
    assert "truthfully" not in holds_if(answered_if(others))
