"""`diff` passes only where nothing is worse than before: each kind of thing made worse, and made good again."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.model.comparison.change import Direction, FailOn
from tests.keystore.builder import signed_document
from tests.keystore.documents import criterion, domain_rule, governance, rule
from tests.model.comparing import Member, Store, authority, compared
from tests.model.single_changes import BASE, LISTENER, SOONER, TALKER, by_topic, talker, talks
from tests.model.test_comparison_identities import CERTIFICATE, KEY

OPEN = governance(domain_rule(rtps="NONE"))
SIGNER = authority("permissionsCA")
TWO = (authority("permissionsCA"), authority("another"))
MORE = talks(TALKER, rule(criterion("publish", "rt/more")))
RELAYS = rule(criterion("relay", "rt/x"))
REVOKED = replace(BASE, revoked=(999,))

PAIRS = {
    "right": (BASE, MORE),
    "protection kind": (BASE, by_topic(data="SIGN")),
    "anchor": (BASE, replace(BASE, permissions=TWO)),
    "signer": (BASE.member("/talker", tampered=True), BASE),
    "CRL entry": (replace(BASE, revoked=(998, 999)), REVOKED),
    "CRL": (REVOKED, BASE),
    "identity": (BASE, BASE.member("/talker", ca=True)),
    "identity added": (BASE.without("/talker"), BASE),
    "validity of an identity": (BASE.member("/talker", end=SOONER), BASE),
    "validity of a grant": (BASE.member("/talker", permissions=talker(TALKER, end="2030-01-01T00:00:00")), BASE),
    "validity of an authority": (replace(BASE, identity=(authority("identityCA", end=SOONER),)), BASE),
    "unmanaged certificate": (BASE, replace(BASE, files={**KEY, **CERTIFICATE})),
    "unmanaged certificate without its key": (BASE, replace(BASE, files=CERTIFICATE)),
    "unmanaged permissions": (
        BASE,
        replace(BASE, strays={"more.p7s": talker(TALKER, RELAYS)}),
    ),
    "unmanaged governance": (BASE, replace(BASE, files={"old.p7s": signed_document(OPEN.encode(), SIGNER)})),
}


@pytest.mark.parametrize("kind", PAIRS)
def test_what_is_worse_fails_and_what_is_better_passes(kind: str, tmp_path: Path) -> None:
    better, worse = PAIRS[kind]
    found = compared(better, worse, tmp_path / "worse")
    assert not found.unknown
    assert found.failing(FailOn.GAINED)
    back = compared(worse, better, tmp_path / "better")
    assert back.changes
    assert not back.failing(FailOn.GAINED)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (BASE, BASE.member("/talker", key="another")),
        (BASE, BASE.member("/talker", subject="/other")),
        (BASE, BASE.member("/talker", signer=authority("nobody"))),
        (BASE, replace(BASE, permissions=(authority("another"),))),
        (replace(BASE, permissions=TWO), replace(BASE, permissions=TWO[::-1])),
    ],
)
def test_what_is_another_and_neither_more_nor_less_fails_both_ways(old: Store, new: Store, tmp_path: Path) -> None:
    """Nobody reviewed it."""
    assert compared(old, new, tmp_path / "one").failing(FailOn.GAINED)
    assert compared(new, old, tmp_path / "other").failing(FailOn.GAINED)


def test_a_right_is_gone_only_where_no_document_of_before_counts(tmp_path: Path) -> None:
    """The same authority signed both; or another one the new, and the old one is in no CA file any more."""
    without = talks(rule(criterion("publish", "rt/chatter"), criterion("subscribe", "rt/clock")))
    for number, (new, until) in enumerate(
        (
            (without, "2033-12-29T00:00:00Z"),
            (replace(without, permissions=(authority("another"),)), None),
            (replace(without, permissions=TWO), "2033-12-29T00:00:00Z"),
        )
    ):
        found = compared(BASE, new, tmp_path / str(number), ("cyclonedds-11",))
        (lost,) = [each for each in found.changes if each.kind == "right"]
        assert (lost.direction, lost.until) == (Direction.LOST, until)
        assert lost.what == ("may no longer publish" if until is None else f"may still, until {until}, publish")


def test_a_grant_that_ends_ends_what_is_still_effective(tmp_path: Path) -> None:
    end = datetime(2027, 3, 1, tzinfo=timezone.utc)
    short = talks(TALKER, end=f"{end:%Y-%m-%dT%H:%M:%S}")
    found = compared(short, talks(LISTENER, end=f"{end:%Y-%m-%dT%H:%M:%S}"), tmp_path, ("spec",))
    lost = [each for each in found.changes if each.direction is Direction.LOST]
    assert {each.until for each in lost} == {"2027-03-01T00:00:00Z"}


@pytest.mark.parametrize(("revoked", "until"), [(None, True), ((101,), False)])
def test_an_enclave_that_was_removed_may_go_on_unless_it_is_revoked(
    revoked: tuple[int, ...] | None, until: bool, tmp_path: Path
) -> None:
    third = Member(permissions=talker(TALKER).replace("/talker", "/third"), serial=103)
    old = replace(BASE, members={**BASE.members, "/third": third}).without("/talker")
    new = old.without("/third")
    new = replace(new, revoked=(103,) if revoked else None)
    found = compared(old, new, tmp_path, ("fastdds-2.9",))
    (gone,) = [each for each in found.changes if each.kind == "enclave-removed"]
    assert bool(gone.until) is until
    assert any(each.what.startswith("may still" if until else "may no longer") for each in gone.consequences)
