"""The dates of a grant as instants (xs:dateTime, W3C XML Schema Part 2, 3.2.7)."""

from __future__ import annotations

import re
from datetime import datetime, timedelta, timezone
from functools import lru_cache

_DATE_TIME = re.compile(
    r"(?P<year>[0-9]{4})-(?P<month>[0-9][0-9])-(?P<day>[0-9][0-9])"
    r"T(?P<hour>[0-9][0-9]):(?P<minute>[0-9][0-9]):(?P<second>[0-9][0-9])(?:\.(?P<fraction>[0-9]{1,9})[0-9]*)?"
    r"(?P<zone>Z|[+-][0-9][0-9]:[0-9][0-9])?"
)


@lru_cache(maxsize=4096)  # the dates of one keystore are mostly the same two
def parse_instant(text: str) -> datetime | None:
    """The instant that `text` names, aware UTC.

    Without a zone it is UTC (what sros2 writes and `spec` reads).

    None for whatever is no date of the years 1 to 9999 in the four-digit form, for midnight written as 24:00 and for
    zones beyond 12 hours, which Cyclone DDS takes for expired (measured, 0.10.2): implementations differ about them.
    """
    match = _DATE_TIME.fullmatch(text)
    if match is None:
        return None
    fraction = (match["fraction"] or "").ljust(6, "0")[:6]
    try:
        instant = datetime(
            int(match["year"]),
            int(match["month"]),
            int(match["day"]),
            int(match["hour"]),
            int(match["minute"]),
            int(match["second"]),
            int(fraction or "0"),
            tzinfo=timezone.utc,
        )
        return instant - _offset(match["zone"])
    except (ValueError, OverflowError):
        return None


def _offset(zone: str | None) -> timedelta:
    """The zone's distance from UTC. Raises ValueError beyond 12 hours."""
    if zone is None or zone == "Z":
        return timedelta()
    hours, minutes = int(zone[1:3]), int(zone[4:6])
    if minutes > 59 or hours * 60 + minutes > 12 * 60:
        raise ValueError(zone)
    offset = timedelta(hours=hours, minutes=minutes)
    return -offset if zone[0] == "-" else offset
