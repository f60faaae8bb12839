"""POSIX and Fast DDS: topic classes and single expressions are what glibc's own fnmatch says they are."""

from __future__ import annotations

import random

import pytest

from keystore_audit.profiles import Matcher
from tests.amount import tried
from tests.oracles.fnmatch.brute_force import assert_classes_are_exact
from tests.oracles.fnmatch.corpus import BRACKET_NAMES, meant, pattern_set
from tests.oracles.fnmatch.libraries import ask, ask_all

BOTH = (Matcher.POSIX, Matcher.POSIX_NOESCAPE)
CHECKS = tried(260_000)
"""Of a name and a set of expressions; for two seeds and two matchers more than a million."""


@pytest.mark.slow
@pytest.mark.parametrize("matcher", BOTH)
@pytest.mark.parametrize("seed", range(2))
def test_no_name_lies_outside_of_the_classes(matcher: Matcher, seed: int) -> None:
    random_ = random.Random(f"{matcher}{seed}")
    checked = 0
    while checked < CHECKS:
        checked += assert_classes_are_exact(pattern_set(random_, matcher, odd=seed % 2 == 1), ask_all)


@pytest.mark.parametrize("matcher", BOTH)
def test_every_text_that_is_defined_matches_as_in_libc(matcher: Matcher) -> None:
    random_ = random.Random(str(matcher))
    patterns = [meant(random_, matcher) for _ in range(tried(1_500))]
    assert sum(pattern.malformed is not None for pattern in patterns) > tried(300)
    matched = 0
    for pattern in patterns:
        column = ask(pattern, BRACKET_NAMES)
        assert [pattern.matches(name) for name in BRACKET_NAMES] == column, pattern.text
        matched += sum(column)
    assert matched > tried(5_000)
