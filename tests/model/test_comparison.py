"""Keystores that differ in one thing: it is told once, where it was made, and turned round the other way."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.model.comparison.change import Direction, FailOn, Layer
from tests.amount import tried
from tests.keystore.documents import criterion, domain_rule, governance, rule, topic_rule
from tests.model.comparing import Store, authority, compared
from tests.model.single_changes import BASE, CASES, EVERYBODY, SOONER, TALKER, Case, talker, talks


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_single_change_is_told_once_where_it_was_made(case: Case, tmp_path: Path) -> None:
    found = compared(case.old, case.new, tmp_path)
    told = [
        (change.layer.value, change.kind, change.direction.value, change.enclaves, change.operation)
        for change in found.changes
        if change.direction is not Direction.INFO
    ]
    assert sorted(told) == sorted(case.expected)
    assert not found.unknown


@pytest.mark.parametrize("seed", range(tried(20)))
def test_two_changes_at_once_are_turned_round_too(seed: int, tmp_path: Path) -> None:
    """From one changed keystore to another that is changed elsewhere; `compared` looks at both ways."""
    one, other = random.Random(seed).sample(CASES, 2)
    found = compared(one.new, other.new, tmp_path)
    layers = {change.layer for change in found.changes}
    assert layers >= {Layer(expected[0]) for expected in other.expected} - {Layer.GRANTS, Layer.ACCESS}


def test_equal_meaning_is_silent_but_for_the_signatures(tmp_path: Path) -> None:
    """Rules whose order does not matter, one rule written as two, other layout and comments, signed anew."""
    old = replace(
        BASE,
        governance=governance(domain_rule(topic_rule("rt/a*") + topic_rule("*"))),
    ).member(
        "/talker",
        permissions=talker(
            rule(criterion("publish", "rt/chatter", "rt/rosout"), criterion("subscribe", "rt/clock")),
            rule(criterion("publish", "rt/x*")),
        ),
    )
    anew = governance().replace("<dds>", "<!-- anew -->\n<dds>").replace("><", ">\n  <")
    new = replace(BASE, governance=anew).member(
        "/talker",
        permissions=talker(
            rule(criterion("subscribe", "rt/clock")),
            rule(criterion("publish", "rt/xb", "rt/rosout", "rt/x*")),
            rule(criterion("publish", "rt/chatter", "rt/chatter")),
            rule(criterion("publish", "rt/never"), allow=False),
        ).replace("><", ">\n\t<"),
    )
    found = compared(old, new, tmp_path)
    assert [(change.kind, change.direction) for change in found.changes] == [("signed-again", Direction.INFO)]
    assert found.changes[0].enclaves == EVERYBODY
    assert not any(found.failing(fail_on) for fail_on in FailOn)


def test_brackets_mean_less_to_one_implementation(tmp_path: Path) -> None:
    """Cyclone DDS takes a bracket after the first character of a set for one of it: only there a right is lost."""
    old, new = (talks(TALKER, rule(criterion("publish", *topics))) for topics in (("rt/x[ab]",), ("rt/xa", "rt/xb")))
    (change,) = compared(old, new, tmp_path).changes
    assert change.profiles == ("cyclonedds-0.10", "cyclonedds-11")
    assert change.direction is Direction.LOST
    assert change.names is not None
    assert [name.topic for name in change.names.shown] == ["rt/x]"]


def test_a_keystore_and_itself(tmp_path: Path) -> None:
    assert compared(BASE, BASE, tmp_path).changes == ()


def test_an_unread_document_is_unknown_and_not_compared(tmp_path: Path) -> None:
    twice = BASE.members["/talker"].permissions.replace("<dds>", "<!DOCTYPE dds><dds>")
    found = compared(BASE, BASE.member("/talker", permissions=twice), tmp_path)
    assert {(each.side, each.enclave) for each in found.unknown} == {("new", "/talker")}
    assert [change for change in found.changes if "/talker" in change.enclaves] == []


@pytest.mark.parametrize("taken", [True, False])
def test_an_unread_document_that_its_own_enclave_refuses_is_unknown_where_peers_take_it(
    taken: bool, tmp_path: Path
) -> None:
    another = authority("another")
    names = ("talker",) if taken else [path.strip("/") for path in BASE.members]
    old = replace(BASE, files={f"enclaves/{name}/permissions_ca.cert.pem": another.pem for name in names})
    unread = BASE.members["/talker"].permissions.replace("<dds>", "<!DOCTYPE dds><dds>")
    found = compared(old, old.member("/talker", permissions=unread), tmp_path)
    assert {(each.side, each.enclave) for each in found.unknown} == ({("new", "/talker")} if taken else set())


@pytest.mark.parametrize(
    ("new", "failing"),
    [
        (talks(rule(criterion("publish", "rt/chatter"), criterion("subscribe", "rt/clock"))), (False, True, False)),
        (talks(TALKER, rule(criterion("publish", "rt/more"))), (True, True, False)),
        (BASE.member("/talker", key="another"), (True, True, False)),
        (BASE.member("/talker", end=SOONER), (False, True, False)),
        (replace(BASE, permissions=(authority("another"),)), (True, True, False)),
    ],
)
def test_what_fails(new: Store, failing: tuple[bool, bool, bool], tmp_path: Path) -> None:
    found = compared(BASE, new, tmp_path)
    assert tuple(bool(found.failing(each)) for each in (FailOn.GAINED, FailOn.ANY, FailOn.NONE)) == failing
