"""The picture of a whole system on a web page: enclaves, the topics between them, and which causes are where."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, Final

from msgspec import Struct

from keystore_audit.grouped import gathered, grouped
from keystore_audit.model.tables.access_rows import label
from keystore_audit.model.tables.access_table import AccessTable
from keystore_audit.model.tables.overview import Neighbourhood, Overview
from keystore_audit.properties.result import Step
from keystore_audit.report.access_words import unread
from keystore_audit.report.pictures import fitted
from keystore_audit.report.view_model import Cause, Consequences
from keystore_audit.text import some
from keystore_audit.truth import Truth
from keystore_audit.zenoh.answers import SENDING, RoutedTable

WIDTH: Final = 470
"""Of the picture, in its own units, as all that follows."""

SIDE: Final = 124
MIDDLE: Final = 122
BOX: Final = 19
"""Of boxes: the width of those of enclaves and of topics, and their height."""

NEAR: Final = 25
FAR: Final = 52
TALL: Final = 240
"""How far apart boxes stand, and the height that few of them fill."""

MAX_ENCLAVES: Final = 12
"""Enclaves that have a box each: of more, those of one last name share one."""

MAX_BOXES: Final = 14
"""Boxes of one column; those of causes come first."""

CHARACTER: Final = 6.4
"""Width of a character of 10.5 units in the widest of the usual fixed fonts."""

_MIDDLE_X: Final = (WIDTH - MIDDLE) // 2
_AT: Final = (0.3, 0.5, 0.7)
_Ends = dict[str, tuple[set[str], set[str]]]
"""By topic who sends and who receives."""
_About = tuple[str, str, int, int]
"""An enclave, a topic (empty: none in particular), the number of a cause, and what the enclave does there.

It sends (0), receives (1), or that is not known (-1).
"""


class _Topics(Struct, frozen=True, kw_only=True):
    """Topics with the same ends. `ends`: who sends and who receives. `marks`: likewise the causes that are about it."""

    names: tuple[str, ...]
    ends: tuple[frozenset[str], frozenset[str]]
    marks: tuple[Mapping[str, Sequence[int]], Mapping[str, Sequence[int]]]

    def all_ends(self, side: int) -> frozenset[str]:
        """Those who send or receive, by right or as a cause has it."""
        return self.ends[side] | frozenset(self.marks[side])

    def told(self, side: int) -> str:
        """The same in words, with the numbers of causes."""
        marks = self.marks[side]
        return some(
            (f"{who} ({_numbers(marks[who])})" if who in marks else who for who in sorted(self.all_ends(side))), 4
        )


def system(
    paths: Sequence[str],
    overview: Overview | None,
    routed: RoutedTable | None,
    causes: Sequence[Cause],
    told: Consequences,
) -> Mapping[str, Any]:
    """Who sends to whom, with topics of the same ends in one box: by the files of sessions where there are any.

    Numbers (from 1) are those of causes that are about an enclave, or about what it does on a topic.
    Nothing where flows were not worked out.
    """
    shared, table = _shared(paths), None
    if routed is not None:
        ends = _routed_ends(routed, shared)
    elif overview is not None and overview.access is not None and overview.neighbourhoods and not overview.undrawn:
        table = overview.access
        ends = _ends(table, overview.neighbourhoods, shared)
    else:
        return {}
    about = [*_about(table, causes, told, shared)]
    if not ends and len(shared) < 2:
        return {}
    every = sorted(_topics(ends, about), key=lambda each: (not any(each.marks), each.names))
    shown = sorted(every[:MAX_BOXES], key=lambda each: each.names)
    receiving = {who for each in every for who in each.all_ends(1)}
    sending = {*shared.values()} - receiving | {who for each in every for who in each.all_ends(0)}
    columns = [[*_first(each, about)] for each in (sending, receiving)]
    rows = max(len(shown), *map(len, columns))
    row = min(FAR, max(NEAR, TALL // rows))
    height = row * rows + 4
    left, right = (_tops(each, height, row) for each in columns)
    marks = [
        gathered((who, number) for who, _topic, number, at in about if at == side or (at < 0 and who in column))
        for side, column in enumerate(({*left}, {*right} - {*left}))
    ]
    places = _tops([each.names for each in shown], height, row)
    return {
        "routed": routed is not None,
        "width": WIDTH,
        "height": height,
        "enclaves": [*_boxes(left, 1, marks[0]), *_boxes(right, WIDTH - SIDE - 1, marks[1])],
        "topics": [
            (_MIDDLE_X, places[each.names], _fit(_words(each.names), MIDDLE), any(each.marks)) for each in shown
        ],
        "edges": [edge for each in shown for edge in _edges(each, places[each.names], left, right)],
        "lines": [(each.told(0), _words(each.names), each.told(1)) for each in shown],
        "left_out": len(every) - len(shown),
        "unread": unread(table) if table is not None else "",
    }


def _shared(paths: Sequence[str]) -> dict[str, str]:
    """By enclave what its box is called."""
    if len(paths) <= MAX_ENCLAVES:
        return {path: path for path in paths}
    alike = grouped(paths, lambda path: path.rpartition("/")[2])
    return {path: f"*/{last} ({len(same)})" if len(same) > 1 else path for last, same in alike.items() for path in same}


def _about(
    table: AccessTable | None, causes: Sequence[Cause], told: Consequences, shared: Mapping[str, str]
) -> Iterator[_About]:
    """Where the causes are: the enclaves of their findings, what is sent, and the steps of their counterexamples."""
    names = {named.topic: label(table, number) for number, named in enumerate(table.names)} if table is not None else {}
    for number, cause in enumerate(causes, start=1):
        found: set[tuple[str | None, str, int]] = {(each.enclave, "", -1) for each in cause.every}
        for each in cause.every:
            found |= {(*sent, 0) for sent in each.sent}
            result = told.result(each)
            answers = result.profiles.values() if result is not None else ()
            for example in (answer.counterexample for answer in answers if answer.counterexample is not None):
                found |= {*_placed(example.steps, names, ordered=bool(each.properties))}
        yield from sorted(
            (shared[who], topic, number, side) for who, topic, side in found if who is not None and who in shared
        )


def _placed(steps: Sequence[Step], names: Mapping[str, str], *, ordered: bool) -> Iterator[tuple[str | None, str, int]]:
    """The steps about a topic; `ordered`: of a flow, in which of each topic the sender comes first."""
    for witness, alike in groupby((each for each in steps if each.enclave is not None), lambda each: each.witness):
        for place, step in enumerate(alike):
            if witness in names:
                yield step.enclave, names[witness], min(place, 1) if ordered else -1


def _ends(table: AccessTable, flows: Sequence[Neighbourhood], shared: Mapping[str, str]) -> _Ends:
    """By topic who sends and who receives by right."""
    ends: _Ends = {}
    for flow in flows:
        for side, groups in enumerate((flow.outgoing, flow.incoming)):
            for name in (name for each in groups if each.by_right for name in each.names):
                ends.setdefault(label(table, name), (set(), set()))[side].add(shared.get(flow.path, flow.path))
    return ends


def _routed_ends(table: RoutedTable, shared: Mapping[str, str]) -> _Ends:
    """By topic or service who sends and who receives, each with the own file."""
    ends: _Ends = {}
    for right in table.rights:
        if any(each.works.truth is Truth.YES for each in right.answers.values()):
            side = right.operation not in SENDING
            ends.setdefault(right.name, (set(), set()))[side].add(shared[right.enclave])
    return ends


def _topics(ends: _Ends, about: Sequence[_About]) -> Iterator[_Topics]:
    ends = {topic: (set[str](), set[str]()) for _who, topic, _number, _side in about if topic} | ends
    marks = {topic: _marks(ends[topic], [each for each in about if each[1] == topic]) for topic in ends}
    kinds = grouped(
        ends, lambda topic: (*map(frozenset, ends[topic]), f"{[*map(sorted, map(dict.items, marks[topic]))]}")
    )
    for names in kinds.values():
        senders, receivers = map(frozenset, ends[names[0]])
        yield _Topics(names=tuple(sorted(names)), ends=(senders, receivers), marks=marks[names[0]])


def _marks(
    ends: tuple[set[str], set[str]], about: Sequence[_About]
) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
    """Whom causes are about as senders and as receivers. If it is not known: as what it is by right, else a sender."""
    senders, receivers = ends
    sent = (
        (who, number)
        for who, _topic, number, side in about
        if side == 0 or (side < 0 and who not in receivers - senders)
    )
    received = ((who, number) for who, _topic, number, side in about if side == 1 or (side < 0 and who in receivers))
    return gathered(sent), gathered(received)


def _first(names: set[str], about: Sequence[_About]) -> Sequence[str]:
    """As many as there is room for, those of causes first."""
    blamed = {who for who, *_more in about}
    return sorted(sorted(names, key=lambda who: (who not in blamed, who))[:MAX_BOXES])


def _tops(names: Sequence[Any], height: int, row: int) -> dict[Any, float]:
    """Where the boxes of a column begin, which stands in the middle."""
    top = (height - row * (len(names) - 1) - BOX) / 2
    return {name: top + row * place for place, name in enumerate(names)}


def _boxes(
    tops: Mapping[str, float], x: int, marks: Mapping[str, Sequence[int]]
) -> Iterator[tuple[int, float, str, str]]:
    for name, y in tops.items():
        numbers = _numbers(marks.get(name, ()))
        yield x, y, _fit(name, SIDE - int(CHARACTER * len(numbers))), numbers


def _edges(
    topics: _Topics, y: float, left: Mapping[str, float], right: Mapping[str, float]
) -> Iterator[Mapping[str, Any]]:
    """From senders and to receivers; dashed where it is no right."""
    for side, tops, (near, far) in (
        (0, left, (SIDE + 1, _MIDDLE_X)),
        (1, right, (_MIDDLE_X + MIDDLE, WIDTH - SIDE - 1)),
    ):
        marks = topics.marks[side]
        for place, who in enumerate(sorted(topics.all_ends(side) & {*tops})):
            begin, end = (tops[who], y) if tops is left else (y, tops[who])
            begin, end, bend = begin + BOX / 2, end + BOX / 2, (near + far) / 2
            share = _AT[place % len(_AT)]  # numbers of lines that meet stand apart
            kind = " bad" if who in marks else ""
            yield {
                "points": (near, begin, bend, far, end),
                "kind": kind if who in topics.ends[side] else f"{kind} keys",
                "mark": _numbers(marks.get(who, ())[:1]),
                "at": _on_curve((near, bend, bend, far), share),
                "height": _on_curve((begin, begin, end, end), share) - 2,
            }


def _on_curve(points: tuple[float, float, float, float], share: float) -> float:
    """A coordinate of a cubic Bézier curve."""
    rest = 1 - share
    weights = (rest**3, 3 * rest**2 * share, 3 * rest * share**2, share**3)
    return sum(weight * point for weight, point in zip(weights, points, strict=True))


def _numbers(marks: Iterable[int]) -> str:
    return ", ".join(map(str, sorted({*marks})[:3]))


def _words(names: Sequence[str]) -> str:
    return names[0] + (f" +{len(names) - 1}" if len(names) > 1 else "")


def _fit(text: str, width: int) -> str:
    return fitted(text, int((width - 10) / CHARACTER))
