"""What revocation lists take back, before and after, where each implementation looks for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime

from msgspec import Struct

from keystore_audit.findings import Location
from keystore_audit.keystore.crl import RevocationList
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.model.comparison.change import Direction, direction_of
from keystore_audit.model.comparison.facts import Fact, Placed, dated, listing
from keystore_audit.model.comparison.sides import Sides
from keystore_audit.model.trust.revocation import (
    ends_of_lists,
    identity_authorities,
    list_in_force,
    list_looked_up,
    list_unread,
    lists_read,
)
from keystore_audit.model.validity import SECOND
from keystore_audit.profiles import Trust
from keystore_audit.text import instant

_Label = tuple[str, str]
"""An authority by its subject and key; without the key where one keystore alone has it."""


class _Side(Struct, frozen=True, kw_only=True):
    """The lists that an implementation reads, and by authority the one in which it looks up what that one issued."""

    lists: tuple[RevocationList, ...]
    used: Mapping[_Label, RevocationList | None]

    def refuses_all(self, label: _Label) -> bool:
        """Whether nothing that the authority issued is let in: lists are read, and none is of use for it."""
        return bool(self.lists) and self.used[label] is None

    def serials(self, label: _Label) -> frozenset[int]:
        used = self.used[label]
        return used.revoked if used is not None else frozenset()

    @property
    def place(self) -> Location | None:
        return Location(path=self.lists[0].path, line=self.lists[0].line) if self.lists else None


def revocation_facts(old: Enclave, new: Enclave, sides: Sides) -> Iterator[Placed]:
    """What lists take back, and until when they count, with the profiles under which that is another.

    Of a list that is unknown nothing is said: `diff` lists it as such.
    """
    if _same_files(old, new):
        return
    found: dict[Placed, list[str]] = {}
    known: dict[object, list[Placed]] = {}
    for profile in sides.profiles:
        if any(list_unread(each, profile.trust) for each in (old, new)):
            continue
        row = profile.trust.revocation, profile.trust.first_authority_only
        if row not in known:
            now = dict.fromkeys(_facts(*_read(old, new, profile.trust, sides.at), sides.at))
            known[row] = list(now) or list(_later(old, new, profile.trust, sides.at))
        for placed in known[row]:
            found.setdefault(placed, []).append(profile.name)
    for (fact, one, other), profiles in found.items():
        yield fact._replace(profiles=tuple(profiles)), one, other


def _same_files(old: Enclave, new: Enclave) -> bool:
    """Whether no list is another, since none of the files is; nearly always there are none."""
    files = [(enclave.identity_ca, enclave.crl) for enclave in (old, new)]
    digests = [tuple(file and file.file.sha256 for file in pair) for pair in files]
    none = not any(crl or (ca and ca.revocation_lists) for ca, crl in files)
    return none or digests[0] == digests[1]


def _read(old: Enclave, new: Enclave, trust: Trust, at: datetime) -> tuple[_Side, _Side]:
    pools = [identity_authorities(enclave, trust) for enclave in (old, new)]
    common = {each.key for each in pools[0]} & {each.key for each in pools[1]}
    sides = []
    for enclave, pool in zip((old, new), pools, strict=True):
        lists = lists_read(enclave, trust)
        used = {
            (each.subject, each.key if each.key in common else ""): list_looked_up(each, lists, at) for each in pool
        }
        sides.append(_Side(lists=lists, used=used))
    return sides[0], sides[1]


def _later(old: Enclave, new: Enclave, trust: Trust, at: datetime) -> Iterator[Placed]:
    """What is refused first, of lists that begin or end, that was not, and the other way round.

    A void list refuses everybody: where one keystore alone has none in force, that is a matter of dates.
    """
    for date in sorted({date for each in (old, new) for date in ends_of_lists(each, trust, at)}):
        for moment in (date, date + SECOND):
            one, other = _read(old, new, trust, moment)
            since = f"from {instant(moment)} on"
            labels = [label for label in one.used if label in other.used]
            valid: dict[_Label, list[bool]] = {}
            for label in labels:
                used = one.used[label], other.used[label]
                valid[label] = [each is not None and list_in_force(each, moment) for each in used]
            found = [
                fact._replace(what=f"its revocation lists take back others {since}")
                for fact in _taken_back(one, other, [label for label in labels if all(valid[label])])
            ]
            if not found and any(any(each) and not all(each) for each in valid.values()):
                found.append(
                    Fact("revocation", Direction.CHANGED, f"its revocation lists in force are others {since}", ())
                )
            if found:
                yield from ((fact, one.place, other.place) for fact in found)
                return


def _facts(old: _Side, new: _Side, at: datetime) -> Iterator[Placed]:
    places = old.place, new.place
    labels = [label for label in old.used if label in new.used]  # what others issued is not let in at all
    taken_back = list(_taken_back(old, new, labels))
    for fact in taken_back:
        yield fact, *places
    if not taken_back and bool(old.lists) != bool(new.lists):
        word = "it has a revocation list" if new.lists else "it has no revocation list any more"
        direction = Direction.LOST if new.lists else Direction.GAINED
        yield Fact("revocation", direction, word, ()), *places
    for label in labels:
        one, other = old.used[label], new.used[label]
        if one is not None and other is not None:
            for fact in _of_lists(one, other, at, told=bool(taken_back)):
                yield fact, *places


def _taken_back(old: _Side, new: _Side, labels: list[_Label]) -> Iterator[Fact]:
    """What is refused that was not, and the other way round, by issuer and serial number."""
    before, after = _beyond(old, new, labels), _beyond(new, old, labels)
    if before or after:
        direction = direction_of(gains=bool(before), losses=bool(after))
        aspect = listing("revoked", before, after, direction)
        yield Fact("revocation", direction, "its revocation lists take back others", (aspect,))


def _beyond(one: _Side, other: _Side, labels: list[_Label]) -> list[str]:
    """What one refuses and the other does not, in words."""
    found = []
    for label in labels:
        if other.refuses_all(label):
            continue
        if one.refuses_all(label):
            found.append(f"every identity of {label[0]}")
        found += [f"{label[0]} {number:x}" for number in one.serials(label) - other.serials(label)]
    return found


def _of_lists(one: RevocationList, other: RevocationList, at: datetime, *, told: bool) -> Iterator[Fact]:
    """The dates of the lists, unless what they take back is `told`, and extensions that OpenSSL cannot process."""
    if one.unknown_critical != other.unknown_critical:
        aspect = listing("critical extensions", one.unknown_critical, other.unknown_critical, Direction.CHANGED)
        yield Fact("revocation", Direction.CHANGED, "its revocation lists have other critical extensions", (aspect,))
    if told:
        return
    dates = tuple((each.this_update, each.next_update) for each in (one, other))
    for fact in dated("revocation-validity", "its revocation lists", *dates):
        in_time = list_in_force(one, at) and list_in_force(other, at)
        newer = in_time and one.this_update < other.this_update
        again = fact._replace(direction=Direction.INFO, what="its revocation lists were issued again")
        yield again if newer else fact
