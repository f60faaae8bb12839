"""Which labels of the settings a change is about (docs/diff.md, Labels)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.claims.globs import Globs, matching
from keystore_audit.model.claims.stated import Labelling
from keystore_audit.model.comparison.change import Influenced, Layer
from keystore_audit.model.comparison.drafts import Draft
from keystore_audit.model.comparison.sides import Sides
from keystore_audit.model.formal.bit_sets import union
from keystore_audit.model.names import AMBIENT


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


class _Labelled(Struct, frozen=True, kw_only=True):
    """Enclaves with a label; and names with it, or that those enclaves may use in either keystore.

    `users`: enclaves that may use any of these names in either keystore: whoever takes their identities may, too.
    """

    paths: frozenset[str]
    channels: int
    users: frozenset[str]

    def shows_in(self, enclaves: Collection[str], channels: int, influenced: Influenced | None) -> bool:
        """Whether something about these enclaves and channels is about the label."""
        ends = influenced.ends if influenced is not None else ()
        return bool(self.channels & channels) or not self.paths.isdisjoint((*enclaves, *ends))


class ConcernedLabels:
    """Which of the labels changes are about. `sides` tell their topics apart.

    Raises errors.UsageError where a glob matches no enclave, or no topic that anybody may use, of either keystore, and
    everything could be read.
    """

    def __init__(self, sides: Sides, labels: Mapping[str, Globs]) -> None:
        self._labels = {label: _labelled(sides, label, globs) for label, globs in labels.items()}

    def of(self, draft: Draft) -> tuple[str, ...]:
        """Those that the change, or anything that follows from it, is about; of the keystore as a whole: all."""
        whole = draft.whole or (not draft.enclaves and not draft.channels and draft.influenced is None)
        return tuple(
            label
            for label, each in self._labels.items()
            if whole
            or _concerns(each, draft)
            or any(each.shows_in(it.enclaves, channels, it.influenced) for it, channels in draft.effects.items())
        )


def _concerns(labelled: _Labelled, draft: Draft) -> bool:
    # Whose governance says something of names that none of them uses does not count.
    enclaves = (*draft.enclaves, *draft.touched) if draft.kind != "protection" else ()
    trust = draft.layer is Layer.TRUST and not draft.channels
    by_user = trust and not labelled.users.isdisjoint(enclaves)
    return by_user or labelled.shows_in(enclaves, draft.channels, draft.influenced)


def _labelled(sides: Sides, label: str, globs: Globs) -> _Labelled:
    everybody = sorted({*sides.enclaves[0], *sides.enclaves[1]})
    paths: set[str] = set()
    for glob in globs.enclaves:
        matched = matching(glob, everybody)
        if not matched and not sides.unknown:
            raise UsageError(f"--label {label}: {glob} is no enclave of either keystore")
        paths.update(matched)
    theirs = 0
    usable: dict[str, int] = {}
    for pair in sides.pairs:
        for view in (pair.old, pair.new):
            for path in view.numbers:
                names = union(view.accepted(path, operation) for operation in Operation)
                usable[path] = usable.get(path, 0) | names
                theirs |= names if path in paths else 0
    named, used = theirs & ~sides.named(AMBIENT), union(usable.values())
    for glob in globs.topics:
        channels = sides.claimed(glob)
        if not channels & used and not sides.unknown:
            raise UsageError(f"--label {label}: {glob} is no topic that anybody may use in either keystore")
        named |= channels
    return _Labelled(
        paths=frozenset(paths),
        channels=named,
        users=frozenset(path for path, names in usable.items() if names & named),
    )
