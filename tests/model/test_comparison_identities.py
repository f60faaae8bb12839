"""Identities beside the enclaves' own: who comes by them is a gain, whichever file they are in."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta
from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.keystore import unmanaged
from keystore_audit.model.comparison.change import Comparison, FailOn
from keystore_audit.profiles import resolve
from tests.keystore.builder import Signed, certificate, key
from tests.keystore.documents import criterion, domain_rule, governance, grant, permissions, rule
from tests.model.comparing import AT, Store, authority, compared
from tests.model.single_changes import BASE

RIGHTS = permissions(grant("/admin", rule(criterion("publish", "rt/*"))))
GRANTED = replace(BASE, strays={"old.p7s": RIGHTS})
OPEN = replace(BASE, governance=governance(domain_rule(join="false")))
IDENTITY = authority("identityCA")


def identity(subject: str = "/admin", name: str = "spare", issuer: Signed = IDENTITY, **more: object) -> Signed:
    return certificate(subject, issuer, key=key(name), **more)  # type: ignore[arg-type]


ADMIN = identity()
KEY, CERTIFICATE = {"backup/key.pem": ADMIN.key_pem}, {"backup/cert.pem": ADMIN.pem}
EXPIRED = {"backup/cert.pem": identity(end=AT - timedelta(days=1)).pem}
Files = Mapping[str, bytes]


def changed(tmp_path: Path, old: Files, new: Files, store: Store = GRANTED) -> Comparison:
    """What differs with these files in each."""
    return compared(replace(store, files=old), replace(store, files=new), tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "gained"),
    [
        (KEY, {**KEY, **CERTIFICATE}, True),
        ({**KEY, **EXPIRED}, {**KEY, **CERTIFICATE}, True),
        ({**KEY, **CERTIFICATE}, {**KEY, **CERTIFICATE}, False),
        ({**KEY, **CERTIFICATE}, {**KEY, "notes": ADMIN.pem}, False),
        ({**KEY, **CERTIFICATE}, {**KEY, "backup/cert.pem": identity(serial=9).pem}, False),
        (KEY, {**KEY, **EXPIRED}, False),
        (KEY, {**KEY, "backup/cert.pem": identity(issuer=authority("other")).pem}, False),
        (KEY, {**KEY, "backup/cert.pem": identity("/nobody").pem}, False),
    ],
)
def test_whom_peers_let_in_by_the_keys_that_lie_about(old: Files, new: Files, gained: bool, tmp_path: Path) -> None:
    found = changed(tmp_path, old, new)
    told = [(change.kind, change.direction.value, change.enclaves) for change in found.changes]
    assert told == ([("identity-at-large", "gained", ())] if gained else [])
    assert bool(found.failing(FailOn.GAINED)) is gained
    if gained:
        assert found.changes[0].profiles == tuple(profile.name for profile in resolve(()))
        assert found.changes[0].new is not None
        assert found.changes[0].new.path == "backup/cert.pem"


def test_an_identity_of_an_enclave_and_one_that_needs_no_grant_count(tmp_path: Path) -> None:
    again = {"backup/cert.pem": identity("/talker").pem}
    assert [each.kind for each in changed(tmp_path / "a", KEY, {**KEY, **again}).changes] == ["identity-at-large"]
    no_right = {"backup/cert.pem": identity("/nobody").pem}
    assert not changed(tmp_path / "b", KEY, {**KEY, **no_right}).changes
    assert [each.kind for each in changed(tmp_path / "c", KEY, {**KEY, **no_right}, OPEN).changes] == [
        "identity-at-large"
    ]


@pytest.mark.parametrize("one_ca", [True, False])
def test_an_identity_that_signs_itself_its_permissions_needs_no_grant(one_ca: bool, tmp_path: Path) -> None:
    """Where one authority has both roles, and implementations do not ask whether it signed itself."""
    store = replace(BASE, permissions=(IDENTITY,)) if one_ca else BASE
    no_right = {"backup/cert.pem": identity("/nobody").pem}
    found = changed(tmp_path, KEY, {**KEY, **no_right}, store).changes
    unpinned = tuple(profile.name for profile in resolve(()) if not profile.trust.pins_signer)
    assert [(each.kind, each.profiles) for each in found] == [("identity-at-large", unpinned)] * one_ca


def test_certificates_that_nobody_parsed_are_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unmanaged, "MAX_BYTES", 10)
    found = changed(tmp_path, KEY, {**KEY, **CERTIFICATE})
    assert [(each.side, each.location.path) for each in found.unknown] == [("new", "backup/cert.pem")]


@pytest.mark.parametrize(
    ("gap", "open_between"),
    [
        (timedelta(days=9), True),
        (timedelta(seconds=2), True),
        (timedelta(seconds=1), False),
        (-timedelta(days=5), False),
    ],
)
@pytest.mark.parametrize(("name", "files"), [("spare", KEY), ("/talker", {})])
def test_what_lies_between_two_certificates_is_no_time_of_theirs(
    gap: timedelta, open_between: bool, name: str, files: Files, tmp_path: Path
) -> None:
    """One that covers both lets its key in between them as well, where they leave anything there."""
    first = AT + timedelta(days=9)
    early, late = identity("/admin", name, end=first), identity("/admin", name, start=first + gap)
    apart = {**files, "public/x_ca.cert.pem": early.pem, "public/y_ca.cert.pem": late.pem}
    whole = {**files, "public/x_ca.cert.pem": identity("/admin", name).pem}
    there, back = changed(tmp_path / "there", apart, whole), changed(tmp_path / "back", whole, apart)
    told = [[change.direction.value for change in each.changes] for each in (there, back)]
    assert told == ([["gained"], ["lost"]] if open_between else [[], []])


def test_a_further_certificate_that_peers_come_to_take(tmp_path: Path) -> None:
    """It had the same name before, and was over, or of another authority that is called the same."""
    over = identity("/admin", "/talker", end=AT - timedelta(days=1))
    namesake = certificate("/admin", certificate("identityCA", ca=True, key=key("another")), key=key("/talker"))
    good = {"public/x_ca.cert.pem": identity("/admin", "/talker").pem}
    for number, before in enumerate((over, namesake)):
        found = changed(tmp_path / str(number), {"public/x_ca.cert.pem": before.pem}, good)
        assert [(each.kind, each.direction.value) for each in found.changes] == [("identity-certified-again", "gained")]
        (aspect,) = found.changes[0].aspects
        assert aspect.old == "CN=/admin, issued by CN=identityCA, let in by nobody"
