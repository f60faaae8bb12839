"""What revocation lists revoke, before and after, where each implementation looks for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime

from msgspec import Struct
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered, grouped
from keystore_audit.keystore.crl import RevocationList
from keystore_audit.keystore.keystore import Enclave
from keystore_audit.model.comparison.change import Direction, direction_of
from keystore_audit.model.comparison.facts import Draft, dated, fact, listing, placed
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


class _Lists(Struct, frozen=True):
    """The lists that an implementation reads; by authority, the one in which it looks up certificates of that one."""

    read: tuple[RevocationList, ...]
    used: Mapping[_Label, RevocationList | None]

    def refused(self, label: _Label) -> frozenset[int] | None:
        """By serial number, which certificates of the authority are refused; None: all, as no list is usable."""
        used = self.used[label]
        if used is None:
            return None if self.read else frozenset()
        return used.revoked

    @property
    def place(self) -> Location | None:
        return Location(path=self.read[0].path, line=self.read[0].line) if self.read else None


def revocation_facts(old: Enclave, new: Enclave, sides: Sides) -> Iterator[Draft]:
    """What lists revoke, and until when they count, with the profiles under which that differs.

    Of an unknown list nothing is said: `diff` lists it as such.
    """
    if not any(each.crl or (each.identity_ca and each.identity_ca.revocation_lists) for each in (old, new)):
        return  # nearly always
    rows = grouped(sides.profiles, lambda profile: (profile.trust.revocation, profile.trust.first_authority_only))
    found = gathered(
        ((each.kind, each.direction, each.what, each.aspects, each.old, each.new), (each, profile.name))
        for profiles in rows.values()
        if not any(list_unread(enclave, profiles[0].trust) for enclave in (old, new))
        for each in _now(old, new, profiles[0].trust, sides.at) or _later(old, new, profiles[0].trust, sides.at)
        for profile in profiles
    )
    for several in found.values():
        yield replace(several[0][0], profiles=sides.in_order(name for _draft, name in several))


def _read(old: Enclave, new: Enclave, trust: Trust, at: datetime) -> tuple[_Lists, _Lists, list[_Label]]:
    """What is read on either side, and the authorities of both: certificates of others are refused anyway."""
    pools = [identity_authorities(enclave, trust) for enclave in (old, new)]
    common = {each.key for each in pools[0]} & {each.key for each in pools[1]}
    sides = []
    for enclave, pool in zip((old, new), pools, strict=True):
        read = lists_read(enclave, trust)
        used = {(each.subject, each.key if each.key in common else ""): list_looked_up(each, read, at) for each in pool}
        sides.append(_Lists(read, used))
    one, other = sides
    return one, other, [label for label in one.used if label in other.used]


def _now(old: Enclave, new: Enclave, trust: Trust, at: datetime) -> list[Draft]:
    """What differs at the instant."""
    one, other, labels = _read(old, new, trust, at)
    facts = list(_taken_back(one, other, labels))
    taken_back = bool(facts)
    if not taken_back and bool(one.read) != bool(other.read):
        word = "it has a revocation list" if other.read else "it has no revocation list any more"
        facts.append(fact("revocation", direction_of(one.read, other.read), word))
    for label in labels:
        before, after = one.used[label], other.used[label]
        if before is not None and after is not None:
            facts += _of_lists(before, after, at, told=taken_back)
    return list(placed(facts, (one.place, other.place)))


def _later(old: Enclave, new: Enclave, trust: Trust, at: datetime) -> list[Draft]:
    """What is refused first, of lists that begin or end, that was not, and the other way round.

    A void list refuses everybody. Where only one keystore has none in force, that is a matter of dates.
    """
    for date in sorted({date for each in (old, new) for date in ends_of_lists(each, trust, at)}):
        for moment in (date, date + SECOND):
            one, other, labels = _read(old, new, trust, moment)
            since = f"from {instant(moment)} on"
            valid = {
                label: {
                    used is not None and list_in_force(used, moment) for used in (one.used[label], other.used[label])
                }
                for label in labels
            }
            facts = [
                replace(each, what=f"its revocation lists revoke others {since}")
                for each in _taken_back(one, other, [label for label in labels if valid[label] == {True}])
            ]
            if not facts and {True, False} in valid.values():
                facts.append(fact("revocation", Direction.CHANGED, f"it has other revocation lists in force {since}"))
            if facts:
                return list(placed(facts, (one.place, other.place)))
    return []


def _taken_back(old: _Lists, new: _Lists, labels: list[_Label]) -> Iterator[Draft]:
    """What is refused that was not, and the other way round, by issuer and serial number."""
    before, after = _beyond(old, new, labels), _beyond(new, old, labels)
    if before or after:
        direction = direction_of(before, after)
        aspect = listing("revoked", before, after, direction)
        yield fact("revocation", direction, "its revocation lists revoke others", aspect)


def _beyond(one: _Lists, other: _Lists, labels: list[_Label]) -> list[str]:
    """What one refuses and the other does not, in words."""
    found = []
    for label in labels:
        mine, theirs = one.refused(label), other.refused(label)
        if theirs is None:
            continue
        if mine is None:
            found.append(f"every identity of {label[0]}")
        else:
            found += [f"{label[0]} {number:x}" for number in mine - theirs]
    return found


def _of_lists(one: RevocationList, other: RevocationList, at: datetime, *, told: bool) -> Iterator[Draft]:
    """The dates of the lists, unless what they revoke is `told`, and extensions that OpenSSL cannot process."""
    if one.unknown_critical != other.unknown_critical:
        aspect = listing("critical extensions", one.unknown_critical, other.unknown_critical, Direction.CHANGED)
        yield fact("revocation", Direction.CHANGED, "its revocation lists have other critical extensions", aspect)
    dates = ((each.this_update, each.next_update) for each in (one, other))
    for each in dated("revocation-validity", "its revocation lists", *dates) if not told else ():
        in_time = list_in_force(one, at) and list_in_force(other, at)
        newer = in_time and one.this_update < other.this_update
        again = replace(each, direction=Direction.INFO, what="its revocation lists were issued again")
        yield again if newer else each
