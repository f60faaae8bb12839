"""The comparison of two keystores in meaning: every layer, each change once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Final
from zoneinfo import ZoneInfo

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.model.claims.globs import Globs
from keystore_audit.model.comparison.again import signed_again
from keystore_audit.model.comparison.causes import Causes
from keystore_audit.model.comparison.change import ORDER, Comparison, Layer
from keystore_audit.model.comparison.drafts import Draft
from keystore_audit.model.comparison.governance import governance_changes
from keystore_audit.model.comparison.grants import grant_changes, validity_changes
from keystore_audit.model.comparison.influence import influence_changes
from keystore_audit.model.comparison.labels import ConcernedLabels
from keystore_audit.model.comparison.later import later_changes
from keystore_audit.model.comparison.others import OthersGrants, carriers
from keystore_audit.model.comparison.reach import Reach
from keystore_audit.model.comparison.sides import Sides
from keystore_audit.model.comparison.still import Still
from keystore_audit.model.comparison.trust import AUTHORITY, trust_changes
from keystore_audit.profiles import Profile

_LAYERS: Final = list(Layer)


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
    still = Still(sides)
    rights = grant_changes(sides, still)
    dates = validity_changes(sides, rights)
    later = later_changes(sides, frozenset(path for draft in dates for path in draft.enclaves))
    drafts = [*trust_changes(sides), *governance_changes(sides), *dates, *later, *rights]
    causes = Causes(drafts)
    unaccounted = [*Reach(sides, causes, still).work_out(), *influence_changes(sides, causes, still)]
    others = OthersGrants(sides)
    found = [*causes.drafts, *unaccounted, *others.drafts()]
    found += signed_again(sides, found, carriers(others.places, sides))
    concerned = ConcernedLabels(sides, labels)
    changes = [draft.change(sides, concerned.of(draft)) for draft in sorted(found, key=_order)]
    return Comparison(
        old=old.root,
        new=new.root,
        old_digest=old.digest,
        new_digest=new.digest,
        at=at,
        domain=domain,
        profiles=tuple(profile.name for profile in profiles),
        common=len(sides.common),
        changes=tuple(changes),
        unknown=sides.unknown,
        labels=tuple(labels),
        assumed=assumed,
    )


def _order(draft: Draft) -> tuple[bool, int, int, str, tuple[str, ...], str]:
    """Other authorities first, on which all rests; else by layer; gains come first, and last what nobody notices."""
    what = draft.what + "".join(f"{aspect.what} {aspect.old} {aspect.new}" for aspect in draft.aspects)
    other = draft.kind != AUTHORITY
    return other, _LAYERS.index(draft.layer), ORDER.index(draft.direction), draft.kind, draft.enclaves, what
