"""Vendors that do not pin signers take what any certificate signed that the permissions CA made, wherever it is kept.

The certificate is in the message that the attacker presents, and in `docs/` of the tree, where nobody carries it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from keystore_audit.access import Access
from keystore_audit.circumstances import Circumstances
from keystore_audit.flow import FlowQuestion, find_flow
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.asked import Attacker
from keystore_audit.model.question import Question
from keystore_audit.profiles import VARIANTS
from keystore_audit.properties import Status
from keystore_audit.truth import Truth
from tests.keystore.builder import Signed, certificate, signed_document
from tests.oracles.vendors import recipe
from tests.oracles.vendors.enclave import publish, subscribe
from tests.oracles.vendors.ours import PROFILES
from tests.oracles.vendors.pairs import pairs
from tests.oracles.vendors.pairs_case import CAS, SECOND, Case, outcome, plain
from tests.oracles.vendors.pairs_material import EVERYTHING, Enclave, grant, permissions
from tests.oracles.xml.parsers import require_measured_versions

pytestmark = pytest.mark.xdist_group("vendors-pairs")

CROSS = certificate(CAS.identity.certificate.subject, CAS.permissions, key=CAS.identity.key, ca=True)
"""By the permissions CA over the identity CA's key."""

AGAIN = certificate("/second", CAS.permissions, key=SECOND.key)
"""By the permissions CA for the enclave's key."""

ALL = permissions(grant("CN=/second", EVERYTHING))
LITTLE = Enclave(
    authorities=CAS,
    identity=SECOND,
    governance=plain("second").governance,
    permissions=CAS.sign(permissions(grant("CN=/second"))),
)


PRESENTED = {
    "cross": (CROSS, signed_document(ALL, SECOND, CROSS)),
    "again": (AGAIN, signed_document(ALL, AGAIN)),
}


@pytest.mark.parametrize("name", PRESENTED)
def test_vendors_that_do_not_pin_take_what_it_signed(name: str, oracle: Callable[[str], str], tmp_path: Path) -> None:
    require_measured_versions(oracle)
    case = Case(title=name, second=LITTLE, presented=PRESENTED[name][1], endpoints=(publish("a"), subscribe("b")))
    none = Case(title="its own", second=LITTLE, presented=LITTLE.permissions, endpoints=case.endpoints)
    with pairs(oracle, tmp_path) as both:
        for vendor, peers in both.items():
            refused = peers.meet(*none.sides(tmp_path / f"{vendor}-own"))
            assert outcome(refused, none) == "..", vendor
            sides = case.sides(tmp_path / f"{vendor}-{name}")
            taken = peers.meet_as(*sides, lambda meeting: outcome(meeting, case) == "++")
            assert outcome(taken, case) == "++", vendor


def keystore(directory: Path, *kept: Signed) -> Path:
    for role in ("first", "second"):
        (plain(role) if role == "first" else LITTLE).write(directory / "enclaves" / role)
    (directory / "docs").mkdir()
    for number, each in enumerate(kept):
        (directory / "docs" / f"old{number}.pem").write_bytes(each.pem)
    return directory


@pytest.mark.parametrize("name", PRESENTED)
@pytest.mark.parametrize("vendor", PROFILES)
def test_so_it_counts_where_it_lies_in_the_tree(name: str, vendor: str, tmp_path: Path) -> None:
    profiles = [VARIANTS[PROFILES[vendor]], VARIANTS["spec"]]
    question = Question(enclave="/second", operation=Operation.PUBLISH, topic="b", domain=0)
    asked = FlowQuestion(source="/second", target="/first", attackers=(Attacker.SOURCE,))
    told = {}
    for kept in ((), (PRESENTED[name][0],)):
        store = keystore(tmp_path / str(len(kept)), *kept)
        answers = Access(store, [question], Circumstances(profiles=profiles, at=recipe.NOW)).answers(question)
        [(_attacker, flow)] = find_flow(store, asked, Circumstances(profiles=profiles, at=recipe.NOW)).results
        told[len(kept)] = [(answers[each.name].effective, flow.profiles[each.name].status) for each in profiles]
    unpinned, pinned = told[1]
    assert unpinned == (Truth.YES, Status.VIOLATED)
    assert told[0] == [pinned, pinned], "nothing of the kind lies there, or the signer is pinned"
    assert pinned[0] is Truth.NO
