"""The comparison of two keystores in meaning: every layer, each change once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from datetime import datetime
from typing import Final
from zoneinfo import ZoneInfo

from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.claims import Globs
from keystore_audit.model.comparison import ORDER, Comparison, Direction, Layer
from keystore_audit.model.comparison_causes import Causes
from keystore_audit.model.comparison_drafts import Draft
from keystore_audit.model.comparison_form import DOCUMENT
from keystore_audit.model.comparison_governance import governance_changes
from keystore_audit.model.comparison_grants import grant_changes, validity_changes
from keystore_audit.model.comparison_influence import influence_changes
from keystore_audit.model.comparison_labels import ConcernedLabels
from keystore_audit.model.comparison_later import KIND as LATER
from keystore_audit.model.comparison_later import later_changes
from keystore_audit.model.comparison_others import OthersGrants, carriers
from keystore_audit.model.comparison_reach import Reach
from keystore_audit.model.comparison_sides import Sides
from keystore_audit.model.comparison_trust import trust_changes
from keystore_audit.model.profiles import Profile

_LAYERS: Final = list(Layer)


def compare(
    old: Keystore,
    new: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    zone: ZoneInfo | None = None,
    domain: int | None = None,
    labels: Mapping[str, Globs] | None = None,
) -> Comparison:
    """What changed from `old` to `new` as `profiles` read them at `at` (aware UTC).

    `zone`: where the robots are, None if that is not known. `domain`: the only one that counts; None: all.
    `labels`: by label, what has it; where there are some, changes about others do not fail.
    Raises errors.BudgetExceeded where there are too many classes of names, and errors.UsageError for a label of
    nothing in either keystore.
    """
    labels = labels or {}
    sides = Sides(old, new, profiles, at, zone, domain, [glob for each in labels.values() for glob in each.topics])
    rights = grant_changes(sides)
    dates = validity_changes(sides, rights)
    later = later_changes(sides, frozenset(path for draft in dates for path in draft.enclaves))
    drafts = [*trust_changes(sides), *governance_changes(sides), *dates, *later, *rights]
    causes = Causes(drafts)
    unaccounted = [*Reach(sides, causes).work_out(), *influence_changes(sides, causes)]
    others = OthersGrants(sides)
    found = [*causes.drafts, *unaccounted, *others.drafts()]
    found += _signed_again(sides, found, carriers(others.places, sides))
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
    )


def _order(draft: Draft) -> tuple[int, int, str, tuple[str, ...], str]:
    """By layer; gains come first, and last what nobody notices."""
    what = draft.what + "".join(f"{aspect.what} {aspect.old} {aspect.new}" for aspect in draft.aspects)
    return _LAYERS.index(draft.layer), ORDER.index(draft.direction), draft.kind, draft.enclaves, what


def _signed_again(sides: Sides, found: Iterable[Draft], carrying: Set[str]) -> Iterator[Draft]:
    """Documents with other bytes and the same meaning, all in one line. `carrying`: others' rights in them changed."""
    told = carrying | {
        path
        for draft in found
        for path in draft.enclaves
        if draft.kind in ("protection", "right", "grant-validity", LATER, "signature", "signer", "authority", DOCUMENT)
    }
    others = any(draft.layer in (Layer.ACCESS, Layer.ATTACKERS, Layer.INFLUENCE) for draft in found)
    again: list[str] = []
    places: list[tuple[Location, Location]] = []
    for path in sides.compared:
        old, new = (by_path[path] for by_path in sides.enclaves)
        changed = list(_rewritten(old, new))
        if changed and path not in told and not others:
            again.append(path)
            places += changed
    if again:
        yield Draft(
            layer=Layer.TRUST,
            kind="signed-again",
            direction=Direction.INFO,
            what="its documents were signed again, with the same meaning",
            enclaves=tuple(again),
            profiles=tuple(profile.name for profile in sides.profiles),
            old=places[0][0],
            new=places[0][1],
        )


def _rewritten(old: Enclave, new: Enclave) -> Iterator[tuple[Location, Location]]:
    for one, other in ((old.governance, new.governance), (old.permissions, new.permissions)):
        if one is not None and other is not None and one.signed.file.sha256 != other.signed.file.sha256:
            yield Location(path=one.signed.file.place), Location(path=other.signed.file.place)
