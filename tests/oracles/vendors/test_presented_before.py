"""A right that a keystore no longer grants: the enclave presents its document of before to peers of now."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import pytest

from keystore_audit.circumstances import Circumstances
from keystore_audit.diff import compare_keystores
from keystore_audit.profiles import resolve
from tests.keystore.builder import authority
from tests.keystore.documents import allow, pubsub
from tests.oracles.vendors.enclave import publish, subscribe
from tests.oracles.vendors.ours import PROFILES
from tests.oracles.vendors.pairs import Meeting, Pairs, Side
from tests.oracles.vendors.pairs_case import CAS, FIRST, SECOND
from tests.oracles.vendors.pairs_material import EVERYTHING, Authorities, Enclave, governance, grant, permissions

pytestmark = pytest.mark.xdist_group("vendors-pairs")

AT = datetime(2026, 11, 21, 12, tzinfo=timezone.utc)
RENEWED = Authorities(identity=CAS.identity, permissions=authority("another permissions CA"))
"""The same identities, and permissions that somebody else signs."""


def keystore(root: Path, authorities: Authorities, topic: str) -> Path:
    """/first, the motor, and /second, which may publish the topic."""
    documents = {"first": grant("CN=/first", EVERYTHING), "second": grant("CN=/second", allow(pubsub(topic)))}
    for name, identity in (("first", FIRST), ("second", SECOND)):
        Enclave(
            authorities=authorities,
            identity=identity,
            governance=authorities.sign(governance()),
            permissions=authorities.sign(permissions(documents[name])),
        ).write(root / "enclaves" / name)
    return root


def _heard(meeting: Meeting) -> bool:
    first = meeting.sides[0]
    assert first is not None
    return bool(first[0].heard)


@pytest.mark.parametrize("vendor", PROFILES)
@pytest.mark.parametrize(("renewed", "heard"), [(CAS, True), (RENEWED, False)])
def test_an_old_document_counts_as_long_as_its_authority_does(
    vendors: dict[str, Pairs], vendor: str, renewed: Authorities, heard: bool, tmp_path: Path
) -> None:
    old, new = keystore(tmp_path / "old", CAS, "motor"), keystore(tmp_path / "new", renewed, "display")
    motor = Side(enclave=new / "enclaves/first", endpoints=(subscribe("motor"),))
    for presented, arrives in ((old, heard), (new, False)):
        attacker = Side(
            enclave=new / "enclaves/second",
            endpoints=(publish("motor"),),
            compromised=True,
            presented=presented / "enclaves/second/permissions.p7s",
        )
        meeting = vendors[vendor].meet_as(motor, attacker, lambda seen: _heard(seen) is arrives)  # noqa: B023
        assert _heard(meeting) is arrives, presented
        second = meeting.sides[1]
        assert second is not None
        assert second[0].created
    found = compare_keystores(old, new, Circumstances(profiles=resolve([PROFILES[vendor]]), at=AT))
    (lost,) = (each for each in found.changes if (each.operation, each.direction.value) == ("publish", "lost"))
    assert lost.until == ("2033-12-29T00:00:00Z" if heard else None)
    assert lost.what == ("may still, until 2033-12-29T00:00:00Z, publish" if heard else "may no longer publish")
