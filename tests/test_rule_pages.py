"""docs/rules/ says what the registry says: a page for each rule, and none for another."""

from __future__ import annotations

import re

from tests.samples.test_build import MADE_BY_FAULTS
from tools import rule_pages


def test_the_pages_are_what_the_registry_says() -> None:
    wanted = rule_pages.pages()
    there = {path.name: path.read_text("utf-8") for path in rule_pages.PAGES.glob("*.md")}
    assert sorted(there) == sorted(wanted), "run tools/rule_pages.py"
    assert [name for name in wanted if there[name] != wanted[name]] == [], "run tools/rule_pages.py"


def test_samples_that_pages_link_to_are_there() -> None:
    for name, text in rule_pages.pages().items():
        for target in re.findall(r"\]\((\.\./\.\./[^)]+)\)", text):
            assert (rule_pages.PAGES / target).exists(), f"{name}: {target}"


def test_every_rule_shows_what_it_finds() -> None:
    """A sample, or the recipe of one."""
    for name, text in rule_pages.pages().items():
        if name != rule_pages.INDEX and name.removesuffix(".md") not in MADE_BY_FAULTS:
            assert "**Samples.**" in text, name
