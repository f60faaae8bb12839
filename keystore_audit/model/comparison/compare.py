"""The comparison of two keystores in meaning: every layer, each change once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from datetime import datetime
from functools import cache
from itertools import chain
from typing import Final
from zoneinfo import ZoneInfo

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.comparison.change import Comparison, Direction, Layer
from keystore_audit.model.comparison.facts import Causes, Draft, accounted, fact, folded, order, placed
from keystore_audit.model.comparison.governance import governance_changes, same_protection
from keystore_audit.model.comparison.grants import LATER, grant_changes, later_changes, validity_changes
from keystore_audit.model.comparison.influence import influence_changes
from keystore_audit.model.comparison.labels import labelled
from keystore_audit.model.comparison.others import others_grants, said_grants
from keystore_audit.model.comparison.reach import PRESENTED, reach_changes
from keystore_audit.model.comparison.sides import Pair, Sides
from keystore_audit.model.comparison.trust import FORM, documents, trust_changes
from keystore_audit.profiles import Profile

_TELLING: Final = frozenset(("protection", "right", "grant-validity", LATER, "signature", "signer", "authority", FORM))
_SAME: Final = "its documents were signed again, with the same meaning"
_IDLE: Final = "its documents were signed again; what differs in them counts for nobody, save what is told here"
"""As grants that are over or that another hides, or documents that every implementation asked about refuses."""

_ELSEWHERE: Final = (Layer.ACCESS, Layer.ATTACKERS, Layer.INFLUENCE)
"""Layers of changes that may stand in anybody's documents."""


def compare(
    old: Keystore,
    new: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    zone: ZoneInfo | None = None,
    domain: int | None = None,
    labels: Mapping[str, Globs] | None = None,
    assumed: frozenset[Assumption] = EVERY,
) -> Comparison:
    """What changed from `old` to `new` as `profiles` read them at `at` (aware UTC).

    `zone`: where the robots are, None if that is not known. `domain`: the only one that counts; None: all.
    `labels`: by label, what has it; where there are some, changes about others do not fail. `assumed`: what else is
    taken for granted.
    Raises errors.BudgetExceeded where there are too many classes of names, and errors.UsageError for a label of
    nothing in either keystore.
    """
    labels = labels or {}
    topics = [glob for each in labels.values() for glob in each.topics]
    sides = Sides(old, new, profiles, at, zone, domain, topics, assumed)
    rights = list(grant_changes(sides))
    dates = list(validity_changes(sides, rights))
    later = later_changes(sides, frozenset(path for draft in dates for path in draft.enclaves))
    causes = Causes([*trust_changes(sides), *governance_changes(sides), *dates, *later, *rights])
    shown = accounted(chain(reach_changes(sides, causes), influence_changes(sides, causes)), sides)
    others, carriers = others_grants(sides)
    found = [*causes.drafts, *shown, *others]
    found += signed_again(sides, found, carriers)
    having = labelled(sides, labels)
    return Comparison(
        old=old.root,
        new=new.root,
        old_digest=old.digest,
        new_digest=new.digest,
        at=at,
        domain=domain,
        profiles=sides.every,
        common=len(sides.common),
        changes=tuple(
            draft.change(sides, tuple(each.label for each in having if each.concerns(draft)))
            for draft in sorted(found, key=order)
        ),
        unknown=sides.unknown,
        labels=tuple(labels),
        assumed=assumed,
    )


def signed_again(sides: Sides, found: Sequence[Draft], carrying: Set[str]) -> list[Draft]:
    """Documents with other bytes of which no change tells, all alike in one line. `carrying`: others' rights in them
    changed.
    """
    if any(draft.layer in _ELSEWHERE or draft.kind == PRESENTED for draft in found):
        return []
    told = carrying | {path for draft in found for path in draft.enclaves if draft.kind in _TELLING}
    return list(folded(_signed_again(sides, told), sides))


def _signed_again(sides: Sides, told: Set[str]) -> Iterator[Draft]:
    """One for each enclave, those `told` aside."""
    said = cache(said_grants)

    def alike(path: str, word: str, pair: Pair) -> bool:
        """Whether the enclave's governance or permissions, as these profiles read them, have the same meaning."""
        if word == "governance":
            return same_protection(pair, path)
        documents = [(view, view.enclave(path).permissions) for view in (pair.old, pair.new)]
        one, other = (said(view).get(each, []) if each is not None else None for view, each in documents)
        return one is not None and one == other

    for path in sides.compared:
        old, new = (by_path[path] for by_path in sides.enclaves)
        changed = [each for each in documents(old, new) if each[1].signed.file.sha256 != each[2].signed.file.sha256]
        if path in told or not changed:
            continue
        same = []
        for word, one, other, _places in changed:
            void = [(pair, {sides.is_void(each, pair.lead) for each in (one, other)}) for pair in sides.pairs]
            says = [(pair, each) for pair, each in void if each != {True}]  # else nothing, before and after
            same.append(bool(says) and all(each == {False} and alike(path, word, pair) for pair, each in says))
        yield from placed([fact("signed-again", Direction.INFO, _SAME if all(same) else _IDLE)], changed[0][3], path)
