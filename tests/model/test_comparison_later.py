"""Grants that are signed today and begin later: they are no new signature with the same meaning."""

from __future__ import annotations

import random
from datetime import datetime, timezone
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.comparison.change import Comparison, FailOn
from keystore_audit.model.comparison.compare import compare
from keystore_audit.profiles import resolve
from tests.amount import tried
from tests.keystore.documents import criterion, grant, permissions, rule
from tests.model.comparing import AT, Store, compared
from tests.model.single_changes import BASE, LISTENER

NOW = {"end": "2029-12-31T00:00:00"}
NEXT = {"start": "2030-01-01T00:00:00"}
ONE, ALL = rule(criterion("publish", "rt/chatter")), rule(criterion("publish", "*"))


def granted(*grants: str) -> Store:
    return BASE.member("/talker", permissions=permissions(*grants))


def told(found: Comparison) -> list[tuple[str, str]]:
    return [(change.kind, change.direction.value) for change in found.changes if "/talker" in change.enclaves]


ALONE = granted(grant("/talker", ONE, **NOW))
RENEWED = granted(grant("/talker", ONE, **NOW), grant("/talker", ONE, **NEXT))
WIDER = granted(grant("/talker", ONE, **NOW), grant("/talker", ALL, **NEXT))

SEVENTH = rule(domains="<id>7</id>")
JOINS = granted(grant("/talker", ONE, **NOW), grant("/talker", SEVENTH, **NEXT))
JOINS_TOO = granted(grant("/talker", ONE, **NOW), grant("/talker", ONE, SEVENTH, **NEXT))
"""It lets the talker join a domain, and do nothing there."""

ELSEWHERE = ALONE.member(
    "/listener", permissions=permissions(grant("/listener", LISTENER), grant("/talker", SEVENTH, **NEXT))
)

BEHIND = granted(grant("/talker", ONE, **NOW), grant("/talker", ALL))
"""Fast DDS passes over the first grant once it has ended."""


@pytest.mark.parametrize(
    ("old", "new", "direction"),
    [
        (ALONE, WIDER, "gained"),
        (WIDER, ALONE, "lost"),
        (RENEWED, WIDER, "gained"),
        (ALONE, RENEWED, "changed"),
        (ALONE, BEHIND, "gained"),
        (BEHIND, ALONE, "lost"),
        (ALONE, JOINS, "gained"),
        (RENEWED, JOINS_TOO, "gained"),
        (JOINS, ALONE, "lost"),
        (ALONE, ELSEWHERE, "gained"),
        (ALONE, replace(ALONE, strays={"old.p7s": permissions(grant("/talker", ALL, **NEXT))}), "gained"),
    ],
)
def test_what_begins_later_is_told_now(old: Store, new: Store, direction: str, tmp_path: Path) -> None:
    found = compared(old, new, tmp_path)
    assert ("later-rights", direction) in told(found)
    assert "signed-again" not in [kind for kind, _direction in told(found)]
    assert bool(found.failing(FailOn.GAINED)) is (direction != "lost")


@pytest.mark.parametrize("seed", range(tried(30)))
def test_a_right_that_comes_one_day_is_told_today(seed: int, tmp_path: Path) -> None:
    """Whatever a comparison at a later instant finds gained is a change now; it fails if there was never such a right.

    `ever`: the old grants as one that is always in force.
    """
    chance = random.Random(seed)
    years = ("2024", "2027", "2028", "2029", "2030")

    def some() -> tuple[Store, Store]:
        grants, rules = [], []
        for _grant in range(chance.randint(1, 3)):
            first, last = sorted(chance.sample(years, 2))
            topics = chance.sample(("rt/a", "rt/b", "rt/c*", "*"), chance.randint(1, 2))
            rules.append(rule(criterion(chance.choice(("publish", "subscribe")), *topics)))
            grants.append(grant("/talker", rules[-1], start=f"{first}-01-01T00:00:00", end=f"{last}-01-01T00:00:00"))
        return granted(*grants), granted(grant("/talker", *rules))

    (one, always), (other, _always) = some(), some()
    stores = {"old": one, "ever": always, "new": other}
    old, ever, new = (read_keystore(store.write(tmp_path / name)) for name, store in stores.items())
    profiles = resolve(("spec",))
    now = compare(old, new, profiles, AT)
    for year in range(2027, 2030):
        later = datetime(year, 6, 1, tzinfo=timezone.utc)
        assert not gained(compare(old, new, profiles, later)) or now.failing(FailOn.ANY), year
        assert not gained(compare(ever, new, profiles, later)) or now.failing(FailOn.GAINED), year


def gained(found: Comparison) -> bool:
    return any(change.kind == "right" and change.direction.gains for change in found.changes)
