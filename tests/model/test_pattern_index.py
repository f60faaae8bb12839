"""The index leaves out no expression that matches, whatever the matcher; and of many that are unlike it asks few."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.model.matching.automaton import PatternIndex
from keystore_audit.model.matching.expression import parse
from keystore_audit.profiles import Matcher

TEXTS = st.text("ab*?[]!\\", max_size=6)


@given(st.lists(TEXTS, max_size=8), st.text("ab[]", max_size=6), st.sampled_from(Matcher))
def test_all_that_match_are_candidates(texts: list[str], name: str, matcher: Matcher) -> None:
    patterns = [pattern for pattern in (parse(text, matcher) for text in texts) if pattern.literal is None]
    index = PatternIndex(enumerate(patterns))
    asked = sorted(number for number, _pattern in index.candidates(name))
    assert len(asked) == len(set(asked))
    assert {n for n, pattern in enumerate(patterns) if pattern.matches(name)} <= set(asked)


def test_few_of_many_are_candidates() -> None:
    texts = [*(f"rt/t{number}*" for number in range(3_000)), *(f"rt/*{number}" for number in range(3_000))]
    index = PatternIndex(enumerate(parse(text, Matcher.POSIX) for text in texts))
    assert len(list(index.candidates("rt/t1234"))) < 10
