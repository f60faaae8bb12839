"""Signed again: "the same meaning" is said only where every grant and every rule of protection is alike."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.model.comparison.change import Comparison, FailOn
from tests.amount import tried
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule
from tests.model.comparing import Member, Store, authority, compared
from tests.model.single_changes import BASE, TALKER
from tests.model.test_comparison_exactly import rules

ONE, ALL = rule(criterion("publish", "rt/chatter")), rule(criterion("publish", "*"))
OVER = {"end": "2025-01-01T00:00:00"}
NOW = grant("/talker", TALKER)
STRANGER = authority("stranger")
SAME, IDLE = "the same meaning", "counts for nobody"


def granted(*grants: str) -> Store:
    return BASE.member("/talker", permissions=permissions(*grants))


def unsigned(*grants: str) -> Store:
    """Nobody takes the talker's permissions."""
    return BASE.member("/talker", permissions=permissions(*grants), signer=STRANGER)


def ruled(*rules: str) -> Store:
    return replace(BASE, governance=governance(*rules))


OTHER = domain_rule(domains="<id>7</id>")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (granted(NOW), granted(NOW.replace('"g"', '"h"')), SAME),
        (granted(NOW), granted(grant("/talker", TALKER, TALKER)), SAME),
        (granted(NOW, grant("/x", ONE)), granted(grant("/x", ONE), NOW), SAME),
        # over
        (granted(NOW, grant("/x", ONE, **OVER)), granted(NOW, grant("/x", ALL, **OVER)), IDLE),
        (granted(NOW, grant("/x", ONE, **OVER)), granted(NOW, grant("/x", ONE, ONE, **OVER)), SAME),
        # hidden by another for the same subject; where that one ends first, Fast DDS takes this
        (granted(NOW, grant("/talker", ONE)), granted(NOW, grant("/talker", ALL)), IDLE),
        (granted(NOW, grant("/talker", ONE)), granted(NOW, grant("/talker", ONE, ONE)), SAME),
        (granted(NOW), granted(NOW, grant("/x", rule(criterion("publish", "*"), allow=False))), IDLE),
        # nobody takes it
        (unsigned(NOW, grant("/x", ONE)), unsigned(NOW, grant("/x", ALL)), IDLE),
        (unsigned(NOW, grant("/x", ONE)), unsigned(NOW, grant("/x", ONE, ONE)), SAME),
        # governance
        (ruled(domain_rule(), OTHER), ruled(OTHER, domain_rule()), SAME),
    ],
)
def test_the_same_meaning_is_said_where_everything_is_alike(old: Store, new: Store, words: str, tmp_path: Path) -> None:
    found = compared(old, new, tmp_path)
    assert [change.kind for change in found.changes] == ["signed-again"]
    assert words in found.changes[0].what


several = st.lists(rules, min_size=1, max_size=3)


def _rights(found: Comparison) -> set[tuple[str, str | None]]:
    """Of grants, and what peers accept; consequences aside."""
    kinds = ("right", "right-presented", "accepted")
    return {(each.direction.value, each.operation) for each in found.changes if each.kind in kinds}


@settings(max_examples=tried(25, 5), deadline=None, derandomize=True)
@given(several, several)
def test_a_right_in_the_document_of_another_is_told_as_one_in_its_own(before: list[str], after: list[str]) -> None:
    def own(listed: Sequence[str]) -> Store:
        return Store(members={"/a": Member(permissions=permissions(grant("/a", *listed)))})

    def others(listed: Sequence[str]) -> Store:
        talker = Member(permissions=permissions(grant("/talker", ONE), grant("/a", *listed)), serial=101)
        return Store(members={"/a": Member(permissions=permissions(grant("/x"))), "/talker": talker})

    with tempfile.TemporaryDirectory() as root:
        expected = compared(own(before), own(after), Path(root, "own"))
        found = compared(others(before), others(after), Path(root, "others"))
    assert _rights(found) == _rights(expected)
    assert bool(found.failing(FailOn.GAINED)) is bool(expected.failing(FailOn.GAINED))
