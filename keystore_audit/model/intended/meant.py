"""What enclaves may do and were not meant to, and the other way about: for tables that show both side by side."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from msgspec import Struct

from keystore_audit.grouped import gathered
from keystore_audit.keystore.typed import Operation
from keystore_audit.model.intended.drift import Drift
from keystore_audit.model.intended.observed import Observation

Uses = Mapping[str, Collection[tuple[Operation, str]]]
"""By enclave operations on DDS topics that a policy, a graph or a document names."""


class Meant(Struct, frozen=True, kw_only=True):
    """`beyond`: what the enclave's own permissions allow and nobody meant; `lacking`: what was meant and they deny.

    Of names by patterns one is there, since no more is known of them.
    """

    beyond: Uses
    lacking: Uses


def meant(drift: Drift | None, observed: Observation | None) -> Meant | None:
    """What a policy and graphs say; None where there are none."""
    if drift is None and observed is None:
        return None
    own = [each for each in drift.enclaves if each.own] if drift is not None else []
    beyond = [(each.enclave, (right.operation, right.topic)) for each in own for right in each.exceeding.rights]
    lacking = [(each.enclave, (right.operation, right.topic)) for each in own for right in each.lacking.rights]
    if observed is not None:
        beyond += [(each.enclave, (name.operation, name.topic)) for each in observed.excess for name in each.names]
        lacking += [(each.need.enclave, use) for each in observed.missing for use in each.need.channels]
    return Meant(beyond=gathered(beyond), lacking=gathered(lacking))
