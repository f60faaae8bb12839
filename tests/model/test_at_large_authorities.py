"""A certificate of the identity CA and its key make a participant, whatever authority has the same key."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from keystore_audit.circumstances import Circumstances
from keystore_audit.flow import find_blast_radius
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.profiles import resolve
from keystore_audit.properties import Status
from tests.keystore.builder import Signed, certificate, key
from tests.model.comparing import AT, Store, authority
from tests.model.test_at_large import IDENTITY, LYING_ABOUT, STORE, flows, identity, written

PERMISSIONS = authority("permissionsCA")
LONE = certificate("/admin", key=key("/talker"))
FORGED = certificate("/admin", certificate("/admin"), key=key("/talker"))
STRANGER = certificate("/admin", certificate("other"), key=key("/talker"))
SAME_KEY = key("admin")
OF_PERMISSIONS_CA = identity("/admin", "permissionsCA")


@pytest.mark.parametrize(
    "store",
    [
        STORE,
        replace(STORE, permissions=(PERMISSIONS, certificate("oldCA", ca=True, key=SAME_KEY))),
        replace(STORE, identity=(IDENTITY, certificate("oldCA", ca=True, key=SAME_KEY))),
        replace(STORE, identity=(IDENTITY, certificate("subCA", IDENTITY, ca=True, key=SAME_KEY))),
    ],
)
def test_an_authority_with_its_key_takes_nothing_away(store: Store, tmp_path: Path) -> None:
    """Some implementations do not even read a second authority."""
    assert flows(written(tmp_path / "a", {}, store), "/talker", "/motor")[Attacker.HONEST] is Status.HOLDS
    assert flows(written(tmp_path / "b", LYING_ABOUT, store), "/talker", "/motor")[Attacker.HONEST] is Status.VIOLATED


@pytest.mark.parametrize(
    ("identities", "expected"),
    [
        ((IDENTITY, LONE), Status.UNKNOWN),
        ((IDENTITY, FORGED), Status.UNKNOWN),
        ((IDENTITY, STRANGER), Status.HOLDS),
    ],
)
def test_one_in_the_identity_ca_file_that_names_itself_may_join_though_it_is_no_authority(
    identities: tuple[Signed, ...], expected: Status, tmp_path: Path
) -> None:
    """X509_verify_cert takes it (`tests/oracles/identities`): whoever has its key is let in, as an enclave would be."""
    root = written(tmp_path / "a", {}, replace(STORE, identity=identities))
    assert flows(root, "/talker", "/motor")[Attacker.HONEST] is expected


def test_the_key_of_the_permissions_ca_certified_as_an_identity(tmp_path: Path) -> None:
    held = {"backup/cert.pem": OF_PERMISSIONS_CA.pem, "backup/key.pem": OF_PERMISSIONS_CA.key_pem}
    assert flows(written(tmp_path, held), "/talker", "/motor")[Attacker.HONEST] is Status.VIOLATED


@pytest.mark.parametrize("held", [True, False])
def test_who_has_that_key_joins_by_it_wherever_the_key_is(held: bool, tmp_path: Path) -> None:
    """Certificates are no secret, and the question is what follows from the key."""
    lying = {"backup/key.pem": OF_PERMISSIONS_CA.key_pem} if held else {}
    for of, reached in (("permissionsCA", {"/listener", "/motor"}), ("somebody", set())):
        files = {"backup/cert.pem": identity("/admin", of).pem, **lying}
        found = find_blast_radius(
            written(tmp_path / of, files), "permissions-ca", Circumstances(profiles=resolve(("cyclonedds-11",)), at=AT)
        )
        (answer,) = found.keys
        assert {path for each in answer.alone.values() for path in each.radius.reached} == reached
