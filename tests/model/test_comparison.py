"""Keystores that differ in one thing: it is told once, where it was made, and turned round the other way."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

import pytest

from keystore_audit.model.comparison import Direction, FailOn
from tests.model.comparing import (
    Member,
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

TALKER = rule(criterion("publish", "rt/chatter", "rt/rosout"), criterion("subscribe", "rt/clock"))
LISTENER = rule(criterion("subscribe", "rt/chatter"))
SOONER = datetime(2030, 1, 1, tzinfo=timezone.utc)
PAST = datetime(2025, 1, 1, tzinfo=timezone.utc)


def talker(*rules: str, **others: str) -> str:
    return permissions(grant("/talker", *rules, **others))


BASE = Store(
    members={
        "/talker": Member(permissions=talker(TALKER), serial=101),
        "/listener": Member(permissions=permissions(grant("/listener", LISTENER)), serial=102),
    }
)
EVERYBODY = ("/listener", "/talker")


def talks(*rules: str, **others: str) -> Store:
    """The talker's permissions are others."""
    return BASE.member("/talker", permissions=talker(*rules, **others))


def governed(*rules: str) -> Store:
    return replace(BASE, governance=governance(*rules))


def by_topic(**flags: str) -> Store:
    return governed(domain_rule(topics=topic_rule(**flags)))


class Case(NamedTuple):
    """A keystore beside BASE, and the changes as (layer, kind, direction, enclaves, operation)."""

    name: str
    new: Store
    expected: tuple[tuple[str, str, str, tuple[str, ...], str | None], ...]
    old: Store = BASE


def right(direction: str, operation: str, *paths: str) -> tuple[str, str, str, tuple[str, ...], str | None]:
    return "grants", "right", direction, paths or ("/talker",), operation


def trust(kind: str, direction: str, *paths: str) -> tuple[str, str, str, tuple[str, ...], str | None]:
    return "trust", kind, direction, paths, None


CASES = (
    Case(
        "a topic more to publish",
        talks(rule(criterion("publish", "rt/chatter", "rt/rosout", "rt/more"), criterion("subscribe", "rt/clock"))),
        (right("gained", "publish"),),
    ),
    Case(
        "a topic less to publish",
        talks(rule(criterion("publish", "rt/chatter"), criterion("subscribe", "rt/clock"))),
        (right("lost", "publish"),),
    ),
    Case(
        "another topic",
        talks(rule(criterion("publish", "rt/chatter", "rt/other"), criterion("subscribe", "rt/clock"))),
        (right("gained", "publish"), right("lost", "publish")),
    ),
    Case(
        "a topic more to subscribe to",
        talks(TALKER, rule(criterion("subscribe", "rt/chatter"))),
        (right("gained", "subscribe"),),
    ),
    Case("everything to subscribe to", talks(TALKER, rule(criterion("subscribe", "*"))), (right("gained", "subscribe"),)),
    Case("a deny rule before", talks(rule(criterion("publish", "rt/r*"), allow=False), TALKER), (right("lost", "publish"),)),
    Case("a default that allows", talks(TALKER, default="ALLOW"), tuple(right("gained", each) for each in ("publish", "relay", "subscribe"))),
    Case("relaying", talks(TALKER, rule(criterion("relay", "rt/chatter"))), (right("gained", "relay"), right("gained", "subscribe"))),
    Case(
        "another domain to publish in",
        talks(TALKER, rule(criterion("publish", "rt/chatter"), domains="<id>7</id>")),
        (right("gained", "publish"),),
    ),
    Case("a domain to join", talks(TALKER, rule(domains="<id>7</id>")), (right("gained", "join"),)),
    Case(
        "a partition more",
        talks(TALKER, rule(criterion("publish", "rt/inner", partitions=("p",)))),
        (right("gained", "publish"),),
    ),
    Case("unauthenticated participants", governed(domain_rule(allow_unauthenticated_participants="true")), (trust("protection", "gained", *EVERYBODY),)),
    Case("no join access control", governed(domain_rule(enable_join_access_control="false")), (trust("protection", "gained", *EVERYBODY),)),
    Case("RTPS in clear", governed(domain_rule(rtps_protection_kind="NONE")), (trust("protection", "gained", *EVERYBODY),)),
    Case("RTPS encrypted", governed(domain_rule(rtps_protection_kind="ENCRYPT")), (trust("protection", "lost", *EVERYBODY),)),
    Case("discovery signed", governed(domain_rule(discovery_protection_kind="SIGN")), (trust("protection", "gained", *EVERYBODY),)),
    Case("liveliness in clear", governed(domain_rule(liveliness_protection_kind="NONE")), (trust("protection", "gained", *EVERYBODY),)),
    Case("no write access control", by_topic(enable_write_access_control="false"), (trust("protection", "gained", *EVERYBODY),)),
    Case("no read access control", by_topic(enable_read_access_control="false"), (trust("protection", "gained", *EVERYBODY),)),
    Case("topics in discovery", by_topic(enable_discovery_protection="false"), (trust("protection", "gained", *EVERYBODY),)),
    Case("liveliness of topics", by_topic(enable_liveliness_protection="false"), (trust("protection", "gained", *EVERYBODY),)),
    Case("payload signed", by_topic(data_protection_kind="SIGN"), (trust("protection", "gained", *EVERYBODY),)),
    Case("origin authenticated", by_topic(metadata_protection_kind="ENCRYPT_WITH_ORIGIN_AUTHENTICATION"), (trust("protection", "lost", *EVERYBODY),)),
    Case("encrypted, or signed with its origin", by_topic(metadata_protection_kind="SIGN_WITH_ORIGIN_AUTHENTICATION"), (trust("protection", "mixed", *EVERYBODY),)),
    Case(
        "one topic in clear",
        governed(domain_rule(topics=topic_rule("rt/chatter", data_protection_kind="NONE") + topic_rule())),
        (trust("protection", "gained", *EVERYBODY),),
    ),
    Case(
        "one topic apart in every way",
        governed(domain_rule(topics=topic_rule("rt/chatter", data_protection_kind="NONE", enable_read_access_control="false") + topic_rule())),
        (trust("protection", "gained", *EVERYBODY),),
    ),
    Case("no topic covered but one", governed(domain_rule(topics=topic_rule("rt/chatter"))), (trust("protection", "lost", *EVERYBODY),)),
    Case("a domain more", governed(domain_rule("<id>0</id><id>7</id>")), (trust("protection", "gained", *EVERYBODY),)),
    Case("one enclave's governance", BASE.member("/talker", governance=governance(domain_rule(rtps_protection_kind="NONE"))), (trust("protection", "gained", "/talker"),)),
    Case("a grant that ends sooner", talks(TALKER, end="2030-01-01T00:00:00"), (trust("grant-validity", "changed", "/talker"),)),
    Case(
        "a grant out of date",
        talks(TALKER, end="2025-01-01T00:00:00"),
        (right("lost", "publish"), right("lost", "subscribe")),
    ),
    Case("an identity that ends sooner", BASE.member("/talker", end=SOONER), (trust("identity-validity", "changed", "/talker"),)),
    Case("an identity out of date", BASE.member("/talker", end=PAST), (trust("identity-validity", "changed", "/talker"),)),
    Case("an identity with another key", BASE.member("/talker", key="another"), (trust("identity-key", "changed", "/talker"),)),
    Case("an identity with another subject", BASE.member("/talker", subject="/other"), (trust("identity-subject", "changed", "/talker"),)),
    Case("an identity that is an authority", BASE.member("/talker", ca=True), (trust("identity-authority", "gained", "/talker"),)),
    Case("an identity of another authority", BASE.member("/talker", issuer=authority("somebody")), (trust("identity-issuer", "changed", "/talker"),)),
    Case(
        "a private key of another's",
        BASE.member("/talker", private_key="another"),
        (("access", "start", "lost", ("/talker",), None),),
    ),
    Case(
        "an enclave more",
        replace(BASE, members={**BASE.members, "/more": Member(permissions=permissions(grant("/more", LISTENER)), serial=103)}),
        (trust("enclave-added", "gained", "/more"),),
    ),
    Case("an enclave less", BASE.without("/listener"), (trust("enclave-removed", "lost", "/listener"),)),
    Case("an identity CA more", replace(BASE, identity=(authority("identityCA"), authority("more"))), (trust("authority", "gained", *EVERYBODY),)),
    Case("a permissions CA more", replace(BASE, permissions=(authority("permissionsCA"), authority("more"))), (trust("authority", "gained", *EVERYBODY),)),
    Case("another permissions CA", replace(BASE, permissions=(authority("another"),)), (trust("authority", "mixed", *EVERYBODY),)),
    Case("another identity CA", replace(BASE, identity=(authority("another"),)), (trust("authority", "mixed", *EVERYBODY),)),
    Case("an identity CA that ends sooner", replace(BASE, identity=(authority("identityCA", end=SOONER),)), (trust("authority-validity", "changed", *EVERYBODY),)),
    Case("permissions signed by somebody", BASE.member("/talker", signer=authority("somebody")), (trust("signer", "mixed", "/talker"),)),
    Case("governance signed by somebody", replace(BASE, governance_signer=authority("somebody")), (trust("signer", "mixed", *EVERYBODY),)),
    Case("permissions changed after the signature", BASE.member("/talker", tampered=True), (trust("signature", "lost", "/talker"),)),
    Case("an identity taken back", replace(BASE, revoked=(101,)), (trust("revocation", "lost", *EVERYBODY),), replace(BASE, revoked=())),
    Case("a revocation list", replace(BASE, revoked=()), (trust("revocation", "lost", *EVERYBODY),)),
    Case("a list out of date", replace(BASE, revoked=(), crl_end=PAST), (trust("revocation-validity", "changed", *EVERYBODY),), replace(BASE, revoked=())),
    Case(
        "a document beside the enclaves that names one",
        replace(BASE, strays={"more.p7s": talker(rule(criterion("publish", "rt/more")))}),
        (("access", "accepted", "gained", ("/talker",), "publish"),),
    ),
    Case(
        "a grant for one in the document of another",
        BASE.member("/listener", permissions=permissions(grant("/listener", LISTENER), grant("/talker", rule(criterion("publish", "rt/more"))))),
        (("access", "accepted", "gained", ("/talker",), "publish"),),
    ),
)  # fmt: skip


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


def test_an_unread_document_is_unknown_and_not_compared(tmp_path: Path) -> None:
    twice = BASE.members["/talker"].permissions.replace("<dds>", "<dds a='&#38;'>")
    found = compared(BASE, BASE.member("/talker", permissions=twice), tmp_path)
    assert {(each.side, each.enclave) for each in found.unknown} == {("new", "/talker")}
    assert [change for change in found.changes if "/talker" in change.enclaves] == []


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
        (BASE.member("/talker", key="another"), (False, True, False)),
        (BASE.member("/talker", end=SOONER), (False, True, False)),
        (replace(BASE, permissions=(authority("another"),)), (True, True, False)),
    ],
)
def test_what_fails(new: Store, failing: tuple[bool, bool, bool], tmp_path: Path) -> None:
    found = compared(BASE, new, tmp_path)
    assert tuple(bool(found.failing(each)) for each in (FailOn.GAINED, FailOn.ANY, FailOn.NONE)) == failing
