"""Which labels of the settings a change is about (docs/diff.md, Labels)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.claims.globs import Globs, matching
from keystore_audit.model.claims.stated import Labelling
from keystore_audit.model.comparison.change import Layer
from keystore_audit.model.comparison.facts import Draft
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
