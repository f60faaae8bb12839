"""`able`: what has to be true now and until a date, in the domain that is used."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest

from keystore_audit.engine.native import NativeEngine
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import read_keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.claim import Attacker, ClaimKind
from keystore_audit.model.claims import Claim, Globs
from keystore_audit.model.interpret import interpret
from keystore_audit.model.inventory import documents_of
from keystore_audit.model.profiles import resolve
from keystore_audit.model.usability import Usabilities
from keystore_audit.properties import Status
from tests.model.comparing import AT, Member, Store, criterion, domain_rule, governance, grant, permissions, rule

ENDS = datetime(2027, 3, 1, tzinfo=timezone.utc)
BEFORE, AFTER = (datetime(year, 2, 1, tzinfo=timezone.utc) for year in (2027, 2028))

TALKER = Member(permissions=permissions(grant("/e", rule(criterion("publish", "rt/a")))))
LISTENER = Member(permissions=permissions(grant("/f", rule(criterion("subscribe", "rt/a")))))
STORE = Store(members={"/e": TALKER, "/f": LISTENER}, governance=governance(domain_rule("<id>0</id><id>9</id>")))


def holds(
    store: Store,
    root: Path,
    *,
    until: datetime | None = None,
    domain: int | None = None,
    profiles: tuple[str, ...] = ("fastdds", "cyclonedds"),
) -> bool:
    """Whether /e can reach /f, for every profile."""
    keystore = read_keystore(store.write(root))
    accesses = AccessViews(documents_of(keystore), AT, None)
    claim = Claim(
        id="able",
        statement="",
        kind=ClaimKind.ABLE,
        attacker=Attacker.HONEST,
        source=Globs(enclaves=("/e",)),
        target=Globs(enclaves=("/f",)),
        until=until,
        location=Location(path="s.toml", beside=True),
        place="s.toml:1:1",
    )
    found = interpret(keystore, resolve(profiles), AT, accesses, Usabilities(domain, accesses), domain, [claim])
    answers = NativeEngine(found.systems).answers
    [answer] = {each["able"].status for each in answers}
    return answer is Status.HOLDS


@pytest.mark.parametrize(
    "ending",
    [
        STORE.member("/f", end=ENDS),
        Store(members=STORE.members, governance=STORE.governance, revoked=(), crl_end=ENDS),
        STORE.member("/f", permissions=LISTENER.permissions.replace("2034-01-01", "2027-03-01")),
    ],
    ids=["certificate", "revocation list", "grant"],
)
def test_it_lasts_until_something_ends(ending: Store, tmp_path: Path) -> None:
    assert holds(ending, tmp_path / "now")
    assert holds(ending, tmp_path / "before", until=BEFORE)
    assert not holds(ending, tmp_path / "after", until=AFTER)
    assert holds(STORE, tmp_path / "nothing", until=AFTER)


@pytest.mark.parametrize(("profile", "lasts"), [("spec", True), ("cyclonedds", False)])
def test_an_end_that_is_not_included_any_more(profile: str, lasts: bool, tmp_path: Path) -> None:
    """Cyclone DDS counts no grant at its not_after itself."""
    ending = STORE.member("/f", permissions=LISTENER.permissions.replace("2034-01-01", "2027-03-01"))
    assert holds(ending, tmp_path / "k", until=ENDS, profiles=(profile,)) is lasts


def test_it_is_asked_in_the_domain_that_is_used(tmp_path: Path) -> None:
    """Both start in 9 as well, by a rule about another topic, and nothing of one reaches the other there."""
    store = STORE
    for path, member in STORE.members.items():
        own = rule(criterion("publish", f"rt{path}"), domains="<id>9</id>")
        store = store.member(path, permissions=member.permissions.replace("<default>", own + "<default>"))
    assert holds(store, tmp_path / "any")
    assert holds(store, tmp_path / "zero", domain=0)
    assert not holds(store, tmp_path / "nine", domain=9)
