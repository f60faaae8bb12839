"""Identities beside the enclaves' own: who comes by them is a gain, whichever file they are in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import pytest

from keystore_audit.keystore import stray_identity
from keystore_audit.model.comparison import Comparison, FailOn
from keystore_audit.model.profiles import resolve
from tests.keystore.builder import Signed, certificate
from tests.model.comparing import (
    AT,
    Store,
    authority,
    compared,
    criterion,
    domain_rule,
    governance,
    grant,
    key,
    permissions,
    rule,
)
from tests.model.single_changes import BASE

RIGHTS = permissions(grant("/admin", rule(criterion("publish", "rt/*"))))
GRANTED = replace(BASE, strays={"old.p7s": RIGHTS})
OPEN = replace(BASE, governance=governance(domain_rule(enable_join_access_control="false")))
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


def test_certificates_that_nobody_parsed_are_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stray_identity, "MAX_BYTES", 10)
    found = changed(tmp_path, KEY, {**KEY, **CERTIFICATE})
    assert [(each.side, each.location.path) for each in found.unknown] == [("new", "backup/cert.pem")]


TALKER = identity("/listener", "/talker")
ELSEWHERE = identity("/listener", "/talker", authority("other"))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ({}, {"public/x_ca.cert.pem": TALKER.pem}, "gained"),
        ({"public/x_ca.cert.pem": TALKER.pem}, {"public/y_ca.cert.pem": TALKER.pem}, None),
        ({"public/x_ca.cert.pem": TALKER.pem}, {"public/x_ca.cert.pem": ELSEWHERE.pem}, "mixed"),
        ({}, {"public/x_ca.cert.pem": ADMIN.pem}, None),
    ],
)
def test_the_key_of_an_enclave_certified_again(old: Files, new: Files, expected: str | None, tmp_path: Path) -> None:
    found = changed(tmp_path, old, new, BASE)
    told = [(change.kind, change.direction.value, change.enclaves) for change in found.changes]
    assert told == ([("identity-certified-again", expected, ("/talker",))] if expected else [])
    assert bool(found.failing(FailOn.GAINED)) is (expected is not None)
    if expected == "gained":
        (aspect,) = found.changes[0].aspects
        assert (aspect.old, aspect.new) == (None, "CN=/listener, issued by CN=identityCA")
