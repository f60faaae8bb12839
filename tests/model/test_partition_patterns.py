"""Which partitions meet: against every short pattern and name, matched one by one."""

from __future__ import annotations

import fnmatch
import itertools
import random

import pytest

from keystore_audit.errors import BudgetExceeded
from keystore_audit.model.channels import build_channels
from keystore_audit.model.domains import domain_classes
from keystore_audit.model.matching import patterns as partition_patterns
from keystore_audit.model.matching.patterns import Patterns, meetings
from keystore_audit.model.semantics import Area, Region
from keystore_audit.profiles import Matcher
from tests.amount import tried

EXPRESSIONS = [
    *("a", "b", "ab", "abb", "*", "?", "??", "a*", "*b", "a?", "?b", "[ab]", "[!a]", "[!a]*", "[ab*]", "[a?]b", "aa*"),
    *("?*", "*ab*", "[*]", "b[*]", "\\*", "\\?b", ""),
]
STARS = ["".join(letters) for n in (1, 2, 3) for letters in itertools.product("ab*?", repeat=n)]
BRACKETS = [
    f"{head}[{inside}]{tail}"
    for head in ("", "a", "b", "aa", "*")
    for inside in ("a", "b", "ab", "bb", "*", "?", "abc")
    for tail in ("", "a", "b", "*", "?")
]
ESCAPED = [f"\\{one}{tail}" for one in "abc*" for tail in ("", "a", "b", "c", "*")]
NAMES = ["".join(letters) for n in range(5) for letters in itertools.product("abc", repeat=n)]


@pytest.mark.parametrize("seed", range(tried(40)))
def test_classes_meet_if_a_pattern_in_one_matches_a_name_in_the_other(seed: int) -> None:
    """Nothing that meets is missed, and for all that is found there is a pattern and what it matches."""
    patterns = Patterns()
    for text in random.Random(seed).sample(EXPRESSIONS, 1 + seed % 5):
        patterns.number(text, Matcher.POSIX)
    classes = [patterns.empty(), *patterns.classes()]
    place_of = {each.members: place for place, each in enumerate(classes) if place}

    def place(name: str) -> int:
        matching = frozenset(n for n, pattern in enumerate(patterns.patterns) if pattern.matches(name))
        return place_of[matching] if name else 0

    def met(ways: list[str], names: list[str]) -> set[tuple[int, int]]:
        placed = [(place(name), name) for name in names]
        tried = [(place(way), way) for way in ways]
        pairs = {(one, other) for one, way in tried for other, name in placed if fnmatch.fnmatchcase(name, way)}
        return {(one, other) for one, other in pairs if one != other}

    found = meetings(patterns.patterns, classes, range(len(classes)))
    pairs = {(one, other) for one, others in found.items() for other in others}
    assert met(STARS, NAMES) <= pairs
    known = met([*STARS, *BRACKETS], [*NAMES, *STARS, *BRACKETS, *ESCAPED])
    known |= {(place(way), place(way[1:])) for way in ESCAPED}
    assert pairs <= known


@pytest.mark.parametrize("seed", range(tried(20)))
def test_what_a_class_meets_does_not_hang_on_which_others_are_asked_about(seed: int) -> None:
    """Nor on what was asked before about the same expressions in another order."""
    random_ = random.Random(seed)
    texts = random_.sample(EXPRESSIONS, 4)
    found = []
    for order in (texts, texts[::-1]):
        patterns = Patterns()
        for text in order:
            patterns.number(text, Matcher.POSIX)
        classes = [patterns.empty(), *patterns.classes()]
        all_of_them = patterns.meetings(range(len(classes)))
        asked = random_.sample(range(len(classes)), 2)
        assert patterns.meetings(asked) == {one: met for one, met in all_of_them.items() if one in asked}
        found.append({classes[one].witness: {classes[n].witness for n in met} for one, met in all_of_them.items()})
    assert found[0] == found[1]


def test_the_partition_of_all_meets_the_default_one() -> None:
    patterns = Patterns()
    for text in ("secret", "*"):
        patterns.number(text, Matcher.POSIX)
    classes = [patterns.empty(), *patterns.classes()]
    number = next(n for n, each in enumerate(classes) if n and each.witness != "secret")
    assert meetings(patterns.patterns, classes, [number]) == {number: frozenset(range(len(classes))) - {number}}


def test_a_walk_that_takes_too_long_is_not_finished(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(partition_patterns, "MAX_PAIRS", 50)
    patterns = Patterns()
    for text in ("a?b", "*c*d*e*"):
        patterns.number(text, Matcher.POSIX)
    classes = [patterns.empty(), *patterns.classes()]
    with pytest.raises(BudgetExceeded, match="2 expressions of partitions"):
        meetings(patterns.patterns, classes, range(len(classes)))


def region(topics: tuple[str, ...], partitions: tuple[str, ...] | None) -> tuple[Matcher, Region]:
    return Matcher.POSIX, (Area(topics, partitions),)


def test_channels_of_a_topic_meet_where_somebody_may_be_allowed() -> None:
    """Deny in `secret`, allow in `*`; another topic is allowed in the default partition alone, and meets nothing."""
    domains = domain_classes([((0, 0),)])
    everything, denied = region(("*",), None), region(("rt/x",), ("secret",))
    allowed, other = region(("rt/x",), ("*",)), region(("rt/y",), ("",))
    channels = build_channels(
        domains, [True], [everything, denied, allowed, other], opening=frozenset({allowed, other})
    )
    secret, anywhere = channels.regions[denied], channels.regions[allowed] - channels.regions[denied]
    assert len(secret) == len(anywhere) == 1
    assert [channels.meets[number] for number in sorted(anywhere)] == [secret]
    assert sum(map(len, channels.meets)) == 1


def test_without_partitions_nothing_meets_and_no_channel_is_more() -> None:
    domains = domain_classes([((0, 0),)])
    regions = [region(("*",), None), region(("rt/x",), ("",)), region(("rt/y*",), ("",))]
    plain = build_channels(domains, [True], regions)
    asked = build_channels(domains, [True], regions, opening=frozenset(regions[1:]))
    assert asked.channels == plain.channels
    assert plain.meets == asked.meets == ()
