"""The picture of a whole system on a web page: enclaves, the topics between them, and which causes are where."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from msgspec import Struct

from keystore_audit.grouped import gathered, grouped
from keystore_audit.model.tables.access_rows import label
from keystore_audit.model.tables.access_table import AccessTable
from keystore_audit.model.tables.overview import Neighbourhood, Overview
from keystore_audit.properties.result import PropertyResult
from keystore_audit.report.pictures import fitted
from keystore_audit.report.view_model import Cause
from keystore_audit.text import some

WIDTH: Final = 470
"""Of the picture, in its own units, as all that follows."""

SIDE: Final = 128
MIDDLE: Final = 146
ROW: Final = 25
"""Of boxes: the width of those of enclaves and of topics, and how far apart they stand."""

MAX_ENCLAVES: Final = 12
"""Enclaves that have a box each: of more, those of one last name share one."""

MAX_BOXES: Final = 14
"""Boxes of one column; those of causes come first."""

CHARACTER: Final = 6.4
"""Width of a character of 10.5 units in the widest of the usual fixed fonts."""

_MIDDLE_X: Final = (WIDTH - MIDDLE) // 2
_About = tuple[str, str, int]
"""An enclave, a topic (empty: none in particular), and the number of a cause."""


class _Topics(Struct, frozen=True, kw_only=True):
    """Topics with the same ends. `marks`: by enclave, the causes that are about it on these topics."""

    names: tuple[str, ...]
    senders: frozenset[str]
    receivers: frozenset[str]
    marks: Mapping[str, Sequence[int]]


def system(
    overview: Overview, causes: Sequence[Cause], properties: Sequence[PropertyResult], paths: Sequence[str]
) -> Mapping[str, Any]:
    """Who sends to whom by right, with topics of the same ends in one box.

    Numbers (from 1) are those of causes that are about an enclave of `paths`, or about what it does on a topic.
    Nothing where flows were not worked out.
    """
    table = overview.access
    if table is None or overview.undrawn or not overview.neighbourhoods:
        return {}
    shared = _shared(paths)
    about = [*_about(table, causes, properties, shared)]
    every = sorted(
        _topics(table, overview.neighbourhoods, shared, about), key=lambda each: (not each.marks, each.names)
    )
    shown = sorted(every[:MAX_BOXES], key=lambda each: each.names)
    receiving = {who for each in every for who in each.receivers}
    sending = {*shared.values()} - receiving | {who for each in every for who in each.senders}
    columns = [[*_first(each, about)] for each in (sending, receiving)]
    height = ROW * max(len(shown), *map(len, columns)) + 4
    left, right = (_tops(each, height) for each in columns)
    marks = gathered((who, number) for who, _topic, number in about)
    places = _tops([each.names for each in shown], height)
    return {
        "width": WIDTH,
        "height": height,
        "enclaves": [*_boxes(left, 1, marks), *_boxes(right, WIDTH - SIDE - 1, {})],
        "topics": [
            (_MIDDLE_X, places[each.names], _fit(_words(each.names), MIDDLE), bool(each.marks)) for each in shown
        ],
        "edges": [edge for each in shown for edge in _edges(each, places[each.names], left, right)],
        "lines": [
            (some(sorted(each.senders), 4), _words(each.names), some(sorted(each.receivers), 4)) for each in shown
        ],
        "left_out": len(every) - len(shown),
    }


def _shared(paths: Sequence[str]) -> dict[str, str]:
    """By enclave what its box is called."""
    if len(paths) <= MAX_ENCLAVES:
        return {path: path for path in paths}
    alike = grouped(paths, lambda path: path.rpartition("/")[2])
    return {path: f"*/{last} ({len(same)})" if len(same) > 1 else path for last, same in alike.items() for path in same}


def _about(
    table: AccessTable, causes: Sequence[Cause], properties: Sequence[PropertyResult], shared: Mapping[str, str]
) -> Iterator[_About]:
    """Where the causes are: the enclaves of their findings, and the steps of their counterexamples."""
    names = {named.topic: label(table, number) for number, named in enumerate(table.names)}
    answers = {each.prop.id: each.profiles.values() for each in properties}
    for number, cause in enumerate(causes, start=1):
        found = {(each.enclave, "") for each in cause.every if each.enclave is not None}
        examples = (answer.counterexample for each in cause.every for answer in answers.get(each.name, ()))
        steps = (step for example in examples if example is not None for step in example.steps)
        found |= {(each.enclave, names[each.witness]) for each in steps if each.enclave and each.witness in names}
        yield from sorted({(shared[who], topic, number) for who, topic in found if who in shared})


def _topics(
    table: AccessTable, flows: Sequence[Neighbourhood], shared: Mapping[str, str], about: Sequence[_About]
) -> Iterator[_Topics]:
    ends: dict[str, tuple[set[str], set[str]]] = {topic: (set(), set()) for _who, topic, _number in about if topic}
    for flow in flows:
        for side, groups in enumerate((flow.outgoing, flow.incoming)):
            for name in (name for each in groups if each.by_right for name in each.names):
                ends.setdefault(label(table, name), (set(), set()))[side].add(shared.get(flow.path, flow.path))
    marks = {topic: gathered((who, number) for who, at, number in about if at == topic) for topic in ends}
    kinds = grouped(ends, lambda topic: (*map(frozenset, ends[topic]), f"{sorted(marks[topic].items())}"))
    for names in kinds.values():
        senders, receivers = map(frozenset, ends[names[0]])
        yield _Topics(names=tuple(sorted(names)), senders=senders, receivers=receivers, marks=marks[names[0]])


def _first(names: set[str], about: Sequence[_About]) -> Sequence[str]:
    """As many as there is room for, those of causes first."""
    blamed = {who for who, _topic, _number in about}
    return sorted(sorted(names, key=lambda who: (who not in blamed, who))[:MAX_BOXES])


def _tops(names: Sequence[Any], height: int) -> dict[Any, float]:
    """Where the boxes of a column begin, which stands in the middle."""
    top = (height - ROW * len(names)) / 2
    return {name: top + ROW * place for place, name in enumerate(names)}


def _boxes(
    tops: Mapping[str, float], x: int, marks: Mapping[str, Sequence[int]]
) -> Iterator[tuple[int, float, str, str]]:
    for name, y in tops.items():
        yield x, y, _fit(name, SIDE), _numbers(marks.get(name, ()))


def _edges(
    topics: _Topics, y: float, left: Mapping[str, float], right: Mapping[str, float]
) -> Iterator[Mapping[str, Any]]:
    """From senders and to receivers; whoever is blamed and neither has a line of its own, dashed."""
    blamed = {*topics.marks} - topics.senders - topics.receivers
    for ends, tops, (near, far) in (
        (topics.senders | blamed, left, (SIDE + 1, _MIDDLE_X)),
        (topics.receivers, right, (_MIDDLE_X + MIDDLE, WIDTH - SIDE - 1)),
    ):
        for who in sorted(ends & {*tops}):
            begin, end = (tops[who], y) if tops is left else (y, tops[who])
            kind = " bad" if who in topics.marks else ""
            yield {
                "points": (near, begin + ROW / 2, (near + far) / 2, far, end + ROW / 2),
                "kind": f"{kind} keys" if who in blamed else kind,
                "mark": _numbers(topics.marks.get(who, ())),
            }


def _numbers(marks: Iterable[int]) -> str:
    return ", ".join(map(str, sorted({*marks})[:3]))


def _words(names: Sequence[str]) -> str:
    return names[0] + (f" +{len(names) - 1}" if len(names) > 1 else "")


def _fit(text: str, width: int) -> str:
    return fitted(text, int((width - 10) / CHARACTER))
