"""The information flow of each enclave in three columns: from whom samples come, the enclave, whom its own reach."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final

from msgspec import Struct

from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.tables.access_rows import label
from keystore_audit.model.tables.access_table import AccessTable
from keystore_audit.model.tables.neighbours import Neighbourhood, PeerGroup
from keystore_audit.model.tables.overview import Overview
from keystore_audit.report.access_words import namespace
from keystore_audit.report.html.element import Html, element, fitted, folded, joined, lines, name
from keystore_audit.report.html.protection import protected
from keystore_audit.report.html.sheet import Sheet
from keystore_audit.text import counted, shorten, terminal

MAX_PICTURES: Final = 300
"""Enclaves that have a picture."""

MAX_OPEN: Final = 6
"""Enclaves up to which the pictures are seen without a click."""

MAX_BOXES: Final = 10
"""Boxes on each side of one picture."""

MAX_NAMES: Final = 4
"""Topics in one box, and lines of peers."""

ANYBODY: Final = "anybody on the network"
WIDTH: Final = 960
BOX: Final = 336
"""Width of a box, in the units of the picture."""

CENTRE: Final = 184
LINE: Final = 17
PAD: Final = 8
GAP: Final = 10
CHARACTER: Final = 7.3
"""Width of a character of 12 units in the widest of the usual fixed fonts."""

_FIT: Final = int((BOX - 2 * PAD) / CHARACTER)
_NOTE: Final = "only with keys of a compromised enclave"


class _Line(Struct, frozen=True):
    """A line of a box, and its class."""

    text: str
    kind: str


def flows(sheet: Sheet, overview: Overview) -> Html:
    """Return a picture for each enclave, folded; by namespace where there are many."""
    table = overview.access
    if table is None or overview.undrawn:
        words = f"The flows were not drawn: {overview.undrawn} `keystore-audit flow` answers for each."
        return element("p", words, class_="soft")
    shown = overview.neighbourhoods[:MAX_PICTURES]
    ambient = ", ".join(sorted({label(table, number) for number in members(overview.ambient)}))
    intro = (
        f"Samples that pass in one step, in domain {table.domain}, by what peers accept. A solid line is a right; a "
        "dashed one takes keys that a compromised enclave holds. A topic without a remark is encrypted, and both of "
        "its sides need a grant."
    )
    rest = f" Left out: {ambient}, which nearly every node uses." if ambient else ""
    parts = [element("p", intro + rest)]
    parts += _by_namespace([(each, _folded(sheet, table, each)) for each in shown])
    total = len(sheet.report.enclaves)
    if total > len(shown):
        words = f"{counted(total - len(shown), 'more enclave')} not drawn; `keystore-audit flow` answers for each."
        parts.append(element("p", words, class_="soft"))
    return joined(parts)


def _by_namespace(pictures: Sequence[tuple[Neighbourhood, Html]]) -> list[Html]:
    spaces: dict[str, list[Html]] = {}
    for each, picture in pictures:
        spaces.setdefault(namespace(each.path), []).append(picture)
    if len(pictures) <= 24 or len(spaces) == 1:
        return [element("div", lines(picture for _each, picture in pictures), class_="pictures")]
    drawn = (
        folded(
            joined([name(f"{space}/"), f" {counted(len(each), 'enclave')}"]),
            element("div", lines(each), class_="pictures"),
            class_="space",
        )
        for space, each in spaces.items()
    )
    return [element("div", lines(drawn), class_="spaces-list")]


def _folded(sheet: Sheet, table: AccessTable, flow: Neighbourhood) -> Html:
    """One enclave: a line that sums it up, and its picture."""
    sources = _peers(flow.incoming)
    targets = _peers(flow.outgoing)
    summed = f" hears {counted(sources, 'peer')}, is heard by {counted(targets, 'peer')}"
    number = sheet.numbers.get(flow.path)
    anchor = {"id": sheet.anchor("flow", number)} if number is not None else {}
    figure = element("figure", _picture(table, flow), **anchor)
    few = len(sheet.numbers) <= MAX_OPEN
    return folded(joined([name(flow.path), element("span", summed, class_="soft")]), figure, open_=few, class_="flow")


def _peers(groups: Sequence[PeerGroup]) -> int:
    return len({peer for group in groups for peer in group.peers if group.by_right})


def _picture(table: AccessTable, flow: Neighbourhood) -> Html:
    left = [_box(table, group) for group in flow.incoming[:MAX_BOXES]]
    right = [_box(table, group) for group in flow.outgoing[:MAX_BOXES]]
    for groups, boxes, words in ((flow.incoming, left, "sends to it"), (flow.outgoing, right, "hears it")):
        if not groups:
            boxes.append([_Line(f"nobody {words}", "soft")])
        if len(groups) > MAX_BOXES:
            boxes.append([_Line(f"{len(groups) - MAX_BOXES} more not drawn", "soft")])
    rows = _wrapped(flow.path, int((CENTRE - 2 * PAD) / CHARACTER))
    height = max(_height(left), _height(right), _centre_height(rows)) + 8
    middle = height / 2
    solid = [group.by_right for group in flow.incoming], [group.by_right for group in flow.outgoing]
    centre = _centre(rows, middle)
    title = element("title", f"Information flow of {shorten(flow.path, _FIT)}")
    drawn = [
        *_column(left, 0, middle, height, solid[0], bool(flow.incoming)),
        *_column(right, WIDTH - BOX, middle, height, solid[1], bool(flow.outgoing)),
    ]
    box = f"0 0 {WIDTH} {height}"
    return element("svg", title, lines(drawn), centre, viewBox=box, role="group", class_="flowing")


def _height(boxes: Sequence[Sequence[_Line]]) -> int:
    return sum(len(box) * LINE + 2 * PAD + GAP for box in boxes) - GAP


def _column(
    boxes: Sequence[Sequence[_Line]], x: int, middle: float, height: int, by_right: Sequence[bool], linked: bool
) -> Iterator[Html]:
    """The boxes of one side, centred, each with its line to or from the enclave."""
    y = (height - _height(boxes)) / 2
    for number, box in enumerate(boxes):
        tall = len(box) * LINE + 2 * PAD
        drawn = linked and number < len(by_right) and number < MAX_BOXES
        right = drawn and by_right[number]
        if drawn:
            yield _line(x, y + tall / 2, middle, right)
        kind = "box" if right else "box keys" if drawn else "box empty"
        yield element("rect", x=x + 1, y=y, width=BOX - 2, height=tall, rx=4, class_=kind)
        for row, line in enumerate(box):
            at = y + PAD + row * LINE + 12.5
            yield element("text", line.text, x=x + PAD, y=at, class_=line.kind)
        y += tall + GAP


def _line(x: int, y: float, middle: float, right: bool) -> Html:
    """A curve between a box and the enclave, with its head at the end that gets the samples."""
    inner = (WIDTH - CENTRE) / 2
    kind = "hop" if right else "hop keys"
    if x == 0:
        start, end = (float(BOX), y), (inner - 7, middle)
    else:
        start, end = (WIDTH - inner, middle), (float(WIDTH - BOX) - 7, y)
    bend = (end[0] - start[0]) / 2
    near, far = f"{start[0] + bend:g} {start[1]:g}", f"{end[0] - bend:g} {end[1]:g}"
    curve = f"M{start[0]:g} {start[1]:g} C{near} {far} {end[0]:g} {end[1]:g}"
    head = f"{end[0]:g},{end[1] - 4:g} {end[0] + 7:g},{end[1]:g} {end[0]:g},{end[1] + 4:g}"
    return joined([element("path", d=curve, class_=kind), element("polygon", points=head, class_="arrow")])


def _centre_height(rows: Sequence[str]) -> int:
    return len(rows) * LINE + 3 * PAD


def _centre(rows: Sequence[str], middle: float) -> Html:
    """The enclave, its name on as many lines as it needs."""
    tall = _centre_height(rows)
    top = middle - tall / 2
    drawn = [element("rect", x=(WIDTH - CENTRE) / 2, y=top, width=CENTRE, height=tall, rx=6, class_="centre")]
    for number, row in enumerate(rows):
        y = top + PAD * 1.5 + number * LINE + 12.5
        drawn.append(element("text", row, x=WIDTH / 2, y=y, text_anchor="middle", class_="centre"))
    return joined(drawn)


def _wrapped(text: str, fit: int) -> list[str]:
    """The name on at most MAX_NAMES lines, cut before its slashes where it is too long for one."""
    rows = [""]
    for part in re.split("(?=/)", terminal(text)):
        if rows[-1] and len(rows[-1]) + len(part) > fit:
            rows.append("")
        rows[-1] += part
    if len(rows) > MAX_NAMES:
        rows[MAX_NAMES - 1 :] = ["".join(rows[MAX_NAMES - 1 :])]
    return [fitted(row, fit) for row in rows]


def _box(table: AccessTable, group: PeerGroup) -> list[_Line]:
    """The topics, each with what is remarkable about its protection, and whoever is at the other end."""
    found = [_Line(row, "peer") for row in _peer_rows(group)]
    safeguards = table.groups[-1].safeguards
    for number in group.names[:MAX_NAMES]:
        guard = protected(frozenset({safeguards[number]}))
        remark = f" {guard.mark} {guard.remark}" if guard.remark else ""
        room = max(_FIT - len(remark), 16)
        found.append(_Line(fitted(label(table, number), room) + remark, f"topic {guard.kind}"))
    if len(group.names) > MAX_NAMES:
        found.append(_Line(f"and {counted(len(group.names) - MAX_NAMES, 'more topic')}", "soft"))
    if not group.by_right:
        found.append(_Line(_NOTE, "soft"))
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
