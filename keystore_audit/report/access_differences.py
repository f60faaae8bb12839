"""What the access tables of two groups of profiles do not agree about, and peers with the enclaves, in sentences.

Names in them are raw: whoever shows them escapes them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from keystore_audit.model.tables.access_rows import (
    Disagreement,
    Row,
    decision_rows,
    label,
    left_open,
    taken_besides,
    taken_by_nobody,
)
from keystore_audit.model.tables.access_table import AccessTable, EnclaveRights, Group
from keystore_audit.report.access_words import protection_words
from keystore_audit.text import some

MAX_NAMES: Final = 8
"""Names in one sentence; JSON and CSV have all."""


def differences(table: AccessTable, group: Group, main: Group, rows: Sequence[Row]) -> Iterator[str]:
    """What `group` has that the `main` one, of these rows, has not, and the other way round."""
    own = _by_enclave(decision_rows(table, group))
    shared = _by_enclave(rows)
    said: dict[tuple[str, ...], list[str]] = {}
    for path, enclave in group.enclaves.items():
        other = main.enclaves[path]
        found: list[str] = []
        if (enclave.usable, enclave.reasons) != (other.usable, other.reasons):
            found.append(_start(enclave))
        if enclave.usable and other.usable is not None:
            more = _without(own.get(path, {}), shared.get(path, {}))
            less = _without(shared.get(path, {}), own.get(path, {}))
            found += [f"may also {_listed(more)}"] if more else []
            found += [f"may not {_listed(less)}"] if less else []
        if found:
            said.setdefault(tuple(found), []).append(path)
    for sentences, paths in said.items():
        yield f"{_listed(paths)}: {'; '.join(sentences)}."
    lines = peers(table, group)
    known = peers(table, main)
    if known and not set(known) <= {*lines}:
        yield f"What is said of peers below does not hold here{', but this:' if lines else '.'}"
        yield from lines
    else:
        yield from (line for line in lines if line not in known)
    if group.safeguards != main.safeguards:
        yield from _safeguards(table, group, main)


def _safeguards(table: AccessTable, group: Group, main: Group) -> Iterator[str]:
    changed: dict[str, list[str]] = {}
    for number, (own, other) in enumerate(zip(group.safeguards, main.safeguards, strict=True)):
        if own != other:
            changed.setdefault(protection_words(frozenset({own})), []).append(label(table, number))
    for words, names in changed.items():
        yield f"{_listed(names)}: {words}."


def _start(enclave: EnclaveRights) -> str:
    reasons = f" ({'; '.join(enclave.reasons)})" if enclave.reasons else ""
    words = {True: "starts", False: "does not start", None: "whether it starts cannot be told"}
    return words[enclave.usable] + reasons


def _by_enclave(rows: Iterable[Row]) -> Mapping[str, Mapping[str, Sequence[str]]]:
    """By enclave and label: what it may do."""
    found: dict[str, dict[str, Sequence[str]]] = {}
    for row in rows:
        for path, words in row.cells.items():
            found.setdefault(path, {})[row.label] = words
    return found


def _without(held: Mapping[str, Sequence[str]], other: Mapping[str, Sequence[str]]) -> list[str]:
    """What is held and not by the other, in words."""
    left = {name: [word for word in words if word not in other.get(name, ())] for name, words in held.items()}
    return [f"{' and '.join(words)} {name}" for name, words in left.items() if words]


_PEERS: Final = (
    (taken_besides, "Should its own checks be skipped, as an attacker would, peers accept besides from"),
    (left_open, "It cannot be told whether peers accept from"),
    (taken_by_nobody, "Allowed, but accepted by no peer, from"),
)


def peers(table: AccessTable, group: Group) -> list[str]:
    """Where peers and the enclaves' own implementations do not agree, in sentences."""
    lines = []
    for find, sentence in _PEERS:
        said: dict[str, list[str]] = {}
        for path, enclave in group.enclaves.items():
            found = find(enclave)
            if found:
                said.setdefault(_disagreement_words(table, found), []).append(path)
        for words, paths in said.items():
            whom = "every enclave" if len(paths) == len(group.enclaves) > 1 else _listed(paths)
            lines.append(f"{sentence} {whom}: {words}.")
    return lines


def _disagreement_words(table: AccessTable, found: Sequence[Disagreement]) -> str:
    whole = [each.operation.value for each in found if each.everything]
    words = [f"{', '.join(whole)} every topic"] if whole else []
    words += [
        f"{each.operation.value} {_listed([label(table, name) for name in each.names])}"
        for each in found
        if not each.everything
    ]
    return "; ".join(words)


def _listed(names: Sequence[str]) -> str:
    return some(names, MAX_NAMES)
