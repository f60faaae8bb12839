"""What an enclave may do on Cyclone DDS 11.0.1, which is not installed: ours beside what it answered once.

Built from source with its own plugins, asked by `cyclonedds_enclave.c` about rules, partitions and joining.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from tests.oracles.vendors.enclave import Answer
from tests.oracles.vendors.local_comparison import Comparison
from tests.oracles.vendors.ours import Asked
from tests.oracles.vendors.recipe import NOW
from tests.oracles.vendors.recipes_rules import RECIPES

_MEASURED: Mapping[str, Mapping[str, str]] = json.loads(
    Path(__file__).with_name("measured_cyclonedds_11.json").read_text("utf-8")
)
"""As `local_answers.MEASURED`."""

_VENDOR = "cyclone-11"


def _answer(title: str) -> Answer:
    written = _MEASURED[title][_VENDOR]
    if written.startswith("refused: "):
        return Answer(participant=written)
    return Answer(participant=None, endpoints=tuple(None if letter == "+" else letter for letter in written))


def test_ours_agree_with_what_it_answered(tmp_path: Path) -> None:
    comparison = Comparison()
    for number, recipe in enumerate(RECIPES):
        keystore = tmp_path / str(number)
        recipe.build(keystore / "enclaves/talker")
        ours = Asked(keystore, "/talker", recipe.domain, recipe.endpoints, NOW, recipe.time_zone)
        comparison.add(recipe, _VENDOR, ours, _answer(recipe.title))
    assert comparison.deviating == {}
    assert comparison.agreed[_VENDOR] >= 800
    assert len(comparison.abstained) <= 10
