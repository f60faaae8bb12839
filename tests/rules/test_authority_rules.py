"""Who is trusted: one change to a CA file, or to what is declared, makes KA223 speak."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from keystore_audit.findings import Severity
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.trust.chain import Authorities, trusted
from tests.rules.evidence import (
    IDENTITY_CA,
    PERMISSIONS_CA,
    Change,
    both,
    certificates,
    enclave,
    findings,
    first,
    healthy,
    judged,
    keystore,
    pem,
    talker,
)

PUBLIC = "public/permissions_ca.cert.pem"
OWN = "enclaves/talker/permissions_ca.cert.pem"
FOREIGN = pem("theirCA", issuer="theirCA")
RENEWED = pem("permissionsCA", issuer="permissionsCA", serial=77)
OURS, THEIRS = first("x", PERMISSIONS_CA), first("x", FOREIGN)
IDENTITY = frozenset({first("x", IDENTITY_CA).key})


def published(store: Keystore, *pems: bytes, name: str = PUBLIC) -> Keystore:
    """With this file in public/."""
    file = certificates(name, *pems)
    layout = replace(store.layout, authorities=(file.file,))
    return replace(store, layout=layout, authorities=(file,))


def unexpected(store: Keystore, *declared: str) -> list[Severity]:
    authorities = Authorities(identity=IDENTITY, permissions=frozenset(declared)) if declared else Authorities()
    return [each.severity for each in findings("KA223", judged(store, authorities=authorities))]


HIGH, MEDIUM = [Severity.HIGH], [Severity.MEDIUM]

UNDECLARED = {
    "all alike": (both(permissions_ca=certificates(PUBLIC, PERMISSIONS_CA)), []),
    "renewed with its key for one enclave": (talker(permissions_ca=certificates(OWN, RENEWED)), []),
    "both forms of one authority": (both(permissions_ca=certificates(PUBLIC, PERMISSIONS_CA, RENEWED)), []),
    "appended for one": (talker(permissions_ca=certificates(OWN, PERMISSIONS_CA, FOREIGN)), HIGH),
    "exchanged for one": (talker(permissions_ca=certificates(OWN, FOREIGN)), HIGH),
    "appended for all": (both(permissions_ca=certificates(PUBLIC, PERMISSIONS_CA, FOREIGN)), HIGH),
    "put before": (both(permissions_ca=certificates(PUBLIC, FOREIGN, PERMISSIONS_CA)), HIGH),
}


@pytest.mark.parametrize("name", UNDECLARED)
@pytest.mark.parametrize("public", [False, True])
def test_undeclared(name: str, public: bool) -> None:
    """With the file of public/ what is there is taken as found, without it what all have alike."""
    change, expected = UNDECLARED[name]
    store = change(healthy())
    assert unexpected(published(store, PERMISSIONS_CA) if public else store) == expected


def test_a_second_authority_in_public_is_high_though_no_enclave_reads_it_yet() -> None:
    store = both(permissions_ca=certificates("enclaves/p.pem", PERMISSIONS_CA))(healthy())
    assert unexpected(published(store, PERMISSIONS_CA)) == []
    assert unexpected(published(store, PERMISSIONS_CA, FOREIGN)) == HIGH
    assert unexpected(published(store, FOREIGN)) == HIGH, "and so is one that enclaves do not have"


@pytest.mark.parametrize(
    ("change", "declared", "expected"),
    [
        (both(), (OURS.key,), []),
        (both(), (OURS.sha256,), []),
        (both(), (THEIRS.key,), HIGH),
        (talker(permissions_ca=certificates(OWN, RENEWED)), (OURS.key,), []),
        (talker(permissions_ca=certificates(OWN, RENEWED)), (OURS.sha256,), HIGH),
        (talker(permissions_ca=certificates(OWN, FOREIGN)), (OURS.key,), HIGH),
        (talker(permissions_ca=certificates(OWN, FOREIGN)), (OURS.key, THEIRS.key), MEDIUM),
        (both(permissions_ca=certificates(PUBLIC, PERMISSIONS_CA, FOREIGN)), (OURS.key,), HIGH),
        (both(permissions_ca=certificates(PUBLIC, PERMISSIONS_CA, FOREIGN)), (OURS.key, THEIRS.key), []),
        (both(permissions_ca=certificates(PUBLIC, FOREIGN)), (OURS.key,), HIGH),
    ],
)
def test_declared(change: Change, declared: tuple[str, ...], expected: list[Severity]) -> None:
    assert unexpected(change(healthy()), *declared) == expected


def test_the_roles_are_apart() -> None:
    """An identity CA that is declared for identities signs no permissions."""
    swapped = keystore(*(enclave(path, permissions_ca=certificates(PUBLIC, IDENTITY_CA)) for path in ("/a", "/b")))
    assert unexpected(swapped, OURS.key) == HIGH
    identity, _permissions = trusted(swapped, Authorities(identity=IDENTITY))
    assert (identity.role, identity.trusts(OURS), identity.found_in) == (Role.IDENTITY_CA, False, "")
