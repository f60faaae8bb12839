"""Changes in the order in which they account for what shows in later layers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from keystore_audit.grouped import gathered
from keystore_audit.model.comparison.change import Direction, Layer
from keystore_audit.model.comparison.drafts import Draft
from keystore_audit.model.comparison.trust import ADDED, FILE, REMOVED, SUBJECT

_LAYERS: Final = list(Layer)


class Causes:
    """Changes, and by whether something is gained those that may account for it: the other way round come last.

    `rows`: of protection. `everybody`: those that bear on what peers accept from any enclave. `grants`: rights.
    """

    def __init__(self, drafts: list[Draft]) -> None:
        self.drafts = _without_rights_of_others(sorted(drafts, key=_either_way_round))
        self.rows = agreeing(draft for draft in self.drafts if draft.kind == "protection")
        self.everybody = agreeing(draft for draft in self.drafts if draft.everybody)
        self.grants = agreeing(draft for draft in self.drafts if draft.layer is Layer.GRANTS)
        self._of_enclave = gathered((path, draft) for draft in self.drafts for path in draft.enclaves)

    def of(self, path: str) -> list[Draft]:
        """The changes that are about an enclave."""
        return self._of_enclave.get(path, [])


def _without_rights_of_others(drafts: list[Draft]) -> list[Draft]:
    """Rights that an enclave has or lost since its identity is another's, or gone, follow from that."""
    causes = [draft for draft in drafts if draft.kind in (SUBJECT, FILE)]
    kept = []
    for draft in drafts:
        follows = draft.kind in ("right", "grant-validity")
        cause = next((each for each in causes if set(draft.enclaves) <= set(each.enclaves)), None) if follows else None
        if cause is None:
            kept.append(draft)
        else:
            cause.account_for(draft)
    return kept


def _either_way_round(draft: Draft) -> tuple[int, str, tuple[str, ...], str, str, int]:
    """An order of changes that is the same for NEW and OLD as for OLD and NEW."""
    kind = ADDED if draft.kind == REMOVED else draft.kind
    aspects = " ".join(sorted(aspect.what for aspect in draft.aspects))
    return _LAYERS.index(draft.layer), kind, draft.enclaves, draft.operation or "", aspects, draft.channels


def agreeing(drafts: Iterable[Draft]) -> tuple[list[Draft], list[Draft]]:
    """In the order in which they account for a loss, and for a gain: those last that are the other way."""
    several = list(drafts)
    loss = sorted(several, key=lambda draft: (draft.direction is Direction.GAINED, draft.direction is Direction.INFO))
    gain = sorted(several, key=lambda draft: (draft.direction is Direction.LOST, draft.direction is Direction.INFO))
    return loss, gain
