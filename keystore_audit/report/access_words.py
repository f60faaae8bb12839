"""Tables of rights in words: what protects a topic, what two groups of profiles do not agree about, and peers with the
enclaves. Names are raw: whoever shows them escapes them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Final

from msgspec import Struct

from keystore_audit.grouped import gathered
from keystore_audit.model.formal.bit_sets import members
from keystore_audit.model.formal.rights import Safeguard
from keystore_audit.model.tables.access_rows import Row, label, rows_beyond
from keystore_audit.model.tables.access_table import AccessTable, EnclaveRights, Group, Rights
from keystore_audit.text import some
from keystore_audit.truth import Truth

MAX_NAMES: Final = 8
"""Names in one sentence; JSON and CSV have all."""

SHORT: Final = {
    "publish": "pub",
    "subscribe": "sub",
    "relay": "relay",
    "request": "req",
    "reply": "rep",
    "call": "call",
    "execute": "exec",
}
"""Operations as they stand in a matrix."""


def unread(table: AccessTable) -> str:
    """A sentence about enclaves of which it is unknown what they may do; empty where there are none."""
    enclaves = table.groups[-1].enclaves
    paths = [path for path, enclave in enclaves.items() if enclave.usable is Truth.UNKNOWN]
    return f"Unread, so shown as able to do anything: {_listed(paths)}." if paths else ""


def namespace(path: str) -> str:
    """That of an enclave."""
    return path.rpartition("/")[0]


def full_name(row: Row) -> str:
    """What a row of a matrix is about, raw text."""
    return row.label + (" (not in ROS 2)" if row.dds_only else "")


def rights(rows: Iterable[Row]) -> dict[str, list[tuple[int, tuple[str, ...]]]]:
    """By enclave the numbers of the rows in which it may do something, and what."""
    found: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
    for number, row in enumerate(rows):
        for path, words in row.cells.items():
            found.setdefault(path, []).append((number, tuple(words)))
    return found


def worth_showing(rows: Sequence[Row], wanted: Iterable[int]) -> list[Row]:
    """The rows with these numbers, and with a pattern among them those that take something out of one."""
    numbers = set(wanted)
    if any(rows[number].several for number in numbers):  # what they may not do is news then
        numbers.update(number for number, row in enumerate(rows) if row.excepted)
    return [rows[number] for number in sorted(numbers)]


_LAYERS: Final = {"data": "payload", "metadata": "submessages", "rtps": "RTPS messages"}


@lru_cache(maxsize=1024)  # hundreds of rows share a few
def protection_words(several: frozenset[tuple[Safeguard, ...]]) -> str:
    """A phrase; where governances differ, or topics that stand together, each."""
    phrases = dict.fromkeys(_words(each) for group in sorted(several, key=repr) for each in group)
    if len(phrases) == 1:
        return next(iter(phrases))
    return f"Protected in different ways: {' / '.join(phrases)}"


def _words(safeguard: Safeguard) -> str:
    if not safeguard.governed:
        return "No rule of the governance covers it: nobody can use it"
    open_ = "; participants without any identity are let in" if safeguard.unauthenticated else ""
    return f"{_secrecy(safeguard)}; {_control(safeguard)}{open_}"


def _secrecy(safeguard: Safeguard) -> str:
    if safeguard.encrypted:
        return f"Encrypted ({', '.join(_LAYERS[layer] for layer in safeguard.encrypted)})"
    if safeguard.authenticated:
        layers = ", ".join(_LAYERS[layer] for layer in safeguard.authenticated)
        return f"In clear for everybody on the network, but signed ({layers})"
    return "In clear for everybody on the network, and not signed"


def _control(safeguard: Safeguard) -> str:
    if safeguard.read_controlled and safeguard.write_controlled:
        return "publishing and subscribing need a grant"
    if safeguard.write_controlled:
        return "publishing needs a grant, any enclave may subscribe"
    if safeguard.read_controlled:
        return "subscribing needs a grant, any enclave may publish"
    return "any enclave may publish and subscribe"


class Protected(Struct, frozen=True, kw_only=True):
    """`kind`: a class of the style sheet. `rank`: 0 is the least protected. `mark`: its shape. `remark`: what is not as
    it should be, in a few words; empty where everything is encrypted and asks for a grant.
    """

    kind: str
    rank: int
    mark: str
    remark: str


_KINDS: Final = (
    ("clear", "▽"),
    ("signed", "◇"),
    ("loose", "△"),
    ("guarded", "●"),
    ("ungoverned", "×"),
)
"""In clear; signed only; encrypted, and open to every enclave; encrypted and granted; covered by no rule."""


@lru_cache(maxsize=1024)  # hundreds of rows share a few
def protected(several: frozenset[tuple[Safeguard, ...]]) -> Protected:
    """The worst of what protects topics that stand together."""
    safeguards = {safeguard for group in several for safeguard in group}
    rank = min((_rank(safeguard) for safeguard in safeguards), default=len(_KINDS) - 1)
    remarks = dict.fromkeys(_remark(each) for each in sorted(safeguards, key=repr) if _rank(each) == rank)
    kind, mark = _KINDS[rank]
    return Protected(kind=kind, rank=rank, mark=mark, remark="; ".join(remark for remark in remarks if remark))


def _rank(safeguard: Safeguard) -> int:
    if not safeguard.governed:
        return 4
    if not safeguard.encrypted:
        return 1 if safeguard.authenticated else 0
    controlled = safeguard.read_controlled and safeguard.write_controlled and not safeguard.unauthenticated
    return 3 if controlled else 2


def _remark(safeguard: Safeguard) -> str:
    if not safeguard.governed:
        return "covered by no rule"
    remarks = []
    if not safeguard.encrypted:
        remarks.append("signed, in clear" if safeguard.authenticated else "in clear, not signed")
    if not safeguard.write_controlled:
        remarks.append("any enclave may publish")
    if not safeguard.read_controlled:
        remarks.append("any enclave may subscribe")
    if safeguard.unauthenticated:
        remarks.append("strangers are let in")
    return ", ".join(remarks)


def differences(table: AccessTable, group: Group, main: Group) -> Iterator[str]:
    """What `group` has that the `main` one has not, and the other way round."""
    more, less = (_by_enclave(rows_beyond(table, one, two)) for one, two in ((group, main), (main, group)))
    said: dict[tuple[str, ...], list[str]] = {}
    for path, enclave in group.enclaves.items():
        other = main.enclaves[path]
        found: list[str] = []
        if (enclave.usable, enclave.reasons) != (other.usable, other.reasons):
            found.append(_start(enclave))
        if enclave.usable.must and other.usable is not Truth.UNKNOWN:
            for what, beyond in (("may also", more), ("may not", less)):
                found += [f"{what} {verbs} {_listed(names)}" for verbs, names in beyond.get(path, {}).items()]
        if found:
            said.setdefault(tuple(found), []).append(path)
    for sentences, paths in said.items():
        yield f"{_listed(paths)}: {'; '.join(sentences)}."
    lines = peers(table, group)
    known = peers(table, main)
    if known and not set(known) <= {*lines}:
        yield f"The notes under the table about peers do not apply here{'; these do:' if lines else '.'}"
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
    words = {
        Truth.YES: "starts",
        Truth.NO: "does not start",
        Truth.UNKNOWN: "whether it starts cannot be told",
    }
    return words[enclave.usable] + reasons


def _by_enclave(rows: Iterable[Row]) -> Mapping[str, Mapping[str, Sequence[str]]]:
    """By enclave and what it may do: where."""
    found: dict[str, dict[str, list[str]]] = {}
    for row in rows:
        for path, words in row.cells.items():
            found.setdefault(path, {}).setdefault(" and ".join(words), []).append(row.label)
    return found


_PEERS: Final[tuple[tuple[Callable[[Rights], tuple[int, int]], str], ...]] = (
    (
        lambda right: (right.accepted & ~right.allowed, right.accepted),
        "If compromised, {} can do this too, and peers do not stop it",
    ),
    (lambda right: (right.disputed, right.taken.may), "It is unknown whether peers accept this from {}"),
    (
        lambda right: (right.allowed & ~right.taken.may, 0),
        "Allowed by its own implementation, and refused by every peer, of {}",
    ),
)
"""Where peers and the enclave's own implementation do not agree: names; and with which others these may be all."""


def peers(table: AccessTable, group: Group) -> list[str]:
    """Where peers and the enclaves' own implementations do not agree, in sentences."""
    lines = []
    for find, sentence in _PEERS:
        said = gathered((_where(table, enclave, find), path) for path, enclave in group.enclaves.items())
        for words, paths in said.items():
            whom = "every enclave" if len(paths) == len(group.enclaves) > 1 else _listed(paths)
            lines += [f"{sentence.format(whom)}: {words}."] if words else []
    return lines


def _where(table: AccessTable, enclave: EnclaveRights, find: Callable[[Rights], tuple[int, int]]) -> str:
    whole, words = [], []
    for operation, right in enclave.rights.items():
        names, together = find(right)
        if names and together == right.names:
            whole.append(operation.value)
        elif names:
            words.append(f"{operation.value} {_listed([label(table, name) for name in members(names)])}")
    return "; ".join([f"{', '.join(whole)} every topic", *words] if whole else words)


def _listed(names: Sequence[str]) -> str:
    return some(names, MAX_NAMES)
