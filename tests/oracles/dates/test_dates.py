"""Our reading of a grant's dates against the plugins of those who read them.

The plugins run with a clock that the tests set (set_clock.c), in processes of several zones: so each date is asked
about at the very seconds where our reading says that the answer changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import datetime, timedelta, timezone
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from keystore_audit.model.validity import BEGINNING, Dated, counts_at, read_date
from keystore_audit.profiles import DateReading
from keystore_audit.truth import Truth
from tests.amount import tried
from tests.oracles.dates.clock import EPOCH, MALFORMED, ClockedPlugin, clocked, seconds
from tests.oracles.dates.texts import TEXTS, almost, near
from tests.oracles.xml.parsers import require_measured_versions

pytestmark = pytest.mark.xdist_group("date-oracle")

ZONES = ("UTC", "Asia/Tokyo", "America/Los_Angeles", "Pacific/Kiritimati", "Europe/Berlin", "Europe/Dublin")
ASKED = [*(("fastdds", zone) for zone in ZONES), ("cyclone", "UTC"), ("cyclone", "Pacific/Kiritimati")]
NOW = datetime(2026, 11, 21, 10, 0, tzinfo=timezone.utc)

READINGS = {"fastdds": DateReading.ROBOT_TIME, "cyclone": DateReading.UNREADABLE_IS_PAST}
LONG_AGO = {"fastdds": "1950-01-01T00:00:00", "cyclone": "1970-01-01T00:00:00"}
AT_LAST = {"fastdds": "9999-12-30T00:00:00", "cyclone": "2262-04-11T23:47:16"}
CLOCK = {"fastdds": (-600_000_000, 253_000_000_000), "cyclone": (10, 9_223_372_034)}
"""What the clock can show: certificates are good from 1950 to 9999, and Cyclone DDS counts as its dates do."""


@pytest.fixture(scope="module")
def plugins(
    oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[tuple[str, str], ClockedPlugin]]:
    require_measured_versions(oracle)
    with clocked(oracle, tmp_path_factory.mktemp("clocked"), ASKED) as running:
        yield running


def of_interest(vendor: str, dated: Dated | None) -> set[int]:
    """Seconds at which a date decides, and others."""
    first, last = CLOCK[vendor]
    times = {first, seconds(NOW), last}
    for instant in (dated.earliest, dated.latest) if dated is not None else ():
        times.update(min(max(seconds(instant) + step, first), last) for step in (-1, 0, 1, 2))
    return times


def agree(plugin: ClockedPlugin, vendor: str, zone: str, text: str) -> bool:
    """Whether the implementation reads the text as a date at all, after comparing everything it does with it."""
    reading, there = READINGS[vendor], ZoneInfo(zone)
    dated = read_date(text, reading, there)
    begin, end = (read_date(other[vendor], reading, there) for other in (LONG_AGO, AT_LAST))
    assert begin is not None
    assert end is not None
    for second in sorted(of_interest(vendor, dated)):
        at = EPOCH + timedelta(seconds=second)
        for not_before, not_after, validity in (
            (text, AT_LAST[vendor], (dated, end)),
            (LONG_AGO[vendor], text, (begin, dated)),
        ):
            refused = plugin.refusal(not_before, not_after, second)
            malformed = refused is not None and any(word in refused for word in MALFORMED)
            assert malformed == (dated is None), (text, refused)
            if validity[0] is not None and validity[1] is not None:
                expected = counts_at(validity[0], validity[1], at, reading)
                assert expected is Truth(refused is None), (not_before, not_after, at, refused)
    return dated is not None and dated.readable


@pytest.mark.parametrize(("vendor", "zone"), ASKED)
def test_each_form_is_read_as_the_vendor_does(
    plugins: dict[tuple[str, str], ClockedPlugin], vendor: str, zone: str
) -> None:
    read = [agree(plugins[vendor, zone], vendor, zone, text) for text in TEXTS]
    assert len(read) > 120
    assert sum(read) >= 35


@settings(max_examples=tried(60))
@given(text=near(NOW, 40))
@pytest.mark.parametrize(("vendor", "zone"), ASKED)
def test_dates_near_the_present(
    plugins: dict[tuple[str, str], ClockedPlugin], vendor: str, zone: str, text: str
) -> None:
    agree(plugins[vendor, zone], vendor, zone, text)


@settings(max_examples=tried(200))
@given(text=almost())
@pytest.mark.parametrize(("vendor", "zone"), [("fastdds", "Europe/Berlin"), ("cyclone", "UTC")])
def test_what_is_almost_a_date(
    plugins: dict[tuple[str, str], ClockedPlugin], vendor: str, zone: str, text: str
) -> None:
    agree(plugins[vendor, zone], vendor, zone, text)


@settings(max_examples=tried(100))
@given(
    text=st.datetimes(datetime(1971, 1, 1), datetime(2261, 1, 1)).map(lambda moment: f"{moment:%Y-%m-%dT%H:%M:%S}"),
    zone=st.sampled_from(ZONES),
)
def test_any_time_of_any_year(plugins: dict[tuple[str, str], ClockedPlugin], text: str, zone: str) -> None:
    assert agree(plugins["fastdds", zone], "fastdds", zone, text)


def test_a_grant_that_cyclone_cannot_date_is_in_force_before_it_begins(
    plugins: dict[tuple[str, str], ClockedPlugin],
) -> None:
    plugin = plugins["cyclone", "UTC"]
    for start in ("2263-01-01T00:00:00", "2030-01-01T24:00:00", "2030-01-01T00:00:00+13:00"):
        assert plugin.refusal(start, AT_LAST["cyclone"], seconds(NOW)) is None
        dated = read_date(start, DateReading.UNREADABLE_IS_PAST, None)
        assert dated is not None
        assert (dated.instant, dated.readable) == (BEGINNING, False)


def test_fastdds_does_not_say_which_date_is_to_blame(plugins: dict[tuple[str, str], ClockedPlugin]) -> None:
    plugin = plugins["fastdds", "UTC"]
    early = plugin.refusal("2030-01-01T00:00:00", "2031-01-01T00:00:00", seconds(NOW))
    late = plugin.refusal("2020-01-01T00:00:00", "2021-01-01T00:00:00", seconds(NOW))
    assert early is not None
    assert "Not found the identity subject name" in early
    assert early == late


@pytest.mark.parametrize("hours", [-15, -10, -8, -1, 1, 8, 10, 15])
def test_the_clock_of_the_machine_shows_the_same(real: dict[tuple[str, str], ClockedPlugin], hours: int) -> None:
    """Without set_clock.c; half an hour from every boundary."""
    now = datetime.now(timezone.utc)
    text = f"{now + timedelta(hours=hours, minutes=30):%Y-%m-%dT%H:%M:%S}"
    for (vendor, zone), plugin in real.items():
        dated = read_date(text, READINGS[vendor], ZoneInfo(zone))
        assert dated is not None
        begun = plugin.refusal(text, AT_LAST[vendor], 0) is None
        assert begun == (dated.instant < now), (vendor, zone)
        assert (plugin.refusal(LONG_AGO[vendor], text, 0) is None) == (not begun), (vendor, zone)


@pytest.fixture(scope="module")
def real(
    oracle: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[tuple[str, str], ClockedPlugin]]:
    asked = [("fastdds", "Asia/Tokyo"), ("fastdds", "America/Los_Angeles"), ("cyclone", "Asia/Tokyo")]
    with clocked(oracle, tmp_path_factory.mktemp("real"), asked, settable=False) as running:
        yield running
