"""Documents that were signed again, of which no change tells: they mean the same, or differ where nobody cares."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set
from typing import Final

from keystore_audit.findings import Location
from keystore_audit.model.comparison.change import Direction, Layer
from keystore_audit.model.comparison.drafts import Draft
from keystore_audit.model.comparison.form import DOCUMENT
from keystore_audit.model.comparison.governance import same_protection
from keystore_audit.model.comparison.later import KIND as LATER
from keystore_audit.model.comparison.others import SameGrants
from keystore_audit.model.comparison.reach import PRESENTED
from keystore_audit.model.comparison.sides import Sides, is_void
from keystore_audit.model.comparison.trust import documents

_TELLING: Final = frozenset(
    ("protection", "right", "grant-validity", LATER, "signature", "signer", "authority", DOCUMENT)
)
_SAME: Final = "its documents were signed again, with the same meaning"
_IDLE: Final = "its documents were signed again; what differs in them counts for nobody, save what is told here"
"""As grants that are over or that another hides, or documents that every implementation asked about refuses."""

_ELSEWHERE: Final = (Layer.ACCESS, Layer.ATTACKERS, Layer.INFLUENCE)
"""Layers of changes that may stand in anybody's documents."""


def signed_again(sides: Sides, found: Iterable[Draft], carrying: Set[str]) -> Iterator[Draft]:
    """Documents with other bytes, all alike in one line. `carrying`: others' rights in them changed."""
    found = list(found)
    told = carrying | {path for draft in found for path in draft.enclaves if draft.kind in _TELLING}
    if any(draft.layer in _ELSEWHERE or draft.kind == PRESENTED for draft in found):
        return
    same_grants = SameGrants(sides)
    places: dict[str, list[tuple[str, Location, Location]]] = {_SAME: [], _IDLE: []}
    for path in sides.compared:
        changed = list(_rewritten(sides, path, same_grants)) if path not in told else []
        if changed:
            same = all(same for same, _old, _new in changed)
            places[_SAME if same else _IDLE].append((path, *changed[0][1:]))
    for what, several in places.items():
        if several:
            yield Draft(
                layer=Layer.TRUST,
                kind="signed-again",
                direction=Direction.INFO,
                what=what,
                enclaves=tuple(path for path, _old, _new in several),
                profiles=tuple(profile.name for profile in sides.profiles),
                old=several[0][1],
                new=several[0][2],
            )


def _rewritten(sides: Sides, path: str, same_grants: SameGrants) -> Iterator[tuple[bool, Location, Location]]:
    """The enclave's documents that have other bytes, and whether they say the same."""
    for word, one, other, places in documents(*(by_path[path] for by_path in sides.enclaves)):
        if one.signed.file.sha256 == other.signed.file.sha256:
            continue
        says_the_same = same_protection if word == "governance" else same_grants.of
        same = []
        for pair in sides.pairs:
            void = [is_void(document, pair.lead, sides.accesses) for document in (one, other)]
            if not all(void):  # else it says nothing there, before and after
                same.append(not any(void) and says_the_same(pair, path))
        yield bool(same) and all(same), *places
