"""Grants: which one counts, its subject, its dates and what zone they are in."""

from __future__ import annotations

from tests.keystore.documents import allow, deny, permissions, pub, pubsub, sub
from tests.oracles.vendors.recipe import CHATTER, LAST_YEAR, NEXT_YEAR, Recipe, date, grant

ALLOWS = allow(pubsub("rt/chatter"))
PUBLISHES = allow(pub("rt/chatter"))
SUBSCRIBES = allow(sub("rt/chatter"))
EXPIRED = grant(PUBLISHES, end=date(hours=-48))
EARLY = grant(PUBLISHES, start=date(hours=48))
MINE, OTHERS = grant(SUBSCRIBES), grant(ALLOWS, subject="CN=/listener")


def granted(title: str, *grants: str, time_zone: str = "UTC") -> Recipe:
    """A keystore with these grants."""
    return Recipe(title=title, permissions=permissions(*grants), time_zone=time_zone)


CHOICE = (
    granted("one grant of two", grant(PUBLISHES), MINE),
    granted("a stranger's grant first", OTHERS, MINE),
    granted("a stranger's grant only", OTHERS),
    granted("expired grant first", EXPIRED, MINE),
    granted("early grant first", EARLY, MINE),
    granted("expired grant last", MINE, EXPIRED),
    granted("expired grant only", EXPIRED),
    granted("early grant only", EARLY),
    granted("expired and early, then one that holds", EXPIRED, EARLY, MINE),
    granted("a stranger's expired grant first", grant(ALLOWS, subject="CN=/x", end=date(hours=-48)), MINE),
    granted("a denying grant first", grant(deny(pubsub("*")), PUBLISHES), grant(ALLOWS)),
    granted("a grant without allow rule first", grant(deny(pub("rt/z"))), grant(ALLOWS)),
    granted("a grant without rules first", grant(), grant(ALLOWS)),
    granted("first grant for another domain", grant(allow(pub("*"), domains="<id>9</id>")), grant(ALLOWS)),
    granted("default allow in the second grant", grant(PUBLISHES), grant(PUBLISHES, default="ALLOW")),
    granted("equal names", grant(PUBLISHES, name="x"), grant(SUBSCRIBES, name="x")),
    granted("no name", grant(ALLOWS, name=None)),
    granted("empty name", grant(ALLOWS, name="")),
    granted("many grants", *(grant(PUBLISHES, subject=f"CN=/n{i}") for i in range(60)), MINE),
)


def dated(title: str, start: str, end: str, time_zone: str = "UTC") -> Recipe:
    """A keystore whose grant has these dates, in a process with this TZ."""
    return granted(f"dates: {title}, TZ={time_zone}", grant(ALLOWS, start=start, end=end), time_zone=time_zone)


ZONES = tuple(
    dated(f"{what} {hours:+} h{suffix}", *((LAST_YEAR, when) if what == "end" else (when, NEXT_YEAR)), zone)
    for zone, zone_hours in (
        ("UTC", 0),
        ("Asia/Tokyo", 9),
        ("America/Los_Angeles", -8),
        ("Pacific/Kiritimati", 14),
        ("Etc/GMT+12", -12),
    )
    for what, hours in (
        ("end", zone_hours - 0.5),
        ("end", zone_hours + 0.5),
        ("start", zone_hours - 0.5),
        ("start", zone_hours + 0.5),
    )
    for suffix in ("", "Z")
    for when in (date(hours=hours) + suffix,)
)
OFFSETS = tuple(
    dated(f"end {hours:+} h{offset}", LAST_YEAR, date(hours=hours) + offset, zone)
    for zone in ("UTC", "Asia/Tokyo")
    for hours, offset in (
        (5, "+09:00"),
        (10, "+09:00"),
        (-5, "-08:00"),
        (-9, "-08:00"),
        (0.5, "+00:00"),
        (-0.5, "+00:00"),
        (5, "+12:00"),
        (5, "+13:00"),
        (20, "+14:00"),
        (5, "+14:30"),
        (5, "+0900"),
        (5, "+09"),
        (5, "z"),
        (5, "UTC"),
    )
)


def ends(title: str, end: str, start: str = LAST_YEAR) -> Recipe:
    """A keystore whose grant ends so."""
    return dated(f"end {title}", start, end)


FORMS = (
    ends("with fraction", NEXT_YEAR + ".5"),
    ends("with fraction and Z", NEXT_YEAR + ".123Z"),
    ends("with a long fraction", NEXT_YEAR + ".1234567890123"),
    ends("with an empty fraction", NEXT_YEAR + "."),
    ends("as a date", NEXT_YEAR[:10]),
    ends("as a date and hour", NEXT_YEAR[:13]),
    ends("without seconds", NEXT_YEAR[:16]),
    ends("with a blank for T", NEXT_YEAR.replace("T", " ")),
    ends("with small t", NEXT_YEAR.replace("T", "t")),
    ends("with blanks around", f" {NEXT_YEAR} "),
    ends("with line breaks around", f"\n{NEXT_YEAR}\n"),
    ends("at hour 24", NEXT_YEAR[:10] + "T24:00:00"),
    ends("at second 60", NEXT_YEAR[:17] + "60"),
    ends("at second 61", NEXT_YEAR[:17] + "61"),
    ends("at minute 60", NEXT_YEAR[:14] + "60:00"),
    ends("on 30 February", NEXT_YEAR[:4] + "-02-30T00:00:00"),
    ends("on 29 February of no leap year", "2030-02-29T00:00:00"),
    ends("on 31 April", NEXT_YEAR[:4] + "-04-31T00:00:00"),
    ends("in month 13", NEXT_YEAR[:4] + "-13-01T00:00:00"),
    ends("in month 0", NEXT_YEAR[:4] + "-00-01T00:00:00"),
    ends("with one digit", "2030-1-1T0:0:0"),
    ends("in 2038", "2038-01-20T00:00:00"),
    ends("in 2106", "2106-02-08T00:00:00"),
    ends("before 2262-04-11", "2262-04-11T00:00:00"),
    ends("after 2262-04-11", "2262-04-12T00:00:00"),
    ends("in 2300", "2300-01-01T00:00:00"),
    ends("in 9999", "9999-12-31T23:59:59"),
    ends("in 10000", "10000-01-01T00:00:00"),
    ends("before the start", LAST_YEAR, NEXT_YEAR),
    ends("empty", ""),
    ends("no date", "never"),
    dated("start in 1969", "1969-12-31T00:00:00", NEXT_YEAR),
    dated("start in 1970", "1970-01-01T00:00:00", NEXT_YEAR),
    dated("start in 1900", "1900-01-01T00:00:00", NEXT_YEAR),
    dated("start in year 1", "0001-01-01T00:00:00", NEXT_YEAR),
    dated("start negative", "-0001-01-01T00:00:00", NEXT_YEAR),
    dated("start empty", "", NEXT_YEAR),
    dated("start on 30 February", "2024-02-30T00:00:00", NEXT_YEAR),
    dated("both in the past", "2019-01-01T00:00:00", "2020-01-01T00:00:00"),
    dated("both in the future", "2090-01-01T00:00:00", "2091-01-01T00:00:00"),
)
VALIDITY_ORDER = Recipe(
    title="dates: not_after before not_before",
    permissions=permissions(grant(ALLOWS)).replace(
        f"<not_before>{LAST_YEAR}</not_before><not_after>{NEXT_YEAR}</not_after>",
        f"<not_after>{NEXT_YEAR}</not_after><not_before>{LAST_YEAR}</not_before>",
    ),
    endpoints=CHATTER,
)

RECIPES = (*CHOICE, *ZONES, *OFFSETS, *FORMS, VALIDITY_ORDER)
