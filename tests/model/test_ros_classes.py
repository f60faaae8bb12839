"""Classes of ROS names against every short name, asked of the expressions themselves."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.errors import BudgetExceeded
from keystore_audit.intent.intent import is_ros_name
from keystore_audit.model.matching.expression import parse
from keystore_audit.model.ros.classes import Affix, classify_ros_names
from keystore_audit.profiles import Matcher
from tests.amount import tried

REQUEST, REPLY, FEEDBACK = Affix("rq", "Request"), Affix("rr", "Reply"), Affix("rt", "/_action/feedback")
AFFIXES = (REQUEST, REPLY, FEEDBACK)
NAMES = [name for length in range(2, 6) for name in map("".join, product("/aR1", repeat=length)) if is_ros_name(name)]
_TEXTS = st.one_of(
    st.sampled_from(
        ("*", "r*", "rq/*Request", "rr/*Reply", "rt/*", "rq/a/*", "r[qr]/a*", "*Reply", "*/a*R*", "r?/?Re*", "*t")
    ),
    st.tuples(
        st.sampled_from(("rq", "rr", "rt", "r?", "*", "r[!q]")),
        st.lists(st.sampled_from(("/", "a", "R", "*", "?", "[a1]", "[!a]")), max_size=4).map("".join),
        st.sampled_from(("Request", "Reply", "/_action/feedback", "*", "t", "?eply")),
    ).map("".join),
)


@settings(max_examples=tried(150), deadline=None)
@given(texts=st.lists(_TEXTS, max_size=5), matcher=st.sampled_from(tuple(Matcher)))
def test_every_name_is_in_exactly_one_class(texts: list[str], matcher: Matcher) -> None:
    patterns = [parse(text, matcher) for text in texts]

    def members(name: str) -> tuple[frozenset[int], ...]:
        return tuple(
            frozenset(n for n, pattern in enumerate(patterns) if pattern.matches(affix.topic(name)))
            for affix in AFFIXES
        )

    classes = classify_ros_names(patterns, AFFIXES)
    for each in classes:
        assert is_ros_name(each.name)
        assert each.members == members(each.name)
    literal = {affix.name(text) for text, p in zip(texts, patterns, strict=True) if p.literal for affix in AFFIXES}
    by_name = {each.name: each.members for each in classes}
    others = [each.members for each in classes if each.name not in literal]
    assert len(set(others)) == len(others), "classes that nothing tells apart"
    for name in NAMES:
        assert by_name.get(name, members(name)) == members(name)
        assert name in literal or members(name) in others, name


def test_a_class_that_is_only_a_literal_is_not_said_twice() -> None:
    patterns = [parse(text, Matcher.POSIX) for text in ("rq/?Request", "rq/aRequest")]
    classes = classify_ros_names(patterns, (REQUEST,))
    assert [(each.name, each.members) for each in classes] == [
        ("/a", (frozenset({0, 1}),)),
        ("/aa", (frozenset(),)),
        ("/b", (frozenset({0}),)),
    ]


def test_too_many_classes_are_no_answer() -> None:
    patterns = [parse(f"rq/*{letter}*Request", Matcher.POSIX) for letter in "abcdefghijklmn"]
    with pytest.raises(BudgetExceeded):
        classify_ros_names(patterns, (REQUEST, REPLY))


def test_an_affix_knows_the_names_that_it_is_put_around() -> None:
    assert REQUEST.name("rq/addRequest") == "/add"
    assert REQUEST.name("rq/Request") is None
    assert REQUEST.name("rr/addRequest") is None
    assert Affix("rq/", "/Request").name("rq/Request") is None
