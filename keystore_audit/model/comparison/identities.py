"""Identities beside those of the enclaves: in files of no enclave, further certificates of an enclave's key. Keys that
several have: in enclaves' key files, of several identities, and keys that anybody can have.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Final

from msgspec import Struct, field
from msgspec.structs import replace

from keystore_audit.findings import Location
from keystore_audit.grouped import gathered
from keystore_audit.keystore.certificate import Certificate
from keystore_audit.keystore.key_quality import Place, material_of_keystore, weaknesses
from keystore_audit.keystore.keystore import Enclave, Keystore
from keystore_audit.keystore.layout import Role
from keystore_audit.model.comparison.change import Aspect, Direction, direction_of
from keystore_audit.model.comparison.facts import Draft, fact, folded, listing, parted, place_of, placed, told
from keystore_audit.model.comparison.sides import Sides
from keystore_audit.model.inventory import certified_again
from keystore_audit.model.participants.admitted import Takers, admitted
from keystore_audit.model.validity import SECOND
from keystore_audit.profiles import Profile
from keystore_audit.text import some

_Period = tuple[datetime, datetime]

_Name = tuple[str, ...]
"""Key, subject and issuer of an identity; subject and key alone if it is no enclave's. Also which certificate, where
they are too many to ask who takes each."""

MAX_PAIRS: Final = 1_000_000
"""Most pairs of a certificate and an enclave that may accept it; beyond, each other certificate is a different one."""

MAX_PATHS: Final = 3
"""Enclaves that are told by their names; the rest are counted."""

MAX_PERIODS: Final = 3
"""How many periods in which somebody is let in are told."""

_UNREAD: Final = "unread "
_CAS: Final = (Role.IDENTITY_CA, Role.PERMISSIONS_CA)
_HOLDS: Final = {
    Direction.GAINED: "holds a private key that is not its own",
    Direction.LOST: "no longer holds a private key that is not its own",
    Direction.MIXED: "holds another private key that is not its own",
}
_LET_IN: Final = {
    Direction.GAINED: "more peers, or peers for longer, let in",
    Direction.LOST: "fewer peers, or peers for shorter, let in",
    Direction.MIXED: "other peers, or peers at other times, let in",
}
_CERTIFIED: Final = {
    Direction.GAINED: "further certificates",
    Direction.LOST: "fewer further certificates",
    Direction.MIXED: "other further certificates",
}


class _Taken(Struct, kw_only=True):
    """Certificates that say the same of somebody. `place`: of the first. `periods`: by enclave that takes them."""

    place: Location | None
    periods: dict[str, set[_Period]] = field(default_factory=dict)

    def by(self, paths: Collection[str]) -> str:
        """Which of these enclaves take it, and from when to when."""
        known = sorted(self.periods.keys() & paths)
        if not known:
            return "by nobody"
        joined = _joined({period for path in known for period in self.periods[path]})
        words = [f"from {told(begin)} until {told(end)}" for begin, end in joined[:MAX_PERIODS]]
        times = f", and {len(joined) - MAX_PERIODS} times more" if len(joined) > MAX_PERIODS else ""
        return f"by {some(known, MAX_PATHS)}, {' and '.join(words)}{times}"

    def beyond(self, other: _Taken, sides: Sides) -> frozenset[str]:
        """The common enclaves that accept it, now or later, at times when they do not accept the other."""
        return frozenset(
            path
            for path in self.periods.keys() & sides.both  # what others take is said with them
            if not _within(
                ((max(begin, sides.at), end) for begin, end in self.periods[path] if end >= sides.at),
                _joined(other.periods.get(path, ())),
            )
        )


def _joined(periods: Iterable[_Period]) -> tuple[_Period, ...]:
    """Touching periods as one: the last second of a certificate counts, and the next may begin after it."""
    found: list[_Period] = []
    for begin, end in sorted(periods):
        if found and begin - found[-1][1] <= SECOND:
            found[-1] = found[-1][0], max(found[-1][1], end)
        else:
            found.append((begin, end))
    return tuple(found)


def _within(periods: Iterable[_Period], others: Sequence[_Period]) -> bool:
    """Whether each lies in one of the others, which are in order and do not touch."""
    starts = [begin for begin, _end in others]
    found = ((end, bisect_right(starts, begin)) for begin, end in periods)
    return all(number and end <= others[number - 1][1] for end, number in found)


def _takers(sides: Sides, count: int) -> tuple[Takers | None, Takers | None]:
    """Who takes certificates of either keystore, of which there are at most `count`; None: too many to ask."""
    pairs = count * max(len(each.enclaves) for each in sides.keystores)
    old, new = (Takers(keystore, sides.at) if 0 < pairs <= MAX_PAIRS else None for keystore in sides.keystores)
    return old, new


def _note(
    found: dict[_Name, _Taken], takers: Takers | None, profiles: Sequence[Profile], certificate: Certificate, *name: str
) -> None:
    """Add a certificate to those that say the same."""
    which = certificate.sha256 if takers is None else ""
    taken = found.setdefault((*name, which), _Taken(place=place_of(certificate)))
    for path in () if takers is None else takers.of(certificate, profiles):
        taken.periods.setdefault(path, set()).add((certificate.not_before, certificate.not_after))


def identities_let_in(sides: Sides) -> Iterator[Draft]:
    """Identities of no enclave that peers let in, and whose private keys are there (KA668), in only one keystore. Also
    those that other peers let in, or from or until another time.

    A change of the keystore as a whole: what it may do is what grants give its subject.
    """
    count = max(len(each.identities.found) for each in sides.keystores)
    takers = _takers(sides, count)
    found: dict[_Name, list[Draft]] = {}
    for profile in sides.profiles if count else ():  # nearly never
        old, new = (
            _admitted(keystore, asked, profile, sides) for keystore, asked in zip(sides.keystores, takers, strict=True)
        )
        for name in (*new, *(each for each in old if each not in new)):
            change = _unmanaged(name[0], old.get(name), new.get(name), sides)
            found.setdefault(name, []).extend(replace(each, profiles=(profile.name,)) for each in change)
    for several in found.values():
        yield from folded(several, sides)


def _admitted(keystore: Keystore, takers: Takers | None, profile: Profile, sides: Sides) -> dict[_Name, _Taken]:
    found: dict[_Name, _Taken] = {}
    for each in admitted(keystore, keystore.identities.found, (profile,), sides.at):
        _note(found, takers, (profile,), each.certificate, each.certificate.subject, each.certificate.key)
    return found


def _unmanaged(subject: str, old: _Taken | None, new: _Taken | None, sides: Sides) -> Iterator[Draft]:
    aspects = []
    if old is not None and new is not None:
        more, fewer = new.beyond(old, sides), old.beyond(new, sides)
        if not more and not fewer:
            return
        direction = direction_of(more, fewer)
        verb = _LET_IN[direction]
        aspects.append(Aspect("let in", old.by(more | fewer), new.by(more | fewer), direction))
    else:
        direction = direction_of(new is not None, old is not None)
        verb = "peers let in" if new is not None else "peers no longer let in"
    what = f"{verb} {subject}, an identity of no enclave whose private key lies in the keystore"
    places = (each.place if each is not None else None for each in (old, new))
    yield from placed([fact("identity-at-large", direction, what, *aspects)], places)


def identities_certified_again(sides: Sides) -> Iterator[Draft]:
    """The enclaves of either keystore whose identity key has other certificates there than before (KA228).

    Also those whose further certificates other peers accept than before, or from or until another time.
    """
    again = [{enclave.path: others for enclave, others in certified_again(each)} for each in sides.keystores]
    takers = _takers(sides, max(sum(map(len, each.values())) for each in again))
    for path in sorted({*again[0], *again[1]}):
        tables: tuple[dict[_Name, _Taken], dict[_Name, _Taken]] = {}, {}
        for found, certificates, asked in zip(tables, again, takers, strict=True):
            for certificate in certificates.get(path, ()):
                name = certificate.key, certificate.subject, certificate.issuer
                _note(found, asked, sides.profiles, certificate, *name)
        old, new = tables
        gone, come = (
            [name for name, taken in one.items() if name not in other or taken.beyond(other[name], sides)]
            for one, other in ((old, new), (new, old))
        )
        if gone or come:
            direction, names = direction_of(come, gone), {*gone, *come}
            words = [
                _words({name: table[name] for name in sorted(names & table.keys())}, old, new, sides)
                for table in tables
            ]
            what = f"its identity key has {_CERTIFIED[direction]}"
            aspect = Aspect("certified as", words[0] or None, words[1] or None, direction)
            # Whom grants name by these subjects, each implementation says in its own way.
            change = replace(fact("identity-certified-again", direction, what, aspect), whole=True)
            places = (table[min(names & table.keys() or table)].place if table else None for table in tables)
            yield from placed([change], places, path)


def _words(
    table: Mapping[_Name, _Taken], old: Mapping[_Name, _Taken], new: Mapping[_Name, _Taken], sides: Sides
) -> str:
    """The subjects and issuers; where both keystores have such certificates, also who accepts them."""
    return ", ".join(
        f"{name[1]}, issued by {name[2]}" + (f", let in {taken.by(sides.both)}" if name in old and name in new else "")
        for name, taken in table.items()
    )


def shared_keys(sides: Sides) -> Iterator[Draft]:
    """Enclaves whose identity has the key of another one: whoever holds it has the rights of both."""
    holders = [
        gathered((each.identity.key, path) for path, each in by_path.items() if each.identity is not None)
        for by_path in sides.enclaves
    ]
    for path in sides.common:
        firsts = [by_path[path].identity for by_path in sides.enclaves]
        one, other = (
            {other for other in found[first.key] if other != path} if first is not None else set()
            for found, first in zip(holders, firsts, strict=True)
        )
        if one != other:
            direction = direction_of(other - one, one - other)
            word = "another enclave" if direction is not Direction.LOST else "another enclave no longer"
            aspect = listing("shared with", one, other, direction)
            found = fact("identity-shared", direction, f"its identity has the key of {word}", aspect)
            yield from placed([found], map(place_of, firsts), path)


def foreign_keys(sides: Sides) -> Iterator[Draft]:
    """Enclaves in whose key files others' private keys came or went: who has such a file is somebody else too."""
    every = [(path, enclave) for by_path in sides.enclaves for path, enclave in by_path.items()]
    authorities = {
        c.key: c.subject for _path, each in reversed(every) for role in _CAS for c in each.trusts(role)[::-1]
    }
    owners = gathered((each.identity.key, (path, each.identity.subject)) for path, each in every if each.identity)

    def told(key: str) -> str:
        if key.startswith(_UNREAD):
            return "one that could not be read"
        if key in authorities:
            return f"the authority {authorities[key]} (key {key[:12]})"
        return f"{owners[key][0][1] if key in owners else 'nobody here'} (key {key[:12]})"

    for path in sorted({path for path, _enclave in every}):
        files = [by_path.get(path) for by_path in sides.enclaves]
        keys = [_foreign(enclave) for enclave in files]
        gone, come, direction = parted(*({key: key for key in each} for each in keys))
        if gone or come:
            aspect = listing("private key", {*map(told, gone)}, {*map(told, come)}, direction)
            # None where it may open anything: an authority's, or one that nobody here is known to have.
            whose = [owners.get(key, []) if key not in authorities else [] for key in (*gone, *come)]
            found = replace(
                fact("private-key", direction, f"its key file {_HOLDS[direction]}", aspect),
                touched=tuple(sorted({owner for each in whose for owner, _subject in each})),
                whole=not all(whose),
            )
            yield from placed([found], map(_key_file, files, keys), path)


def _foreign(enclave: Enclave | None) -> Mapping[str, int | None]:
    """By key the line; by the file for a key of unknown owner."""
    if enclave is None or enclave.key is None:
        return {}
    first = enclave.identity
    own = first.key if first is not None else enclave.key.key
    found: dict[str, int | None] = {}
    if enclave.key.key is not None and enclave.key.key != own:
        found[enclave.key.key] = None
    for other in enclave.key.others:
        if other.key is None or other.key != own:
            found.setdefault(other.key or f"{_UNREAD}{enclave.key.file.sha256} {other.line}", other.line)
    return found


def _key_file(enclave: Enclave | None, lines: Mapping[str, int | None]) -> Location | None:
    if enclave is None or enclave.key is None:
        return None
    return Location(path=enclave.key.file.place, line=next(iter(lines.values()), None))


def weak_keys(sides: Sides) -> Iterator[Draft]:
    """Keys of which anybody can have the private half: alone, beside each other, or by what they signed.

    What the two keystores reveal together is new: who has both finds it. A weak key is gone where nobody has it.
    """
    old, new = (material_of_keystore(keystore) for keystore in sides.keystores)
    before, after, together = (
        {(each.fact, each.keys): each.places for each in weaknesses(material)} for material in (old, new, old + new)
    )
    kept = {each.key for each in new.keys}
    come = {name: places for name, places in (together | after).items() if name not in before}
    gone = {name: places for name, places in before.items() if name not in after and kept.isdisjoint(name[1])}
    for direction, verb, found in (
        (Direction.GAINED, "a key", come),
        (Direction.LOST, "no longer: a key", gone),
    ):
        for (said, _keys), places in found.items():
            first = (_first(places, keystore.root) for keystore in sides.keystores)
            yield from placed([fact("weak-key", direction, f"{verb} {said}")], first)


def _first(places: Iterable[Place], root: str) -> Location | None:
    return next((Location(path=each.path, line=each.line) for each in places if each.root == root), None)
