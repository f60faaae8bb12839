"""Which line of which document lets an enclave do what the access table says it may."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from keystore_audit.dataclass import dataclass
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.profiles import Profile
from keystore_audit.model.window import Window


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowance:
    """`names`: places in the table, as a bit set, for which `location` (None: no line) allows the operation.

    `reason`: why, raw text.
    """

    operation: Operation
    names: int
    reason: str
    location: Location | None


def allowances(
    enclaves: Iterable[Enclave], profile: Profile, local: LocalRights, window: Window
) -> Mapping[str, tuple[Allowance, ...]]:
    """By enclave path: everything that allows it something on its own implementation, in the order in which it is
    asked.
    """
    return {
        enclave.path: tuple(
            allowance
            for operation in Operation
            for allowance in _allowances(enclave, profile, local, window, operation)
        )
        for enclave in enclaves
    }


def _allowances(
    enclave: Enclave, profile: Profile, local: LocalRights, window: Window, operation: Operation
) -> Iterable[Allowance]:
    undecided = window.all
    for step in local.steps(enclave, profile, operation):
        names = window.of(step.channels) & undecided
        undecided &= ~names
        if names and step.allow:
            decision = step.decision
            yield Allowance(operation=operation, names=names, reason=decision.reason, location=decision.location)
