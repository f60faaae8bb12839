"""The comparison of two keystores in meaning: every layer, each change once, with the labels that it is about."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from datetime import datetime
from functools import cache
from typing import Final
from zoneinfo import ZoneInfo

from msgspec import Struct

from keystore_audit.assumptions import EVERY, Assumption
from keystore_audit.errors import UsageError
from keystore_audit.keystore.keystore import Keystore
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.claims.globs import Globs, matching
from keystore_audit.model.claims.stated import Labelling
from keystore_audit.model.comparison.change import Comparison, Direction, Layer
from keystore_audit.model.comparison.facts import Causes, Draft, accounted, fact, folded, order, placed
from keystore_audit.model.comparison.governance import governance_changes, same_protection
from keystore_audit.model.comparison.grants import LATER, grant_changes, later_changes, validity_changes
from keystore_audit.model.comparison.others import others_grants, said_grants
from keystore_audit.model.comparison.reach import PRESENTED, reach_changes
from keystore_audit.model.comparison.sides import Pair, Sides
from keystore_audit.model.comparison.trust import FORM, documents, trust_changes
from keystore_audit.model.formal.bit_sets import union
from keystore_audit.model.names import AMBIENT
from keystore_audit.profiles import Profile

_TELLING: Final = frozenset(("protection", "right", "grant-validity", LATER, "signature", "signer", "authority", FORM))
_SAME: Final = "its documents were signed again, with the same meaning"
_IDLE: Final = "its documents were signed again; apart from what is listed here, what differs counts for nobody"
"""As expired or hidden grants, or documents that every implementation asked about refuses."""

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
    shown = accounted(reach_changes(sides, causes), sides)
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
        documents = [(view, view.enclave(path).document) for view in (pair.old, pair.new)]
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


def label_globs(labelling: Labelling, labels: Iterable[str]) -> dict[str, Globs]:
    """What has each of the labels, and who is trusted to take it or to give it.

    Raises errors.UsageError for a label that nothing has.
    """
    found = {}
    for label in labels:
        places = (*labelling.sources(label), *labelling.targets(label))
        if not places:
            raise UsageError(f"--label: nothing has the label {label} in {labelling.place}")
        found[label] = Globs(
            enclaves=tuple(dict.fromkeys(glob for place in places for glob in place.enclaves)),
            topics=tuple(dict.fromkeys(glob for place in places for glob in place.topics)),
        )
    return found


class Labelled(Struct, frozen=True, kw_only=True):
    """Enclaves with a label; and names with it, or that those enclaves may use in either keystore.

    `users`: enclaves that may use any of these names in either keystore: whoever takes their identities may, too.
    """

    label: str
    paths: frozenset[str]
    channels: int
    users: frozenset[str]

    def concerns(self, draft: Draft) -> bool:
        """Whether the change, or anything that follows from it, is about the label; of the keystore as a whole: yes."""
        whole = draft.whole or (not draft.enclaves and not draft.channels and draft.influenced is None)
        # Whose governance says something of names that none of them uses does not count.
        told = (*draft.enclaves, *draft.touched) if draft.kind != "protection" else ()
        taken = draft.layer is Layer.TRUST and not draft.channels and not self.users.isdisjoint(told)
        return (
            whole
            or taken
            or self._shows(draft.channels, told, draft)
            or any(self._shows(each.channels, each.enclaves, each) for each in draft.follows)
        )

    def _shows(self, channels: int, enclaves: Iterable[str], draft: Draft) -> bool:
        ends = draft.influenced.ends if draft.influenced is not None else ()
        return bool(self.channels & channels) or not self.paths.isdisjoint((*enclaves, *ends))


def labelled(sides: Sides, labels: Mapping[str, Globs]) -> list[Labelled]:
    """What has the labels; `sides` tell their topics apart.

    Raises errors.UsageError where a glob matches no enclave, or no topic that anybody may use, of either keystore, and
    everything could be read.
    """
    usable = _usable(sides) if labels else {}
    return [_labelled(sides, label, globs, usable) for label, globs in labels.items()]


def _usable(sides: Sides) -> dict[str, int]:
    """By enclave, the names that it may use in either keystore."""
    usable: dict[str, int] = {}
    for view in (view for pair in sides.pairs for view in (pair.old, pair.new)):
        for path in view.numbers:
            names = union(view.accepted(path, operation) for operation in Operation)
            usable[path] = usable.get(path, 0) | names
    return usable


def _labelled(sides: Sides, label: str, globs: Globs, usable: Mapping[str, int]) -> Labelled:
    everybody = sorted({*sides.enclaves[0], *sides.enclaves[1]})
    paths: set[str] = set()
    for glob in globs.enclaves:
        matched = matching(glob, everybody)
        if not matched and not sides.unknown:
            raise UsageError(f"--label {label}: {glob} is no enclave of either keystore")
        paths.update(matched)
    named = union(names for path, names in usable.items() if path in paths) & ~sides.named(AMBIENT)
    for glob in globs.topics:
        channels = sides.claimed(glob)
        if not channels & union(usable.values()) and not sides.unknown:
            raise UsageError(f"--label {label}: {glob} is no topic that anybody may use in either keystore")
        named |= channels
    users = frozenset(path for path, names in usable.items() if names & named)
    return Labelled(label=label, paths=frozenset(paths), channels=named, users=users)
