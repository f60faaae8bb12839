"""Grants for subjects that are no enclave of the keystore: whoever holds the identity has what they give."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from keystore_audit.model.comparison.change import Change, Comparison
from keystore_audit.report.diff_text import sentence
from tests.amount import tried
from tests.keystore.documents import criterion, grant, permissions, rule
from tests.model.comparing import Member, Store, compared
from tests.model.single_changes import BASE, LISTENER, TALKER, talker
from tests.model.test_comparison_exactly import rules

GHOST = grant("/ghost", rule(criterion("publish", "rt/cmd_vel")))
EVERYTHING = grant("/ghost", rule(criterion("publish", "*"), criterion("subscribe", "*")))
Told = list[tuple[str, str, str | None]]
AGAIN = ("signed-again", "info", None)


def beside(*grants: str, own: str = grant("/talker", TALKER)) -> Store:
    """The talker's document has grants for others."""
    return BASE.member("/talker", permissions=permissions(own, *grants))


def told(found: Comparison) -> Told:
    return sorted(((each.kind, each.direction.value, each.operation) for each in found.changes), key=repr)


def right(direction: str, *operations: str) -> Told:
    return [("right-of-others", direction, operation) for operation in operations]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (beside(), beside(EVERYTHING), right("gained", "publish", "subscribe")),
        (beside(GHOST), beside(EVERYTHING), right("gained", "publish", "subscribe")),
        (
            beside(GHOST),
            beside(GHOST.replace("cmd_vel", "other")),
            [*right("gained", "publish"), *right("lost", "publish")],
        ),
        (beside(GHOST), beside(GHOST.replace(' name="g"', ' name="h"')), [AGAIN]),
        (beside(), beside(grant("/ghost", rule(criterion("publish", "*"), allow=False))), [AGAIN]),
        (beside(), beside(grant("/ghost", rule(domains="<id>7</id>"))), right("gained", "join")),
        (beside(), beside(grant("/ghost", default="ALLOW")), right("gained", "publish", "relay", "subscribe")),
        (beside(), beside(GHOST.replace("2024-", "2030-")), right("gained", "publish")),
        (beside(), beside(GHOST.replace("2034-", "2025-")), [AGAIN]),
        (beside(GHOST), beside(GHOST.replace("2034-", "2044-")), [("grant-of-others", "changed", None)]),
        # the first grant for a subject decides, for others too
        (beside(GHOST), beside(GHOST, EVERYTHING), right("gained", "publish", "subscribe")),
        (beside(GHOST, EVERYTHING), beside(EVERYTHING, GHOST), right("gained", "publish", "subscribe")),
        # plain subjects name nobody else, odd ones may
        (beside(GHOST, grant("/x")), beside(grant("/x"), GHOST), [AGAIN]),
        (
            beside(GHOST, grant("/ghost,O=x")),
            beside(grant("/ghost,O=x"), GHOST),
            [("grant-of-others", "changed", None)],
        ),
        # in another document, and in one beside the enclaves
        (
            beside(GHOST),
            BASE.member("/listener", permissions=permissions(grant("/listener", LISTENER), GHOST)),
            [AGAIN],
        ),
        (BASE, replace(BASE, strays={"more.p7s": permissions(GHOST)}), right("gained", "publish")),
        # an enclave that came or went says so; what others' documents give it beyond that is told
        (BASE, BASE.without("/listener"), [("enclave-removed", "lost", None)]),
        (beside(GHOST), replace(beside(), members={**BASE.members, "/ghost": Member(permissions=permissions(GHOST))}), [
            ("enclave-added", "gained", None), AGAIN
        ]),
        (
            BASE,
            beside(grant("/listener", rule(criterion("publish", "rt/more")))).without("/listener"),
            [("enclave-removed", "lost", None), *right("gained", "publish")],
        ),
        # nobody takes it
        (
            beside(),
            BASE.member("/talker", permissions=permissions(grant("/talker", TALKER), GHOST), tampered=True),
            [("signature", "lost", None)],
        ),
    ],
)  # fmt: skip
def test_grants_for_others(old: Store, new: Store, expected: Told, tmp_path: Path) -> None:
    assert told(compared(old, new, tmp_path)) == sorted(expected, key=repr)


def test_alike_for_many_is_told_once(tmp_path: Path) -> None:
    ghosts = [EVERYTHING.replace("/ghost", f"/ghost{number}") for number in range(9)]
    found = compared(beside(), beside(*ghosts), tmp_path)
    assert told(found) == right("gained", "publish", "subscribe")
    assert sentence(found.changes[0], found).startswith(
        "Whoever has the identity CN=/ghost0 or CN=/ghost1 or CN=/ghost2 and 6 more may publish"
    )
    assert len(found.changes[0].aspects) == 9


several = st.lists(rules, max_size=3)
defaults = st.sampled_from(["DENY", "ALLOW"])


def _shape(change: Change) -> tuple[object, ...]:
    return change.direction, change.operation, change.names, change.profiles, change.varies


@settings(max_examples=tried(25, 5), deadline=None, derandomize=True)
@given(several, defaults, several, defaults)
def test_as_if_it_were_an_enclave(before: list[str], first: str, after: list[str], second: str) -> None:
    """What changes for a holder from elsewhere is what would for an enclave with the grant for its own document."""
    grants = [grant("/a", *before, default=first), grant("/a", *after, default=second)]
    talks = Member(permissions=talker(TALKER), serial=101)
    elsewhere, here = (
        [
            Store(members={"/talker": replace(talks, permissions=permissions(grant("/talker", TALKER), each))})
            for each in grants
        ],
        [Store(members={"/talker": talks, "/a": Member(permissions=permissions(each))}) for each in grants],
    )
    with tempfile.TemporaryDirectory() as root:
        found = compared(*elsewhere, Path(root, "elsewhere"))
        expected = compared(*here, Path(root, "here"))
    own = [_shape(each) for each in expected.changes if each.kind == "right" and each.enclaves == ("/a",)]
    others = [_shape(each) for each in found.changes if each.kind == "right-of-others"]
    assert sorted(map(repr, others)) == sorted(map(repr, own))
