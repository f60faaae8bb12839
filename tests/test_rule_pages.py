"""docs/rules/ says what the registry says: a page for each rule, and none for another."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest

from keystore_audit import toml
from keystore_audit.properties import BY_ID
from tests.cli.keystores import answer
from tests.samples.test_build import MADE_BY_FAULTS
from tests.test_samples import SAMPLES
from tools import rule_pages


@cache
def pages() -> Mapping[str, str]:
    """What the tool would write; it makes every sample for it."""
    return rule_pages.pages()


def test_the_pages_are_what_the_registry_says() -> None:
    wanted = pages()
    there = {path.name: path.read_text("utf-8") for path in rule_pages.PAGES.glob("*.md")}
    assert sorted(there) == sorted(wanted), "run tools/rule_pages.py"
    assert [name for name in wanted if there[name] != wanted[name]] == [], "run tools/rule_pages.py"


def test_samples_that_pages_link_to_are_there() -> None:
    for name, text in pages().items():
        for target in re.findall(r"\]\((\.\./\.\./[^)]+)\)", text):
            assert (rule_pages.PAGES / target).exists(), f"{name}: {target}"


def test_every_rule_shows_what_it_finds() -> None:
    """A sample, or the recipe of one."""
    for name, text in pages().items():
        if name != rule_pages.INDEX and name.removesuffix(".md") not in MADE_BY_FAULTS:
            assert "\n## Samples\n" in text, name


@pytest.mark.parametrize("code", ["KA302", "KA640", "KA740", "KA909"])
def test_the_commands_of_a_page_find_what_it_says(code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """From a clone, whose private keys others can read: the exit code stays."""
    monkeypatch.chdir(SAMPLES)
    samples = re.findall(
        r"\.\./\.\./sample_keystores/(.*?)\).*?(?: Options: `(.*)`\.)?$", pages()[f"{code}.md"], re.MULTILINE
    )
    (at,) = re.findall(r"```sh\nkeystore-audit \S+ (.*)\n```", pages()[rule_pages.INDEX])
    assert len(samples) == 2
    for directory, options in samples:
        words = [directory, *shlex.split(f"{at} {options}")]
        expected = toml.loads(Path(f"{words[0]}.toml").read_text("utf-8"))
        exit_code, text = answer("audit", *words, "--engine", "native")
        assert exit_code == expected["exit_code"]
        assert (f"{code} " in text) is (words[0].endswith("/bad") or code in " ".join(expected["findings"]))


def test_every_property_has_a_page_and_a_line_of_the_index() -> None:
    found = pages()
    for prop in BY_ID.values():
        (code,) = re.findall(rf"^\| {prop.id} \| \[(KA7\d\d)\]", found[rule_pages.INDEX], re.MULTILINE)
        assert prop.statement in found[f"{code}.md"]
