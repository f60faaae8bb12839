"""The pictures of a web page, as shapes and texts with their places: when what holds, and who hears whom."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta, timezone
from typing import Any, Final

from keystore_audit.grouped import grouped
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.tables.access_rows import label
from keystore_audit.model.tables.access_table import AccessTable
from keystore_audit.model.tables.overview import Neighbourhood, Overview, PeerGroup, Period
from keystore_audit.report.access_words import namespace, protected, unread
from keystore_audit.text import counted, shorten, terminal

WIDTH: Final = 960
"""Of every picture, in its own units, as all that follows."""

MAX_ROWS: Final = 40
"""Periods that are drawn: those that end first."""

LEFT: Final = 300
RIGHT: Final = 130
ROW: Final = 24
TOP: Final = 34
"""Of a timeline: names to the left, dates to the right, the audit above, years below."""

_LABEL: Final = 40
_FIRST: Final = datetime.min.replace(tzinfo=timezone.utc)
_LAST: Final = datetime.max.replace(tzinfo=timezone.utc)
_YEARS: Final = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
_MONTHS: Final = (1, 3, 6)

MAX_PICTURES: Final = 300
"""Enclaves that have a picture of their information flow."""

MAX_FLAT: Final = 24
"""Pictures up to which they are not folded by namespace."""

MAX_BOXES: Final = 10
"""Boxes on each side of one picture."""

MAX_NAMES: Final = 4
"""Topics in one box, and lines of peers."""

ANYBODY: Final = "anybody on the network"
BOX: Final = 336
CENTRE: Final = 184
"""Widths of boxes: of peers to both sides, and of the enclave between them."""

LINE: Final = 17
PAD: Final = 8
GAP: Final = 10
BASE: Final = 12.5
"""Of boxes: the height of a line, around its lines, between two of them, and where a line's letters stand."""

CHARACTER: Final = 7.3
"""Width of a character of 12 units in the widest of the usual fixed fonts."""

_FIT: Final = int((BOX - 2 * PAD) / CHARACTER)

_Line = tuple[str, str]
"""A line of a box, and its class."""


def fitted(text: str, fit: int) -> str:
    """The text as it is shown in `fit` columns of a picture; beyond ASCII a character may take two."""
    shown = terminal(text)
    return shorten(shown, fit if shown.isascii() else max(fit // 2, 2))


def timeline(periods: Sequence[Period], at: datetime, until: datetime | None) -> Mapping[str, Any]:
    """Certificates, grants and revocation lists on one axis, with the audit and the end of its answer."""
    if not periods:
        return {}
    soonest = sorted(periods, key=lambda p: (p.start <= at, p.end is None, p.end or p.start))[:MAX_ROWS]
    kept = {id(period) for period in soonest}
    shown = [period for period in periods if id(period) in kept]
    axis = _Axis(at, until, shown)
    return {
        "height": TOP + ROW * len(shown) + 22,
        "ticks": axis.ticks(),
        "bars": [_bar(axis, number, period, at) for number, period in enumerate(shown)],
        "at": axis.x(at),
        "until": axis.x(until) if until is not None and until > at else None,
        "safe": until,
        "left_out": len(periods) - len(shown),
        "periods": shown,
    }


class _Axis:
    """From `start` to `end`; what lies beyond is cut, and drawn so."""

    def __init__(self, at: datetime, until: datetime | None, periods: Sequence[Period]) -> None:
        """All dates, but no more than five times the time to the first end that matters, and a year at least."""
        year = timedelta(days=365)
        last = max([period.end for period in periods if period.end is not None] + [at] + [until or at])
        if until is not None and until > at:
            last = min(last, _moved(at, max(5 * (until - at), year)))
        first = max(min([at, *(period.start for period in periods)]), _moved(at, -max(last - at, year)))
        margin = max((last - first) / 40, timedelta(days=7))
        self.start, self.end = _moved(first, -margin), _moved(last, margin)

    def x(self, moment: datetime) -> float:
        """Where an instant stands, in units of the picture."""
        part = (min(max(moment, self.start), self.end) - self.start) / (self.end - self.start)
        return round(LEFT + (WIDTH - LEFT - RIGHT) * part, 1)

    def ticks(self) -> Iterator[tuple[float, str]]:
        """A handful of years, or of months."""
        years = (self.end - self.start).days / 365.25
        by_year = years > 3
        if by_year:
            months = 12 * next((each for each in _YEARS if years / each <= 8), _YEARS[-1])
        else:
            months = next((each for each in _MONTHS if years * 12 / each <= 9), _MONTHS[-1])
        for number in range(self.start.year * 12 // months * months, (self.end.year + 1) * 12, months):
            year, month = divmod(number, 12)
            if 1 <= year <= 9999:
                moment = datetime(year, month + 1, 1, tzinfo=timezone.utc)
                if self.start < moment < self.end:
                    yield self.x(moment), str(year) if by_year else f"{year}-{month + 1:02}"


def _moved(moment: datetime, by: timedelta) -> datetime:
    """The instant that much later or earlier, or the last or first that there is."""
    try:
        return moment + by
    except OverflowError:
        return _LAST if by > timedelta() else _FIRST


def _bar(axis: _Axis, number: int, period: Period, at: datetime) -> Mapping[str, Any]:
    """What it stands for and when it ends; its ends are open where they lie beyond the axis."""
    state = "future" if period.start > at else "past" if period.end is not None and period.end < at else "now"
    kind, names = period.kind.value, period.names
    return {
        "y": TOP + number * ROW,
        "label": fitted(f"{kind} {names[0]}" if len(names) == 1 else counted(len(names), kind), _LABEL),
        "start": axis.x(period.start),
        "end": axis.x(period.end or axis.end),
        "state": state,
        "opens": period.start < axis.start,
        "goes_on": period.end is None or period.end > axis.end,
        "word": {"past": "ended", "future": "from", "now": "to"}[state],
        "date": period.start if state == "future" else period.end,
    }


def flows(overview: Overview, enclaves: int) -> Mapping[str, Any]:
    """A picture for each enclave, by namespace where there are many: from whom samples come, the enclave, whom its own
    reach.
    """
    table = overview.access
    if table is None or overview.undrawn:
        return {"undrawn": overview.undrawn}
    shown = overview.neighbourhoods[:MAX_PICTURES]
    spaces = grouped(shown, lambda each: namespace(each.path))
    if len(shown) <= MAX_FLAT or len(spaces) == 1:
        spaces = {"": [*shown]}
    return {
        "domain": table.domain,
        "unread": unread(table),
        "profiles": table.groups[-1].profiles,
        "ambient": ", ".join(sorted({label(table, number) for number in members(overview.ambient)})),
        "spaces": [(space, [picture(table, each) for each in several]) for space, several in spaces.items()],
        "left_out": max(enclaves - len(shown), 0),
    }


def picture(table: AccessTable, flow: Neighbourhood) -> Mapping[str, Any]:
    """One enclave between those that it hears, to the left, and those that hear it."""
    left, right = _boxes(table, flow.incoming, "sends to it"), _boxes(table, flow.outgoing, "hears it")
    rows = _wrapped(flow.path, int((CENTRE - 2 * PAD) / CHARACTER))
    tall = len(rows) * LINE + 3 * PAD
    height = max(_height(left), _height(right), tall) + 8
    return {
        "path": flow.path,
        "title": shorten(flow.path, _FIT),
        "hears": _peers(flow.incoming),
        "heard": _peers(flow.outgoing),
        "height": height,
        "boxes": [*_placed(left, flow.incoming, 0, height), *_placed(right, flow.outgoing, WIDTH - BOX, height)],
        "tall": tall,
        "rows": rows,
    }


def _peers(groups: Sequence[PeerGroup]) -> int:
    return len({peer for group in groups for peer in group.peers if group.by_right})


def _boxes(table: AccessTable, groups: Sequence[PeerGroup], doing: str) -> list[list[_Line]]:
    """Those of one side; what is not drawn is said in one of its own."""
    boxes = [_box(table, group) for group in groups[:MAX_BOXES]] or [[(f"nobody {doing}", "soft")]]
    return boxes + ([[(f"{len(groups) - MAX_BOXES} more not drawn", "soft")]] if len(groups) > MAX_BOXES else [])


def _height(boxes: Sequence[Sequence[_Line]]) -> int:
    return sum(len(box) * LINE + 2 * PAD + GAP for box in boxes) - GAP


def _placed(
    boxes: Sequence[Sequence[_Line]], groups: Sequence[PeerGroup], x: int, height: int
) -> Iterator[Mapping[str, Any]]:
    """The boxes of one side, centred; each that stands for peers is linked to or from the enclave."""
    y = (height - _height(boxes)) / 2
    for number, box in enumerate(boxes):
        tall = len(box) * LINE + 2 * PAD
        linked = number < min(len(groups), MAX_BOXES)
        by_right = linked and groups[number].by_right
        yield {"x": x, "y": y, "tall": tall, "linked": linked, "by_right": by_right, "lines": box}
        y += tall + GAP


def _wrapped(text: str, fit: int) -> list[str]:
    """The name on at most MAX_NAMES lines, cut before its slashes where it is too long for one."""
    rows = [""]
    for part in re.split("(?=/)", terminal(text)):
        if rows[-1] and len(rows[-1]) + len(part) > fit and len(rows) < MAX_NAMES:
            rows.append("")
        rows[-1] += part
    return [fitted(row, fit) for row in rows]


def _box(table: AccessTable, group: PeerGroup) -> list[_Line]:
    """The topics, each with what is remarkable about its protection, and whoever is at the other end."""
    found = [(row, "peer") for row in _peer_rows(group)]
    safeguards = table.groups[-1].safeguards
    for number in group.names[:MAX_NAMES]:
        guard = protected(frozenset({safeguards[number]}))
        remark = f" {guard.mark} {guard.remark}" if guard.remark else ""
        shown = fitted(label(table, number), max(_FIT - len(remark), 16))
        found.append((shown + remark, f"topic {guard.kind}"))
    if len(group.names) > MAX_NAMES:
        found.append((f"and {counted(len(group.names) - MAX_NAMES, 'more topic')}", "soft"))
    if not group.by_right:
        found.append(("only with keys of a compromised enclave", "soft"))
    return found


def _peer_rows(group: PeerGroup) -> list[str]:
    """The peers, comma by comma, on a few lines."""
    rows = [""]
    for number, peer in enumerate(group.peers):
        shown = ANYBODY if peer is None else fitted(peer, _FIT - 2)
        text = shown + (", " if number + 1 < len(group.peers) else "")
        if rows[-1] and len(rows[-1]) + len(text) > _FIT:
            if len(rows) == MAX_NAMES - 1:
                rows[-1] = shorten(f"{rows[-1]}and {len(group.peers) - number} more", _FIT)
                return rows
            rows.append("")
        rows[-1] += text
    return rows
