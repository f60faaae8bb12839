"""Cyclone DDS and Fast DDS: expressions in signed permissions match the topics that the real plugins let be used."""

from __future__ import annotations

import random
from collections.abc import Sequence
from itertools import zip_longest

import pytest

from keystore_audit.model.matching.expression import Pattern, parse
from keystore_audit.profiles import Matcher
from tests.amount import tried
from tests.oracles.fnmatch.brute_force import assert_classes_are_exact
from tests.oracles.fnmatch.corpus import BRACKET_NAMES, meant, pattern_set, short_names
from tests.oracles.fnmatch.libraries import Column, ask
from tests.oracles.fnmatch.plugin import ask_two
from tests.oracles.xml.plugins import Plugin

pytestmark = pytest.mark.xdist_group("fnmatch-plugins")

PLAIN_NAMES = [*short_names("ab/]", 3), *short_names("-^!:.", 2), "abcab", "a1"]
"""Without wildcards: Fast DDS takes the topic for the pattern too."""


@pytest.mark.parametrize(
    ("vendor", "matcher", "names", "pairs"),
    [
        ("cyclone", Matcher.SIMPLE_BRACKETS, BRACKET_NAMES, tried(100_000)),
        ("fastdds", Matcher.POSIX_NOESCAPE, PLAIN_NAMES, tried(20_000)),
    ],
)
def test_every_text_matches_as_in_the_plugin(
    plugins: dict[str, Plugin], vendor: str, matcher: Matcher, names: list[str], pairs: int
) -> None:
    random_ = random.Random(vendor)
    asked = matched = 0
    while asked < pairs:
        two = meant(random_, matcher), meant(random_, matcher)
        for pattern, column in zip(two, ask_two(plugins[vendor], *two, names), strict=True):
            assert [pattern.matches(name) for name in names] == column, pattern.text
            asked += len(names)
            matched += sum(column)
    assert matched > pairs // 200


def test_classes_of_four_matchers_at_once_are_exact(plugins: dict[str, Plugin]) -> None:
    """Of patterns of every implementation in one partition: each asked of its own."""

    def ask_all(patterns: Sequence[Pattern], names: Sequence[str]) -> list[Column]:
        ours = [pattern for pattern in patterns if pattern.matcher is Matcher.SIMPLE_BRACKETS]
        answers: dict[int, Column] = {}
        for first, second in zip_longest(ours[::2], ours[1::2], fillvalue=parse("rt/chatter", Matcher.SIMPLE_BRACKETS)):
            answers[id(first)], answers[id(second)] = ask_two(plugins["cyclone"], first, second, names)
        return [answers[id(each)] if id(each) in answers else ask(each, names) for each in patterns]

    random_ = random.Random(0)
    checked = 0
    while checked < tried(100_000):
        checked += assert_classes_are_exact(pattern_set(random_, *Matcher), ask_all)


def test_one_text_means_what_each_implementation_makes_of_it(plugins: dict[str, Plugin]) -> None:
    names = ["a", "^", "b", "]", "]]", "a]", "-", "1"]
    for text in ("[^a]", "[a]", "[!a]", "[]a]", "[!]", "[a-]", "[a", "[b-a]", "[a]-c", "[[:digit:]]", "\\a"):
        pattern = parse(text, Matcher.SIMPLE_BRACKETS)
        column, _ = ask_two(plugins["cyclone"], pattern, pattern, names)
        assert [pattern.matches(name) for name in names] == column, text
