"""Dates of grants, against lxml's xs:dateTime and what the vendors were measured to do (tests/oracles/dates)."""

from __future__ import annotations

import re
import time
from datetime import datetime, timedelta, timezone
from zoneinfo import ZoneInfo, available_timezones

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from keystore_audit.errors import UsageError
from keystore_audit.model.validity import BEGINNING, END, counts_at, read_date, time_zone
from keystore_audit.profiles import DateReading
from keystore_audit.truth import Truth

SCHEMA = etree.XMLSchema(
    etree.fromstring(
        '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"><xs:element name="d" type="xs:dateTime"/></xs:schema>'
    )
)


@given(
    st.datetimes(min_value=datetime(1, 1, 3), max_value=datetime(9999, 12, 29)),
    st.integers(-12 * 60, 12 * 60),
)
def test_every_offset_names_the_same_instant(instant: datetime, minutes: int) -> None:
    instant = instant.replace(microsecond=0)
    zone = timezone(timedelta(minutes=minutes))
    text = instant.replace(tzinfo=timezone.utc).astimezone(zone).isoformat()
    if len(text) == 25:
        dated = read_date(text, DateReading.XSD, None)
        assert dated is not None
        assert dated.instant == instant.replace(tzinfo=timezone.utc)


def instant(text: str) -> datetime:
    return datetime.fromisoformat(text).replace(tzinfo=timezone.utc)


@pytest.mark.parametrize("reading", [DateReading.ROBOT_TIME, DateReading.SHIFTED_CLOCK])
def test_no_zone_is_outside_of_what_an_unknown_one_may_be(reading: DateReading) -> None:
    zones = sorted(available_timezones() - {"localtime", "Factory"})
    assert len(zones) > 300
    for zone in zones:
        for text in ("2026-01-15T12:00:00", "2026-07-15T12:00:00"):
            somewhere, there = read_date(text, reading, None), read_date(text, reading, time_zone(zone))
            assert somewhere is not None
            assert there is not None
            assert (somewhere.local, there.local) == (True, False)
            assert somewhere.earliest <= there.instant <= somewhere.latest


def test_the_zone_of_this_machine_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor do the names that stand for it."""
    before = [read_date(date, reading, None) for date in DATES for reading in DateReading]
    for name in ("localtime", "posixrules", "Factory", "right/UTC", "posix/UTC"):
        with pytest.raises(UsageError):
            time_zone(name)
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    try:
        read_date.cache_clear()
        assert [read_date(date, reading, None) for date in DATES for reading in DateReading] == before
    finally:
        monkeypatch.undo()
        time.tzset()


DATES = ("2026-11-21T10:00:00", "2026-07-21T10:00:00Z", "2026-11-21T24:00:00", "2026-11-21")


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("Europe/Berln", "Did you mean Europe/Berlin?"),
        ("europe/berlin", "Did you mean Europe/Berlin?"),
        ("Berlin", "Expected a name"),
        ("Europe", "Expected a name"),
        ("../UTC", "Expected a name"),
        ("/etc/localtime", "Expected a name"),
        ("", "Expected a name"),
        ("Europe/Berlin\0", "Expected a name"),
        ("Europe/Bérlin", "Expected a name"),
    ],
)
def test_an_unknown_zone_is_a_wrong_call(name: str, nearest: str) -> None:
    with pytest.raises(UsageError, match=re.escape(nearest)):
        time_zone(name)


def test_a_machine_may_lack_the_database(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zoneinfo.available_timezones", set)
    with pytest.raises(UsageError, match="no time zone database"):
        time_zone("Mars/Olympus")


FRACTION = timedelta(microseconds=250000)


@pytest.mark.parametrize(
    ("reading", "at_first", "at_last", "within_last_second"),
    [
        (DateReading.XSD, True, True, False),
        (DateReading.ROBOT_TIME, True, True, True),
        (DateReading.SHIFTED_CLOCK, True, True, True),
        (DateReading.UNREADABLE_IS_PAST, False, False, False),
    ],
)
def test_the_bounds(reading: DateReading, at_first: bool, at_last: bool, within_last_second: bool) -> None:
    utc = time_zone("UTC")
    dates = [read_date(text, reading, utc) for text in ("2026-11-21T10:00:00", "2026-11-21T11:00:00")]
    start, end = (dated for dated in dates if dated is not None)
    assert counts_at(start, end, start.instant, reading).must is at_first
    assert counts_at(start, end, end.instant, reading).must is at_last
    assert counts_at(start, end, end.instant + FRACTION, reading).must is within_last_second
    assert counts_at(start, end, start.instant - FRACTION, reading) is Truth.NO
    assert counts_at(start, end, start.instant + FRACTION, reading) is Truth.YES
    assert counts_at(start, end, end.instant - FRACTION, reading) is Truth.YES


def asked(texts: list[str], at: datetime, reading: DateReading, zone: ZoneInfo | None) -> Truth:
    start, end = (read_date(text, reading, zone) for text in texts)
    assert start is not None
    assert end is not None
    return counts_at(start, end, at, reading)


@given(
    start=st.datetimes(datetime(2026, 1, 1), datetime(2026, 1, 5)),
    length=st.integers(0, 200),
    passed=st.integers(-40, 240),
    zone=st.sampled_from(("UTC", "Pacific/Kiritimati", "America/Los_Angeles", "Etc/GMT+12", "Asia/Kolkata")),
    reading=st.sampled_from(list(DateReading)),
)
def test_what_is_certain_without_the_zone_is_so_in_every_zone(
    start: datetime, length: int, passed: int, zone: str, reading: DateReading
) -> None:
    texts = [f"{date:%Y-%m-%dT%H:%M:%S}" for date in (start, start + timedelta(hours=length))]
    at = (start + timedelta(hours=passed)).replace(tzinfo=timezone.utc)
    answer = asked(texts, at, reading, None)
    there = asked(texts, at, reading, time_zone(zone))
    assert there is not Truth.UNKNOWN
    assert answer in (Truth.UNKNOWN, there)


@given(
    st.builds(
        "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}{}{}".format,
        st.one_of(st.just(2026), st.integers(1, 9999)),
        *(st.integers(0, 13), st.integers(0, 32), st.integers(0, 25)),
        *(st.one_of(st.just(0), st.integers(0, 61)), st.one_of(st.just(0), st.integers(0, 61))),
        st.sampled_from(("", "", ".0", ".5", ".", ".1234567890123456")),
        st.sampled_from(("", "Z", "z", "+14:00", "-14:00", "+14:01", "-13:59", "+00:60", "-15:00", "Z01:00")),
    )
)
def test_the_standard_reading_takes_just_what_the_schema_takes(text: str) -> None:
    element = etree.Element("d")
    element.text = text
    assert (read_date(text, DateReading.XSD, None) is not None) == SCHEMA.validate(element)


@given(st.text("0123456789-:TtZ+. \t", max_size=30), st.sampled_from(list(DateReading)))
def test_every_text_has_an_answer(text: str, reading: DateReading) -> None:
    for zone in (None, time_zone("Europe/Berlin")):
        dated = read_date(text, reading, zone)
        assert dated is None or dated.earliest <= dated.instant <= dated.latest


@pytest.mark.parametrize("reading", list(DateReading))
@pytest.mark.parametrize("zone", [None, "Pacific/Kiritimati", "Etc/GMT+12"])
def test_the_ends_of_time(reading: DateReading, zone: str | None) -> None:
    there = None if zone is None else time_zone(zone)
    for text in ("0001-01-01T00:00:00", "9999-12-31T23:59:59", "9999-12-31T23:59:60", "0000-01-01T00:00:00"):
        for suffix in ("", "+12:00", "-12:00"):
            dated = read_date(text + suffix, reading, there)
            assert dated is None or BEGINNING <= dated.earliest <= dated.latest <= END


@pytest.mark.parametrize(
    ("text", "zone", "expected"),
    [
        ("2026-11-21T10:00:00Z", "Asia/Tokyo", "2026-11-21T01:00:00"),
        ("2026-11-21T10:00:00+05:00", "America/Los_Angeles", "2026-11-21T18:00:00"),
        ("2026-11-21T10:00:00", "Pacific/Kiritimati", "2026-11-20T20:00:00"),
        ("2026-07-01T12:00:00", "Europe/Berlin", "2026-07-01T11:00:00"),  # an hour after what a wall clock shows
        ("2026-03-29T02:30:00", "Europe/Berlin", "2026-03-29T01:30:00"),
        ("2026-10-25T02:30:00", "Europe/Berlin", "2026-10-25T01:30:00"),
        ("2026-11-21", "UTC", "2026-11-21T00:00:00"),
        ("2026-02-30T00:00:00", "UTC", "2026-03-02T00:00:00"),
        ("2018-05-04T23:45:00", "Asia/Pyongyang", "1969-12-31T23:59:59"),  # there was no such time
    ],
)
def test_fastdds_reads_the_standard_time_of_the_robot(text: str, zone: str, expected: str) -> None:
    dated = read_date(text, DateReading.ROBOT_TIME, time_zone(zone))
    assert dated is not None
    assert (dated.instant, dated.local) == (instant(expected), False)
