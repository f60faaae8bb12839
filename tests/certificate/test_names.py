"""Classes of names, against every short name."""

from __future__ import annotations

from fnmatch import fnmatchcase
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from keystore_audit.certificate.errors import CannotTell
from keystore_audit.certificate.names import Expressions, matches

EXPRESSIONS = st.text("ab*?", min_size=1, max_size=4)
SHORT = ["".join(letters) for length in range(1, 6) for letters in product("abc", repeat=length)]


@given(st.lists(EXPRESSIONS, min_size=1, max_size=4))
def test_each_short_name_is_in_the_class_of_the_expressions_that_match_it(texts: list[str]) -> None:
    expressions = Expressions(texts)
    classes = expressions.classes()
    for name in SHORT:
        ends = expressions.matched(name)
        assert {text for text in texts if expressions.ends[text] & ends} == {t for t in texts if fnmatchcase(name, t)}
        assert len(classes[ends]) <= len(name)
    for ends, name in classes.items():
        assert expressions.matched(name) == ends


@pytest.mark.parametrize("text", ["", "rt/[ab]", "a\\b", "a b", "é", "a;b"])
def test_what_implementations_read_in_their_own_ways_is_no_expression(text: str) -> None:
    with pytest.raises(CannotTell):
        Expressions([text])


def test_names_that_use_every_letter_leave_none_for_the_others() -> None:
    every = "".join(map(chr, range(ord("0"), ord("z") + 1))).replace("?", "").replace("[", "").replace("\\", "")
    with pytest.raises(CannotTell):
        Expressions([every.replace(";", "").replace("]", "")]).classes()


def test_too_many_combinations_are_beyond_the_checker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("keystore_audit.certificate.names.MAX_STATES", 5)
    with pytest.raises(CannotTell):
        Expressions(["*a*b*c*", "*b*c*a*"]).classes()


def test_a_star_also_matches_a_slash() -> None:
    assert matches("/arm*", "/arm/hand")
    assert not matches("/arm", "/arm/hand")
