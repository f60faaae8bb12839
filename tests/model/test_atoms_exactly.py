"""Topic classes and their finiteness against an exact oracle of our own, which follows every expression by itself."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from hypothesis import example, given
from hypothesis import strategies as st

from keystore_audit.model.matching.atoms import classify
from keystore_audit.model.matching.expression import Pattern, parse
from keystore_audit.model.matching.tokens import SEARCH, STAR, CharSet, Token
from keystore_audit.profiles import Matcher

LETTERS = "ab/]"
PARTS = ["a", "b", "/", "]", "*", "*", "?", "[ab]", "[!a]", "[]a]", "[a-c]", "[!a-b/]", "\\a", "\\", "[[:alpha:]]"]


def searched(tokens: Sequence[Token], place: int, letter: str) -> set[int]:
    """As OpenDDS goes on: from one place to one place, and behind the last star passed where that fails."""
    at = tokens[place] if place < len(tokens) else None
    if at is STAR:  # the last token
        return {place}
    if at is SEARCH:
        place += 1
        at = tokens[place]
    if letter == at if not isinstance(at, CharSet) else at.takes(letter):
        return {place + 1}
    return {
        number + 1 for number in range(place) if tokens[number] is SEARCH and SEARCH not in tokens[number + 1 : place]
    }


def positions_graph(patterns: Sequence[Pattern]) -> tuple[list[frozenset[int]], list[set[int]]]:
    """An exact oracle on its own: places in every expression at once.

    Its letters are those of the texts and one for each other way in which PARTS tell characters apart.
    """
    letters = sorted({*LETTERS, *"cz.", *(letter for pattern in patterns for letter in pattern.text)})
    tokens = [pattern.tokens for pattern in patterns]

    def close(number: int, places: set[int]) -> frozenset[int]:
        return frozenset(
            places | {place + 1 for place in places if place < len(tokens[number]) and tokens[number][place] is STAR}
        )

    def step(number: int, places: frozenset[int], letter: str) -> frozenset[int]:
        after = set()
        if not patterns[number].rewinds:
            return close(number, searched(tokens[number], min(places), letter)) if places else places
        for place in places:
            token = tokens[number][place] if place < len(tokens[number]) else None
            if token is STAR:
                after.add(place)
            elif token is not None and (letter == token if isinstance(token, str) else token.takes(letter)):
                after.add(place + 1)
        return close(number, after)

    start = tuple(close(number, {0}) for number in range(len(tokens)))
    states = {start: 0}
    order = [start]
    edges: list[set[int]] = []
    for state in order:
        targets = set()
        for letter in letters:
            after = tuple(step(number, places, letter) for number, places in enumerate(state))
            if after not in states:
                states[after] = len(order)
                order.append(after)
            targets.add(states[after])
        edges.append(targets)
    accepted = [frozenset(n for n, places in enumerate(state) if len(tokens[n]) in places) for state in order]
    return accepted, edges


@given(
    st.lists(st.lists(st.sampled_from(PARTS), max_size=5).map("".join), min_size=1, max_size=5),
)
@example(["rt/robot[12]", "rt/robot1", "rt/robot2"])
@example(["*", "?"])
@example(["?", "?*"])
@example(["??*"])
@example(["[!a]", "[ab]", "?*b"])
@example(["a*", "ab*", "*b", "?b"])
def test_classes_and_their_finiteness_are_those_of_an_exact_oracle(texts: list[str]) -> None:
    """Every expression is taken as literals are too, in one graph; words of all lengths count."""
    assert_exact([parse(text, Matcher.POSIX) for text in texts])


NO_DEFAULT = ("[]a][!]a][ab]", "[!a-b/]*[ab[!]a]*b*", "]*a?[!][a-c]")
"""A state of theirs from which every class of characters leads somewhere by name."""


@given(st.lists(st.builds(parse, st.lists(st.sampled_from(PARTS), max_size=5).map("".join), st.sampled_from(Matcher))))
@example([parse("[!a]", Matcher.POSIX), parse("?", Matcher.SIMPLE_BRACKETS), parse("*a", Matcher.SINGLE_TRY)])
@example([*map(parse, NO_DEFAULT, (Matcher.SINGLE_TRY, Matcher.POSIX_NOESCAPE, Matcher.SINGLE_TRY))])
def test_so_they_are_where_matchers_meet(patterns: list[Pattern]) -> None:
    assert_exact(patterns)


def assert_exact(patterns: Sequence[Pattern]) -> None:
    texts = [(pattern.text, pattern.matcher) for pattern in patterns]
    accepted, edges = positions_graph(patterns)
    classes = {found.members: found for found in classify(patterns)}
    # The empty name is in no class: where only it leads does not count.
    assert classes.keys() == {accepted[state] for state in set().union(*edges)}
    behind = [set(targets) for targets in edges]
    for middle, state in itertools.product(range(len(edges)), repeat=2):
        if middle in behind[state]:
            behind[state] |= behind[middle]
    on_cycle = {state for state in range(len(edges)) if state in behind[state]}
    endless = {accepted[state] for state in range(len(edges)) if any(state in behind[other] for other in on_cycle)}
    for members, found in classes.items():
        assert found.infinite == (members in endless), (texts, found)
