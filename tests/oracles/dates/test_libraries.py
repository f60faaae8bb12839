"""Our reading of dates against the functions that the vendors call: the C library's, and Cyclone DDS's own."""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta, timezone
from zoneinfo import ZoneInfo, available_timezones

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from keystore_audit.model.validity import mktime, read_date
from keystore_audit.profiles import DateReading
from tests.amount import tried
from tests.conftest import lacking
from tests.oracles.dates.clock import EPOCH, seconds
from tests.oracles.dates.texts import TEXTS, almost, near
from tests.oracles.xml.parsers import require_measured_versions

pytestmark = pytest.mark.xdist_group("date-oracle")

ZONES = tuple(sorted(available_timezones() - {"localtime", "Factory"}))
NOW = datetime(2026, 11, 21, 10, 0, tzinfo=timezone.utc)
INVALID = -(2**63)
MICROSECOND = 1000


class BrokenDownTime(ctypes.Structure):
    """glibc's struct tm."""

    _fields_ = [
        *(
            (f"tm_{name}", ctypes.c_int)
            for name in ("sec", "min", "hour", "mday", "mon", "year", "wday", "yday", "isdst")
        ),
        ("tm_gmtoff", ctypes.c_long),
        ("tm_zone", ctypes.c_char_p),
    ]


@pytest.fixture(scope="module")
def libc() -> Iterator[ctypes.CDLL]:
    """Its `mktime` and `gmtime_r`; the zone of this process is as before afterwards."""
    library = ctypes.CDLL(None)
    library.mktime.restype = library.timegm.restype = ctypes.c_int64
    before = os.environ.get("TZ")
    yield library
    if before is None:
        os.environ.pop("TZ", None)
    else:
        os.environ["TZ"] = before
    time.tzset()


def libc_mktime(libc: ctypes.CDLL, local: datetime, zone: str) -> datetime:
    """As Fast DDS calls it: tm_isdst is 0."""
    os.environ["TZ"] = zone
    time.tzset()
    date = (local.second, local.minute, local.hour, local.day, local.month - 1, local.year - 1900)
    return EPOCH + timedelta(seconds=libc.mktime(ctypes.byref(BrokenDownTime(*date, 0, 0, 0))))


@settings(max_examples=tried(3000))
@given(
    local=st.one_of(
        st.datetimes(datetime(2026, 1, 1), datetime(2030, 1, 1)),
        st.datetimes(datetime(1970, 1, 3), datetime(2200, 1, 1)),
    ),
    zone=st.sampled_from(ZONES),
)
@example(local=datetime(2026, 3, 29, 2, 30), zone="Europe/Berlin")
@example(local=datetime(2026, 10, 25, 2, 30), zone="Europe/Berlin")
@example(local=datetime(2026, 7, 1, 12, 0), zone="Europe/Berlin")
@example(local=datetime(2026, 1, 1, 12, 0), zone="Europe/Dublin")
@example(local=datetime(2016, 7, 1, 12, 0), zone="Europe/Istanbul")
@example(local=datetime(2014, 10, 26, 1, 30), zone="Europe/Moscow")
@example(local=datetime(2011, 12, 30, 12, 0), zone="Pacific/Apia")
@example(local=datetime(1994, 12, 31, 12, 0), zone="Pacific/Kiritimati")
@example(local=datetime(2018, 5, 4, 23, 45), zone="Asia/Pyongyang")
def test_local_time_is_what_the_c_library_makes_of_it(libc: ctypes.CDLL, local: datetime, zone: str) -> None:
    local = local.replace(microsecond=0)
    assert libc_mktime(libc, local, zone) in mktime(local, ZoneInfo(zone))


@pytest.mark.parametrize("zone", ["Europe/Berlin", "America/Los_Angeles", "Europe/Dublin", "Australia/Lord_Howe"])
def test_every_half_hour_of_a_year(libc: ctypes.CDLL, zone: str) -> None:
    times = [datetime(2026, 1, 1) + timedelta(minutes=30 * count) for count in range(2 * 24 * 365)]
    there = ZoneInfo(zone)
    wrong = [local for local in times if mktime(local, there) != (libc_mktime(libc, local, zone),) * 2]
    assert wrong == []


@settings(max_examples=tried(1500))
@given(instant=st.datetimes(datetime(2026, 1, 1), datetime(2035, 1, 1)), zone=st.sampled_from(ZONES))
def test_the_clock_of_opendds(libc: ctypes.CDLL, instant: datetime, zone: str) -> None:
    """mktime(gmtime(t)), as its source has it, comes to the date at the second that we name, and not before."""
    instant = instant.replace(microsecond=0)
    dated = read_date(f"{instant:%Y-%m-%dT%H:%M:%S}Z", DateReading.SHIFTED_CLOCK, ZoneInfo(zone))
    assert dated is not None
    date = instant.replace(tzinfo=timezone.utc)
    then = dated.instant.replace(tzinfo=None)
    assert libc_mktime(libc, then, zone) == date
    assert libc_mktime(libc, then - timedelta(seconds=1), zone) < date


@pytest.fixture(scope="module")
def parse_xml_date(oracle: Callable[[str], str]) -> Callable[[str], int]:
    """Cyclone DDS's `DDS_Security_parse_xml_date`: nanoseconds since 1970."""
    require_measured_versions(oracle)
    try:
        function = ctypes.CDLL("libddsc.so").DDS_Security_parse_xml_date
    except (OSError, AttributeError) as missing:
        lacking(str(missing))
    function.restype = ctypes.c_int64
    return lambda text: int(function(text.encode()))


@settings(max_examples=tried(4000))
@given(
    text=st.one_of(near(NOW, 40), near(datetime(2262, 4, 11, 23, 47, 16), 1), near(datetime(1970, 1, 1), 1), almost())
)
def test_cyclonedds_counts_the_same_nanoseconds(parse_xml_date: Callable[[str], int], text: str) -> None:
    assert_same_nanoseconds(parse_xml_date, text)


def test_each_form_on_cyclonedds(parse_xml_date: Callable[[str], int]) -> None:
    for text in TEXTS:
        assert_same_nanoseconds(parse_xml_date, text)


def assert_same_nanoseconds(parse_xml_date: Callable[[str], int], text: str) -> None:
    """Its XML parser takes blanks away before."""
    bare = text.strip(" \t\n")
    dated = read_date(text, DateReading.UNREADABLE_IS_PAST, None)
    if not bare:
        assert dated is None
        return
    assert dated is not None
    expected = parse_xml_date(bare)
    assert dated.readable == (expected != INVALID)
    if dated.readable:
        difference = seconds(dated.instant) * 10**9 + dated.instant.microsecond * MICROSECOND - expected
        assert -MICROSECOND < difference < MICROSECOND
        assert (dated.instant.microsecond == 0) == (expected % 10**9 == 0)
