"""What a sample is for is what the audit finds in it, and nothing is found where the sample is good."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools import build_samples
from tools.samples import catalogue
from tools.samples.expectation import audit_directory
from tools.samples.made_at_test_time import DEPLOYED, RECIPES, VARIANTS
from tools.samples.story import AT, Story, read_description

PAIRS = tuple(story for story in catalogue.stories() if story.rule)
MADE = [(code, recipe) for code, (recipe, _good) in RECIPES.items()] + list(VARIANTS.values())


def codes(findings: list[str]) -> set[str]:
    return {finding.split()[0] for finding in findings}


@pytest.mark.parametrize("story", PAIRS, ids=lambda story: story.directory)
def test_a_bad_sample_expects_its_rule_and_a_good_one_does_not(story: Story) -> None:
    """Of the committed expectation; tests/test_samples.py compares that with an audit."""
    expected = read_description(build_samples.SAMPLES / story.directory)
    assert "findings" in expected, "run tools/build_samples.py --expect"
    assert (story.rule in codes(expected["findings"])) == story.directory.endswith("/bad")


def options_of(code: str) -> tuple[str, ...]:
    return ("--deployed",) if code in DEPLOYED else ()


@pytest.mark.parametrize(("code", "recipe"), MADE, ids=[*RECIPES, *VARIANTS])
def test_what_git_cannot_hold_is_found(code: str, recipe: object, tmp_path: Path) -> None:
    assert callable(recipe)
    recipe(tmp_path / "keystore")
    assert code in codes(audit_directory(tmp_path / "keystore", at=AT, options=options_of(code))["findings"])


@pytest.mark.parametrize("code", sorted(RECIPES))
def test_the_good_side_of_a_recipe_is_quiet(code: str, tmp_path: Path) -> None:
    RECIPES[code][1](tmp_path / "keystore")
    found = audit_directory(tmp_path / "keystore", at=AT, options=options_of(code))
    assert found["exit_code"] == 0
    assert code not in codes(found["findings"])
