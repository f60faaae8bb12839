"""Expressions match what the C library says they match, every text has a meaning, and no text takes long."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from keystore_audit.model.matching.expression import parse
from keystore_audit.model.matching.tokens import NO_CHARACTER
from keystore_audit.profiles import Matcher
from tests.steps import steps

Fnmatch = Callable[[str, str, Matcher], bool]

BRACKET_PARTS = [*"ab]c[!^-\\.:=/*?", "[:digit:]", "[:alpha:]", "[:foo:]", "[.a.]", "[=b=]", "[!", "a-c", "\\]", "[]"]
NAME_CHARACTERS = "ab]c[!^-\\.:=/1"
NAMES = ["".join(name) for length in range(4) for name in itertools.product("ab]-[/\\", repeat=length)]

texts = st.lists(st.sampled_from(BRACKET_PARTS), max_size=9).map("".join)
names = st.text(NAME_CHARACTERS, max_size=6)
POSIX = (Matcher.POSIX, Matcher.POSIX_NOESCAPE)

matchers = st.sampled_from(Matcher)
posix_matchers = st.sampled_from(POSIX)


@given(text=texts, matcher=posix_matchers, tried=st.lists(names, min_size=20, max_size=40))
def test_well_formed_text_matches_as_in_libc(
    libc_fnmatch: Fnmatch, text: str, matcher: Matcher, tried: list[str]
) -> None:
    pattern = parse(text, matcher)
    assume(pattern.malformed is None)
    # The text itself, with its wildcards filled in, is likelier to match than names at random.
    for name in [*tried, *NAMES[:60], text, text.replace("*", "a"), text.replace("*", "").replace("?", "]")]:
        assert pattern.matches(name) == libc_fnmatch(text, name, matcher), name


@pytest.mark.parametrize("matcher", POSIX)
@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("rt/[ab", "nothing closes"),
        ("[", "nothing closes"),
        ("[]", "nothing closes"),
        ("[!]", "nothing closes"),
        ("a[[b", "nothing closes"),
        ("[[:alpha:]", "nothing closes"),
        ("[a-", "nothing closes"),
        ("[z-a]", "ends before it begins"),
        ("[z-ab]", "ends before it begins"),
        ("[[:foo:]]", "does not exist"),
        ("[a[:foo:]b]", "does not exist"),
        ("[!a[:foo:]]", "does not exist"),
        ("[a[:]", "class name"),
        ("[[:Alpha:]]", "class name"),
        ("[b[=a]", "[="),
        ("[[.ab.]c]", "[."),
        ("[a[.", "[."),
    ],
)
def test_malformed_text_is_said_and_read_as_in_libc(
    libc_fnmatch: Fnmatch, text: str, fault: str, matcher: Matcher
) -> None:
    pattern = parse(text, matcher)
    assert pattern.malformed is not None
    assert fault in pattern.malformed
    for name in ["rt/[ab", "[]", "[!]", "a[[b", "[a", "[[:alpha:]", "]", "z", ":", "c", "b", "a]", "[:]", *NAMES[:60]]:
        if text != "[b[=a]" or name != "b":  # glibc finds b and gives up on the rest, whose = it takes otherwise
            assert pattern.matches(name) == libc_fnmatch(text, name, matcher), name


@pytest.mark.parametrize("name", ["alnum", "alpha", "blank", "cntrl", "digit", "graph", "lower", "print", "punct"])
def test_character_class_holds_what_it_holds_in_the_c_locale(libc_fnmatch: Fnmatch, name: str) -> None:
    for text in (f"[[:{name}:]]", f"[![:{name}:]]"):
        for code in range(1, 128):
            assert parse(text, Matcher.POSIX).matches(chr(code)) == libc_fnmatch(text, chr(code), Matcher.POSIX)


@pytest.mark.parametrize("name", ["space", "upper", "xdigit"])
def test_other_character_classes_too(libc_fnmatch: Fnmatch, name: str) -> None:
    test_character_class_holds_what_it_holds_in_the_c_locale(libc_fnmatch, name)


@given(text=st.text(max_size=30), matcher=matchers, name=st.text(max_size=10))
def test_every_text_has_a_meaning(text: str, matcher: Matcher, name: str) -> None:
    pattern = parse(text, matcher)
    if pattern.literal is not None:
        assert pattern.matches(name) == (name == pattern.literal)
    else:
        assert isinstance(pattern.matches(name), bool)
    assert pattern.text == text


@given(low=st.characters(), high=st.characters(), name=st.characters(exclude_characters="\0"))
def test_ranges_are_by_code_point(low: str, high: str, name: str) -> None:
    assume(not {low, high} & set("\0]!^[\\-"))
    assert parse(f"[{low}-{high}]", Matcher.POSIX).matches(name) == (low <= name <= high)
    assert parse(f"[!{low}-{high}]", Matcher.POSIX).matches(name) != (low <= name <= high)


@pytest.mark.parametrize(
    "unit", ["[", "[[:alpha:]", "[[.", "[[=a", "[[:aaaa", "[\\", "[a-", "[!", "*?", "[[.a.]-", "[]", "\\"]
)
@pytest.mark.parametrize("matcher", Matcher)
def test_parsing_takes_linear_time(unit: str, matcher: Matcher) -> None:
    """Eight times the text is eight times the work; for a quadratic reader it would be 64 times as much."""

    def work(size: int) -> int:
        parse.cache_clear()
        return steps(lambda: parse(unit * (size // len(unit)), matcher))

    assert work(8_000) < 9 * work(1_000)


def test_matching_does_not_backtrack_into_earlier_stars() -> None:
    name = "a" * 5_000 + "b"
    for text, found in (("*a" * 30 + "*b", True), ("*[ac]" * 30 + "*b", True), ("*[ac]" * 30 + "*[de]*b", False)):
        pattern = parse(text, Matcher.POSIX)
        assert pattern.matches(name) is found
        assert not pattern.matches("a" * 5_000)
        steps(partial(pattern.matches, name), most=10 * len(name))


def test_nul_is_in_no_name() -> None:
    pattern = parse("a\0b", Matcher.POSIX)
    assert pattern.malformed is not None
    assert NO_CHARACTER in pattern.tokens
    assert not pattern.matches("a\0b")
