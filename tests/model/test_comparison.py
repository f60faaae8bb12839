"""Keystores that differ in one thing: it is told once, where it was made, and turned round the other way."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.model.comparison.change import Direction, FailOn, Layer
from keystore_audit.profiles import ALIASES
from keystore_audit.report.diff_text import consequence, sentence
from tests.amount import tried
from tests.model.comparing import (
    Store,
    authority,
    compared,
    criterion,
    domain_rule,
    governance,
    grant,
    permissions,
    rule,
    topic_rule,
)
from tests.model.single_changes import BASE, CASES, EVERYBODY, SOONER, TALKER, Case, by_topic, talker, talks


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
        governance=governance(domain_rule(topics=topic_rule("rt/a*") + topic_rule("*"))),
    ).member(
        "/talker",
        permissions=talker(
            rule(criterion("publish", "rt/chatter", "rt/rosout"), criterion("subscribe", "rt/clock")),
            rule(criterion("publish", "rt/x*")),
        ),
    )
    new = replace(
        BASE, governance="<?xml version='1.0'?>\n<!-- anew -->\n" + governance().replace("><", ">\n  <")
    ).member(
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


def test_everything_made_anew_is_one_change_of_authorities_and_others_of_keys(tmp_path: Path) -> None:
    """As when `ros2 security` is run again: no rights are gained but those of the new authority."""
    both = (authority("one"),)
    new = (authority("two"),)
    old_store = replace(BASE, identity=both, permissions=both)
    new_store = replace(BASE, identity=new, permissions=new).member("/talker", key="t2").member("/listener", key="l2")
    found = compared(old_store, new_store, tmp_path)
    assert [(change.kind, change.enclaves) for change in found.changes] == [
        ("authority", EVERYBODY),
        ("identity-key", EVERYBODY),
    ]


def test_a_dates_flip_is_told_once(tmp_path: Path) -> None:
    """The rights that a grant out of date took away come with what they mean: nothing starts."""
    found = compared(BASE, talks(TALKER, end="2025-01-01T00:00:00"), tmp_path)
    assert any(
        "no longer starts" in each.what and each.reasons for change in found.changes for each in change.consequences
    )


def test_consequences_of_protection(tmp_path: Path) -> None:
    found = compared(
        BASE,
        by_topic(data_protection_kind="NONE", metadata_protection_kind="NONE"),
        tmp_path,
    )
    (change,) = found.changes
    assert [(aspect.what, aspect.old, aspect.new) for aspect in change.aspects] == [
        ("metadata_protection_kind", "ENCRYPT", "NONE"),
        ("data_protection_kind", "ENCRYPT", "NONE"),
    ]
    outsiders = {each.what for each in change.consequences if not each.enclaves}
    assert "can read" in outsiders


@pytest.mark.parametrize(("whose", "words"), [(("/talker",), " for /talker"), (EVERYBODY, "")])
def test_whose_governance_covers_a_domain_no_longer(whose: tuple[str, ...], words: str, tmp_path: Path) -> None:
    """What becomes of enclaves with another governance has other causes."""
    new = BASE.member("/listener", signer=authority("a stranger"))
    for path in whose:
        new = new.member(path, governance=governance(domain_rule("<id>7</id>")))
    found = compared(BASE, new, tmp_path)
    gone = next(each for each in found.changes if each.kind == "protection" and each.direction is Direction.LOST)
    assert sentence(gone, found) == f"No longer covered by a domain rule{words}: every name in domain 0."
    told = {path for each in gone.consequences for path in each.enclaves}
    assert ("/listener" in told) is ("/listener" in whose)
    others = [each for each in found.changes if each.kind == "signer"]
    assert any("/listener" in each.enclaves for change in others for each in change.consequences) is bool(words)


@pytest.mark.parametrize("starts", [True, False])
def test_why_it_starts_now_is_why_it_did_not(starts: bool, tmp_path: Path) -> None:
    ended = talks(TALKER, end="2025-01-01T00:00:00")
    found = compared(ended, BASE, tmp_path) if starts else compared(BASE, ended, tmp_path)
    consequences = [consequence(each, found) for change in found.changes for each in change.consequences]
    said = "/talker starts now, and did not before: no grant" if starts else "/talker no longer starts: no grant"
    assert any(each.startswith(said) for each in consequences), consequences


def test_an_unread_document_is_unknown_and_not_compared(tmp_path: Path) -> None:
    twice = BASE.members["/talker"].permissions.replace("<dds>", "<dds a='&#38;'>")
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
    unread = BASE.members["/talker"].permissions.replace("<dds>", "<dds a='&#38;'>")
    found = compared(old, old.member("/talker", permissions=unread), tmp_path)
    assert {(each.side, each.enclave) for each in found.unknown} == ({("new", "/talker")} if taken else set())


def test_endpoints_are_met_alike_on_both_sides(tmp_path: Path) -> None:
    """A writer in the partition `*` is met in the default one, of which alone the deny rule of Cyclone DDS is."""
    both = "<id>0</id><id>5</id>"
    denied = rule(criterion("publish", "rt/chatter"), allow=False, domains=both)
    old, new = (
        replace(BASE, governance=governance(domain_rule(both))).member(
            "/talker", permissions=permissions(grant("/talker", denied, *more, default="ALLOW"))
        )
        for more in ((), (rule(criterion("publish", "rt/chatter"), allow=False),))
    )
    changes = compared(old, new, tmp_path, ("cyclonedds-11",)).changes
    assert [(change.kind, change.direction) for change in changes] == [("signed-again", Direction.INFO)]


def test_a_domain_leaves_out_others(tmp_path: Path) -> None:
    new = talks(TALKER, rule(criterion("publish", "rt/chatter"), domains="<id>7</id>"))
    assert compared(BASE, new, tmp_path / "0", domain=0).changes[0].direction is Direction.INFO
    (change,) = compared(BASE, new, tmp_path / "7", domain=7).changes
    assert change.names is not None
    assert [(name.topic, name.domains, name.several) for name in change.names.shown] == [
        ("rt/chatter", ((7, 7),), False)
    ]


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


def test_names_that_nothing_tells_apart_are_all_told(tmp_path: Path) -> None:
    """One class to both keystores, and yet two names, not one and others like it."""
    found = compared(BASE, talks(TALKER, rule(criterion("publish", "rt/one", "rt/two"))), tmp_path)
    (change,) = found.changes
    assert change.names is not None
    assert [(name.topic, name.several) for name in change.names.shown] == [("rt/one", False), ("rt/two", False)]
    assert (change.names.more, change.names.infinite) == (0, False)


def test_a_right_from_elsewhere_names_the_rule(tmp_path: Path) -> None:
    """The cause is in a document that is nobody's own: nothing else would say where."""
    new = replace(BASE, strays={"more.p7s": talker("\n", rule(criterion("publish", "rt/more")))})
    (change,) = compared(BASE, new, tmp_path).changes
    assert (change.old, change.new) == (None, Location(path="more.p7s", line=10))


def test_what_a_grant_and_peers_say_alike_follows_once(tmp_path: Path) -> None:
    """Another subject: what the enclave's grant no longer gives it, no peer accepts either."""
    (change,) = compared(BASE, BASE.member("/talker", subject="/other"), tmp_path).changes
    told = [(each.what, each.direction, each.enclaves) for each in change.consequences]
    assert len(set(told)) == len(told)
    assert ("may still, until 2033-12-29T00:00:00Z, publish", Direction.LOST, ("/talker",)) in told


def test_own_endpoints_by_a_right_elsewhere_follow_from_it(tmp_path: Path) -> None:
    """Fast DDS applies the rule of domain 9 in domain 0 too, where no honest peer takes what is sent."""
    new = talks(TALKER, rule(criterion("publish", "rt/more"), domains="<id>9</id>"))
    (change,) = compared(BASE, new, tmp_path, ("fastdds", "cyclonedds")).changes
    (effect,) = change.consequences
    assert (change.kind, change.names and change.names.domains) == ("right", ((9, 9),))
    assert (effect.what, effect.direction, effect.profiles) == (
        "can create a writer of",
        Direction.GAINED,
        ALIASES["fastdds"],
    )
    assert effect.names is not None
    assert [(name.topic, name.domains) for name in effect.names.shown] == [("rt/more", ((0, 0),))]


def test_a_denial_of_own_endpoints_is_told_with_its_grant(tmp_path: Path) -> None:
    """Nothing else changed, and the documents do not mean the same."""
    denied = talks(rule(criterion("publish", "rt/chatter"), allow=False, domains="<id>9</id>"), TALKER)
    (change,) = compared(denied, BASE, tmp_path / "all").changes
    assert change.what == "can create a writer of"
    assert all(name.startswith("fastdds") for name in change.profiles)
    assert change.new == Location(path="enclaves/talker/permissions.p7s", line=9)
    assert compared(denied, BASE, tmp_path / "one", ("cyclonedds",)).changes[0].kind == "signed-again"
