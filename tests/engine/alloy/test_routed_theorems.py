"""Theorems about any network of sessions and routers."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.engine.alloy.test_model import any_keystore
from tests.engine.alloy_batch import unexpected

pytestmark = [pytest.mark.alloy, pytest.mark.xdist_group("alloy")]

THEOREM_MUTANTS = {
    "WhoDeniesByDefaultGetsNothing": (
        "all p: to | lets[p, seen, kind, INGRESS,",
        "all p: to | lets[p, seen, kind, EGRESS,",
    ),
    "LessAllowedIsNoMore": ("not denied[(rules - allow_rule).expression,", "not denied[rules.expression,"),
    "PeersHearNothingThroughARouter": ("(from_mode + to_mode != PEER or process in brokering)", "some process"),
    "TheOutsiderHearsNothingOverEncryptedLinks": ("{ l: plain, s: heard", "{ l: Link, s: heard"),
}
"""By theorem a change of the module that no other finds (old text, new text)."""


@pytest.mark.slow
@pytest.mark.parametrize("broken", [None, *THEOREM_MUTANTS])
def test_each_theorem_about_networks_finds_a_mutant_that_no_other_does(broken: str | None, tmp_path: Path) -> None:
    modules = any_keystore()
    if broken is not None:
        old, new = THEOREM_MUTANTS[broken]
        assert modules["routed.als"].count(old) == 1
        modules["routed.als"] = modules["routed.als"].replace(old, new)
    assert unexpected(tmp_path, modules, "routed_theorems.als") == ([] if broken is None else [broken])
