"""What the pictures of a report show, beside its findings: who may do what, flows, certificates and dates.

No verdict rests on it, so it is worked out only where a report draws it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Final

from msgspec import Struct

from keystore_audit.errors import BudgetExceeded
from keystore_audit.findings import Location
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.permissions import Operation
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.decision import LocalRights
from keystore_audit.model.formal.bit_sets import bits
from keystore_audit.model.formal.system import System
from keystore_audit.model.names import AMBIENT
from keystore_audit.model.systems import SystemBuilder
from keystore_audit.model.tables.access_table import AccessTable, access_table
from keystore_audit.model.tables.issuance import Issuance, issuance
from keystore_audit.model.tables.neighbours import Neighbourhood, neighbourhoods
from keystore_audit.model.tables.periods import Period, periods
from keystore_audit.model.window import Window
from keystore_audit.profiles import Profile

MAX_NEIGHBOURHOODS: Final = 400
"""Enclaves whose neighbours are looked for: each is held against each, and nobody looks at more pictures."""

MAX_VIEWS: Final = 10_000
"""Pairs of an enclave and a realm beyond which no neighbours are looked for: hundreds of enclaves, each with a
governance file of its own."""


class Allowance(Struct, frozen=True, kw_only=True):
    """`names`: places in the table, as a bit set, for which `location` (None: no line) allows the operation.

    `reason`: why, raw text.
    """

    operation: Operation
    names: int
    reason: str
    location: Location | None


class Overview(Struct, frozen=True, kw_only=True):
    """`access`: in one domain; None where that could not be worked out, and `refused` says why (a sentence).

    `allowances`: by enclave path, under the profiles of the table's last group, as `neighbourhoods` are, of which there
    are at most MAX_NEIGHBOURHOODS, or none, and `undrawn` says why (a sentence). `ambient`: names (bit set) that those
    leave out.
    """

    access: AccessTable | None
    refused: str
    allowances: Mapping[str, tuple[Allowance, ...]]
    neighbourhoods: tuple[Neighbourhood, ...]
    undrawn: str
    ambient: int
    issuance: Issuance
    periods: tuple[Period, ...]


def overview(
    keystore: Keystore,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    domain: int | None,
    systems: Sequence[System],
) -> Overview:
    """Of a keystore at `at` (aware UTC), as the profiles read it.

    `domain`: that of the table, None: the lowest that some governance covers. `systems`: the keystore's; where there
    are none, nothing could be worked out.
    """
    if not systems:
        return _nothing("The classes of names are too many.")
    issued = issuance(keystore, systems[0])
    dates = periods(keystore, systems[0], issued)
    try:
        table = access_table(keystore, profiles, at, accesses, domain)
    except BudgetExceeded as exceeded:
        return _nothing(exceeded.message, issued, dates)
    shown = next(profile for profile in profiles if profile.name == table.groups[-1].profiles[0])
    points = [(name.topic, name.partition) for name in table.names]
    builder = SystemBuilder(keystore, [shown], at, accesses, points)
    window = Window(builder.channels, table.domain, len(points))
    local = LocalRights(accesses, builder.channels, at)
    system = builder.systems()[0]
    many = len(system.realms) * len(system.enclaves) > MAX_VIEWS
    ambient = bits(number for number, name in enumerate(table.names) if name.topic in AMBIENT and not name.several)
    return Overview(
        access=table,
        refused="",
        allowances={each.path: tuple(_allowances(each, shown, local, window)) for each in keystore.enclaves},
        neighbourhoods=() if many else neighbourhoods(system, window, ambient, MAX_NEIGHBOURHOODS),
        undrawn=f"{len(system.realms)} ways to trust are too many to hold each enclave against each." if many else "",
        ambient=ambient,
        issuance=issued,
        periods=dates,
    )


def _nothing(why: str, issued: Issuance | None = None, dates: tuple[Period, ...] = ()) -> Overview:
    return Overview(
        access=None,
        refused=why,
        allowances={},
        neighbourhoods=(),
        undrawn=why,
        ambient=0,
        issuance=issued or Issuance(certificates=(), unsigned=(), unread=()),
        periods=dates,
    )


def _allowances(enclave: Enclave, profile: Profile, local: LocalRights, window: Window) -> Iterator[Allowance]:
    """Everything that allows it something on its own implementation, in the order in which it is asked."""
    for operation in Operation:
        undecided = window.all
        for step in local.steps(enclave, profile, operation):
            names = window.of(step.channels) & undecided
            undecided &= ~names
            if names and step.allow:
                decision = step.by.explain(None)
                yield Allowance(operation=operation, names=names, reason=decision.reason, location=decision.location)
