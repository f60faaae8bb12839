"""The atoms of a generated model: readable names, made of an index and never of a keystore's text.

An atom is called `T3_chatter`: the letters name its sig, the number is its index in the `System`. No program reads
the rest. An atom of the Analyzer's answer (`keystore/T3_chatter$0`) leads back by letters and number alone.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import groupby
from typing import Final

from msgspec import Struct, field

from keystore_audit import text
from keystore_audit.model.formal.system import ChannelAtom, System
from keystore_audit.properties.result import Role

MAX_DECORATION: Final = 24
"""Characters of a name that an atom carries: enough to recognise it in the Analyzer's window."""

GROUP: Final = 50
"""Atoms under one abstract sig: 5,000 children of one overflow the translator's stack, groups do not."""

SORTS: Final = {
    "domains": ("D", "Domain"),
    "channels": ("T", "Channel"),
    "instants": ("I", "Instant"),
    "keys": ("K", "Key"),
    "certificates": ("C", "Certificate"),
    "documents": ("P", "Document"),
    "trust_domains": ("R", "TrustDomain"),
    "enclaves": ("E", "Enclave"),
    "domain_rules": ("DR", "DomainRule"),
    "topic_rules": ("TR", "TopicRule"),
    "grants": ("G", "Grant"),
    "rules": ("PR", "Rule"),
    "nodes": ("N", "Node"),
}
"""By sort, as `System` calls it: the letters of its atoms' names, and its sig; in the order of the generated module."""

LETTERS: Final = {letters: sort for sort, (letters, _sig) in SORTS.items()}
"""What the letters of an atom's name say."""

ROLE_SORTS: Final = {
    Role.TRUST_DOMAIN: "trust_domains",
    Role.DOMAIN: "domains",
    Role.ENCLAVE: "enclaves",
    Role.OTHER: "enclaves",
    Role.DOCUMENT: "documents",
    Role.CHANNEL: "channels",
    Role.CERTIFICATE: "certificates",
    Role.OTHER_CERTIFICATE: "certificates",
    Role.OTHER_CHANNEL: "channels",
}
"""The sort that a role ranges over."""

_ANSWER: Final = re.compile(r"(?:[\w$]+/)*([A-Z]{1,2})(\d{1,9})(?:_[A-Za-z0-9_]*)?\$0", re.ASCII)


class Atom(Struct, frozen=True, kw_only=True):
    """`name`: the identifier; `label` and `place`: raw text of what it stands for and where that is.

    `sig`: the one below that of its sort that it belongs to; empty for none.
    """

    name: str
    label: str
    place: str
    sig: str = ""

    @property
    def comment(self) -> str:
        """Both on one line, once where they are the same."""
        return ": ".join(dict.fromkeys(filter(None, (self.label, self.place))))


class Sort(Struct, frozen=True, kw_only=True):
    """All atoms of one sig, by index."""

    sig: str
    atoms: tuple[Atom, ...]

    def name(self, index: int) -> str:
        """Return the identifier of the atom with this index."""
        return self.atoms[index].name


def name_atoms(system: System) -> dict[str, Sort]:
    """Return the atoms that stand for `system`, by sort, in the order of the generated module; nodes have their own."""
    return {sort: make_sort(system, sort) for sort in SORTS if sort != "nodes"}


def make_sort(system: System, sort: str) -> Sort:
    """Return the atoms of a sort."""
    letters, sig = SORTS[sort]
    entries = enumerate(_entries(system, sort))
    return Sort(sig=sig, atoms=tuple(_atom(f"{letters}{index}", *entry) for index, entry in entries))


def keys_of(system: System) -> list[int]:
    """Return the keys of certificates, in the order of their atoms."""
    return sorted({certificate.key for certificate in system.certificates})


def _entries(system: System, sort: str) -> Iterable[tuple[str, ...]]:
    """By atom, its label and its place; of unmanaged identities, which are enclaves, also the sig of their own."""
    match sort:
        case "domains":
            return [("", _intervals(domain.intervals)) for domain in system.domains]
        case "channels":
            return [_channel(system, channel) for channel in system.channels]
        case "instants":
            return [("", instant.isoformat()) for instant in system.instants]
        case "keys":
            return [("", f"key {key}") for key in keys_of(system)]
        case "trust_domains":
            return [("", _members(system, number)) for number in range(len(system.trust_domains))]
        case "enclaves":
            return [(e.label, str(e.location), "Unmanaged" if e.unmanaged else "") for e in system.enclaves]
    return [(getattr(each, "label", ""), str(each.location)) for each in getattr(system, sort)]


def declare(sort: Sort, *, commented: bool = True, lone: Collection[str] = ()) -> str:
    """Return the sigs for the atoms of a sort, in groups where there are many, perhaps with what each is.

    `lone`: those that need not be there.
    """
    groups = []
    for parent, head, atoms in _groups(sort):
        said = (f"-- {text.alloy_comment(atom.comment)}\n" if commented else "" for atom in atoms)
        sigs = [
            f"{says}{'lone' if atom.name in lone else 'one'} sig {atom.name} extends {parent} {{}}"
            for says, atom in zip(said, atoms, strict=True)
        ]
        groups.append("\n".join([*head, *sigs]))
    return "\n".join(groups)


def declare_apart(sort: Sort) -> list[tuple[str, str]]:
    """Return the same atoms for modules of their own, group by group: their sigs, and a function for each of these."""
    groups = []
    for parent, head, atoms in _groups(sort):
        sigs = [f"one sig {atom.name}_ extends {parent} {{}}" for atom in atoms]
        names = [f"fun {atom.name}: {sort.sig} {{ {atom.name}_ }}" for atom in atoms]
        groups.append(("\n".join([*head, *sigs]), "\n".join(names)))
    return groups


def _groups(sort: Sort) -> Iterator[tuple[str, tuple[str, ...], Sequence[Atom]]]:
    """The sig above each group, its declaration if it needs one, and the atoms of the group."""
    number = 0
    for below, members in groupby(sort.atoms, key=lambda atom: atom.sig):
        sig, atoms = below or sort.sig, list(members)
        if len(atoms) <= GROUP:
            yield sig, (), atoms
            continue
        for start in range(0, len(atoms), GROUP):
            parent = f"{sort.sig}_{number}"
            number += 1
            yield parent, (f"private abstract sig {parent} extends {sig} {{}}",), atoms[start : start + GROUP]


def atom_of(answer: str) -> tuple[str, int] | None:
    """The sort and the index of an atom of the Analyzer's answer; None for a word of the model's own."""
    match = _ANSWER.fullmatch(answer)
    return None if match is None or match[1] not in LETTERS else (LETTERS[match[1]], int(match[2]))


def index_of(answer: str, role: Role, system: System) -> int | None:
    """The index that an atom of the Analyzer's answer has, None if it cannot play `role` in the system."""
    sort, index = atom_of(answer) or ("", 0)
    return index if sort == ROLE_SORTS[role] and index < len(getattr(system, sort)) else None


def _atom(number: str, label: str, place: str, sig: str = "") -> Atom:
    return Atom(name="_".join(filter(None, (number, _decoration(label)))), label=label, place=place, sig=sig)


def _decoration(label: str) -> str:
    """Return what is left of the last part of a name when all but ASCII letters, digits and `_` is taken out."""
    last = label.rstrip("/").rpartition("/")[2]
    return re.sub(r"[^A-Za-z0-9]+", "_", last[: 4 * MAX_DECORATION]).strip("_")[:MAX_DECORATION].rstrip("_")


def _members(system: System, trust_domain: int) -> str:
    members = [enclave.label for enclave in system.enclaves if enclave.trust_domain == trust_domain]
    return "what is trusted by " + ", ".join(members)


def _intervals(intervals: tuple[tuple[int, int], ...]) -> str:
    return "domains " + ", ".join(str(low) if low == high else f"{low} to {high}" for low, high in intervals)


def _channel(system: System, channel: ChannelAtom) -> tuple[str, str]:
    partition = f"partition {channel.partition!r}" if channel.partition else "no partition"
    kind = "a ROS name" if channel.ros else "DDS only"
    return channel.topic, f"{partition}, {system.domains[channel.domain].label}, {kind}"


NAMED_SET: Final = 40
"""Atoms up to which a union stands in the row itself; a larger one is a function of its own, shared by all rows."""

TYPE_BUDGET: Final = 200
"""Tuples of one union's type; what goes beyond is cut into private functions."""

RUN: Final = 8
"""Terms of a union without parentheses; a longer one is a balanced tree."""

LINES: Final = "\n\t+ "
"""Rows stand on lines of their own, so that two models can be compared line by line."""


class Row(Struct, frozen=True, kw_only=True):
    """Some tuples of a relation, `left -> right`; `weight`: how many its type has."""

    expression: str
    weight: int


class Relations(Struct):
    """Writes functions. `private`: the helper functions that were needed so far and are not taken yet."""

    private: list[str] = field(default_factory=list)
    _named: dict[tuple[str, tuple[int, ...]], str] = field(default_factory=dict)

    def take_private(self) -> list[str]:
        """Return the helper functions written since the last call."""
        taken, self.private = self.private, []
        return taken

    def atoms(self, sort: Sort, members: Iterable[int]) -> str:
        """Return the function body for the atoms of `sort` with these indices."""
        which = tuple(sorted(members))
        return self._atoms(sort, which) if which else "none"

    def subset(self, name: str, sort: Sort, members: Iterable[int]) -> str:
        """Return the function `name` that is these atoms of `sort`."""
        return function(name, f"set {sort.sig}", self.atoms(sort, members))

    def rows(self, left: Sort, right: Sort, rows: Sequence[Iterable[int]]) -> list[Row]:
        """Return the relation that takes atom i of `left` to the atoms `rows[i]` of `right`."""
        by_right: dict[tuple[int, ...], list[int]] = {}
        for index, row in enumerate(rows):
            if key := tuple(sorted(row)):
                by_right.setdefault(key, []).append(index)
        return [self._row(left, tuple(which), right, key) for key, which in by_right.items()]

    def constant_rows(self, left: Sort, values: Sequence[str]) -> list[Row]:
        """Return the relation that takes atom i of `left` to the atom called `values[i]`."""
        holders: dict[str, list[int]] = {}
        for index, value in enumerate(values):
            holders.setdefault(value, []).append(index)
        return [
            Row(expression=f"{self._atoms(left, tuple(which))} -> {value}", weight=_weight(which))
            for value, which in sorted(holders.items())
        ]

    def relation(self, name: str, declared: str, rows: Sequence[Row]) -> str:
        """Return the function `name` that is the union of `rows`."""
        unions = [union([row.expression for row in block], LINES) for block in _blocks(rows)]
        if len(unions) > 1:
            unions = [self._help(f"{name}_{number}", declared, body) for number, body in enumerate(unions)]
        return function(name, declared, union(unions, LINES) or "none -> none")

    def _row(self, left: Sort, which: tuple[int, ...], right: Sort, key: tuple[int, ...]) -> Row:
        expression = f"{self._atoms(left, which)} -> {self._atoms(right, key)}"
        return Row(expression=expression, weight=_weight(which) * _weight(key))

    def _atoms(self, sort: Sort, which: tuple[int, ...]) -> str:
        """Return an expression for some atoms of a sort: one, the sig for all, a union, a named set for many."""
        if len(which) == 1:
            return sort.name(which[0])
        if len(which) == len(sort.atoms):
            return sort.sig
        if len(which) <= NAMED_SET:
            return f"({union([sort.name(index) for index in which])})"
        if (sort.sig, which) not in self._named:
            self._named[sort.sig, which] = self._name_set(sort, which)
        return self._named[sort.sig, which]

    def _name_set(self, sort: Sort, which: tuple[int, ...]) -> str:
        name = f"some_{sort.sig}_{len(self._named)}"
        parts = [which[start : start + TYPE_BUDGET] for start in range(0, len(which), TYPE_BUDGET)]
        unions = [union([sort.name(index) for index in part]) for part in parts]
        if len(unions) > 1:
            declared = f"set {sort.sig}"
            unions = [self._help(f"{name}_{number}", declared, body) for number, body in enumerate(unions)]
        return self._help(name, f"set {sort.sig}", union(unions))

    def _help(self, name: str, declared: str, body: str) -> str:
        self.private.append("private " + function(name, declared, body))
        return name


def function(name: str, declared: str, body: str) -> str:
    """Return a function without arguments, on one line if its body is."""
    if "\n" in body:
        return f"fun {name}: {declared} {{\n\t{body}\n}}"
    return f"fun {name}: {declared} {{ {body} }}"


def union(terms: Sequence[str], plus: str = " + ") -> str:
    """Return the union of `terms` as a balanced tree; the empty text for none."""
    if len(terms) <= RUN:
        return plus.join(terms)
    middle = len(terms) // 2
    return f"({union(terms[:middle], plus)}){plus}({union(terms[middle:], plus)})"


def _weight(which: Sequence[int]) -> int:
    """Return the size of the type of a set: that of its atoms, or 1 where a function declares it."""
    return len(which) if len(which) <= NAMED_SET else 1


def _blocks(rows: Sequence[Row]) -> Iterator[list[Row]]:
    """Cut rows into blocks within the budget."""
    block: list[Row] = []
    size = 0
    for row in rows:
        if block and size + row.weight > TYPE_BUDGET:
            yield block
            block, size = [], 0
        block.append(row)
        size += row.weight
    if block:
        yield block
