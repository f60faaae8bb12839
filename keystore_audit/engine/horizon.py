"""How long an audit's answers stay true ("safe until", design section 3)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import datetime

from msgspec import Struct

from keystore_audit.engine.native import NativeEngine
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.model.access_view import AccessViews
from keystore_audit.model.formal.system import System
from keystore_audit.model.interpret import usability_by_profile
from keystore_audit.model.participants.usability import Usabilities
from keystore_audit.model.question import Usability
from keystore_audit.model.trust.revocation import lists_carried
from keystore_audit.model.validity import ANY_ZONE, END, LAST, SECOND
from keystore_audit.profiles import DateReading, Profile, doing
from keystore_audit.properties import Answer, Status
from keystore_audit.text import counted, some

MAX_MOMENTS = 64
"""Validity boundaries that are looked at.

Beyond, the horizon is the last one looked at: earlier than the truth, never later.
"""

_LOCAL = {reading: doing("dates", reading) for reading in (DateReading.ROBOT_TIME, DateReading.SHIFTED_CLOCK)}
"""Who reads dates of grants in the zone of the robot."""


class Horizon(Struct, frozen=True, kw_only=True):
    """The first later instant at which a verdict or a usability changes, and what changes; None: never."""

    instant: datetime | None
    why: str


def horizon(
    keystore: Keystore,
    native: NativeEngine,
    profiles: Sequence[Profile],
    at: datetime,
    accesses: AccessViews,
    usabilities: Usabilities,
    usable: Mapping[tuple[str, str], Usability],
) -> Horizon:
    """Looks at each validity boundary after `at` in turn, with the native engine. `usable`: as it is at `at`."""
    if not native.systems:
        return Horizon(instant=at, why="nothing could be decided")
    kinds = tuple({usabilities.kind(profile): profile for profile in profiles}.values())
    local, (begins, ends) = accesses.dates_in_local_time(profiles), accesses.exclusive_bounds(profiles)
    moments = _moments(keystore, native.systems[0], at, local, ends)
    first = {enclave: _first_date(enclave, kinds, usabilities, at) for enclave in keystore.enclaves if moments}
    for count, (moment, instant, earliest) in enumerate(moments):
        if count == MAX_MOMENTS:
            return Horizon(instant=earliest, why="later dates were not looked at")
        asked = [enclave for enclave, date in first.items() if date <= instant]
        why = _usability_change(asked, usable, usability_by_profile(asked, kinds, instant, usabilities))
        if not why:
            changes = map(_status_change, native.answers, native.statuses(moment))
            why = next((change for change in changes if change), "")
        if not why:
            enclave = next((label for label in native.changed_rights(moment) if label is not None), None)
            why = f"{enclave}: its grants give it other rights" if enclave is not None else ""
        if not why and earliest < instant and not local.isdisjoint((instant, instant - SECOND)):
            why = _near(accesses, profiles, (instant, instant - SECOND))
        if not why and instant in begins & ends:
            why = "a grant ends as another begins, and some implementation counts neither at that instant"
        if why:
            return Horizon(instant=earliest, why=why)
    return Horizon(instant=None, why="no date in the keystore changes anything")


def _first_date(enclave: Enclave, kinds: Iterable[Profile], usabilities: Usabilities, at: datetime) -> datetime:
    """Until when it starts as it does `at` the instant."""
    return min((date for kind in kinds for date in usabilities.dates(enclave, kind, at)), default=END)


def _near(accesses: AccessViews, profiles: Sequence[Profile], instants: Collection[datetime]) -> str:
    """Which date is near, of those that depend on the robot's zone."""
    (place, what), *more = dict.fromkeys(accesses.dated(profiles, instants))
    who = " and ".join(name for reading, name in _LOCAL.items() if any(p.access.dates is reading for p in profiles))
    others = f"; {counted(len(more), 'more date')} of grants fall{'s' if len(more) == 1 else ''} then" if more else ""
    return f"a grant {what} in the robots' time zone under {who} ({place}; --time-zone){others}"


def _moments(
    keystore: Keystore, system: System, at: datetime, local: Collection[datetime], excluded: Collection[datetime]
) -> list[tuple[int, datetime, datetime]]:
    """Every boundary after `at`: as a moment of the system, as an instant, and when it may be at the earliest; in
    order.

    A revocation list alone has no instants in the system; it is void one second after nextUpdate. `local`: dates of
    grants that some implementation reads in a zone that we do not know. `excluded`: ends of grants that some
    implementation counts no more at the end itself.
    """
    found: dict[datetime, int] = {}
    earlier: dict[datetime, datetime] = {}
    for index in range(system.now, len(system.instants)):
        instant = system.instants[index]
        if index > system.now:
            found[instant] = 2 * index
        if instant <= LAST:
            found.setdefault(instant + SECOND, 2 * index + 1)
            if instant in excluded:
                earlier[instant + SECOND] = (
                    instant if not instant.microsecond else instant.replace(microsecond=0) + SECOND
                )
        if instant in local:
            for each in (instant, instant + SECOND) if instant <= LAST else (instant,):
                earlier[each] = max(at, each - ANY_ZONE)
    for enclave in keystore.enclaves:
        for revocations in lists_carried(enclave):
            boundaries = [revocations.this_update] if revocations.this_update > at else []
            if revocations.next_update is not None and at <= revocations.next_update <= LAST:
                boundaries.append(revocations.next_update + SECOND)
            for later in boundaries:
                before = sum(1 for instant in system.instants if instant <= later)
                found.setdefault(later, 2 * before - 1)
    moments = [(moment, instant, earlier.get(instant, instant)) for instant, moment in found.items()]
    return sorted(moments, key=lambda each: (each[2], each[1]))


def _usability_change(
    asked: Iterable[Enclave], before: Mapping[tuple[str, str], Usability], after: Mapping[tuple[str, str], Usability]
) -> str:
    changed = sorted({directory for (directory, profile), now in after.items() if before[directory, profile] != now})
    if not changed:
        return ""
    names = {enclave.files.directory: enclave.path for enclave in asked}
    fresh = (
        reason
        for key, now in after.items()
        if key[0] == changed[0]
        for reason in now.reasons
        if reason not in before[key].reasons
    )
    reason = next(fresh, "it can start")
    return f"{some([names[directory] for directory in changed], 1)}: {reason}"


def _status_change(before: Mapping[str, Answer], after: Mapping[str, Status]) -> str:
    # What behaviour rests on is the rights, whose changes are looked at by themselves.
    changed = [property_id for property_id, status in after.items() if before[property_id].status is not status]
    return f"{changed[0]}: {after[changed[0]].value}" if changed else ""
