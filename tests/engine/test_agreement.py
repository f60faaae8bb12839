"""The two engines give one answer: on random systems, by the hundred, through the real Analyzer."""

from __future__ import annotations

from keystore_audit.engine.native import NativeEngine
from keystore_audit.properties import PROPERTIES, Status
from tests.engine.alloy_batch import decide_batch
from tests.engine.systems import random_system

SYSTEMS = 300
"""As many as the project asks for; the seeds are fixed so that a failure can be seen again."""


def test_native_and_alloy_agree_on_random_systems() -> None:
    systems = [random_system(seed) for seed in range(SYSTEMS)]
    alloy = decide_batch(systems)
    differing = []
    violated = dict.fromkeys((prop.id for prop in PROPERTIES), 0)
    for seed, (system, theirs) in enumerate(zip(systems, alloy, strict=True)):
        ours = NativeEngine([system]).answers[0]
        assert set(theirs) == set(ours)
        for property_id, answer in ours.items():
            holds = answer.status is Status.HOLDS
            violated[property_id] += not holds
            if holds != theirs[property_id]:
                differing.append((seed, property_id, answer.status))
    assert differing == []
    for property_id, count in violated.items():
        assert 5 <= count <= SYSTEMS - 5, f"{property_id} is violated in {count} of {SYSTEMS}: a lopsided test"
