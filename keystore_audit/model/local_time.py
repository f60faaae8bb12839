"""Local time as programs take it that ask the C library, and the zones that a user may name.

glibc's `mktime` is what every Linux robot has; it was measured on glibc 2.36 (tests/oracles/dates).
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from functools import lru_cache
from typing import TYPE_CHECKING, Final

from keystore_audit.errors import UsageError

if TYPE_CHECKING:
    from zoneinfo import ZoneInfo

UNREPRESENTABLE: Final = datetime(1969, 12, 31, 23, 59, 59, tzinfo=timezone.utc)
"""What `mktime` returns for a local time that does not exist, -1, when nobody looks whether it is an error."""

_STEP: Final = timedelta(seconds=601_200)
"""The stride in which `mktime` looks for standard time: it is no longer than the shortest such period ever was."""

_STEPS: Final = 446
"""How many strides it looks to either side: half of the longest time that a zone kept the same clock all year round."""

_MACHINE: Final = ("localtime", "posixrules", "Factory")
_SPECIAL: Final = ("right/", "posix/")
"""Entries of zone databases that are this machine's own zone, no zone, or count leap seconds."""


def time_zone(name: str) -> ZoneInfo:
    """The zone of the IANA database that is called `name`; this machine's own zone has no name here.

    Raises UsageError for an unknown name, with the nearest known one, and where the machine has no such database.
    """
    from difflib import get_close_matches
    from zoneinfo import ZoneInfo, available_timezones  # most audits are told no zone

    if name not in _MACHINE and not name.startswith(_SPECIAL) and name.isascii():
        try:
            return ZoneInfo(name)
        except (KeyError, ValueError, OSError):  # unknown; no such key at all ("../UTC"); a directory of zones
            pass
    known = [zone for zone in available_timezones() if zone not in _MACHINE]
    if not known:
        raise UsageError(f"No time zone {name!r}: this machine has no time zone database (Python package tzdata).")
    nearest = get_close_matches(name.casefold(), [zone.casefold() for zone in known], n=1)
    hint = next((f" Did you mean {zone}?" for zone in sorted(known) if zone.casefold() in nearest), "")
    raise UsageError(f"Unknown time zone {name!r}.{hint} Expected a name of the IANA database such as Europe/Berlin.")


def mktime(local: datetime, zone: ZoneInfo) -> tuple[datetime, datetime]:
    """What `mktime` makes of a naive time with `tm_isdst` 0 on a machine in `zone`: aware UTC, earliest and latest.

    The field says that the time is not daylight saving time, in summer too: it is standard time, an hour later. The
    two differ where the answer hangs on what the process had asked before: standard time put back, or daylight saving
    time that skips a day. Raises OverflowError outside the years 1 to 9999.
    """
    readings = [local.replace(tzinfo=zone, fold=fold) for fold in (0, 1)]
    matching = [each for each in readings if _local(each.astimezone(timezone.utc), zone) == local]
    standard = {each.astimezone(timezone.utc) for each in matching or readings if not each.dst()}
    if not matching and len(standard) == 2:
        return UNREPRESENTABLE, UNREPRESENTABLE
    if not standard and matching:
        offset = standard_offset(matching[0].astimezone(timezone.utc), zone)
        standard = {local.replace(tzinfo=timezone.utc) - offset}
    instants = standard or {each.astimezone(timezone.utc) for each in readings}
    return min(instants), max(instants)


@lru_cache(maxsize=4096)
def standard_offset(instant: datetime, zone: ZoneInfo) -> timedelta:
    """How far the standard time of `zone` nearest to `instant` is east of UTC; where it has none, its time then."""
    for steps in range(_STEPS):
        for there in (instant - steps * _STEP, instant + steps * _STEP):
            moment = there.astimezone(zone)
            if not moment.dst():
                return moment.utcoffset() or timedelta()
    return instant.astimezone(zone).utcoffset() or timedelta()


def _local(instant: datetime, zone: ZoneInfo) -> datetime:
    return instant.astimezone(zone).replace(tzinfo=None)
