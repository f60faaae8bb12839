"""Who a sample of a sealed message is of stands inside, and nobody compares it with who sealed the message.

The attacker is a participant of its own, with a grant for "other" alone. In its messages it writes the prefix and the
writer of another participant, which may publish "owned" (forged_source.h).
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest
from msgspec.structs import replace

from tests.keystore.documents import allow, pubsub, topic_rule
from tests.oracles.vendors.enclave import publish, subscribe
from tests.oracles.vendors.ours import PROFILES
from tests.oracles.vendors.pairs import Pairs, Side
from tests.oracles.vendors.pairs_case import CAS, PLAIN_FIRST, PLAIN_SECOND
from tests.oracles.vendors.pairs_material import EVERY_DOMAIN, governance, grant, permissions

pytestmark = pytest.mark.xdist_group("vendors-pairs")  # the programs are compiled once

OWNER: Final = 999
FORGER: Final = 0

SIGN_ORIGIN, ENCRYPT_ORIGIN = "SIGN_WITH_ORIGIN_AUTHENTICATION", "ENCRYPT_WITH_ORIGIN_AUTHENTICATION"
ROWS = [
    ("ENCRYPT", "NONE", True),
    (ENCRYPT_ORIGIN, "NONE", True),
    (ENCRYPT_ORIGIN, "ENCRYPT", False),
    (ENCRYPT_ORIGIN, SIGN_ORIGIN, False),
    ("ENCRYPT", ENCRYPT_ORIGIN, False),
]
"""rtps and metadata protection kind, and whether the forged samples are taken. The forger has no key of "owned"."""


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize(("rtps", "metadata", "taken"), ROWS)
def test_the_origin_of_messages_is_not_compared_with_who_sealed_them(
    name: str, rtps: str, metadata: str, taken: bool, vendors: dict[str, Pairs], tmp_path: Path
) -> None:
    for attempt in range(4):  # the owner may be late, on a busy machine
        heard = _heard(vendors[name], rtps, metadata, tmp_path / str(attempt))
        if heard == ({OWNER, FORGER} if taken else {OWNER}):
            return
    pytest.fail(f"of those who published, {heard} were heard")


def _heard(vendor: Pairs, rtps: str, metadata: str, directory: Path) -> frozenset[int]:
    rules = topic_rule(metadata=metadata, data="NONE")
    signed = CAS.sign(governance(rules, rtps=rtps))
    granted = {"/second": "other", "/owner": "owned"}
    grants = (grant(f"CN={name}", allow(pubsub(topic), domains=EVERY_DOMAIN)) for name, topic in granted.items())
    both = CAS.sign(permissions(*grants))  # Cyclone DDS takes the first document of a process for all participants
    enclaves = {
        "first": PLAIN_FIRST,
        "second": replace(PLAIN_SECOND, permissions=both),
        "owner": replace(PLAIN_SECOND, identity=CAS.issue("/owner"), permissions=both),
    }
    at = {name: replace(enclave, governance=signed).write(directory / name) for name, enclave in enclaves.items()}
    reader = Side(enclave=at["first"], endpoints=(subscribe("owned"), subscribe("other")))
    forger = Side(enclave=at["second"], endpoints=(publish("other"),), compromised=True, passes_for=at["owner"])
    first, _second = vendor.meet(reader, forger).sides
    assert first is not None
    return first[0].heard
