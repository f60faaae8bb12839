"""When what holds: certificates, grants and revocation lists on one axis, with the audit and the end of its answer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from typing import Final

from msgspec import Struct

from keystore_audit.model.tables.periods import Period
from keystore_audit.report.html.element import Html, element, fitted, folded, items, joined, lines, some
from keystore_audit.report.html.sheet import FULL, Sheet
from keystore_audit.text import counted, instant

MAX_ROWS: Final = 40
"""Periods that are drawn: those that end first."""

MAX_NAMES: Final = 200
"""Things that are named in the list of one period."""

WIDTH: Final = 960
LEFT: Final = 300
RIGHT: Final = 130
ROW: Final = 24
TOP: Final = 34
"""In the units of the picture: names to the left, dates to the right, the audit above, years below."""

_LABEL: Final = 40
_YEARS: Final = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
_MONTHS: Final = (1, 3, 6)


class _Axis(Struct, frozen=True):
    """From `start` to `end`; what lies beyond is cut, and drawn so."""

    start: datetime
    end: datetime

    def x(self, moment: datetime) -> float:
        """Where an instant stands, in units of the picture."""
        whole = (self.end - self.start).total_seconds()
        part = (min(max(moment, self.start), self.end) - self.start).total_seconds()
        return round(LEFT + (WIDTH - LEFT - RIGHT) * part / whole, 1)


def timeline(sheet: Sheet, periods: Sequence[Period]) -> Html:
    """Return the picture and, folded, what each of its bars stands for."""
    if not periods:
        return element("p", "Nothing that has dates could be read.", class_="soft")
    report = sheet.report
    shown = _soonest(periods, report.at)
    axis = _axis(report.at, report.safe_until, shown)
    height = TOP + ROW * len(shown) + 22
    drawn = [
        element("title", "When certificates, grants and revocation lists hold"),
        *_ticks(axis, height),
        *(part for number, period in enumerate(shown) for part in _row(axis, number, period, report.at)),
        *_marks(axis, report.at, report.safe_until, height),
    ]
    picture = element("svg", lines(drawn), viewBox=f"0 0 {WIDTH} {height}", role="group", class_="timeline")
    parts = [element("div", picture, class_="wide")]
    if len(periods) > len(shown):
        parts.append(element("p", f"{len(periods) - len(shown)} later dates not drawn. {FULL}", class_="soft"))
    told = [element("li", _words(period), _names(period)) for period in shown]
    parts.append(folded("What the bars stand for", element("ul", lines(told)), class_="space"))
    return joined(parts)


def _soonest(periods: Iterable[Period], at: datetime) -> list[Period]:
    """Those that matter first: not in force, then by end; drawn in the order of their kinds."""
    ordered = sorted(periods, key=lambda p: (p.start <= at, p.end is None, p.end or p.start))
    kept = {id(period) for period in ordered[:MAX_ROWS]}
    return [period for period in periods if id(period) in kept]


def _axis(at: datetime, until: datetime | None, periods: Sequence[Period]) -> _Axis:
    """All dates, but no more than five times the time to the first end that matters, and a year at least."""
    ends = [period.end for period in periods if period.end is not None]
    last = max([*ends, at, *([until] if until is not None else [])])
    if until is not None and until > at:
        last = min(last, _later(at, max(5 * (until - at), timedelta(days=365))))
    first = min([*(period.start for period in periods), at])
    first = max(first, _earlier(at, max(last - at, timedelta(days=365))))
    margin = max((last - first) / 40, timedelta(days=7))
    return _Axis(_earlier(first, margin), _later(last, margin))


def _later(moment: datetime, by: timedelta) -> datetime:
    """Return the instant that much later, or the last that there is."""
    try:
        return moment + by
    except OverflowError:
        return datetime.max.replace(tzinfo=moment.tzinfo)


def _earlier(moment: datetime, by: timedelta) -> datetime:
    try:
        return moment - by
    except OverflowError:
        return datetime.min.replace(tzinfo=moment.tzinfo)


def _ticks(axis: _Axis, height: int) -> Iterator[Html]:
    """A handful of years, or of months."""
    for moment, text in _moments(axis):
        x = axis.x(moment)
        yield element("line", x1=x, y1=TOP, x2=x, y2=height - 18, class_="tick")
        yield element("text", text, x=x, y=height - 5, text_anchor="middle", class_="tick")


def _moments(axis: _Axis) -> Iterator[tuple[datetime, str]]:
    years = (axis.end - axis.start).days / 365.25
    if years > 3:
        step = next((each for each in _YEARS if years / each <= 8), _YEARS[-1])
        for year in range(max(axis.start.year // step * step, step), min(axis.end.year, 9999) + 1, step):
            moment = axis.start.replace(year=year, month=1, day=1, hour=0, minute=0, second=0, microsecond=0)
            if axis.start < moment < axis.end:
                yield moment, str(year)
        return
    months = next((each for each in _MONTHS if years * 12 / each <= 9), _MONTHS[-1])
    for number in range(axis.start.year * 12, axis.end.year * 12 + 12, months):
        year, month = divmod(number, 12)
        moment = axis.start.replace(year=year, month=month + 1, day=1, hour=0, minute=0, second=0, microsecond=0)
        if axis.start < moment < axis.end:
            yield moment, f"{year}-{month + 1:02}"


def _row(axis: _Axis, number: int, period: Period, at: datetime) -> Iterator[Html]:
    """A bar with what it stands for and when it ends; its ends are open where they lie beyond the axis."""
    y = TOP + number * ROW
    state = _state(period, at)
    start, end = axis.x(period.start), axis.x(period.end or axis.end)
    yield element("text", fitted(_short(period), _LABEL), x=LEFT - 10, y=y + 15, text_anchor="end", class_="name")
    yield element("rect", x=start, y=y + 5, width=max(end - start, 2.0), height=ROW - 12, rx=2, class_=f"bar {state}")
    if period.start < axis.start:
        yield element("path", d=f"M{start:g} {y + 5} l-6 6 l6 6 z", class_=f"bar {state}")
    if period.end is None or period.end > axis.end:
        yield element("path", d=f"M{end:g} {y + 5} l6 6 l-6 6 z", class_=f"bar {state}")
    word = {"past": "ended ", "future": "from ", "now": "to "}[state]
    shown = period.start if state == "future" else period.end
    date = f"{word}{instant(shown)[:10]}" if shown is not None else "no end"
    yield element("text", date, x=WIDTH - RIGHT + 14, y=y + 15, class_=f"date {state}")


def _state(period: Period, at: datetime) -> str:
    if period.start > at:
        return "future"
    return "past" if period.end is not None and period.end < at else "now"


def _short(period: Period) -> str:
    if len(period.names) == 1:
        return f"{period.kind.value} {period.names[0]}"
    return counted(len(period.names), period.kind.value)


def _marks(axis: _Axis, at: datetime, until: datetime | None, height: int) -> Iterator[Html]:
    """The audit, and the instant up to which its answer holds."""
    x = axis.x(at)
    yield element("line", x1=x, y1=6, x2=x, y2=height - 18, class_="at")
    near_end = x > WIDTH - 220
    yield element("text", "audit", x=x - 6 if near_end else x + 5, y=14, class_="at", text_anchor=_side(near_end))
    if until is None or until <= at:
        return
    x = axis.x(until)
    yield element("line", x1=x, y1=18, x2=x, y2=height - 18, class_="until")
    yield element("path", d=f"M{x:g} 18 l7 4 l-7 4 z", class_="until")
    near_end = x > WIDTH - 220
    words = f"safe until {instant(until)[:10]}"
    yield element("text", words, x=x - 6 if near_end else x + 10, y=27, class_="until", text_anchor=_side(near_end))


def _side(left: bool) -> str:
    return "end" if left else "start"


def _words(period: Period) -> Html:
    until = "without an end" if period.end is None else f"to {instant(period.end)}"
    head = counted(len(period.names), period.kind.value)
    return element("span", f"{head}: from {instant(period.start)} {until}")


def _names(period: Period) -> Html:
    return items(some(period.names, MAX_NAMES), class_="names")
