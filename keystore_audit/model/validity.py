"""The dates of a grant as instants, as each implementation reads them.

DDS-Security 1.1, 9.4.1.3.2.2: xs:dateTime (W3C XML Schema Part 2, 3.2.7), without a zone UTC. What implementations do
instead was measured on Fast DDS 2.9.1 and Cyclone DDS 0.10.2, with clocks set to the seconds around each date
(tests/oracles/dates). OpenDDS was read in its source.
"""

from __future__ import annotations

import re
from datetime import datetime, timedelta, timezone
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Protocol

from msgspec import Struct

from keystore_audit.errors import UsageError
from keystore_audit.profiles import DateReading
from keystore_audit.truth import Truth

if TYPE_CHECKING:  # most audits are told no zone
    from zoneinfo import ZoneInfo


# Local time as programs take it that ask the C library. Users may name zones.
#
# glibc's `mktime` is what every Linux robot has; it was measured on glibc 2.36 (tests/oracles/dates).


UNREPRESENTABLE: Final = datetime(1969, 12, 31, 23, 59, 59, tzinfo=timezone.utc)
"""What `mktime` returns for a local time that does not exist: -1, if nobody checks whether it is an error."""

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
    two differ where the answer depends on what the process asked before. That is for standard time put back, and for
    daylight saving time that skips a day. Raises OverflowError outside the years 1 to 9999.
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


BEGINNING: Final = datetime.min.replace(tzinfo=timezone.utc)
END: Final = datetime.max.replace(tzinfo=timezone.utc)
"""Before and after everything: what a `datetime` cannot hold is as good as these."""

ANY_ZONE: Final = timedelta(hours=14)
"""How far local time is from UTC at most: Pacific/Kiritimati. To the west it is 12 hours."""

SECOND: Final = timedelta(seconds=1)
"""What dates of X.509 count (RFC 5280, 4.1.2.5): a certificate is void one second after notAfter."""

LAST: Final = END.replace(microsecond=0) - SECOND
"""Beyond, there is no later second: 99991231235959Z means "no expiration" (RFC 5280, 4.1.2.5)."""

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=timezone.utc)
_HOUR: Final = timedelta(hours=1)

_NANOSECONDS: Final = 10**9
_LAST_NANOSECOND: Final = 2**63 - 1
"""The last nanosecond of Cyclone DDS, counted from 1970 on: it belongs to 2262-04-11T23:47:16Z."""

_MAX_DIGITS: Final = 12
"""Most digits of a fraction of a second on Cyclone DDS."""

_BLANKS: Final = " \t\n\v\f\r"
"""White space in C."""

_DATE_TIME: Final = re.compile(
    r"(?P<year>[0-9]{4})-(?P<month>[0-9][0-9])-(?P<day>[0-9][0-9])"
    r"T(?P<hour>[0-9][0-9]):(?P<minute>[0-9][0-9]):(?P<second>[0-9][0-9])(?:\.(?P<fraction>[0-9]+))?"
    r"(?:Z|(?P<sign>[Z+-])(?P<hours>[0-9][0-9]):(?P<minutes>[0-9][0-9]))?"
)
"""Z01:00 is no xs:dateTime: Cyclone DDS reads it as +01:00 (measured)."""

_GET_TIME: Final = re.compile(
    r"[ \t\n\v\f\r]*(?P<year>[0-9]{1,4})"
    r"(?:-(?P<month>[0-9]{1,2})(?:-[ \t\n\v\f\r]?(?P<day>[0-9]{1,2})"
    r"(?:[Tt](?P<hour>[0-9]{1,2}):(?P<minute>[0-9]{1,2}):(?P<second>[0-9]{1,2}).*)?)?)?",
    re.DOTALL,
)
"""`std::get_time` with "%Y-%m-%dT%T", of GCC 12 (measured). A text may end behind each part of the date, and whatever
stands behind the seconds is not looked at."""


class Dated(Struct, frozen=True, kw_only=True):
    """An instant that an implementation takes a date for: aware UTC.

    Where `earliest` and `latest` differ, it depends on what we do not know. `instant` is then what it would be in UTC,
    or one of the two. `readable`: false where the implementation cannot read the text and goes on with `BEGINNING`.
    """

    instant: datetime
    earliest: datetime
    latest: datetime
    readable: bool = True

    @property
    def local(self) -> bool:
        """Whether the instant depends on the robot's zone."""
        return self.earliest != self.latest


class Limited(Protocol):
    """What has a validity, both ends included."""

    @property
    def not_before(self) -> datetime:
        """Its beginning."""

    @property
    def not_after(self) -> datetime:
        """Its end."""


def in_force(limited: Limited, at: datetime) -> bool:
    """Whether the instant is within its validity."""
    return limited.not_before <= at <= limited.not_after


def counts_at(not_before: Dated, not_after: Dated, at: datetime, reading: DateReading) -> Truth:
    """Whether a grant with these dates counts `at` an instant (aware UTC); UNKNOWN: it depends on the robot's zone."""
    if reading in (DateReading.ROBOT_TIME, DateReading.SHIFTED_CLOCK):
        at = at.replace(microsecond=0)  # their clock is `time`, which counts whole seconds
    # Exclusive bounds differ from inclusive ones by the least step of time.
    step = datetime.resolution if reading is DateReading.UNREADABLE_IS_PAST else timedelta()
    begun = _not_later(not_before, _moved(at, -step))
    ended = _not_later(not_after, _moved(at, step - datetime.resolution))
    if begun is Truth.NO or ended is Truth.YES:
        return Truth.NO
    return Truth.UNKNOWN if Truth.UNKNOWN in (begun, ended) else Truth.YES


def _not_later(dated: Dated, than: datetime) -> Truth:
    if dated.latest <= than:
        return Truth.YES
    return Truth.UNKNOWN if dated.earliest <= than else Truth.NO


@lru_cache(maxsize=4096)  # the dates of one keystore are mostly the same two
def read_date(text: str, reading: DateReading, zone: ZoneInfo | None) -> Dated | None:
    """What an implementation takes the text of a not_before or not_after for, on a robot in `zone` (None: unknown).

    None where it refuses the whole document, and for xs:dateTime's years before 1 and after 9999, which the reader of
    permissions lets nobody have.
    """
    match reading:
        case DateReading.XSD:
            return _certain(_xsd(text))
        case DateReading.UNREADABLE_IS_PAST:
            return _unreadable_is_past(text)
        case DateReading.ROBOT_TIME:
            return _robot_time(text, zone)
        case DateReading.SHIFTED_CLOCK:
            return _shifted_clock(text, zone)


def _certain(instant: datetime | None) -> Dated | None:
    return None if instant is None else Dated(instant=instant, earliest=instant, latest=instant)


def _moved(instant: datetime, by: timedelta) -> datetime:
    try:
        return instant + by
    except OverflowError:
        return END if by > timedelta() else BEGINNING


def _xsd(text: str) -> datetime | None:
    """An xs:dateTime of the years 1 to 9999; None for all else."""
    date = _DATE_TIME.fullmatch(text.strip(_BLANKS))
    if date is None or date["sign"] == "Z":
        return None
    midnight = date["hour"] == "24" and not int(date["minute"] + date["second"] + (date["fraction"] or ""))
    offset = _offset(date, timedelta(hours=14))
    try:
        instant = _calendar(date, hour=0 if midnight else int(date["hour"]))
    except ValueError:
        return None
    if offset is None:
        return None
    return _moved(instant, _fraction(date) + timedelta(days=midnight) - offset)


def _calendar(date: re.Match[str], hour: int) -> datetime:
    """The whole seconds as if in UTC. Raises ValueError for what no calendar or clock shows."""
    year, month, day, minute, second = (int(date[part]) for part in ("year", "month", "day", "minute", "second"))
    return datetime(year, month, day, hour, minute, second, tzinfo=timezone.utc)


def _fraction(date: re.Match[str]) -> timedelta:
    """The fraction of a second. Less than a microsecond counts as one: a fraction is never a whole second."""
    digits = date["fraction"] or "0"
    return timedelta(microseconds=int(digits.ljust(6, "0")[:6]) or int(digits.strip("0") != ""))


def _offset(date: re.Match[str], most: timedelta) -> timedelta | None:
    """The zone's distance from UTC; None for more than `most`, and for impossible minutes."""
    if date["sign"] is None:
        return timedelta()
    offset = timedelta(hours=int(date["hours"]), minutes=int(date["minutes"]))
    if date["minutes"] > "59" or offset > most:
        return None
    return -offset if date["sign"] == "-" else offset


def _unreadable_is_past(text: str) -> Dated | None:
    text = text.strip(_BLANKS)
    if not text:
        return None
    date = _DATE_TIME.fullmatch(text)
    nanoseconds = None if date is None else _nanoseconds(date)
    if nanoseconds is None:
        return Dated(instant=BEGINNING, earliest=BEGINNING, latest=BEGINNING, readable=False)
    seconds, rest = divmod(nanoseconds, _NANOSECONDS)
    return _certain(_EPOCH + timedelta(seconds=seconds, microseconds=rest // 1000 or int(rest > 0)))


def _nanoseconds(date: re.Match[str]) -> int | None:
    """Nanoseconds since 1970, as `DDS_Security_parse_xml_date` counts them; None where it reports an error."""
    digits, offset = date["fraction"] or "", _offset(date, 12 * _HOUR)
    try:
        seconds = (_calendar(date, int(date["hour"])) - _EPOCH) // SECOND
    except ValueError:
        return None
    if offset is None or len(digits) > _MAX_DIGITS or not 0 <= seconds <= _LAST_NANOSECOND // _NANOSECONDS:
        return None
    east = offset // SECOND
    if east > 0 and seconds <= east:
        return None
    fraction = int(digits[:9].ljust(9, "0")) + int(digits[9:10] >= "5")
    nanoseconds = (seconds - east) * _NANOSECONDS + fraction
    return nanoseconds if nanoseconds <= _LAST_NANOSECOND else None


def _robot_time(text: str, zone: ZoneInfo | None) -> Dated | None:
    date = _GET_TIME.fullmatch(text)
    if date is None:
        return None
    # What the text does not reach stays 0 in a `struct tm`: January, and the day before the month's first.
    year, month, day = int(date["year"]), int(date["month"] or 1), int(date["day"] or 0)
    hour, minute, second = (int(date[part] or 0) for part in ("hour", "minute", "second"))
    if not 1 <= month <= 12 or hour > 23 or minute > 59 or second > 60:
        return None
    if day > 31 or (day == 0 and date["day"] is not None):
        return None
    if year == 0:
        return _certain(BEGINNING)
    try:
        # The 30th of February is the day after the 29th.
        passed = timedelta(days=day - 1, hours=hour, minutes=minute, seconds=second)
        return _in_zone(datetime(year, month, 1, tzinfo=timezone.utc) + passed, zone)
    except OverflowError:
        return _certain(END if year > 1 else BEGINNING)


def _in_zone(local: datetime, zone: ZoneInfo | None) -> Dated:
    """`local` as if it were UTC."""
    if zone is None:
        return _somewhere(local)
    earliest, latest = mktime(local.replace(tzinfo=None), zone)
    return Dated(instant=latest, earliest=earliest, latest=latest)


def _somewhere(instant: datetime) -> Dated:
    return Dated(instant=instant, earliest=_moved(instant, -ANY_ZONE), latest=_moved(instant, ANY_ZONE))


def _shifted_clock(text: str, zone: ZoneInfo | None) -> Dated | None:
    """Read at 2fea234: `now` is mktime(gmtime(time(0))), and the first instant of 1970 stands for an error."""
    instant = _xsd(text)
    if instant is None or instant == _EPOCH:
        return None
    instant = instant.replace(microsecond=0)
    if zone is None:
        return _somewhere(instant)
    try:
        return _certain(instant + standard_offset(instant, zone))
    except OverflowError:
        return _certain(instant)
