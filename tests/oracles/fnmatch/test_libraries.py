"""Topic classes and single expressions are what libc (POSIX, Fast DDS) and ACE (OpenDDS) say they are."""

from __future__ import annotations

import random

import pytest

from keystore_audit.model.matching.expression import parse
from keystore_audit.profiles import Matcher
from tests.amount import tried
from tests.oracles.fnmatch.brute_force import assert_classes_are_exact
from tests.oracles.fnmatch.corpus import BRACKET_NAMES, meant, pattern_set
from tests.oracles.fnmatch.libraries import ask, ask_all

CHECKS = {Matcher.POSIX: 260_000, Matcher.POSIX_NOESCAPE: 260_000, Matcher.SINGLE_TRY: 150_000}
"""By matcher, of a name and a set of expressions, for each of two seeds: more than a million."""


@pytest.mark.slow
@pytest.mark.parametrize("matcher", CHECKS)
@pytest.mark.parametrize("seed", range(2))
def test_no_name_lies_outside_of_the_classes(matcher: Matcher, seed: int) -> None:
    random_ = random.Random(f"{matcher}{seed}")
    odd = seed % 2 == 1 or matcher is Matcher.SINGLE_TRY
    checked = 0
    while checked < tried(CHECKS[matcher]):
        checked += assert_classes_are_exact(pattern_set(random_, matcher, odd=odd), ask_all)


@pytest.mark.parametrize("matcher", CHECKS)
def test_every_text_that_is_defined_matches_as_in_the_library(matcher: Matcher) -> None:
    random_ = random.Random(str(matcher))
    patterns = [meant(random_, matcher) for _ in range(tried(2_000))]
    assert matcher is Matcher.SINGLE_TRY or sum(each.malformed is not None for each in patterns) > tried(300)
    matched = 0
    for pattern in patterns:
        column = ask(pattern, BRACKET_NAMES)
        assert [pattern.matches(name) for name in BRACKET_NAMES] == column, pattern.text
        matched += sum(column)
    assert matched > tried(5_000)


@pytest.mark.parametrize(
    ("text", "name", "matches"),
    [
        ("*/cmd_vel", "rt/c/cmd_vel", False),  # where libc finds it
        ("*_tf", "rt/x_tf_tf", False),
        ("*Request", "rq/ReRequest", False),
        ("*ab", "aab", False),
        ("*?", "aa", False),
        ("*?", "aaa", True),
        ("*a", "ba", True),
        ("*a*", "xaa", True),
        ("rt/*", "rt/", True),
        ("**", "", True),
        ("[b-a]", "b", True),
        ("[b-a]", "-", False),
        ("[a-\x7f]", "A", True),
        ("[^a]", "^", True),
        (r"\*", "*", True),
        ("a\\", "a\\", False),
    ],
)
def test_what_is_peculiar_is_so_in_ace(text: str, name: str, matches: bool) -> None:
    pattern = parse(text, Matcher.SINGLE_TRY)
    assert list(ask(pattern, [name])) == [matches]
    assert pattern.matches(name) is matches
