"""The access table as a user of ROS 2 thinks of it: topics, services and actions instead of DDS topics.

A service or an action is one row where everybody with some right there has all of them: all DDS topics of sros2's table
(`names.dds_channels`). What is left over is a row of its own, so that no right disappears.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Mapping, Sequence
from enum import Enum
from typing import Any, Final

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.keystore.typed import Operation
from keystore_audit.model.formal.bit_sets import bits, members, union
from keystore_audit.model.formal.rights import Safeguard
from keystore_audit.model.names import (
    ACTION_ROLES,
    AMBIENT_TOPICS,
    PARAMETER_SERVICES,
    SERVICE_ROLES,
    RosKind,
    dds_channels,
    parse_dds_name,
)
from keystore_audit.model.tables.access_table import AccessTable, Group, Named


class Sort(str, Enum):
    """What a row is about, in the order in which rows stand."""

    TOPIC = "topic"
    SERVICE = "service"
    ACTION = "action"
    PART = "part of a service or action"
    PATTERN = "names by an expression"
    REST = "whatever no document lists"
    AMBIENT = "ambient topic"
    PARAMETERS = "parameter services"


PARTS: Final = {Sort.SERVICE: SERVICE_ROLES, Sort.ACTION: ACTION_ROLES}
"""What can be done with them as a whole."""

OWN_PARAMETERS: Final = "parameters of its own nodes"
"""The row of services that one enclave answers and no other asks."""

_MANGLED: Final = re.compile(r"^r[tqr](?=/)|(?:/_action/[a-z_]+)?(?:Request|Reply)?$")
"""What makes the name of a service or an action one of its DDS topics."""

_ORDER: Final = {sort: place for place, sort in enumerate(Sort)}

Safeguards = tuple[Safeguard, ...]


class Row(Struct, frozen=True, kw_only=True):
    """`label`: in words, raw text. `cells`: by enclave path, what it may do: operations, or those of `PARTS`.

    `safeguards`: what protects its topics. `dds_only`: ROS 2 has no such name. `several`: it is about all names of a
    kind, save those that other rows are about; `excepted`: it is one of those. Only these may be without cells.
    `names`: the places in the table that it is about, as a bit set.
    """

    sort: Sort
    label: str
    dds_only: bool
    several: bool
    excepted: bool
    safeguards: frozenset[Safeguards]
    cells: Mapping[str, tuple[str, ...]]
    names: int


def decision_rows(table: AccessTable, group: Group) -> tuple[Row, ...]:
    """What the enclaves' own implementations allow."""
    return _in_order(_rows(table, group))


def rows_beyond(table: AccessTable, group: Group, other: Group) -> tuple[Row, ...]:
    """Of that, what they do not in the other group."""
    known = {(row.label, path): words for row in _rows(table, other) for path, words in row.cells.items()}
    more = []
    for row in _rows(table, group):
        left = {
            path: tuple(word for word in words if word not in known.get((row.label, path), ()))
            for path, words in row.cells.items()
        }
        more.append(replace(row, cells={path: words for path, words in left.items() if words}))
    return _in_order(row for row in more if row.cells)


def _in_order(rows: Iterable[Row]) -> tuple[Row, ...]:
    return tuple(sorted(_joined(rows), key=_place))


def _rows(table: AccessTable, group: Group) -> list[Row]:
    """One by one."""
    by_name: dict[int, dict[str, list[Operation]]] = {}
    for path, enclave in group.enclaves.items():
        for operation, right in enclave.rights.items():
            for name in members(right.allowed):
                by_name.setdefault(name, {}).setdefault(path, []).append(operation)
    for name in _excepted(table, by_name):
        by_name.setdefault(name, {})
    whole: dict[_Subject, dict[int, dict[str, list[Operation]]]] = {}
    rows: list[Row] = []
    for name, cells in sorted(by_name.items()):
        subject = _subject(table.names[name])
        if subject is None:
            rows.append(_plain(table, group, name, cells))
        else:
            whole.setdefault(subject, {})[name] = cells
    for subject, names in whole.items():
        rows += _folded(table, group, subject, names)
    return rows


def _place(row: Row) -> tuple[int, str]:
    return _ORDER[row.sort], row.label


def _excepted(table: AccessTable, by_name: Container[int]) -> Iterable[int]:
    """Names on which nobody has a right though a row about all names of a kind seems to say so."""
    everything = table.rest in by_name
    return [number for number, named in enumerate(table.names) if everything or named.expressions]


_Subject = tuple[Sort, str, bool]
"""A service or an action, by its label, or (the last) all whose names an expression matches."""


def _subject(named: Named) -> _Subject | None:
    """What service or action the names are of."""
    parsed = parse_dds_name(named.topic) if named.ros else None
    if parsed is None or parsed.kind not in (RosKind.SERVICE, RosKind.ACTION) or not parsed.part:
        return None
    if named.several and not named.expressions:
        return None
    name, kind = parsed.name, parsed.kind.value
    if named.several:
        name, kind = " & ".join(sorted({_MANGLED.sub("", text) for text in named.expressions})), f"any {kind}"
    where = f" in partition {named.partition!r}" if named.partition else ""
    return Sort(parsed.kind.value), f"{name} ({kind}){where}", named.several


def _plain(table: AccessTable, group: Group, name: int, cells: Mapping[str, list[Operation]]) -> Row:
    named = table.names[name]
    sort = Sort.REST if name == table.rest else Sort.PATTERN if named.several else Sort.TOPIC
    if named.topic in AMBIENT_TOPICS and not named.several:
        sort = Sort.AMBIENT
    return Row(
        sort=sort,
        label=label(table, name),
        dds_only=not named.ros,
        several=named.several,
        excepted=name != table.rest,
        safeguards=frozenset({group.safeguards[name]}),
        cells={path: tuple(operation.value for operation in operations) for path, operations in cells.items()},
        names=1 << name,
    )


def label(table: AccessTable, name: int) -> str:
    """What the names are called."""
    named = table.names[name]
    parsed = parse_dds_name(named.topic) if named.ros else None
    short = (str(parsed) if parsed.part else parsed.name) if parsed is not None else f'"{named.topic}"'
    if not named.several:
        text = short
    elif name == table.rest:
        text = "any other name"
    elif named.expressions:
        text = f"{' & '.join(map(_expression, named.expressions))}, e.g. {short}"
    else:
        text = f"any other name like {short}"
    return f"{text} in partition {named.partition!r}" if named.partition else text


def _expression(text: str) -> str:
    """An expression for topics as ROS 2 would write it."""
    return text[2:] if text.startswith("rt/") else text


def _folded(
    table: AccessTable, group: Group, subject: _Subject, by_name: Mapping[int, Mapping[str, list[Operation]]]
) -> Iterable[Row]:
    """One row for the whole service or action, and one for each of its topics with rights that are no whole."""
    parts = {name: _part(table.names[name].topic) for name in by_name}
    left = {name: _plain(table, group, name, cells) for name, cells in by_name.items()}
    if len(set(parts.values())) == len(parts):  # else, of several names, not all fare alike
        held: dict[str, set[tuple[Operation, str]]] = {}
        for name, cells in by_name.items():
            for path, operations in cells.items():
                held.setdefault(path, set()).update((operation, parts[name]) for operation in operations)
        sort, text, several = subject
        needs = _NEEDS[sort]
        words = {path: tuple(word for word, need in needs.items() if need <= rights) for path, rights in held.items()}
        if any(words.values()) or not held:
            yield Row(
                sort=sort,
                label=text,
                dds_only=False,
                several=several,
                excepted=True,
                safeguards=frozenset(group.safeguards[name] for name in by_name),
                cells={path: whole for path, whole in words.items() if whole},
                names=bits(by_name),
            )
        spent = {(path, *right) for path, whole in words.items() for word in whole for right in needs[word]}
        for name, cells in by_name.items():
            rest = {
                path: [operation for operation in operations if (path, operation, parts[name]) not in spent]
                for path, operations in cells.items()
            }
            left[name] = _plain(table, group, name, {path: each for path, each in rest.items() if each})
        left = {name: row for name, row in left.items() if row.cells}
    yield from (replace(row, sort=Sort.PART) for row in left.values())


def _part(topic: str) -> str:
    parsed = parse_dds_name(topic)
    return "" if parsed is None else parsed.part


_NEEDS: Final = {
    sort: {
        word: frozenset((operation, _part(topic)) for operation, topic in dds_channels(word, "/x")) for word in words
    }
    for sort, words in PARTS.items()
}
"""What each word of `PARTS` takes: operations on parts."""


def _merged(rows: Sequence[Row], **changes: Any) -> Row:
    """One row about the names of all, with the cells of all."""
    cells = {path: words for row in rows for path, words in row.cells.items()}
    return replace(rows[0], cells=cells, names=union(row.names for row in rows), **changes)


def _joined(rows: Iterable[Row]) -> Iterable[Row]:
    """Rows that need not be told one by one, as one. These are parameter services of one node, and ambient topics.
    Parameters that one enclave answers and no other asks for become one row for all enclaves.
    """
    parameters: dict[tuple[str, object], list[Row]] = {}
    ambient: dict[object, list[Row]] = {}
    own: dict[object, list[Row]] = {}
    for row in rows:
        node, _slash, service = row.label.removesuffix(" (service)").rpartition("/")
        same = row.safeguards, tuple(row.cells.items())
        if row.sort is Sort.SERVICE and service in PARAMETER_SERVICES:
            parameters.setdefault((node, same), []).append(row)
        elif row.sort is Sort.AMBIENT:
            ambient.setdefault(same, []).append(row)
        else:
            yield row
    for bundle in ambient.values():
        yield _merged(bundle, label=", ".join(sorted(row.label for row in bundle)))
    for (node, _same), bundle in parameters.items():
        who = list(bundle[0].cells.values())
        if len(bundle) != len(PARAMETER_SERVICES):
            yield from bundle
        elif len(who) == 1 and "reply" in who[0]:
            own.setdefault(bundle[0].safeguards, []).extend(bundle)
        else:
            yield _merged(bundle, sort=Sort.PARAMETERS, label=f"{node} (parameters)")
    for bundle in own.values():
        yield _merged(bundle, sort=Sort.PARAMETERS, label=OWN_PARAMETERS, excepted=False)


def folded_by_owner(rows: Iterable[Row]) -> tuple[Row, ...]:
    """Names below an enclave's own, on which it alone has a right, as one row for all enclaves: `~/status`.

    Of hundreds of robots alike, each with topics of its own, that leaves one. Nothing else is left out.
    """
    kept: list[Row] = []
    private: dict[tuple[str, object], list[Row]] = {}
    for row in rows:
        owner = next(iter(row.cells), "")
        if len(row.cells) == 1 and owner != "/" and row.label.startswith(f"{owner}/") and not row.several:
            own = "~" + row.label.removeprefix(owner)
            private.setdefault((own, (row.sort, row.safeguards)), []).append(row)
        else:
            kept.append(row)
    for (own, _same), bundle in private.items():
        kept.append(_merged(bundle, label=own, excepted=any(row.excepted for row in bundle)))
    return tuple(sorted(kept, key=_place))
