"""Dates that implementations may read differently, and strategies that make more of them."""

from __future__ import annotations

from datetime import datetime, timedelta

from hypothesis import strategies as st

ORDINARY = "2026-12-01T12:00:00"

TEXTS = (
    # Zones and fractions.
    *(ORDINARY + behind for behind in ("", "Z", "z", "+05:30", "-00:00", "+12:00", "-12:00", "+12:01", "-12:01")),
    *(ORDINARY + behind for behind in ("+13:00", "-13:00", "+14:00", "-14:00", "+14:01", "+01:60", "+1:00", "+0100")),
    *(ORDINARY + behind for behind in (".5", ".0", ".5Z", ".5+01:00", ".", ".9999999999", ".999999999999")),
    *(ORDINARY + behind for behind in (".9999999999999", ".0000000001", ".0000000005", "+01", "Z01:00", "foo", ":00")),
    # The time of day.
    *(f"2026-12-01T{clock}" for clock in ("23:59:59", "24:00:00", "24:00:01", "25:00:00", "12:60:00", "12:00:60")),
    *(f"2026-12-01T{clock}" for clock in ("12:00:61", "12:00:75", "1:2:3", "12:3:04", "12:00:5", "12:00:5Z")),
    *(f"2026-12-01T{clock}" for clock in ("", "1", "12", "12:", "12:3", "12:30", "12:30:", " 12:00:00", "12: 00:00")),
    *("2026-12-01t12:00:00", "2026-12-01 12:00:00", "2026-12-01T12.00.00", "20261201T120000", "2026/12/01T12:00:00"),
    # The day.
    *(
        f"{day}T12:00:00"
        for day in ("2026-02-29", "2026-02-30", "2026-02-31", "2028-02-29", "2100-02-29", "2026-04-31")
    ),
    *(f"{day}T12:00:00" for day in ("2026-11-32", "2026-11-00", "2026-13-11", "2026-00-11", "2026-1-11", "2026-12-1")),
    *(f"{day}T12:00:00" for day in ("2026-12- 1", "2026-12-\t1", "2026-12-  1", "2026- 12-01", "2026 -12-01")),
    *("2026-12-01", "2026-12-1", "2026-12- 1", "2026-12-011", "2026-12", "2026-1", "2026-12-", "2026", "2026-", "202"),
    *("2026-12-01foo", "2026-12-01Z", "2026-12-01 ", "2026-336T12:00:00", "now", "1764590400"),
    # Years.
    *(f"{year}-12-01T12:00:00" for year in ("26", "99", "126", "0126", "0000", "0001", "-0001", "-2026", "+2026")),
    *(f"{year}-12-01T12:00:00" for year in ("12026", "1960", "2038", "2100", "2200", "2261", "2263", "2400", "9998")),
    *("1969-12-31T23:59:59", "1970-01-01T00:00:00", "1970-01-01T00:00:01", "1970-01-01T01:00:00+01:00"),
    *("1970-01-01T01:00:01+01:00", "1969-12-31T23:00:00-01:00", "2038-01-19T03:14:08", "9999-12-31T23:59:59"),
    *("2100-03-01T00:00:00", "2200-03-01T00:00:00", "9999-12-31T23:59:60", "2262-04-11T23:47:15.9999999999"),
    *("2262-04-11T23:47:16", "2262-04-11T23:47:16.8", "2262-04-11T23:47:16.9", "2262-04-11T23:47:17"),
    *("2262-04-11T22:00:00-01:00", "2262-04-11T23:00:00-01:00", "2262-04-12T00:00:00+01:00"),
    # Daylight saving time: begins, ends, and lasts, in Europe and in America.
    *(
        "2026-03-29T02:30:00",
        "2026-10-25T02:30:00",
        "2026-07-01T12:00:00",
        "2026-03-08T02:30:00",
        "2026-11-01T01:30:00",
    ),
    # Blanks round it, and signs that only look like digits.
    *(
        f" {ORDINARY}",
        f"\t{ORDINARY}",
        f"\n{ORDINARY}",
        f"{ORDINARY} ",
        f"{ORDINARY}\n",
        f"\N{NO-BREAK SPACE}{ORDINARY}",
    ),
    *(f"{ORDINARY}\N{NO-BREAK SPACE}", "\N{FULLWIDTH DIGIT TWO}026-12-01T12:00:00", " ", ""),
)

_ZONES = st.one_of(
    st.sampled_from(("", "", "Z")),
    st.builds(
        "{}{:02}:{:02}".format, st.sampled_from("+-"), st.integers(0, 15), st.sampled_from((0, 0, 15, 30, 45, 59, 60))
    ),
)
_FRACTIONS = st.one_of(st.just(""), st.just(""), st.from_regex(r"\.[059]{0,14}", fullmatch=True))


def near(now: datetime, hours: int) -> st.SearchStrategy[str]:
    """Dates around `now`, most of them xs:dateTime."""
    return st.builds(
        lambda passed, midnight, fraction, zone: (
            _written(now + timedelta(seconds=passed), midnight=midnight) + fraction + zone
        ),
        st.one_of(st.integers(-90, 90), st.integers(-3600 * hours, 3600 * hours)),
        st.sampled_from((False,) * 9 + (True,)),
        _FRACTIONS,
        _ZONES,
    )


def _written(moment: datetime, *, midnight: bool) -> str:
    return f"{moment:%Y-%m-%dT%H:%M:%S}" if not midnight else f"{moment:%Y-%m-%d}T24:00:00"


def almost() -> st.SearchStrategy[str]:
    """What a small change makes of a date."""
    return st.builds(
        lambda text, place, length, instead: text[:place] + instead + text[place + length :],
        st.sampled_from((ORDINARY, f"{ORDINARY}Z", f"{ORDINARY}.5-08:00", "2028-02-29T23:59:59", "2026-12-01")),
        st.integers(0, 26),
        st.integers(0, 3),
        st.text(" 0123456789-:TtZz+.\t", max_size=3),
    )
